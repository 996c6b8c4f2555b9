"""MPPI-Belief (Algorithm 1, receding horizon) and, with `evaluate: mean`, CE-MPPI.

    minimise  E[ phi(mu_H, Sigma_H) + sum_k ( q_RS(mu_k, Sigma_k) + 1/2 u_k' R u_k ) dt ]

over controls, Sigma_k being the schedule of Assumption 1 along the nominal trajectory. Of a mixture of Gaussians
(`filter=mixture`) every component moves from its own mean under the same controls, with its own schedule; costs are
those of the mixture, its weights held at their present values over the horizon.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array

from ..belief.cost import (
    certainty_equivalent,
    expected_terminal,
    mixture_risk_sensitive,
    mixture_terminal,
    risk_sensitive,
)
from ..belief.gaussian import MixtureBelief, RootBelief, mixture_covariance
from ..belief.schedule import GainSchedule, diffusion_factors, gain_schedule
from ..planning import ilqr
from ..planning import path_integral as pi
from ..planning import samplers as proposals
from ..problem import Belief, Problem
from ..structs import choice, number, size, struct

Rate = Callable[[Array, Array], Array]
Sampler = Callable[
    [Array, int], tuple[Array, Array, Array]
]  # key, N -> increments, means, what (19) adds to costs


@struct
class MPPIBelief:
    """Sampling planner on the belief mean.

    temperature   lambda
    control_std   standard deviation of the sampled control increments; None samples the matched
                  diffusion itself, covariance lambda R^-1 / dt
    alpha         Girsanov term gamma nominal' S_u^-1 delta with gamma = lambda (1 - alpha) (Williams
                  et al. 2018); None takes nominal' R delta dt, which is alpha = 0 in the exact case
    antithetic    sample in mirrored pairs: half the normals, less variance
    diffusion     "matched" or "innovation", see `mppi_belief.planning.path_integral`
    evaluate      "belief" charges q_RS, "mean" the cost at the mean (certainty equivalence)
    theta, risk   Remark 4 and what its variance is taken of
    expectation   "exact" or "at_mean": how the obstacle penalty is expected, see `mppi_belief.belief.cost`
    charge        the end of a step at which q is charged, see `mppi_belief.planning.path_integral.path_costs`
    sees_state    an oracle: told the true state instead of the belief
    schedule      how the covariance is planned, see `mppi_belief.belief.schedule.gain_schedule`
    plan_from     of a mixture: all its "components", or one Gaussian of its "moments"; with `evaluate: mean` or the
                  innovation diffusion always the moments
    proposal      where paths are sampled: about the "nominal", or by the "laplace" policy of `planning.samplers`,
                  which needs far fewer and has the same limit of many, unless R dt > temperature / control_std^2
    """

    n_samples: int = size(500)
    horizon: int = size(30)
    temperature: float = number(1.0, gt=0)
    control_std: float | None = number(None, gt=0, optional=True)
    alpha: float | None = number(None, ge=0, le=1, optional=True)
    antithetic: bool = choice(False, True)
    diffusion: str = choice("matched", "innovation")
    evaluate: str = choice("belief", "mean")
    theta: float = number(0.0, ge=0)
    risk: str = choice("penalty", "total")
    expectation: str = choice("exact", "at_mean")
    charge: str = choice("end", "start")
    schedule: str = choice("filter", "riccati")
    sees_state: bool = choice(False, True)
    plan_from: str = choice("components", "moments")
    proposal: str = choice("nominal", "laplace")

    def init(self, problem: Problem) -> Array:
        """The zero nominal (H, nu)."""
        return jnp.zeros((self.horizon, problem.cost.R.shape[0]))

    def act(
        self, problem: Problem, belief: Belief, plan: Array, key: Array
    ) -> tuple[Array, Array, pi.PlanInfo]:
        """The control (nu,), the nominal shifted by one step (H, nu), diagnostics."""
        if self.proposal == "laplace" and self.diffusion == "innovation":
            raise ValueError("proposal=laplace moves the control: it needs diffusion=matched")
        if isinstance(belief, MixtureBelief) and self._sees_components():
            if self.proposal == "laplace":
                raise ValueError(
                    "proposal=laplace plans from one Gaussian: it needs plan_from=moments"
                )
            return self._act_on_mixture(problem, belief, plan, key)
        mean, schedule = belief.mean, gain_schedule(problem, belief, plan, self.schedule)
        draw = (self._nominal if self.proposal == "nominal" else self._laplace)(
            problem, mean, schedule, plan
        )

        def paths(key: Array, n: int) -> tuple[Array, Array, Array]:
            increments, means, correction = draw(key, n)
            return increments, self._costs(problem, mean, means, schedule.cov) + correction, means

        change, w, means = pi.weighted_in_blocks(paths, key, self.n_samples, self.temperature)
        improved = plan + change
        nominal_cost = self._costs(problem, mean, schedule.mean[1:, :, None], schedule.cov)[0]
        info = pi.PlanInfo(pi.effective_sample_size(w), nominal_cost, schedule.cov, means, w)
        return improved[0], self._carry(improved), info

    def _nominal(
        self, problem: Problem, mean: Array, schedule: GainSchedule, plan: Array
    ) -> Sampler:
        """Samples about the nominal."""
        weight = pi.girsanov_weight(problem, self.temperature, self.control_std, self.alpha)

        def draw(key: Array, n: int) -> tuple[Array, Array, Array]:
            increments, disturbance = self._sample(problem, schedule, key, n)
            means = self._rollouts(problem, mean, plan, increments, disturbance)
            return increments, means, pi.girsanov(plan, increments, weight)

        return draw

    def _laplace(
        self, problem: Problem, mean: Array, schedule: GainSchedule, plan: Array
    ) -> Sampler:
        """Samples from the optimal policy of the expansion about the nominal, some of them about the nominal itself."""
        aim = proposals.reference(problem, plan, self.temperature, self.control_std, self.alpha)
        running, terminal = self._rates(problem)
        cost = ilqr.staged(
            problem.dt,
            lambda mu, k: running(mu, schedule.cov[k]),
            lambda mu: terminal(mu, schedule.cov[-1]),
            self.horizon,
            self.charge,
        )
        fallback = proposals.plain(problem, plan, self.temperature, self.control_std)
        guide = proposals.laplace(cost, problem, schedule.mean, aim, self.temperature, fallback)

        def draw(key: Array, n: int) -> tuple[Array, Array, Array]:
            eps, second = (
                self._normals(key, plan.shape[1], n),
                proposals.about_nominal(n, self.antithetic),
            )
            controls, means, density = proposals.rollouts(
                problem, mean, (guide, fallback), second, eps
            )
            correction = proposals.correction(aim, self.temperature, controls, density)
            return controls - plan[:, :, None], means, correction

        return draw

    def _sees_components(self) -> bool:
        """Whether a mixture is more to it than its mean and covariance."""
        return (self.plan_from, self.evaluate, self.diffusion) == (
            "components",
            "belief",
            "matched",
        )

    def _act_on_mixture(
        self, problem: Problem, belief: MixtureBelief, plan: Array, key: Array
    ) -> tuple[Array, Array, pi.PlanInfo]:
        """The same with every component's means (m, nx) and covariances (m, nx, nx) in the place of one."""
        schedules = jax.vmap(
            lambda mean, root: gain_schedule(problem, RootBelief(mean, root), plan, self.schedule)
        )(belief.means, belief.roots)
        nominal, covs = jnp.swapaxes(schedules.mean, 0, 1), jnp.swapaxes(schedules.cov, 0, 1)
        weight = pi.girsanov_weight(problem, self.temperature, self.control_std, self.alpha)

        def paths(key: Array, n: int) -> tuple[Array, Array, Array]:
            increments, _ = self._sample(problem, schedules, key, n)
            controls = plan[:, :, None] + increments
            means = jax.vmap(lambda mean: pi.rollouts(problem, mean, controls), out_axes=1)(
                belief.means
            )
            costs = self._mixture_costs(problem, belief, means, covs) + pi.girsanov(
                plan, increments, weight
            )
            return increments, costs, jnp.einsum("i,hi...->h...", belief.weights, means)

        change, w, means = pi.weighted_in_blocks(paths, key, self.n_samples, self.temperature)
        improved = plan + change
        nominal_cost = self._mixture_costs(problem, belief, nominal[1:, :, :, None], covs)[0]
        planned = jax.vmap(mixture_covariance, in_axes=(None, 0, 0))(belief.weights, nominal, covs)
        info = pi.PlanInfo(pi.effective_sample_size(w), nominal_cost, planned, means, w)
        return improved[0], self._carry(improved), info

    def _mixture_costs(
        self, problem: Problem, belief: MixtureBelief, means: Array, covs: Array
    ) -> Array:
        """Path costs (N,) for means (H, m, nx, N) along covs (H+1, m, nx, nx)."""
        weights = belief.weights
        starts = jnp.broadcast_to(belief.means[:, :, None], means.shape[1:])

        def running(mus: Array, covs: Array) -> Array:
            return mixture_risk_sensitive(
                problem, weights, mus, covs, self.theta, self.risk, self.expectation
            )

        def terminal(mus: Array, covs: Array) -> Array:
            return mixture_terminal(problem, weights, mus, covs)

        return pi.path_costs(problem, starts, means, covs, self.charge, running, terminal)

    def _rollouts(
        self,
        problem: Problem,
        mean: Array,
        plan: Array,
        increments: Array,
        disturbance: Array | None,
    ) -> Array:
        """Means (H, nx, N): the increments move the control (matched), or the disturbance the mean (innovation)."""
        nominal = jnp.broadcast_to(plan[:, :, None], increments.shape)
        controls = nominal + increments if disturbance is None else nominal
        return pi.rollouts(problem, mean, controls, disturbance)

    def _sample(
        self, problem: Problem, schedule: GainSchedule, key: Array, n: int
    ) -> tuple[Array, Array | None]:
        """Control increments delta (H, nu, N) and, for the innovation diffusion, L eps (H, nx, N)."""
        R, dt = problem.cost.R, problem.dt
        if self.diffusion == "matched":
            increments = pi.matched_increments(
                problem, self._normals(key, len(R), n), self.temperature, self.control_std
            )
            return increments, None
        factors, _ = diffusion_factors(schedule)
        eps = jnp.sqrt(dt) * self._normals(key, factors.shape[-1], n)
        disturbance = jnp.einsum("hij,hjn->hin", factors, eps)
        maps = jax.vmap(lambda mu: pi.control_map(problem.system.G(mu), R))(schedule.mean[:-1])
        return jnp.einsum("hij,hjn->hin", maps, disturbance) / dt, disturbance

    def _normals(self, key: Array, dim: int, n: int) -> Array:
        return pi.normals(key, (self.horizon, dim, n), self.antithetic)

    def _costs(self, problem: Problem, mean: Array, means: Array, covs: Array) -> Array:
        return pi.path_costs(problem, mean, means, covs, self.charge, *self._rates(problem))

    def _rates(self, problem: Problem) -> tuple[Rate, Rate]:
        """Running and terminal cost of a mean (nx,) and covariance (nx, nx)."""

        def running(mu: Array, cov: Array) -> Array:
            if self.evaluate == "mean":
                return certainty_equivalent(problem, mu)
            return risk_sensitive(problem, mu, cov, self.theta, self.risk, self.expectation)

        def terminal(mu: Array, cov: Array) -> Array:
            return (
                problem.cost.terminal(mu)
                if self.evaluate == "mean"
                else expected_terminal(problem, mu, cov)
            )

        return running, terminal

    def _carry(self, improved: Array) -> Array:
        """The warm start; Algorithm 1 as printed starts each step from zero."""
        return jnp.zeros_like(improved) if self.diffusion == "innovation" else pi.receded(improved)
