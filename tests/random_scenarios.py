"""Closed loops of random scenarios over the whole range of the numbers, every controller, both
precisions.

    python tests/random_scenarios.py [--count 10000] [--seed 0]

Drawn together: noises of 1e-6 to 1e3 or none, dt of 1e-4 to 1, prior deviations of 1e-6 to 1e3 or
none, starts on an obstacle, goals in one, w_obs to 1e8, theta, temperatures and control weights
over many decades. What must hold along each loop is `violations`; a trial that leaves the finite
numbers must be one that says so (`lost`). Prints counts.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array

import mppi_belief as mb
from helpers import quick_jit
from mppi_belief.config.environment import prepare
from mppi_belief.simulate import closed_loop

N = 32
HORIZON = 6
STEPS = 6
PARTICLES = 16
BATCH = 500
SIZES = ((1, 1, 1), (2, 1, 1), (3, 2, 2), (4, 2, 3), (6, 3, 4))  # nx, nu, ny of the linear systems
SYSTEMS = ("light_dark", "scalar_linear", *(f"linear_{nx}_{nu}_{ny}" for nx, nu, ny in SIZES))
Numbers = dict[str, Any]


class Watch(NamedTuple):
    """Holds the belief that the controller got, and its diagnostics."""

    ess: Array
    controller_belief: Any
    diagnostics: Any


@mb.struct
class Watched:
    """Adds the belief that a controller gets to its diagnostics."""

    inner: Any

    def init(self, problem: mb.Problem) -> Any:
        return self.inner.init(problem)

    def act(
        self, problem: mb.Problem, belief: Any, plan: Any, key: Array
    ) -> tuple[Array, Any, Watch]:
        u, plan, info = self.inner.act(problem, belief, plan, key)
        return u, plan, Watch(info.ess, belief, info)


SAMPLED = {"n_samples": N, "horizon": HORIZON}
EKF = mb.EKF
PARTICLE = partial(mb.ParticleFilter, PARTICLES, noise_at="mean")
EACH = partial(mb.ParticleFilter, PARTICLES)
TOTAL = {"variance_of": "total", "at_step_end": False}
RICCATI = mb.SharedCovariance("riccati")


def _planner(numbers: Numbers, path_cost: Any, sampler: Any, **parts: Any) -> mb.MPPI:
    """A planner of given parts."""
    parts = {"path_cost": path_cost, "sampler": sampler} | parts
    return mb.MPPI(**SAMPLED, temperature=numbers["temperature"], **parts)


def _averse(numbers: Numbers, **options: Any) -> mb.RiskSensitive:
    return mb.RiskSensitive(numbers["theta"], **options)


def _nominal(numbers: Numbers) -> mb.NominalSampler:
    return mb.NominalSampler(numbers["control_std"])


def _pipf(numbers: Numbers, combination: Any) -> mb.PIPF:
    return mb.PIPF(
        **SAMPLED,
        temperature=numbers["temperature"],
        sampler=_nominal(numbers),
        combination=combination,
    )


METHODS: dict[str, tuple[Callable[[], Any], Callable[[Numbers], Any]]] = {
    "belief": (EKF, lambda n: _planner(n, _averse(n), _nominal(n))),
    "belief, total, matched std": (
        EKF,
        lambda n: _planner(n, _averse(n, **TOTAL), mb.NominalSampler(alpha=0.5, antithetic=True)),
    ),
    "belief, particle": (
        EACH,
        lambda n: _planner(n, _averse(n, expectation="at_mean"), _nominal(n)),
    ),
    "belief, laplace": (
        EKF,
        lambda n: _planner(n, _averse(n), mb.LaplaceSampler(n["control_std"])),
    ),
    "ce": (EKF, lambda n: _planner(n, mb.CertaintyEquivalent(), _nominal(n))),
    "algorithm_1": (
        EKF,
        lambda n: _planner(n, _averse(n, **TOTAL), mb.InnovationSampler(), schedule=RICCATI),
    ),
    "ilqg": (EKF, lambda n: mb.EKFiLQG(horizon=HORIZON, max_iterations=20)),
    "lqg": (EKF, lambda n: mb.LQG()),
    "pipf": (PARTICLE, lambda n: _pipf(n, mb.AverageOfParticles())),
    "pipf, pooled": (PARTICLE, lambda n: _pipf(n, mb.PooledPaths())),
}


def _of(numbers: Numbers, *names: str) -> Numbers:
    return {name: numbers[name] for name in names}


def draw(system: str, count: int, seed: int) -> Numbers:
    """Numbers of `count` scenarios, each array's first axis."""
    rng = np.random.default_rng([seed, SYSTEMS.index(system)])
    nx, nu, ny = sizes(system)
    d = min(nx, 2)

    def log(low: float, high: float, *shape: int, zero: float = 0.0) -> np.ndarray:
        values = 10 ** rng.uniform(np.log10(low), np.log10(high), (count, *shape))
        return np.where(rng.uniform(size=values.shape) < zero, 0.0, values)

    def sometimes(part: float, yes: np.ndarray, no: np.ndarray) -> np.ndarray:
        return np.where(rng.uniform(size=(count,) + (1,) * (yes.ndim - 1)) < part, yes, no)

    centers = rng.uniform(-3, 3, (count, 2, d))
    on = np.hstack([centers[:, 0], np.zeros((count, nx - d))])
    numbers = {
        "centers": centers,
        "radius": log(0.1, 1),
        "prior_mean": sometimes(0.2, on, rng.uniform(-3, 3, (count, nx))),
        "prior_std": sometimes(0.1, np.zeros((count, nx)), log(1e-6, 1e3, nx, zero=0.25)),
        "dt": log(1e-4, 1),
        "process_noise": log(1e-6, 1e3, zero=0.15),
        "sensor_noise": log(1e-6, 1e3, ny),
        "noise_slope": log(1e-3, 1e3, zero=0.3),
        "goal": sometimes(0.2, on, rng.uniform(-3, 3, (count, nx))),
        "running_weight": log(1e-3, 1e3, nx, zero=0.1),
        "terminal_weight": log(1e-3, 1e3, nx, zero=0.1),
        "control_weight": log(1e-6, 1e3, nu),
        "w_obs": log(1, 1e8, zero=0.1),
        "bump_width": log(1e-2, 10),
        "temperature": log(1e-6, 1e6),
        "control_std": log(1e-3, 1e2),
        "theta": log(1e-3, 1e6, zero=0.2),
        "trial": np.arange(count),
    }
    if system.startswith("linear"):
        size = log(1e-2, 1e4)[:, None, None]  # the largest overflow within a few steps
        C = rng.normal(size=(count, ny, nx))
        C[:, -1] = sometimes(0.3, C[:, 0], C[:, -1])  # a measurement made twice
        numbers |= {
            "A": size * rng.normal(size=(count, nx, nx)),
            "B": rng.normal(size=(count, nx, nu)),
            "C": C,
        }
        numbers["channel"] = rng.normal(size=(count, nx, nx)) * log(1e-6, 1e3, 1, nx, zero=0.3)
    if system == "scalar_linear":
        numbers |= {
            "A": rng.uniform(-10, 10, (count, 1)),
            "B": rng.normal(size=(count, 1)),
            "C": log(1e-3, 1e3, 1),
        }
    for row, corner in enumerate(CORNERS[:count]):
        for name, value in corner(numbers, row).items():
            if name in numbers:
                numbers[name][row] = value
    return numbers


