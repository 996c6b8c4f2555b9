"""Assumption 2 in the light-dark system: how far from holding, the matching residual of Sec. VII.

    eps* = min over W >= 0 of |D - G W G'| / |D| = sqrt(1 - (k^2 / (1 + k^2))^2),   k = K_v / K_p

once the filter of the double integrator is at rest: D is made of K K', and only its velocity block can be matched.
With sigma_o an intensity, (11) gives k^2 = sigma_w / (2 sigma_o). A filter that samples every dt with standard
deviation sigma_o has, by spectral factorisation of its innovations,

    k^2 = root / (2 C dt^2),    C = (root + sqrt(root^2 + 16)) / 4,    root = sigma_w dt^1.5 / sigma_o

with C = (1 + a) / (2 sqrt(a)) for a the product of its two poles; for sigma_o = intensity / sqrt(dt) and dt -> 0 that
is the first.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.linalg import solve_continuous_are
from scipy.optimize import brentq

from ...belief.prior import prior
from ...belief.schedule import gain_schedule
from ...costs import GoalObstacleCost
from ...matching.weights import ConstantWeight, best_constant_weight, best_weight, residual
from ...problem import Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ...systems import LightDark
from ..bands import EPSILON, at_most, near, rounding
from ..compilation import quick_jit
from ..least_residual import SEARCH, least, optimum, relative

SIGMA_W, SIGMA_O, DT, STEPS = 0.3, 0.1, 0.1, 60
PRINTED = 0.79  # Sec. VII
START, GOAL, LIGHT = (0.9, 1.9), (7.0, 0.0), 5.0
SETTLED = {
    "intensity": (2, 400.0),
    "sample": (700, DT),
}  # steps and their length until the filter is at rest
METHOD = {"intensity": "riccati", "sample": "filter"}
SIGMAS = np.geomspace(0.03, 3.0, 41)


def closed_form(sigma_o: float | np.ndarray, convention: str, dt: float = DT) -> np.ndarray:
    """eps* at rest where the noise is sigma_o."""
    if convention == "intensity":
        squared = SIGMA_W / (2 * np.asarray(sigma_o))
    else:
        root = SIGMA_W * dt**1.5 / np.asarray(sigma_o)
        squared = root / (2 * _cosh(root) * dt**2)
    return np.sqrt(1 - (squared / (1 + squared)) ** 2)


def _cosh(root: np.ndarray) -> np.ndarray:
    return (root + np.sqrt(root**2 + 16)) / 4


def problem(
    convention: str, mean: tuple[float, ...], noise_floor: Array | float, steps: int, dt: float
) -> Problem:
    """The vehicle of Sec. VII, without obstacles, from `mean`."""
    system = LightDark(SIGMA_W, LIGHT, 0.5**0.5, noise_floor)  # type: ignore[arg-type]
    cost = GoalObstacleCost(jnp.zeros(4), jnp.ones(4), jnp.ones(4), jnp.ones(2))
    std = jnp.array([0.25, 0.25, 0.05, 0.05])
    return Problem(system, cost, jnp.asarray(mean), std, dt, steps, noise_convention=convention)


def at_rest(sigma_o: np.ndarray, convention: str) -> np.ndarray:
    """eps* (S,) of the library's gain schedule once a vehicle has rested in the light, for noise floors (S,)."""
    steps, dt = SETTLED[convention]

    def settle(floor: Array) -> Array:
        at = problem(convention, (LIGHT, 0.0, 0.0, 0.0), floor, steps, dt)
        schedule = gain_schedule(at, prior(at), jnp.zeros((steps, 2)), METHOD[convention])
        D, G = schedule.diffusion[-1], at.system.G(schedule.mean[-1])
        return residual(D, G, best_weight(D, G))

    return np.asarray(quick_jit(jax.vmap(settle))(jnp.asarray(sigma_o)))


class Along(NamedTuple):
    """`D` (T, 4, 4) and `G` (T, 4, 2) along a path, eps* of each step (T,), the best one W and its residuals (T,)."""

    D: np.ndarray
    G: np.ndarray
    best: np.ndarray
    constant: ConstantWeight
    held: np.ndarray


@partial(quick_jit, static_argnames=("convention", "method"))
def _schedule(means: Array, convention: str, method: str) -> tuple[Array, Array, Array]:
    """D, G and eps* of 60 steps of 0.1 s through the default light-dark system along means (61, 4)."""
    at = problem(convention, (0.0,) * 4, SIGMA_O, STEPS, DT)
    start = prior(at)._replace(mean=means[0])
    D = gain_schedule(at, start, jnp.zeros((STEPS, 2)), method, means[1:]).diffusion
    G = jax.vmap(at.system.G)(means[:-1])
    return D, G, jax.vmap(lambda D, G: residual(D, G, best_weight(D, G)))(D, G)


