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

from ..belief import GainSchedule, gain_schedule, prior
from ..certificate import EPSILON, Certificate, Check, at_least, at_most, rounding
from ..linalg import psd_factor
from ..matching import best_weight, matched_weight, residual
from ..problem import Controller, Filter, Problem
from ..simulate import simulate_trial
from ..tangent import gaussian_nodes, outside_mean_tangent

PLACES = 8  # means along the trial at which functions are examined
PRODUCTS = 100  # of a step of the Riccati flow: its exponential, the doublings, two solves in each
FLAT = 1e-3  # spread of a state that neither the prior nor the trial moves
TRUST = 1.0  # the third-order term of an expansion should be less than the second-order one


class _Path(NamedTuple):
    """What the continuous theory says along the belief means of a trial, and the trial's controls (T, nu)."""

    schedule: GainSchedule
    controls: Array


def what_holds(
    problem: Problem, filter: Filter, controller: Controller, temperature: float, theta: float, seed: int, name: str
) -> Certificate:
    """The conditions of each statement for `problem`, along the belief of trial 0 of `controller`, in double precision.

    `temperature` is lambda of (15), `theta` that of Remark 4. A check that does not hold is no error: the statement
    does not apply, and what is planned is an approximation.
    """
    with jax.enable_x64(True):
        path = _follow(problem, filter, controller, seed)
        exact = [*_affine(problem, path), _independence(problem, path)]
        matched = _matched(problem, path, temperature)
        checks = [*exact, *matched, _expansion(problem, path, theta)]
    title = f"What holds for system={name}, along the belief of trial 0"
    return Certificate(name, title, _reading(exact, matched), checks)


def _follow(problem: Problem, filter: Filter, controller: Controller, seed: int) -> _Path:
    trial = jax.jit(simulate_trial)(problem, filter, controller, seed, 0)
    means = trial.beliefs.mean
    return _Path(_along(problem, trial.controls, means), trial.controls)


@jax.jit
def _along(problem: Problem, controls: Array, means: Array) -> GainSchedule:
    return gain_schedule(problem, prior(problem)._replace(mean=means[0]), controls, "riccati", means[1:])


def _affine(problem: Problem, path: _Path) -> list[Check]:
    """Whether f and c are affine, G and sigma_o constant, around the trial."""
    means = np.asarray(path.schedule.mean)
    spread = np.maximum(np.maximum(np.asarray(problem.prior_std), means.std(axis=0)), FLAT)
    places = means[np.linspace(0, len(means) - 1, PLACES).astype(int)]
    cov = np.diag(spread**2)
    states = places + spread * np.random.default_rng(0).normal(size=places.shape)
    bent = jax.tree.map(np.asarray, _bent(problem, places, cov, *gaussian_nodes(len(spread))))
    values = jax.tree.map(np.asarray, _values(problem, states))
    return [
        _tangent("Theorem 1: part of c outside the mean tangent space, 0 if c is affine", bent["c"], cov),
        _varies("Theorem 1: relative change of sigma_o over the states, 0 if constant", values["sigma_o"]),
        _tangent("Proposition 2: part of f that is not affine", bent["f"], cov),
        _varies("Proposition 2: relative change of G over the states", values["G"]),
    ]


@jax.jit
def _bent(
    problem: Problem, places: Array, cov: Array, points: Array, weights: Array
) -> dict[str, tuple[Array, Array, Array]]:
    """Of c and f at places (P, nx): the part outside the mean tangent space (P,), A (P, n, nx), the value (P, n)."""

    def of(function: Callable[[Array], Array]) -> tuple[Array, Array, Array]:
        nodes = (points, weights)
        parts, A = jax.lax.map(lambda mean: outside_mean_tangent(function, mean, cov, nodes), places)
        return parts, A, jax.vmap(function)(places)

    return {"c": of(problem.system.c), "f": of(problem.system.f)}


@jax.jit
def _values(problem: Problem, states: Array) -> dict[str, Array]:
    return {name: jax.vmap(getattr(problem.system, name))(states) for name in ("sigma_o", "G")}


def _tangent(computed: str, found: Sequence[np.ndarray], cov: np.ndarray) -> Check:
    """The place where the root of the part outside is largest against its rounding, for one entry of `_bent`."""
    parts, A, values = found
    deviation = np.sqrt(np.einsum("pij,jk,pik->p", A, cov, A))
    scale = 1 + np.linalg.norm(values, axis=-1) / np.maximum(deviation, 1e-300)  # a constant has no part outside
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
    pushes = jnp.stack([jnp.zeros_like(u), jnp.broadcast_to(size, u.shape), jnp.broadcast_to(-size, u.shape)])
    covs = _covariances(problem, pushes)
    change = jnp.max(jnp.abs(covs - covs[0])) / jnp.max(jnp.abs(covs[0]))
    computed = "Proposition 2: relative change of Sigma_t with the controls, 0 if none"
    return rounding(computed, float(change), operations=_operations(problem))


