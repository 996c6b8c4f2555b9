"""Path integral control in Gaussian belief space (Das and Tanaka): the public names.

They need no Hydra and no command line. docs/api.md has an example of each.

    import mppi_belief as mb

    discs = mb.Obstacles(centers=[[3, 1], [3, -1]], radius=0.65)
    system = mb.LightDark(process_noise=0.3, light=5, noise_slope=0.5**0.5, noise_floor=0.1)
    cost = mb.GoalObstacleCost(
        goal=[7, 0, 0, 0],
        running_weight=[1.07, 1.07, 2.2, 2.2],
        terminal_weight=[6.2, 6.2, 0.15, 0.15],
        control_weight=[0.135, 0.135],
        w_obs=350,
        obstacle_penalty=mb.SquaredHinge(margin=0.17),
    )
    start = [1.1, 2, 0, 0]
    sd = [0.46, 0.46, 0.05, 0.05]
    problem = mb.Problem(system, cost, start, sd, 0.1, 60, discs, (0, 1), initial_draw="none")
    path_cost = mb.RiskSensitive(theta=1, expectation="at_mean", variance="sigma_points")
    planner = mb.MPPI(path_cost=path_cost, sampler=mb.NominalSampler(2.2))
    trial = mb.simulate_trial(problem, mb.EKF(), planner, seed=0, trial=0)
    print(mb.metrics(problem, trial))

Names are loaded on first use, so that importing the package does not import JAX.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

# isort: off
if TYPE_CHECKING:  # the same names as below, for type checkers
    from .belief.gaussian import MixtureBelief as MixtureBelief, RootBelief as RootBelief
    from .belief.kalman import correct as correct, predict as predict
    from .belief.particles import ParticleBelief as ParticleBelief
    from .belief.prior import draw_start as draw_start, sample_prior as sample_prior
    from .controllers import (
        AverageOfParticles as AverageOfParticles,
        EKFiLQG as EKFiLQG,
        LQG as LQG,
        MPPI as MPPI,
        OracleMPPI as OracleMPPI,
        PIPF as PIPF,
        PooledPaths as PooledPaths,
    )
    from .costs import GoalObstacleCost as GoalObstacleCost
    from .costs.penalties import (
        Bump as Bump,
        CenterPenalty as CenterPenalty,
        DistancePenalty as DistancePenalty,
        Hinge as Hinge,
        Indicator as Indicator,
        SmoothStep as SmoothStep,
        SquaredHinge as SquaredHinge,
        SurfacePenalty as SurfacePenalty,
    )
    from .discretise import (
        euler_step as euler_step,
        measurement_cov as measurement_cov,
        measurement_difference as measurement_difference,
        measurement_factor as measurement_factor,
    )
    from .filters import (
        EKF as EKF,
        MixtureFilter as MixtureFilter,
        ParticleFilter as ParticleFilter,
        UKF as UKF,
    )
    from .obstacles import (
        ClosedFormClearance as ClosedFormClearance,
        HalfSpaces as HalfSpaces,
        ObstacleDistances as ObstacleDistances,
        ObstacleShape as ObstacleShape,
        Obstacles as Obstacles,
        Surroundings as Surroundings,
    )
    from .planning.parts import (
        DrawnPaths as DrawnPaths,
        MixturePathCost as MixturePathCost,
        PathCost as PathCost,
        PlanInfo as PlanInfo,
        Sampler as Sampler,
        Schedule as Schedule,
    )
    from .planning.path_costs import (
        CertaintyEquivalent as CertaintyEquivalent,
        ChanceConstrained as ChanceConstrained,
        RiskSensitive as RiskSensitive,
    )
    from .planning.samplers import (
        InnovationSampler as InnovationSampler,
        LaplaceSampler as LaplaceSampler,
        NominalSampler as NominalSampler,
    )
    from .planning.schedules import (
        PerPathCovariance as PerPathCovariance,
        SharedCovariance as SharedCovariance,
    )
    from .problem import (
        Belief as Belief,
        ClosedFormCost as ClosedFormCost,
        Controller as Controller,
        Correction as Correction,
        Cost as Cost,
        CostMoments as CostMoments,
        Filter as Filter,
        GaussianFilter as GaussianFilter,
        LabelledSystem as LabelledSystem,
        Problem as Problem,
        SeesState as SeesState,
        SteerableSensor as SteerableSensor,
        System as System,
        WeighsPaths as WeighsPaths,
        WrappedMeasurements as WrappedMeasurements,
    )
    from .results.columns import Consistency as Consistency, Metrics as Metrics
    from .simulate import Trial as Trial, plant_step as plant_step, simulate_trial as simulate_trial
    from .structs import (
        ArrayField as ArrayField,
        OptionalArrayField as OptionalArrayField,
        array as array,
        choice as choice,
        indices as indices,
        number as number,
        size as size,
        struct as struct,
    )
    from .systems import (
        Beacons as Beacons,
        LightDark as LightDark,
        Linear as Linear,
        Pendulum as Pendulum,
        PointRobot as PointRobot,
        ScalarLinear as ScalarLinear,
        Steered as Steered,
    )
    from .trial_metrics import consistency as consistency, metrics as metrics

    __version__: str
# isort: on

# The public names by the module that defines them.
_NAMES = {
    "problem": [
        "Belief",
        "ClosedFormCost",
        "Controller",
        "Correction",
        "Cost",
        "CostMoments",
        "Filter",
        "GaussianFilter",
        "LabelledSystem",
        "Problem",
        "SeesState",
        "SteerableSensor",
        "System",
        "WeighsPaths",
        "WrappedMeasurements",
    ],
    "obstacles": [
        "ClosedFormClearance",
        "HalfSpaces",
        "ObstacleDistances",
        "ObstacleShape",
        "Surroundings",
        "Obstacles",
    ],
    "systems": [
        "Beacons",
        "LightDark",
        "Linear",
        "Pendulum",
        "PointRobot",
        "ScalarLinear",
        "Steered",
    ],
    "costs": ["GoalObstacleCost"],
    "costs.penalties": [
        "Bump",
        "CenterPenalty",
        "DistancePenalty",
        "Hinge",
        "Indicator",
        "SmoothStep",
        "SquaredHinge",
        "SurfacePenalty",
    ],
    "filters": ["EKF", "MixtureFilter", "ParticleFilter", "UKF"],
    "controllers": [
        "AverageOfParticles",
        "EKFiLQG",
        "LQG",
        "MPPI",
        "OracleMPPI",
        "PIPF",
        "PooledPaths",
    ],
    "planning.parts": [
        "DrawnPaths",
        "MixturePathCost",
        "PathCost",
        "PlanInfo",
        "Sampler",
        "Schedule",
    ],
    "planning.path_costs": ["CertaintyEquivalent", "ChanceConstrained", "RiskSensitive"],
    "planning.samplers": ["InnovationSampler", "LaplaceSampler", "NominalSampler"],
    "planning.schedules": ["PerPathCovariance", "SharedCovariance"],
    "belief.gaussian": ["MixtureBelief", "RootBelief"],
    "belief.particles": ["ParticleBelief"],
    "belief.prior": ["draw_start", "sample_prior"],
    "belief.kalman": ["correct", "predict"],
    "discretise": ["euler_step", "measurement_cov", "measurement_difference", "measurement_factor"],
    "simulate": ["Trial", "plant_step", "simulate_trial"],
    "results.columns": ["Consistency", "Metrics"],
    "trial_metrics": ["consistency", "metrics"],
    "structs": [
        "ArrayField",
        "OptionalArrayField",
        "array",
        "choice",
        "indices",
        "number",
        "size",
        "struct",
    ],
}
_MODULES: dict[str, str] = {}
for _module, _names in _NAMES.items():
    _MODULES |= dict.fromkeys(_names, _module)

__all__ = [*_MODULES, "__version__"]


if not TYPE_CHECKING:  # type checkers would take every name for one of this function's

    def __getattr__(name: str) -> Any:
        """Loads a public name on first use."""
        if name == "__version__":
            return _version()
        if name not in _MODULES:
            raise AttributeError(f"module 'mppi_belief' has no attribute {name!r}")
        return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("mppi-belief")
    except PackageNotFoundError:  # a source tree that was never installed
        return "0+unknown"


def __dir__() -> list[str]:
    return sorted(__all__)
