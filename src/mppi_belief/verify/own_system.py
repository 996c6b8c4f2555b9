"""What of the paper holds for one system: the conditions of its statements, along the belief of one trial.

Theorem 1 and Proposition 2 ask f and c to be affine, G and sigma_o to be constant; Proposition 3 asks
range(D_t) to be in, or equal to, range(G_t); Theorem 4, Corollary 5 and Theorem 6 ask D_t = lambda G_t R^-1 G_t' (15).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..belief.prior import prior
from ..belief.schedule import GainSchedule, gain_schedule
from ..discretise import unwrapped_measurement
from ..errors import ConfigError
from ..matching.affine import outside_mean_tangent
from ..matching.weights import (
    best_constant_weight,
    best_weight,
    matched_weight,
    numerical_rank,
    residual,
)
from ..numerics.linalg import psd_factor
from ..numerics.quadrature import gaussian_nodes
from ..planning.path_costs import RiskSensitive
from ..problem import Controller, Filter, Problem
from ..results.certificate import Certificate, Check
from ..simulate import simulate_trial
from .bands import EPSILON, at_most, near, rounding

PLACES = 8  # means along the trial at which functions are examined
PRODUCTS = 100  # of a step of the Riccati flow: its exponential, the doublings, two solves in each
FLAT = 1e-3  # spread of a state that neither the prior nor the trial moves
ONE_WEIGHT = 1e-6  # root of the duality gap a step at which the search for one weight ends
EXACT = "As far as the trial's belief reaches, it is exactly Gaussian and its covariance known in advance (Proposition 2)."
APPROXIMATE = (
    "The belief is Gaussian in approximation only, as linearised along the mean (Remark 3)."
)
TRUST = 1.0  # the third-order term of an expansion should be less than the second-order one


class _Path(NamedTuple):
    """What the continuous theory says along the belief means of a trial, and the trial's controls (T, nu)."""

    schedule: GainSchedule
    controls: Array


def what_holds(
    problem: Problem,
    filter: Filter,
    controller: Controller,
    temperature: float,
    seed: int,
    name: str,
    settings: str,
) -> Certificate:
    """The conditions of each statement for `problem`, along the belief of trial 0 of `controller`, in double precision.

    lambda of (15) is the controller's temperature or, if it has none, `temperature`; theta and the risk of Remark 4 are
    the controller's. A check that does not hold is no error: the statement does not apply, and what is planned is an
    approximation. `name` is the certificate's and `settings` what its statement says it is of. Raises `ConfigError` if
    the trial diverges.
    """
    with jax.enable_x64(True):
        path = _follow(problem, filter, controller, seed)
        exact = [*_affine(problem, path), _independence(problem, path)]
        matched, matching = _matched(
            problem, path, float(getattr(controller, "temperature", temperature))
        )
        checks = [*exact, *matched, *_expansion(problem, path, controller)]
    gaussian = all(check.holds for check in exact)
    title = f"What holds for {settings}, along the belief of trial 0"
    return Certificate(name, title, f"{EXACT if gaussian else APPROXIMATE} {matching}", checks)


def _follow(problem: Problem, filter: Filter, controller: Controller, seed: int) -> _Path:
    trial = jax.jit(simulate_trial)(problem, filter, controller, seed, 0)
    means = trial.beliefs.mean
    if not (jnp.all(jnp.isfinite(means)) and jnp.all(jnp.isfinite(trial.controls))):
        raise ConfigError(
            "verify: trial 0 of this system and controller diverges; nothing can be said along it"
        )
    schedule = _along(problem, trial.controls, means)
    if not all(jnp.all(jnp.isfinite(part)) for part in schedule):
        raise ConfigError(
            "verify: the covariance along trial 0 is not finite; is sigma_o singular?"
        )
    return _Path(schedule, trial.controls)


@jax.jit
def _along(problem: Problem, controls: Array, means: Array) -> GainSchedule:
    return gain_schedule(
        problem, prior(problem)._replace(mean=means[0]), controls, "riccati", means[1:]
    )


