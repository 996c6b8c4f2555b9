"""Theorem 1: the belief's diffusion is tangent to the Gaussian means if and only if observations are affine.

    c(x) - E c = A(mu) (x - mu)  for all mu     if and only if     c(x) = A x + b             (7)

Under N(mu, s^2), with a = exp(-s^2), the part of c outside the tangent space and A(mu) are

    c = x^3     (18 mu^2 s^4 + 6 s^6) / (9 mu^4 s^2 + 36 mu^2 s^4 + 15 s^6)             3 (mu^2 + s^2)
    c = sin x   1 - A^2 s^2 / ((1 - a)^2 / 2 + cos^2(mu) a (1 - a))                     cos(mu) sqrt(a)

from the Hermite coefficients of c; the second denominator is Var[sin x], written without cancellation.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.kalman import correct
from ...costs import GoalObstacleCost
from ...discretise import measurement_cov
from ...matching.affine import outside_mean_tangent
from ...numerics.quadrature import gaussian_nodes
from ...problem import Belief, Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ...systems import LightDark
from ..bands import EPSILON, at_least, rounding
from ..compilation import quick_jit

MEANS, GRID = 64, 121
S = 0.5  # standard deviation of the scalar beliefs
BOX = 2.0  # |mu| <= 2
SLOPE = 0.5**0.5
SHAPES = (
    (3, 2, 16),
    (8, 3, None),
)  # states, measurements, nodes per axis of the affine observations

TEXT = (
    "The part of the measurement's diffusion that is not tangent to the Gaussian means is computed for 64 means and a "
    "fixed covariance, by least squares on a Gauss-Hermite rule: nothing for affine observations, the light-dark "
    "system's among them, the closed form for a cubic and a sine, a definite part for distance and bearing. The "
    "theorem is for a constant sigma_o: where it depends on the state, as in the light-dark system, the scatter of the "
    "measurements tells about p_x too. With sigma_o a sample's deviation (of one measurement every Δt) it tells "
    "4 slope² = 2 times as much as the measured position does; with sigma_o an intensity (of the noise of (1b) in "
    "continuous time) it would tell |p_x - 5| at once, since with Δt the mean's information per measurement goes to "
    "zero and the scatter's does not. Equation (5), the EKF and the theorem leave it out."
)


class Found(NamedTuple):
    """One c over means (M, nx): `part` (M,), `A` (M, ny, nx); `rounding` is the operations behind each."""

    part: np.ndarray
    A: np.ndarray
    rounding: int


def outside(
    cs: Sequence[Callable[[Array], Array]],
    means: np.ndarray,
    cov: np.ndarray,
    per_axis: int | None = None,
) -> list[Found]:
    """`outside_mean_tangent` of each c over means (M, nx), all compiled as one."""
    nodes = gaussian_nodes(cov.shape[0], per_axis)

    def at(index: Array, mean: Array) -> tuple[Array, Array]:
        return outside_mean_tangent(
            lambda x: jax.lax.switch(index, cs, x), mean, jnp.asarray(cov), nodes
        )

    index = jnp.arange(len(cs)).repeat(len(means))
    found = quick_jit(lambda *at_all: jax.lax.map(lambda pair: at(*pair), at_all))(
        index, np.tile(means, (len(cs), 1))
    )
    parts, slopes = (np.split(np.asarray(array), len(cs)) for array in found)
    # two sums over the nodes for the slope, one for the mean; the products of a node count less than another
    return [Found(part, A, 4 * len(nodes[1])) for part, A in zip(parts, slopes, strict=True)]


def cubic_part(mu: np.ndarray) -> np.ndarray:
    """Part of x^3 outside, (M,)."""
    return (18 * mu**2 * S**4 + 6 * S**6) / (9 * mu**4 * S**2 + 36 * mu**2 * S**4 + 15 * S**6)


def sine_part(mu: np.ndarray) -> np.ndarray:
    """Part of sin x outside, (M,); least at mu = 0, where it is 1 - s^2 / sinh(s^2)."""
    a, b = np.exp(-(S**2)), -np.expm1(-(S**2))
    return 1 - S**2 * a * np.cos(mu) ** 2 / (b**2 / 2 + a * b * np.cos(mu) ** 2)


def bearing(x: Array) -> Array:
    """Distance and direction of a point, from the origin."""
    return jnp.array([jnp.sqrt(x @ x), jnp.arctan2(x[1], x[0])])


def light_dark(convention: str, dt: float = 0.1) -> Problem:
    """Return the problem of Sec. VII without its obstacles, for one step."""
    system = LightDark(0.3, 5.0, SLOPE, 0.1)
    cost = GoalObstacleCost(jnp.zeros(4), jnp.ones(4), jnp.ones(4), jnp.ones(2))
    return Problem(
        system, cost, jnp.zeros(4), jnp.ones(4), dt, steps=1, noise_convention=convention
    )


def information(problem: Problem, x: Array) -> tuple[Array, Array]:
    """Fisher information about x (nx, nx) in one y ~ N(c(x), R(x)): from its mean, and from its noise level,

    C' R^-1 C   and   1/2 tr(R^-1 dR_i R^-1 dR_j).
    """
    R = measurement_cov(problem, x)
    dR = jax.jacfwd(lambda x: measurement_cov(problem, x))(x)
    C = jax.jacfwd(problem.system.c)(x)
    scaled = jnp.einsum("ab,bci->aci", jnp.linalg.inv(R), dR)
    return C.T @ jnp.linalg.solve(R, C), 0.5 * jnp.einsum("abi,baj->ij", scaled, scaled)


def certify(seed: int = 0) -> Certificate:
    """Theorem 1 over 64 means, and what the light-dark system has besides."""
    rng = np.random.default_rng(seed)
    drawn, grid = rng.uniform(-BOX, BOX, MEANS), np.linspace(-np.pi, np.pi, GRID)
    at_all = outside(
        [lambda x: 3 * x + 1, lambda x: x**3, jnp.sin],
        np.append(drawn, grid)[:, None],
        np.full((1, 1), S**2),
    )
    cubic, sine = (
        Found(found.part[:MEANS], found.A[:MEANS], found.rounding) for found in at_all[1:]
    )
    return Certificate(
        "affine_observations",
        "Theorem 1, affine observations",
        TEXT,
        [
            *_affine(rng),
            *_closed_forms(drawn, cubic, sine),
            *_nonlinear(rng, cubic, sine),
            *_noise_level(rng),
        ],
        [_panel(grid, [found.part[MEANS:] for found in at_all])],
    )


def _affine(rng: np.random.Generator) -> list[Check]:
    """Random affine c in several dimensions and the light-dark c: largest part and spread of A, over their rounding."""
    cases: list[tuple[Callable[[Array], Array], np.ndarray, np.ndarray, int | None]] = []
    for nx, ny, per_axis in SHAPES:
        A, b = rng.normal(size=(ny, nx)), rng.normal(size=ny)
        cases.append((partial(_line, A, b), A, b, per_axis))
    cases.append((light_dark("sample").system.c, np.eye(2, 4), np.zeros(2), 5))
    parts, spreads = [], []
    for c, A, b, per_axis in cases:
        nx = A.shape[1]
        basis, _ = np.linalg.qr(rng.normal(size=(nx, nx)))
        cov = basis * rng.uniform(0.1, 1, nx) @ basis.T
        means = rng.uniform(-BOX, BOX, (MEANS, nx))
        (found,) = outside([c], means, cov, per_axis)
        size = np.linalg.norm(b) + np.linalg.norm(A) * np.sqrt(
            np.max(np.sum(means**2, axis=1)) + np.trace(cov)
        )
        unit = found.rounding * EPSILON * size
        parts.append(np.max(np.sqrt(found.part)) / (unit / np.sqrt(np.trace(A @ cov @ A.T))))
        spreads.append(
            np.max(np.linalg.norm(found.A - A, axis=(1, 2)))
            * np.sqrt(np.linalg.eigvalsh(cov)[0])
            / unit
        )
    derived = "rounding of c: 4 P operations for P nodes, over the deviation of c"
    return [
        Check(
            "affine c: root of the largest part outside, in units of its rounding",
            max(parts),
            0.0,
            1.0,
            derived,
        ),
        Check(
            "affine c: largest |A(mu) - A|, in units of its rounding",
            max(spreads),
            0.0,
            1.0,
            derived,
        ),
    ]


def _line(A: np.ndarray, b: np.ndarray, x: Array) -> Array:
    return jnp.asarray(A) @ x + b


def _closed_forms(mu: np.ndarray, cubic: Found, sine: Found) -> list[Check]:
    """The quadrature against the closed forms; the root mean square of c over its deviation magnifies rounding."""
    rms = np.sqrt((mu**6 + 15 * mu**4 * S**2 + 45 * mu**2 * S**4 + 15 * S**6) / cubic_variance(mu))
    checks = [
        rounding(
            "x³: largest error of the part outside",
            _gap(cubic, cubic_part(mu)),
            cubic.rounding,
            2 * rms.max(),
        )
    ]
    a, b = np.exp(-(S**2)), -np.expm1(-(S**2))
    scale = 2 / np.sqrt(b**2 / 2 + a * b * np.min(np.cos(mu) ** 2))
    checks.append(
        rounding(
            "sin x: largest error of the part outside",
            _gap(sine, sine_part(mu)),
            sine.rounding,
            scale,
        )
    )
    floor = "least of the closed form over |mu| ≤ 2"
    # the cubic's part rises up to mu^2 = s^2 / 3 and falls from there, the sine's rises with sin^2(mu)
    checks.append(
        at_least(
            "x³: least part outside", cubic.part.min(), cubic_part(np.array([0, BOX])).min(), floor
        )
    )
    checks.append(
        at_least("sin x: least part outside", sine.part.min(), 1 - S**2 / np.sinh(S**2), floor)
    )
    return checks


def cubic_variance(mu: np.ndarray) -> np.ndarray:
    """Var[x^3], (M,)."""
    return 9 * mu**4 * S**2 + 36 * mu**2 * S**4 + 15 * S**6


def _gap(found: Found, expected: np.ndarray) -> float:
    return float(np.max(np.abs(found.part - expected)))


def _nonlinear(rng: np.random.Generator, cubic: Found, sine: Found) -> list[Check]:
    """Distance and bearing, away from the origin and the cut; A(mu) that is not constant."""
    means = np.column_stack([rng.uniform(3, 6, MEANS), rng.uniform(-3, 3, MEANS)])
    coarse, fine = (
        outside([bearing], means, 0.3**2 * np.eye(2), per_axis)[0] for per_axis in (32, 48)
    )
    noise = fine.rounding * EPSILON * 2 * np.hypot(np.max(np.linalg.norm(means, axis=1)), 1) / 0.3
    error = np.max(np.abs(fine.part - coarse.part)) + noise
    error_A = np.max(np.abs(fine.A - coarse.A)) + noise
    spread = min(np.ptp(found.A, axis=0).max() for found in (cubic, sine, fine))
    two = "the quadrature's error: 32 against 48 points an axis, and rounding"
    return [
        at_least("distance and bearing: least part outside", fine.part.min(), error, two),
        at_least(
            "x³, sin x, distance and bearing: least spread of A(mu) over mu", spread, error_A, two
        ),
    ]


def _noise_level(rng: np.random.Generator) -> list[Check]:
    """What the state-dependent sigma_o of the light-dark system tells, and that the filter does not use it."""
    problem = light_dark("sample")
    means = np.column_stack([rng.uniform(-1, 8, MEANS), rng.normal(size=(MEANS, 3))])

    def sampled(x: Array) -> tuple[tuple[Array, Array], Array]:
        """What a measurement tells, and the covariance (nx, nx) that the filter has after it, from I before."""
        told = information(problem, x)
        return told, correct(problem, Belief(x, jnp.eye(4)), problem.system.c(x)).posterior.cov

    told, after = quick_jit(jax.vmap(sampled))(means)
    ratios = [_ratio(told)]
    for dt in (0.1, 1e-3):
        continuous = light_dark("intensity", dt)
        ratios.append(_ratio(quick_jit(jax.vmap(partial(information, continuous)))(means)) * dt)
    gained = np.linalg.inv(after) - np.eye(4) - told[0]
    size = np.linalg.norm(np.eye(4) + told[0], 2, axis=(1, 2))
    # from a unit covariance, the condition number of the inverse is the size of what it gives
    excess = np.max(np.linalg.norm(gained, 2, axis=(1, 2)) / size**2)
    return [
        rounding(
            "noise level tells 4 slope² = 2 times the mean, or 2/dt: relative error",
            _worst(ratios),
            40,
        ),
        rounding("EKF: information gained besides the mean's, over (1 + the mean's)²", excess, 60),
    ]


def _ratio(told: tuple[Array, Array]) -> np.ndarray:
    """Information about p_x (M,) from the noise level over that from the mean."""
    mean, level = (np.asarray(part)[:, 0, 0] for part in told)
    return level / mean


def _worst(ratios: list[np.ndarray]) -> float:
    return float(np.max(np.abs(np.array(ratios) / (4 * SLOPE**2) - 1)))


def _panel(mu: np.ndarray, parts: list[np.ndarray]) -> Panel:
    labels = ("affine, 3x + 1", "cubic, x³", "sine, sin x")
    lines = [
        Line(label, mu.tolist(), part.tolist()) for label, part in zip(labels, parts, strict=True)
    ]
    lines += [
        Line(f"{name}, closed form", mu[::6].tolist(), form(mu[::6]).tolist(), "points")
        for name, form in (("cubic", cubic_part), ("sine", sine_part))
    ]
    return Panel(
        f"Part of the diffusion outside the mean tangent space, standard deviation {S}",
        "belief mean μ",
        "part outside (share of the mean square)",
        lines,
    )
