"""Paths from the optimal feedback policy of the problem expanded about the nominal.

One path in five is drawn about the nominal itself. The formulas are those of
`mppi_belief.planning.feedback_policy`. Far fewer paths suffice than with the nominal sampler. In
the limit of many paths the controls of both are the same, unless R dt > temperature /
control_std^2.
"""

from typing import ClassVar

from jax import Array

from ...problem import Problem
from ...structs import choice, number, struct
from .. import feedback_policy
from ..lq_problem import time_varying_cost
from ..parts import Draw, DrawnPaths, PathCost, PlannedBelief
from ..path_integral import normals, shifted


@struct
class LaplaceSampler:
    """Draws controls from the policy of the Laplace approximation.

    Fields:
        control_std: standard deviation of sampled controls; None for S_u = lambda R^-1 / dt
        alpha: of the Girsanov term; None for nominal' R delta dt, which is alpha = 0 in the exact
            case
        antithetic: draw mirrored pairs: half the normals, less variance
    """

    control_std: float | None = number(default=None, gt=0, optional=True)
    alpha: float | None = number(default=None, ge=0, le=1, optional=True)
    antithetic: bool = choice(False, True, default=False)

    disturbs_mean: ClassVar[bool] = False

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
            second = feedback_policy.about_nominal(n, self.antithetic)
            controls, means, log_density = feedback_policy.feedback_rollouts(
                problem, schedule.mean[0], (guide, fallback), second, eps
            )
            correction = feedback_policy.density_correction(
                reference, temperature, controls, log_density
            )
            return DrawnPaths(controls - nominal[:, :, None], means, correction)

        return draw

    def warm_start(self, improved: Array) -> Array:
        """Returns the improved plan (H, nu) one step later."""
        return shifted(improved)