def _affine(problem: Problem, path: _Path) -> list[Check]:
    """Whether f and c are affine, G and sigma_o constant, around the trial."""
    means = np.asarray(path.schedule.mean)
    prior_std = np.sqrt(np.diag(prior(problem).cov))
    spread = np.maximum(np.maximum(prior_std, means.std(axis=0)), FLAT)
    places = means[np.linspace(0, len(means) - 1, PLACES).astype(int)]
    cov = np.diag(spread**2)
    states = places + spread * np.random.default_rng(0).normal(size=places.shape)
    bent = jax.tree.map(np.asarray, _bent(problem, places, cov, *gaussian_nodes(len(spread))))
    values = jax.tree.map(np.asarray, _values(problem, states))
    return [
        _tangent(
            "Theorem 1: part of c outside the mean tangent space, 0 if c is affine", bent["c"], cov
        ),
        _varies(
            "Theorem 1: relative change of sigma_o over the states, 0 if constant",
            values["sigma_o"],
        ),
        _tangent("Proposition 2: part of f that is not affine", bent["f"], cov),
        _varies("Proposition 2: relative change of G over the states", values["G"]),
    ]


@jax.jit
def _bent(
    problem: Problem, places: Array, cov: Array, points: Array, weights: Array
) -> dict[str, tuple[Array, Array, Array]]:
    """Of c and f at places (P, nx): the part outside the mean tangent space (P,), A (P, n, nx), the value (P, n)."""

    system, nodes = problem.system, (points, weights)

    def of(around: Callable[[Array], Callable[[Array], Array]]) -> tuple[Array, Array, Array]:
        parts, A = jax.lax.map(
            lambda mean: outside_mean_tangent(around(mean), mean, cov, nodes), places
        )
        return parts, A, jax.vmap(lambda mean: around(mean)(mean))(places)

    return {
        "c": of(lambda mean: unwrapped_measurement(system, mean)),
        "f": of(lambda mean: system.f),
    }


@jax.jit
def _values(problem: Problem, states: Array) -> dict[str, Array]:
    return {name: jax.vmap(getattr(problem.system, name))(states) for name in ("sigma_o", "G")}


def _tangent(computed: str, found: Sequence[np.ndarray], cov: np.ndarray) -> Check:
    """The place where the root of the part outside is largest against its rounding, for one entry of `_bent`."""
    parts, A, values = found
    deviation = np.sqrt(np.einsum("pij,jk,pik->p", A, cov, A))
    scale = 1 + np.linalg.norm(values, axis=-1) / np.maximum(
        deviation, 1e-300
    )  # a constant has no part outside
    roots = np.sqrt(parts)
    worst = int(np.argmax(roots / scale))
    operations = 4 * len(gaussian_nodes(len(cov))[1])
    return rounding(computed, roots[worst], operations, scale=float(scale[worst]))


def _varies(computed: str, values: np.ndarray) -> Check:
    largest = float(np.max(np.abs(values), initial=0.0))
    change = float(np.max(np.abs(values - values[0]), initial=0.0))
    return rounding(computed, change / largest if largest else 0.0, operations=4)


def _independence(problem: Problem, path: _Path) -> Check:
    """The covariances that controls of the trial's size lead to, against those of no control."""
    u = path.controls
    size = 1.0 + jnp.max(jnp.abs(u), axis=0)
    pushes = jnp.stack(
        [jnp.zeros_like(u), jnp.broadcast_to(size, u.shape), jnp.broadcast_to(-size, u.shape)]
    )
    covs = _covariances(problem, pushes)
    largest, change = float(jnp.max(jnp.abs(covs[0]))), float(jnp.max(jnp.abs(covs - covs[0])))
    computed = "Proposition 2: relative change of Sigma_t with the controls, 0 if none"
    return rounding(
        computed, change / largest if largest else change, operations=_operations(problem)
    )


@jax.jit
def _covariances(problem: Problem, controls: Array) -> Array:
    """Sigma (C, T+1, nx, nx) for C sequences of controls (C, T, nu)."""
    return jax.vmap(lambda u: gain_schedule(problem, prior(problem), u, "riccati").cov)(controls)


def _operations(problem: Problem) -> float:
    """Roundings behind a schedule: matrix products at every step."""
    return float(problem.steps * PRODUCTS * len(problem.prior_mean) ** 3)


