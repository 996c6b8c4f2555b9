"""Proposition 3 and the matching condition (15) at every step of a trial.

Proposition 3 requires range(D_t) to be contained in, or equal to, range(G_t); Theorem 4, Corollary
5 and Theorem 6 require D_t = lambda G_t R^-1 G_t' (15).
"""

from collections.abc import Iterable

import jax
import numpy as np
from jax import Array

from ...errors import counted
from ...matching.constant_weight import best_constant_weight
from ...matching.weights import best_weight, matched_weight, numerical_rank, residual
from ...problem import Problem
from ...results.certificate import Check
from ..bands import EPSILON, at_most, near, rounding
from .trial_path import TrialPath, schedule_operations

# Root of the duality gap per step at which the search for one W ends.
CONSTANT_WEIGHT_TOLERANCE = 1e-6


def matching_conditions(
    problem: Problem, path: TrialPath, temperature: float
) -> tuple[list[Check], str]:
    """Returns Proposition 3 and (15) at every step, and in words what they mean together."""
    D = path.schedule.diffusion
    G = jax.vmap(problem.system.G)(path.schedule.mean[:-1])
    checks = [
        *_feasibility_checks(problem, path, D, G),
        *_weight_checks(problem, D, G, matched_weight(problem.cost.R, temperature)),
    ]
    return checks, _reading(checks, steps_without_diffusion=int(np.sum(~np.any(D, axis=(1, 2)))))


def _feasibility_checks(problem: Problem, path: TrialPath, D: Array, G: Array) -> list[Check]:
    """Checks Proposition 3 for D (T, nx, nx) and G (T, nx, nu)."""
    operations = schedule_operations(problem)
    least = _weight_residuals(D, G, jax.vmap(best_weight)(D, G))

    # The gain's range is that of D = K R_o K', and rounding does not square its rank.
    gains = np.asarray(path.schedule.gain)
    equal_ranks = np.array(
        [numerical_rank(K) == numerical_rank(g) for K, g in zip(gains, np.asarray(G), strict=True)]
    )
    equal_ranges = equal_ranks & (least <= operations * EPSILON)
    return [
        rounding(
            "Proposition 3(i): largest eps* over the steps, 0 if range(D) is in range(G)",
            np.max(least),
            operations,
        ),
        rounding("the same: smallest eps* over the steps", np.min(least), operations),
        near(
            "Proposition 3(ii): share of the steps at which range(D) = range(G)",
            float(np.mean(equal_ranges)),
            1.0,
            0.0,
            "a count",
        ),
    ]


def _weight_checks(problem: Problem, D: Array, G: Array, W: Array) -> list[Check]:
    """Checks (15) with the given W = lambda R^-1, and with the best single W for all steps."""
    operations = schedule_operations(problem)
    Q = problem.system.H @ problem.system.H.T
    return [
        rounding(
            "(15) with this lambda and R: largest residual over the steps",
            np.max(_weight_residuals(D, G, [W] * len(D))),
            operations,
        ),
        at_most(
            "(15) with one W >= 0 for lambda R^-1 at all steps: RMS residual",
            _constant_weight_residual(D, G),
            CONSTANT_WEIGHT_TOLERANCE,
            "accuracy of the search for it",
        ),
        rounding(
            "Remark 1: residual of Q = lambda G R^-1 G', the state being known",
            _weight_residual(Q, G[0], W),
            operations,
        ),
    ]


def _weight_residuals(D: Array, G: Array, weights: Iterable[Array]) -> np.ndarray:
    """Returns the residuals of (15) (T,) with a weight (nu, nu) for each step."""
    return np.array([_weight_residual(d, g, W) for d, g, W in zip(D, G, weights, strict=True)])


def _weight_residual(D: Array, G: Array, W: Array) -> float:
    """Returns the residual of (15); for D = 0 it is 0 or infinite."""
    if np.any(D):
        return float(residual(D, G, W))
    return float(np.inf) if np.any(G @ W @ G.T) else 0.0


def _constant_weight_residual(D: Array, G: Array) -> float:
    """Returns the RMS residual of (15) with the best single W for all steps; inf if all D are 0."""
    if not np.any(D):
        return float(np.inf)
    constant = best_constant_weight(D, G)
    return float(np.sqrt(max(constant.value, 0.0) / constant.steps))


def _reading(checks: list[Check], steps_without_diffusion: int) -> str:
    """Returns what the checks of `matching_conditions` mean."""
    largest, smallest, equal, given, constant, _ = checks
    if given.holds:
        return (
            "Matching (15) holds: Theorem 4, Corollary 5 and Theorem 6 are exact for the mean's "
            "equation (12)."
        )
    if constant.holds and equal.holds:
        return "Matching (15) does not hold with this lambda and R, but would with one other R."
    if equal.holds:
        return "Matching (15) would need an R that changes with time, while that of (2) is fixed."
    if largest.holds:
        steps = counted(steps_without_diffusion, "step")
        without = f"; D = 0 at {steps}" if steps_without_diffusion else ""
        return (
            "Matching (15) holds for no R > 0, since D has less rank than G "
            f"(Proposition 3(ii)){without}."
        )
    return (
        "Matching (15) holds for no R: part of the diffusion is out of reach of the controls, "
        f"eps* = {smallest.value:.2f} to {largest.value:.2f}; "
        "Theorem 4, Corollary 5 and Theorem 6 are approximations here."
    )