def straight(start: tuple[float, float], goal: tuple[float, float]) -> np.ndarray:
    """Means (T+1, 4) of a vehicle that keeps its velocity."""
    position = np.linspace(start, goal, STEPS + 1)
    return np.hstack(
        [position, np.tile((position[-1] - position[0]) / (STEPS * DT), (STEPS + 1, 1))]
    )


def along(convention: str, start: tuple[float, float], goal: tuple[float, float]) -> Along:
    """The schedule along a straight line at constant speed."""
    means = jnp.asarray(straight(start, goal))
    D, G, best = (np.asarray(part) for part in _schedule(means, convention, METHOD[convention]))
    constant = best_constant_weight(D, G, SEARCH)
    return Along(D, G, best, constant, np.asarray(relative(D, G, constant.weight[None])[0]))


def certify(seed: int = 0) -> Certificate:
    """The residual at rest, its minimality over W >= 0, and the readings of the printed 0.79."""
    line = {convention: along(convention, START, GOAL) for convention in METHOD}
    resting = along("intensity", (LIGHT, 0.0), (LIGHT, 0.0))
    return Certificate(
        "matching_residual",
        "Assumption 2, the matching residual ε*",
        _text(line, resting),
        [*_at_rest(), *least(np.random.default_rng(seed)), *_constant(line)],
        [_panel_rest(), _panel_along(line, resting)],
    )


def _at_rest() -> list[Check]:
    """Closed forms against SciPy's Riccati equation and the library's schedules."""
    found = {convention: at_rest(SIGMAS, convention) for convention in METHOD}
    errors = {name: np.max(np.abs(found[name] - closed_form(SIGMAS, name))) for name in METHOD}
    # relative size of the least entry of a covariance, Sigma_pp : Sigma_pv : Sigma_vv = 1 : k : 2 k^2
    spread = 2 * SIGMAS[-1] / SIGMA_W
    # the filter forgets a factor a a step, so the rounding of 1 / (1 - a) steps is seen
    tanh = np.sqrt(1 - _cosh(SIGMA_W * DT**1.5 / SIGMAS[-1]) ** -2)
    remembered = np.ceil((1 + tanh) / (2 * tanh))
    doublings = np.ceil(np.log2(2 * SETTLED["intensity"][1] / SIGMAS[0] ** 2))
    return [
        _against_scipy(),
        rounding(
            "intensity: largest error of the Riccati flow at rest, σₒ 0.03 to 3",
            errors["intensity"],
            40 * doublings,
            spread,
        ),
        rounding(
            "sample: largest error of the filter at rest, σₒ 0.03 to 3",
            errors["sample"],
            40 * remembered,
            spread,
        ),
    ]


def _against_scipy() -> Check:
    """In the light, with the intensity."""
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.zeros((2, 4))]])
    C, R = np.eye(2, 4), SIGMA_O**2 * np.eye(2)
    S = solve_continuous_are(A.T, C.T, np.diag([0, 0, SIGMA_W**2, SIGMA_W**2]), R)
    D, G = S @ C.T @ np.linalg.solve(R, C @ S), np.eye(4)[:, 2:]
    value = float(
        residual(jnp.asarray(D), jnp.asarray(G), best_weight(jnp.asarray(D), jnp.asarray(G)))
    )
    # stable and unstable eigenvalues of the Hamiltonian are 2 sqrt(sigma_w / (2 sigma_o)) apart, its norm is 1 / R
    error = 80 * EPSILON / SIGMA_O**2 / (2 * np.sqrt(SIGMA_W / (2 * SIGMA_O)))
    derived = "closed form; Schur vectors of an 8 x 8 Hamiltonian, eps |H| / separation"
    return near(
        "ε* in the light, σₒ an intensity, from SciPy's Riccati equation",
        value,
        0.8,
        error,
        derived,
    )