def _matched(problem: Problem, path: _Path, temperature: float) -> tuple[list[Check], str]:
    """Proposition 3 and (15) at every step, and what they mean together."""
    means, D, gains = (
        path.schedule.mean[:-1],
        path.schedule.diffusion,
        np.asarray(path.schedule.gain),
    )
    G = jax.vmap(problem.system.G)(means)
    imposed = matched_weight(problem.cost.R, temperature)
    least, given = (
        np.array([_left(d, g, W) for d, g, W in zip(D, G, weights, strict=True)])
        for weights in (jax.vmap(best_weight)(D, G), [imposed] * len(D))
    )
    # the gain's range is that of D = K R_o K', and its rank is not squared by rounding
    equal = np.array(
        [numerical_rank(K) == numerical_rank(g) for K, g in zip(gains, np.asarray(G), strict=True)]
    )
    one = best_constant_weight(D, G) if np.any(D) else None
    operations = _operations(problem)
    equal &= least <= operations * EPSILON
    alone = np.inf if one is None else np.sqrt(max(one.value, 0.0) / one.steps)
    Q = problem.system.H @ problem.system.H.T
    checks = [
        rounding(
            "Proposition 3(i): largest eps* over the steps, 0 if range(D) is in range(G)",
            np.max(least),
            operations,
        ),
        rounding("the same: smallest eps* over the steps", np.min(least), operations),
        near(
            "Proposition 3(ii): share of the steps at which range(D) = range(G)",
            np.mean(equal),
            1.0,
            0.0,
            "a count",
        ),
        rounding(
            "(15) with this lambda and R: largest residual over the steps",
            np.max(given),
            operations,
        ),
        at_most(
            "(15) with one W >= 0 for lambda R^-1 at all steps: RMS residual",
            alone,
            ONE_WEIGHT,
            "accuracy of the search for it",
        ),
        rounding(
            "Remark 1: residual of Q = lambda G R^-1 G', the state being known",
            _left(Q, G[0], imposed),
            operations,
        ),
    ]
    return checks, _reading(checks, still=int(np.sum(~np.any(D, axis=(1, 2)))))


def _left(D: Array, G: Array, W: Array) -> float:
    """The residual of (15) (); for D = 0 it is 0 or infinite."""
    if np.any(D):
        return float(residual(D, G, W))
    return float(np.inf) if np.any(G @ W @ G.T) else 0.0


def _reading(checks: list[Check], still: int) -> str:
    """What the checks of `_matched` mean; D = 0 at `still` steps."""
    largest, smallest, equal, given, one, _ = checks
    if given.holds:
        return "Matching (15) holds: Theorem 4, Corollary 5 and Theorem 6 are exact for the mean's equation (12)."
    if one.holds and equal.holds:
        return "Matching (15) does not hold with this lambda and R, but would with one other R."
    if equal.holds:
        return "Matching (15) would need an R that changes with time, while that of (2) is fixed."
    if largest.holds:
        nothing = f"; D = 0 at {still} steps" if still else ""
        return f"Matching (15) holds for no R > 0, since D has less rank than G (Proposition 3(ii)){nothing}."
    return (
        "Matching (15) holds for no R: part of the diffusion is out of reach of the controls, "
        f"eps* = {smallest.value:.2f} to {largest.value:.2f}; "
        "Theorem 4, Corollary 5 and Theorem 6 are approximations here."
    )


def _expansion(problem: Problem, path: _Path, controller: Controller) -> list[Check]:
    """Whether the expansion that q_RS begins falls off; where it does not, q_RS is another thing than the risk.

    Nothing for a controller whose path cost is not `RiskSensitive`.
    """
    path_cost = getattr(controller, "path_cost", None)
    if not isinstance(path_cost, RiskSensitive):
        return []
    theta = path_cost.theta
    of_all = path_cost.variance_of == "total"
    mean, cov, *_ = path.schedule
    ratios = float(theta) * np.abs(
        _skewness(problem, mean, cov, float(of_all), *gaussian_nodes(mean.shape[1]))
    )
    worst, what = int(np.argmax(ratios)), "the cost" if of_all else "the penalty"
    computed = f"Remark 4, theta = {float(theta):g}, {what}: third over second term of rho, largest at step {worst}"
    return [at_most(computed, ratios[worst], TRUST, "the expansion has to fall off")]


@jax.jit
def _skewness(
    problem: Problem, means: Array, covs: Array, base: Array, points: Array, weights: Array
) -> Array:
    """kappa_3 / (3 kappa_2) (P,) of `base` times the base cost plus the penalty; means (P, nx), covs (P, nx, nx)."""

    def at(belief: tuple[Array, Array]) -> Array:
        mean, cov = belief
        factor, _ = psd_factor(cov)
        states = mean + points @ factor.T
        q = jax.vmap(lambda x: base * problem.cost.base(x) + problem.penalty(x))(states)
        q = q - weights @ q
        second, third = weights @ q**2, weights @ q**3
        return jnp.where(second > 0, third / (3 * jnp.where(second > 0, second, 1.0)), 0.0)

    return jax.lax.map(at, (means, covs))