# the first scenarios of every system, the rest of their numbers as drawn
CORNERS: tuple[Callable[[Numbers, int], Numbers], ...] = (
    lambda n, i: {"prior_std": 0},
    lambda n, i: {"process_noise": 0, "channel": 0},
    lambda n, i: {"prior_std": 0, "process_noise": 0, "channel": 0},
    lambda n, i: {"prior_mean": _padded(n, i), "prior_std": 0},
    lambda n, i: {"goal": _padded(n, i), "w_obs": 1e8},
    lambda n, i: {"sensor_noise": 1e-6, "noise_slope": 0, "prior_std": 1e3},
    lambda n, i: {"sensor_noise": 1e3, "process_noise": 1e3, "prior_std": 1e-6},
    lambda n, i: {"theta": 1e6, "w_obs": 1e8},
    lambda n, i: {"theta": 0, "temperature": 1e-6},
    lambda n, i: {"temperature": 1e6, "w_obs": 1e8},
    lambda n, i: {"control_weight": 1e-6, "temperature": 1e6},
    lambda n, i: {"dt": 1e-4},
    lambda n, i: {"dt": 1.0, "process_noise": 1e3},
)


def _padded(numbers: Numbers, row: int) -> np.ndarray:
    """The state at the centre of a scenario's first obstacle, (nx,)."""
    center = numbers["centers"][row, 0]
    return np.append(center, np.zeros(numbers["goal"].shape[-1] - len(center)))