@jax.jit
def _covariances(problem: Problem, controls: Array) -> Array:
    """Sigma (C, T+1, nx, nx) for C sequences of controls (C, T, nu)."""
    return jax.vmap(lambda u: gain_schedule(problem, prior(problem), u, "riccati").cov)(controls)


def _operations(problem: Problem) -> float:
    """Roundings behind a schedule: matrix products at every step."""
    return float(problem.steps * PRODUCTS * len(problem.prior_mean) ** 3)


def _matched(problem: Problem, path: _Path, temperature: float) -> list[Check]:
    """Proposition 3 and (15) at every step with D != 0."""
    means, D = path.schedule.mean[:-1], path.schedule.diffusion
    moved = np.asarray(jnp.any(D != 0, axis=(1, 2)))
    G = jax.vmap(problem.system.G)(means)
    best = jax.vmap(best_weight)(D, G)
    imposed = matched_weight(problem.cost.R, temperature)
    least, given = (
        np.asarray(jax.vmap(residual, in_axes=(0, 0, axis))(D, G, W))[moved] for W, axis in ((best, 0), (imposed, None))
    )
    singular = np.linalg.svd(np.asarray(G), compute_uv=False)
    values = np.linalg.eigvalsh(np.asarray(best))[moved]
    rank = int(np.sum(singular[0] > max(G.shape[1:]) * EPSILON * singular[0, 0])) if singular.size else 0
    share = float(np.min(values[:, -rank] / np.maximum(values[:, -1], 1e-300), initial=1.0)) if rank else 0.0
    Q = problem.system.H @ problem.system.H.T
    classical = float(residual(Q, G[0], imposed))
    operations = _operations(problem)
    reached = operations * EPSILON
    return [
        rounding(
            "Proposition 3(i): largest eps* over the steps, 0 if range(D) is in range(G)", _top(least), operations
        ),
        rounding("the same: smallest eps* over the steps", float(np.min(least, initial=np.inf)), operations),
        at_least(
            "Proposition 3(ii): least eigenvalue of W* on the rows of G, over the largest", share, reached, "rounding"
        ),
        rounding("(15) with this lambda and R: largest residual over the steps", _top(given), operations),
        rounding("Remark 1: residual of Q = lambda G R^-1 G', the state being known", classical, operations),
    ]


def _top(values: np.ndarray) -> float:
    return float(np.max(values, initial=0.0))


def _expansion(problem: Problem, path: _Path, theta: float) -> Check:
    """Whether the expansion that q_RS begins falls off; where it does not, q_RS is another thing than the risk."""
    steps = np.linspace(0, problem.steps, PLACES).astype(int)
    nodes = gaussian_nodes(len(problem.prior_mean))
    ratios = theta * _skewness(problem, path.schedule.mean[steps], path.schedule.cov[steps], *nodes)
    computed = f"Remark 4, theta = {theta:g}: third-order over second-order term of the entropic risk"
    return at_most(computed, float(np.max(np.abs(ratios))), TRUST, "the expansion has to fall off")


@jax.jit
def _skewness(problem: Problem, means: Array, covs: Array, points: Array, weights: Array) -> Array:
    """kappa_3 / (3 kappa_2) (P,) of the running cost under beliefs (P, nx), (P, nx, nx)."""

    def at(belief: tuple[Array, Array]) -> Array:
        mean, cov = belief
        factor, _ = psd_factor(cov)
        q = jax.vmap(lambda z: problem.cost.base(mean + factor @ z) + problem.cost.penalty(mean + factor @ z))(points)
        q = q - weights @ q
        second, third = weights @ q**2, weights @ q**3
        return jnp.where(second > 0, third / (3 * jnp.where(second > 0, second, 1.0)), 0.0)

    return jax.lax.map(at, (means, covs))


def _reading(exact: list[Check], matched: list[Check]) -> str:
    """What the checks mean together."""
    gaussian = all(check.holds for check in exact)
    first = (
        "The belief is exactly Gaussian and its covariance known in advance (Proposition 2). "
        if gaussian
        else "The belief is Gaussian in approximation only: the filter is an extended Kalman filter (Remark 3). "
    )
    largest, smallest, equal, given, _ = matched
    if given.holds:
        return first + "Matching (15) holds: Theorem 4, Corollary 5 and Theorem 6 are exact for the belief's mean."
    if largest.holds and equal.holds:
        return first + "Matching (15) does not hold with this lambda and R, but with other R, another at each step."
    if largest.holds:
        return first + "Matching (15) holds for no R > 0: D has less rank than G (Proposition 3(ii))."
    return first + (
        "Matching (15) holds for no R: part of the diffusion is out of reach of the controls, "
        f"eps* = {smallest.value:.2f} to {largest.value:.2f}; Theorem 4 to Theorem 6 are approximations here."
    )
