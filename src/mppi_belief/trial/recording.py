"""One trial in detail, for pictures: the paths a planner sampled at each step, the residuals of two statements.

That of matching (Proposition 3) is taken along the trial's own belief means, for the covariances that both readings of
sigma_o lead to there: "sample" by the filter's recursion, "intensity" by the Riccati equation. That of Theorem 1 is
taken where measurements meet the filter's own belief, predicted from the step before, with c in units of its noise.
"""

from dataclasses import replace
from typing import Any

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
from ..problem import Belief, Controller, Filter, Problem
from ..simulate import Trial, closed_loop
from .build import build
from .device import computing

PER_AXIS, TENSOR_UP_TO = 9, 4  # Gauss-Hermite points an axis, for so many states
SHOWN = 40  # sampled paths kept of each step: the heaviest quarter, and the first of the others


def record(config: dict[str, Any]) -> dict[str, Any]:
    """Run the trial `config["record"]` again and keep what `run_trials` does not."""
    with computing(config):
        parts = jax.device_put(build(config))
        samples, result = _run(*parts, config["seed"], config["record"])
        kept = (
            None if samples is None else _thin(*(np.asarray(part, dtype=float) for part in samples))
        )
        return {
            "trial": config["record"],
            "samples": kept,
            "matching": _matching(
                parts.problem, parts.controller, result.controls, result.beliefs.mean
            ),
            "tangent": _tangent(parts.problem, result),
        }


def sampled_paths(config: dict[str, Any], trial: int) -> dict[str, Any] | None:
    """The part `samples` of a recording, by itself: what the planner sampled in a trial, None if it samples nothing."""
    with computing(config):
        samples = _run(*jax.device_put(build(config)), config["seed"], trial)[0]
        return (
            None if samples is None else _thin(*(np.asarray(part, dtype=float) for part in samples))
        )


@jax.jit
def _run(
    problem: Problem, filter: Filter, controller: Controller, seed: Any, trial: Any
) -> tuple[tuple[Array, Array] | None, Trial]:
    """Positions (T, H, d, N) and weights (T, N) of the sampled paths, if the planner tells them; the trial."""
    place = jax.vmap(jax.vmap(problem.position_of, in_axes=-1, out_axes=-1))

    def note(info: Any) -> tuple[Array, Array] | None:
        shapes = [getattr(getattr(info, name, None), "ndim", 0) for name in ("means", "weights")]
        return (place(info.means), info.weights) if shapes == [3, 1] else None

    result, samples = closed_loop(problem, filter, controller, seed, trial, note)
    return samples, result


def _thin(positions: np.ndarray, weights: np.ndarray) -> dict[str, Any]:
    """`SHOWN` paths of each step: positions (T, SHOWN, H, d) in metres, weights (T, SHOWN)."""
    shown = min(SHOWN, weights.shape[1])
    order = np.argsort(-weights, axis=1, kind="stable")
    heavy, others = order[:, : shown // 4], np.sort(order[:, shown // 4 :], axis=1)
    chosen = np.concatenate([heavy, others[:, : shown - shown // 4]], axis=1)
    paths = np.take_along_axis(positions, chosen[:, None, None, :], axis=3).transpose(0, 3, 1, 2)
    kept = np.take_along_axis(weights, chosen, axis=1)
    return {"position": np.round(paths, 3).tolist(), "weight": np.round(kept, 5).tolist()}


def _matching(
    problem: Problem, controller: Controller, controls: Array, means: Array
) -> dict[str, Any]:
    """Residuals (T,) at the best weight of each step and, if the controller has a temperature, at lambda R^-1."""
    curves: dict[str, Any] = {}
    temperature = getattr(controller, "temperature", None)
    for convention, method in (("sample", "filter"), ("intensity", "riccati")):
        told = replace(problem, noise_convention=convention)
        start = prior(told)._replace(mean=means[0])
        schedule = gain_schedule(told, start, controls, method, means[1:])
        curves[convention] = {"optimum": _curve(told, schedule, None)}
        if temperature is not None:
            curves[convention]["imposed"] = _curve(
                told, schedule, matched_weight(problem.cost.R, temperature)
            )
    return curves


def _curve(problem: Problem, schedule: GainSchedule, weight: Array | None) -> list[float | None]:
    def at(mean: Array, D: Array) -> Array:
        G = problem.system.G(mean)
        return residual(D, G, best_weight(D, G) if weight is None else weight)

    values = jax.jit(jax.vmap(at))(schedule.mean[:-1], schedule.diffusion)
    return _rounded(values)


def _tangent(problem: Problem, result: Trial) -> dict[str, Any]:
    """Theorem 1's residual (T,), the part of the measurement that is not tangent to the Gaussian means; nx and ny."""
    before = Belief(*(part[:-1] for part in result.beliefs))
    parts = _outside(problem, before, result.controls)
    return {
        "part": _rounded(parts),
        "states": len(problem.prior_mean),
        "measurements": result.measurements.shape[1],
    }


@jax.jit
def _outside(problem: Problem, before: Belief, controls: Array) -> Array:
    """The part (T,) for beliefs (T, ...) and the controls (T, nu) that followed them."""
    nx = len(problem.prior_mean)
    nodes = gaussian_nodes(nx, PER_AXIS if nx <= TENSOR_UP_TO else None)

    def at(given: tuple[Belief, Array]) -> Array:
        mean, root = predict(problem, *given)
        system = aim_sensor(problem, mean, root).system
        middle, units = system.c(mean), measurement_factor(problem, mean)

        def seen(x: Array) -> Array:
            return jnp.linalg.solve(units, measurement_difference(system, system.c(x), middle))

        return outside_mean_tangent(seen, mean, covariance(root), nodes)[0]

    return jax.lax.map(at, (before, controls))


def _rounded(values: Array) -> list[float | None]:
    return [round(float(value), 5) if np.isfinite(value) else None for value in values]