def sizes(system: str) -> tuple[int, int, int]:
    """nx, nu, ny."""
    if system == "light_dark":
        return 4, 2, 2
    if system == "scalar_linear":
        return 1, 1, 1
    nx, nu, ny = (int(word) for word in system.split("_")[1:])
    return nx, nu, ny


def problem(system: str, n: Numbers) -> mb.Problem:
    """One scenario's problem."""
    obstacles = mb.Obstacles(n["centers"], n["radius"])
    dynamics: Any
    if system == "light_dark":
        dynamics = mb.LightDark(n["process_noise"], 1.0, n["noise_slope"], n["sensor_noise"][0])
    elif system == "scalar_linear":
        dynamics = mb.ScalarLinear(
            n["A"][0], n["B"][0], n["C"][0], n["process_noise"], n["sensor_noise"][0]
        )
    else:
        dynamics = mb.Linear(n["A"], n["B"], n["C"], n["channel"], n["sensor_noise"])
    weights = _of(n, "goal", "running_weight", "terminal_weight", "control_weight", "w_obs")
    cost = mb.GoalObstacleCost(**weights, obstacle_penalty=mb.Bump(n["bump_width"]))
    return mb.Problem(
        dynamics,
        cost,
        n["prior_mean"],
        n["prior_std"],
        n["dt"],
        STEPS,
        obstacles=obstacles,
        position=tuple(range(n["centers"].shape[-1])),
        noise_convention="sample" if system == "light_dark" else "intensity",
    )


class Loop(NamedTuple):
    """One closed loop or, with one more axis at the front, many."""

    trial: mb.Trial
    metrics: mb.Metrics
    controller_belief: Any
    diagnostics: Any


def loops(system: str, method: str) -> Callable[[Numbers], Loop]:
    """A program for closed loops of stacked scenarios; far more time goes into compiling it than
    into running it.
    """
    filter, controller = METHODS[method]

    def closed_loop_of(n: Numbers) -> Loop:
        posed = problem(system, n)
        watched = Watched(controller(n))
        trial, notes = closed_loop(
            posed,
            filter(),
            watched,
            0,
            n["trial"],
            lambda info: (info.controller_belief, info.diagnostics),
        )
        return Loop(trial, mb.metrics(posed, trial), *notes)

    return quick_jit(jax.vmap(closed_loop_of))


def lost(loop: Loop) -> np.ndarray:
    """What left the finite numbers first in each scenario (B,): "", control, paths (the costs of
    all that were sampled at a step), state, belief or cost.
    """
    trial = loop.trial
    gone = {
        "control": ~_finite(trial.controls),
        "paths": trial.ess == 0,
        "state": ~_finite(trial.states)[:, 1:],
        "belief": ~(_finite(trial.beliefs.mean) & _finite(trial.beliefs.cov))[:, 1:],
    }
    order = np.arange(len(gone)) / len(gone)
    first = (
        np.stack([np.where(bad.any(1), bad.argmax(1), STEPS) for bad in gone.values()], axis=1)
        + order
    )
    names = np.array(list(gone))[np.argmin(first, axis=1)]
    return np.where(
        first.min(axis=1) >= STEPS, np.where(np.isfinite(loop.metrics.cost), "", "cost"), names
    )


def _finite(values: np.ndarray) -> np.ndarray:
    """(B, T) of (B, T, ...)."""
    return np.isfinite(values).reshape(*values.shape[:2], -1).all(-1)


