"""Paths from the optimal feedback policy of the problem expanded about the nominal.

One path in five is drawn about the nominal itself. The formulas are those of
`planning.feedback_policy` and `planning.policy_mixture`. Far fewer paths suffice than with the
nominal sampler. In the limit of many paths the controls of both are the same, unless
R dt > temperature / control_std^2.
"""

from typing import ClassVar

from jax import Array

from ...problem import Problem
from ...structs import struct
from .. import feedback_policy, policy_mixture
from ..lq_problem import time_varying_cost
from ..parts import Draw, DrawnPaths, PathCost, PlannedBelief
from ..path_integral import normals
from .control_density import ControlDensity


@struct
class LaplaceSampler(ControlDensity):
    """Draws controls from the policy of the Laplace approximation."""

    expands_cost: ClassVar[bool] = True  # differentiates the cost

    def prepare(
        self,
        problem: Problem,
        path_cost: PathCost,
        planned: PlannedBelief,
        nominal: Array,
        temperature: Array | float,
    ) -> Draw:
        """Returns a function that draws paths for the nominal controls (H, nu)."""
        schedule = planned.moments.schedule
        reference = feedback_policy.reference_density(
            problem, nominal, temperature, self.control_std, self.alpha
        )
        cost = time_varying_cost(
            problem.dt,
            lambda mu, k: path_cost.running(problem, mu, schedule.cov[k]),
            lambda mu: path_cost.terminal(problem, mu, schedule.cov[-1]),
            len(nominal),
            path_cost.at_step_end,
        )
        fallback = feedback_policy.nominal_policy(problem, nominal, temperature, self.control_std)
        guide = feedback_policy.laplace_policy(
            cost, problem, schedule.mean, reference, temperature, fallback
        )

        def draw(key: Array, n: int) -> DrawnPaths:
            horizon, n_controls = nominal.shape
            eps = normals(key, (horizon, n_controls, n), self.antithetic)
            second = policy_mixture.about_nominal(n, self.antithetic)
            controls, means, log_density = policy_mixture.feedback_rollouts(
                problem, schedule.mean[0], (guide, fallback), second, eps
            )
            correction = policy_mixture.density_correction(
                reference, temperature, controls, log_density
            )
            return DrawnPaths(controls - nominal[:, :, None], means, correction)

        return draw