def _constant(line: dict[str, Along]) -> list[Check]:
    """Along a line, where G is constant: W is then the weighted mean of the D_k, seen through G."""
    gaps, errors = [], []
    for D, G, best, constant, _ in line.values():
        weights = 1 / np.sum(D**2, axis=(1, 2))
        mean = np.einsum("t,tij->ij", weights / weights.sum(), D)
        closed, _ = optimum(D, G, mean[2:, 2:])
        errors.append(abs(optimum(D, G, constant.weight)[0] - closed) / STEPS)
        for k in (1, int(np.argmin(best))):
            W = np.asarray(best_weight(jnp.asarray(D[k]), jnp.asarray(G[k])))
            gaps.append(abs(optimum(D[k : k + 1], G[k : k + 1], W)[1]))
    return [
        rounding("line, one step: duality gap of W* = G⁺DG⁺'", max(gaps), 4 * 41),
        at_most(
            "line, one W: error of the least mean square",
            max(errors),
            SEARCH + 40 * EPSILON,
            "closed form; the gap the search is asked for, and rounding",
        ),
    ]


def _text(line: dict[str, Along], resting: Along) -> str:
    readings = {
        "at rest in the light as an intensity": float(closed_form(SIGMA_O, "intensity")),
        "at rest for a filter that samples this intensity every 0.1 s": float(
            closed_form(SIGMA_O / DT**0.5, "sample")
        ),
        "at rest in the light as a sample's deviation": float(closed_form(SIGMA_O, "sample")),
    }
    for name, found in line.items():
        readings[f"on the line at least ({name})"] = float(found.best.min())
        readings[f"on average ({name})"] = float(found.best.mean())
        readings[f"as a root mean square with one W for all steps ({name})"] = float(
            np.sqrt(found.constant.value / found.constant.steps)
        )
    met = [name for name, value in readings.items() if round(value, 2) == PRINTED]
    intensity, sample = (
        brentq(lambda s, name=name: float(closed_form(s, name)) - PRINTED, 1e-3, 10, xtol=1e-12)
        for name in METHOD
    )
    values = ", ".join(f"{name} {value:.3f}" for name, value in readings.items())
    return (
        "The residual at rest has a closed form, be sigma_o an intensity (of the noise of the continuous measurement) "
        "or a sample's deviation (of one measurement every Δt), and SciPy's Riccati equation, the library's Riccati "
        "flow and its filter agree with it. That no other W ≥ 0 leaves less is shown by a duality gap, also for control"
        " directions that turn with time, where W ≥ 0 binds. The paper prints 0.79 without saying where; nine readings,"
        " on a straight line at constant speed from (0.9, 1.9) to (7, 0), not the planner's path: "
        f"{values}; {' and '.join(met) or 'none'} of them is 0.79 to two digits. Others were tried too (windows around "
        "the light, discretisations): only one, with an arbitrary window, rounds to 0.79 (sample, Riccati schedule, "
        f"averaged over |p_x - 5| < 0.5: {windowed():.3f}), so it proves nothing. At rest 0.79 needs sigma_o = "
        f"{intensity:.4f} as an intensity, or {sample:.3f} as a sample's deviation, "
        f"{(sample - SIGMA_O) / 0.5**0.5:.2f} m from the light; on the way from the prior to rest in the light "
        f"(intensity) it is passed, since ε* first falls to {resting.best.min():.3f}."
    )


def windowed() -> float:
    """Of the other readings that were tried, the one that is 0.79 to two digits."""
    means = straight(START, GOAL)
    *_, best = _schedule(jnp.asarray(means), "sample", "riccati")
    return float(np.mean(np.asarray(best)[np.abs(means[:-1, 0] - LIGHT) < 0.5]))


def _panel_rest() -> Panel:
    lines = [
        Line(
            "intensity (Riccati equation)",
            SIGMAS.tolist(),
            closed_form(SIGMAS, "intensity").tolist(),
        ),
        Line(
            "sample (filter, Δt = 0.1 s)", SIGMAS.tolist(), closed_form(SIGMAS, "sample").tolist()
        ),
        Line("printed, 0.79", SIGMAS[[0, -1]].tolist(), [PRINTED, PRINTED], "dashed"),
    ]
    return Panel(
        "Matching residual at rest",
        "measurement noise σₒ (m, or m√s as an intensity)",
        "ε*",
        lines,
        "x",
    )


def _panel_along(line: dict[str, Along], resting: Along) -> Panel:
    time = (DT * np.arange(STEPS)).tolist()
    lines = [
        Line(f"{name}, {which}", time, values.tolist())
        for name, found in line.items()
        for which, values in (("best W of each step", found.best), ("one W", found.held))
    ]
    lines.append(Line("intensity, at rest in the light, best W", time, resting.best.tolist()))
    lines.append(Line("printed, 0.79", [time[0], time[-1]], [PRINTED, PRINTED], "dashed"))
    return Panel(
        "Matching residual along a straight line through the light, and at rest in it",
        "time t (s)",
        "ε",
        lines,
    )
