"""Records one trial in detail, for pictures: sampled paths, residuals of two statements.

The residual of matching (Proposition 3) is taken along the trial's own belief means, for the
covariances that both readings of sigma_o lead to there: "sample" by the filter's recursion,
"intensity" by the Riccati equation. The residual of Theorem 1 is taken where measurements meet the
filter's own belief, predicted from the step before, with c in units of its noise.

Symbols: T steps of the trial, H steps of the horizon, N sampled paths, d components of the
position.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..belief.gaussian import covariance
from ..belief.kalman import aim_sensor, predict
from ..belief.prior import prior
from ..belief.schedule import GainSchedule, gain_schedule
from ..discretise import measurement_difference, measurement_factor
from ..matching.affine import outside_mean_tangent
from ..matching.weights import best_weight, matched_weight, residual
from ..numerics.quadrature import gaussian_nodes
from ..planning.parts import SampledPaths
from ..problem import Belief, Controller, Filter, Problem, WeighsPaths
from ..simulate import Trial, closed_loop
from .build import CellParts, build
from .device import computing

PER_AXIS = 9  # Gauss-Hermite points per axis
TENSOR_UP_TO = 4  # states; for more, `gaussian_nodes` chooses the points
SHOWN = 40  # sampled paths kept of each step: the heaviest quarter, and the first of the others


class PathsInSpace(NamedTuple):
    """Holds the sampled paths of every step as positions."""

    positions: Array  # (T, H, d, N), m
    weights: Array  # (T, N)


def record(config: dict[str, Any]) -> dict[str, Any]:
    """Runs the trial `config["record"]` again and keeps what `run_trials` does not."""
    with computing(config):
        parts = jax.device_put(build(config))
        paths, trial = _run_with_paths(*parts, config["seed"], config["record"])
        return {
            "trial": config["record"],
            "collided_at": _first_collision(parts.problem, trial),
            "samples": _thinned(paths),
            "matching": _matching_residuals(parts, trial),
            "tangent": _tangent_residuals(parts.problem, trial),
        }


def sampled_paths(config: dict[str, Any], trial: int) -> dict[str, Any] | None:
    """Returns only the part `samples` of a recording; None if the planner samples nothing."""
    with computing(config):
        paths, _ = _run_with_paths(*jax.device_put(build(config)), config["seed"], trial)
        return _thinned(paths)


@jax.jit
def _run_with_paths(
    problem: Problem, filter: Filter, controller: Controller, seed: Any, trial: Any
) -> tuple[PathsInSpace | None, Trial]:
    """Runs a trial; returns the sampled paths, if the diagnostics hold them, and the trial."""
    positions = jax.vmap(jax.vmap(problem.position_of, in_axes=-1, out_axes=-1))

    def select(info: Any) -> PathsInSpace | None:
        if not isinstance(info, SampledPaths):
            return None
        return PathsInSpace(positions(info.means), info.weights)

    result, paths = closed_loop(problem, filter, controller, seed, trial, select)
    return paths, result


def _thinned(paths: PathsInSpace | None) -> dict[str, Any] | None:
    """Returns `SHOWN` paths of each step: positions (T, SHOWN, H, d), m, and weights (T, SHOWN)."""
    if paths is None:
        return None
    positions = np.asarray(paths.positions, dtype=float)
    weights = np.asarray(paths.weights, dtype=float)

    # The heaviest quarter, and the others in the order in which they were drawn.
    shown = min(SHOWN, weights.shape[1])
    order = np.argsort(-weights, axis=1, kind="stable")
    heaviest = order[:, : shown // 4]
    others = np.sort(order[:, shown // 4 :], axis=1)
    chosen = np.concatenate([heaviest, others[:, : shown - shown // 4]], axis=1)

    shown_positions = np.take_along_axis(positions, chosen[:, None, None, :], axis=3)
    shown_weights = np.take_along_axis(weights, chosen, axis=1)
    return {
        "position": np.round(shown_positions.transpose(0, 3, 1, 2), 3).tolist(),
        "weight": np.round(shown_weights, 5).tolist(),
    }


def _first_collision(problem: Problem, trial: Trial) -> int | None:
    """Returns the first step by whose end the path has touched an obstacle, None without any."""
    clearance = np.asarray(jax.jit(Problem.path_clearance)(problem, trial.states))
    touched = np.flatnonzero(clearance <= 0)
    if not len(touched):
        return None
    starts_inside = touched[0] == 0 and problem.clearance(trial.states[0]) <= 0
    return 0 if starts_inside else int(touched[0]) + 1


def _matching_residuals(parts: CellParts, trial: Trial) -> dict[str, Any]:
    """Returns residuals (T,) by convention, at the best weight of each step.

    If the controller has a temperature, also those at the weight lambda R^-1.
    """
    problem = parts.problem
    means = trial.beliefs.mean
    curves: dict[str, Any] = {}
    for convention, method in (("sample", "filter"), ("intensity", "riccati")):
        reinterpreted = replace(problem, noise_convention=convention)
        start = prior(reinterpreted)._replace(mean=means[0])
        schedule = gain_schedule(reinterpreted, start, trial.controls, method, means[1:])
        curves[convention] = {"optimum": _residual_curve(reinterpreted, schedule, None)}
        if isinstance(parts.controller, WeighsPaths):
            weight = matched_weight(problem.cost.R, parts.controller.temperature)
            curves[convention]["imposed"] = _residual_curve(reinterpreted, schedule, weight)
    return curves


def _residual_curve(
    problem: Problem, schedule: GainSchedule, weight: Array | None
) -> list[float | None]:
    """Returns the residuals (T,) at a weight (nu, nu), or at the best one of each step."""

    def residual_at(mean: Array, D: Array) -> Array:
        G = problem.system.G(mean)
        return residual(D, G, best_weight(D, G) if weight is None else weight)

    values = jax.jit(jax.vmap(residual_at))(schedule.mean[:-1], schedule.diffusion)
    return _rounded(values)


def _tangent_residuals(problem: Problem, trial: Trial) -> dict[str, Any]:
    """Returns Theorem 1's residual (T,) with nx and ny.

    It is the part of the measurement that is not tangent to the Gaussian means.
    """
    before = Belief(trial.beliefs.mean[:-1], trial.beliefs.cov[:-1])
    parts = _outside_tangent(problem, before, trial.controls)
    return {
        "part": _rounded(parts),
        "states": len(problem.prior_mean),
        "measurements": trial.measurements.shape[1],
    }


@jax.jit
def _outside_tangent(problem: Problem, before: Belief, controls: Array) -> Array:
    """Returns the part (T,) for beliefs (T, ...) and the controls (T, nu) that followed them."""
    nx = len(problem.prior_mean)
    nodes = gaussian_nodes(nx, PER_AXIS if nx <= TENSOR_UP_TO else None)

    def part(step: tuple[Belief, Array]) -> Array:
        mean, root = predict(problem, *step)
        system = aim_sensor(problem, mean, root).system
        middle = system.c(mean)
        units = measurement_factor(problem, mean)

        def whitened_measurement(x: Array) -> Array:
            return jnp.linalg.solve(units, measurement_difference(system, system.c(x), middle))

        return outside_mean_tangent(whitened_measurement, mean, covariance(root), nodes)[0]

    return jax.lax.map(part, (before, controls))


def _rounded(values: Array) -> list[float | None]:
    """Returns the values to five digits, None where one is not finite."""
    return [round(float(value), 5) if np.isfinite(value) else None for value in values]
