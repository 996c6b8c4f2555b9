"""Path integral control in Gaussian belief space (Das and Tanaka): the parts, for use without Hydra.

    import mppi_belief as mb

    obstacles = mb.Obstacles(centers=[[3, 1], [3, -1]], radius=0.65)
    system = mb.LightDark(process_noise=0.3, light=5, noise_slope=0.5**0.5, noise_floor=0.1)
    cost = mb.GoalObstacleCost(
        goal=[7, 0, 0, 0], running_weight=[1.5, 1.5, 0.6, 0.6], terminal_weight=[5, 5, 0.15, 0.15],
        control_weight=[0.035, 0.035], w_obs=500, bump_width=0.285,
    )
    problem = mb.Problem(
        system, cost, prior_mean=[1, 1, 0, 0], prior_std=[0.2, 0.2, 0.05, 0.05], dt=0.1, steps=60,
        obstacles=obstacles, position=(0, 1),
    )
    planner = mb.MPPI(path_cost=mb.RiskSensitive(theta=1), sampler=mb.NominalSampler(control_std=2.75))
    trial = mb.simulate_trial(problem, mb.EKF(), planner, seed=0, trial=0)
    print(mb.metrics(problem, trial))

Names are loaded on first use, so that importing the package does not import JAX.
"""

from importlib import import_module
from typing import Any

_HOME = {
    "Belief": "problem",
    "Controller": "problem",
    "Cost": "problem",
    "CostMoments": "problem",
    "Filter": "problem",
    "ObstacleShape": "problem",
    "Problem": "problem",
    "Surroundings": "problem",
    "System": "problem",
    "Obstacles": "obstacles",
    "Beacons": "systems",
    "LightDark": "systems",
    "Linear": "systems",
    "Pendulum": "systems",
    "PointRobot": "systems",
    "ScalarLinear": "systems",
    "Steered": "systems",
    "GoalObstacleCost": "costs",
    "EKF": "filters",
    "ParticleFilter": "filters",
    "MixtureFilter": "filters",
    "UKF": "filters",
    "MPPI": "controllers",
    "OracleMPPI": "controllers",
    "EKFiLQG": "controllers",
    "PIPF": "controllers",
    "AverageOfParticles": "controllers",
    "PooledPaths": "controllers",
    "LQG": "controllers",
    "RiskSensitive": "planning.path_costs",
    "CertaintyEquivalent": "planning.path_costs",
    "NominalSampler": "planning.samplers",
    "InnovationSampler": "planning.samplers",
    "LaplaceSampler": "planning.samplers",
    "SharedCovariance": "planning.schedules",
    "PerPathCovariance": "planning.schedules",
    "PlanInfo": "planning.parts",
    "Consistency": "trial_metrics",
    "Metrics": "trial_metrics",
    "Trial": "simulate",
    "consistency": "trial_metrics",
    "metrics": "trial_metrics",
    "simulate_trial": "simulate",
    "struct": "structs",
    "number": "structs",
    "array": "structs",
    "size": "structs",
    "indices": "structs",
    "choice": "structs",
}

__all__ = [*_HOME, "__version__"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return _version()
    if name not in _HOME:
        raise AttributeError(f"module 'mppi_belief' has no attribute {name!r}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("mppi-belief")
    except PackageNotFoundError:  # a source tree that was never installed
        return "0+unknown"


def __dir__() -> list[str]:
    return sorted(__all__)
