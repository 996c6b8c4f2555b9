"""MPPI-Belief (Algorithm 1, receding horizon) and CE-MPPI: one planner of three parts.

    minimise  E[ phi(mu_H, Sigma_H) + sum_k ( q(mu_k, Sigma_k) + 1/2 u_k' R u_k ) dt ]

over controls. The belief covariance evolves deterministically along a path, so the cost of every
sampled path of the belief mean is known; the control is the weighted average of the sampled ones,
(19).

| conf/controller | path cost | sampler | schedule |
|---|---|---|---|
| belief | `RiskSensitive` | `NominalSampler` | `SharedCovariance` |
| ce, oracle | `CertaintyEquivalent` | `NominalSampler` | `SharedCovariance` |
| chance | `ChanceConstrained` | `NominalSampler` | `SharedCovariance` |
| algorithm_1 | `RiskSensitive` | `InnovationSampler` | `SharedCovariance` |
| belief_joint | `RiskSensitive` | `NominalSampler` | `PerPathCovariance` |
"""

from typing import Any, ClassVar

import jax.numpy as jnp
from jax import Array

from ..planning.parts import PathCost, PlanInfo, Sampler, Schedule
from ..planning.path_costs import RiskSensitive
from ..planning.path_weights import CostedPaths, Exponential, effective_sample_size, improve
from ..planning.samplers import NominalSampler
from ..planning.schedules import SharedCovariance
from ..problem import Problem
from ..structs import number, size, struct


@struct
class MPPI:
    """Plans by sampling paths of the belief mean.

    Raises:
        ValueError: for an `InnovationSampler` with `PerPathCovariance`: no control leads along its
            paths, so the filter cannot be run along them
    """

    n_samples: int = size(default=500)  # N
    horizon: int = size(default=30)  # H, steps
    temperature: float = number(default=1.0, gt=0)  # lambda
    path_cost: PathCost = RiskSensitive()  # what a planned belief costs
    sampler: Sampler = NominalSampler()  # where paths are drawn, and with which density
    schedule: Schedule = SharedCovariance()  # how the covariance along a path is planned

    def __post_init__(self) -> None:
        """Refuses parts that are not objects, and the one pair that cannot go together."""
        for name in ("path_cost", "sampler", "schedule"):
            if isinstance(getattr(self, name), str):
                raise ValueError(
                    f"{name} must be an object, got {getattr(self, name)!r}; "
                    f"on the command line choose one with controller/{name}=NAME"
                )
        disturbed = getattr(self.sampler, "disturbs_mean", False)
        if disturbed and getattr(self.schedule, "follows_controls", False):
            schedule = type(self.schedule).__name__
            sampler = type(self.sampler).__name__
            raise ValueError(
                f"schedule={schedule} needs controls to run the filter along, and "
                f"sampler={sampler} draws paths that no control leads along: take SharedCovariance"
            )

    def init(self, problem: Problem) -> Array:
        """Returns the zero nominal (H, nu)."""
        return jnp.zeros((self.horizon, problem.cost.R.shape[0]))

    def act(
        self, problem: Problem, belief: Any, plan: Array, key: Array
    ) -> tuple[Array, Array, PlanInfo]:
        """Returns the control (nu,), the nominal of the next step (H, nu) and diagnostics.

        Args:
            problem: what to control
            belief: of the state, a Gaussian or a mixture
            plan: the nominal controls (H, nu)
            key: of the samples
        """
        planned = self.schedule.plan(problem, self.path_cost, belief, plan)
        if self.sampler.disturbs_mean:
            planned = planned.moments
        draw = self.sampler.prepare(problem, self.path_cost, planned, plan, self.temperature)

        def sample(key: Array, n: int) -> CostedPaths:
            drawn = draw(key, n)
            costs, means = planned.costs(plan[:, :, None] + drawn.increments, drawn.means)
            return CostedPaths(drawn.increments, costs + drawn.correction, means)

        improved = improve(plan, sample, key, self.n_samples, Exponential(self.temperature))
        info = PlanInfo(
            effective_sample_size(improved.weights),
            planned.nominal_cost,
            planned.cov,
            improved.means,
            improved.weights,
        )
        return improved.controls[0], self.sampler.warm_start(improved.controls), info


@struct
class OracleMPPI(MPPI):
    """Plans from the true state instead of the belief.

    What it costs less than `MPPI` is the cost of partial observability.
    """

    sees_state: ClassVar[bool] = True