def violations(loop: Loop, dtype: str) -> dict[str, np.ndarray]:
    """What does not hold, (B,) each, for the scenarios that stayed finite."""
    eps = float(np.finfo(dtype).eps)
    finite = lost(loop) == ""
    checks = {"filter covariance": _not_semidefinite(loop.trial.beliefs.cov, dtype)}
    planned = getattr(loop.diagnostics, "planned_cov", None)
    if planned is not None:
        checks["planned covariance"] = _not_semidefinite(planned, dtype)
    if hasattr(loop.diagnostics, "weights"):
        checks["weights"] = _not_weights(loop.diagnostics.weights, eps)
        ess = loop.trial.ess
        n = loop.diagnostics.weights.shape[-1]
        checks["effective sample size"] = ~np.all(
            (ess >= 1 - n * eps) & (ess <= n * (1 + n * eps)), axis=1
        )
    if hasattr(loop.controller_belief, "log_weights"):
        checks["particle weights"] = _not_weights(
            np.exp(loop.controller_belief.log_weights.astype(float)), eps
        )
    return {name: bad & finite for name, bad in checks.items()}


def _not_semidefinite(cov: np.ndarray, dtype: str) -> np.ndarray:
    """A sum of m products of rows is off by at most m eps of the rows' lengths, in norm by n m eps
    of the largest eigenvalue; m is at most the number of particles. A product below the least
    normal number is lost whole.
    """
    n = cov.shape[-1]
    number = np.finfo(dtype)
    terms = n * max(n, PARTICLES)
    cov = cov.reshape(len(cov), -1, n, n).astype(float)
    values = np.linalg.eigvalsh(np.where(np.isfinite(cov), cov, 0.0))
    low = values[..., 0] < -terms * (float(number.eps) * values[..., -1] + float(number.tiny))
    return np.any(low | np.any(cov != np.swapaxes(cov, -1, -2), axis=(-1, -2)), axis=1)


def _not_weights(w: np.ndarray, eps: float) -> np.ndarray:
    total = np.sum(w.astype(float), axis=-1)
    bad = ~(np.abs(total - 1) <= 2 * w.shape[-1] * eps) | ~np.all(w >= 0, axis=-1)
    return bad.reshape(len(bad), -1).any(axis=1)


def studied(
    system: str, count: int, seed: int, methods: list[str], dtype: str
) -> Iterator[tuple[str, int, Loop]]:
    """Method, number of the first scenario, and loops, batch by batch."""
    numbers = draw(system, count, seed)
    with jax.enable_x64(dtype == "float64"):
        for method in methods:
            run = loops(system, method)
            size = min(BATCH, count)
            for first in range(0, count, size):
                part = {
                    name: values[np.arange(first, first + size) % count]
                    for name, values in numbers.items()
                }
                results = jax.device_get(run(part))
                yield (
                    method,
                    first,
                    jax.tree.map(lambda a, first=first: a[: count - first], results),
                )


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--count", type=int, default=10_000, help="scenarios, shared among the systems"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--system", action="append", choices=SYSTEMS)
    parser.add_argument("--method", action="append", choices=METHODS)
    parser.add_argument("--dtype", action="append", choices=("float32", "float64"))
    options = parser.parse_args()
    prepare()
    chosen = options.system or SYSTEMS
    worst = 0
    for dtype in options.dtype or ("float32", "float64"):
        for system in chosen:
            count = -(-options.count // len(chosen))
            tally: dict[str, Counter] = {}
            for method, first, results in studied(
                system, count, options.seed, options.method or list(METHODS), dtype
            ):
                counts = tally.setdefault(method, Counter())
                names = lost(results)
                counts.update(
                    {
                        name or "ok": int(np.sum(names == name))
                        for name in map(str, np.unique(names))
                    }
                )
                for name, bad in violations(results, dtype).items():
                    if bad.any():
                        counts[f"VIOLATION {name}"] += int(bad.sum())
                        worst += int(bad.sum())
                        scenarios = first + np.flatnonzero(bad)[:8]
                        print(f"{dtype} {system} {method}: {name}, scenarios {scenarios}")
            for method, counts in tally.items():
                print(f"{dtype} {system:14} {method:28}", dict(counts), flush=True)
    raise SystemExit(worst > 0)


if __name__ == "__main__":
    main()
