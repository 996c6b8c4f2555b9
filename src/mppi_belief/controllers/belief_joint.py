"""MPPI-Belief with a covariance for every sampled path: each carries the filter's own recursion along itself.

    minimise  E[ phi(mu_H, Sigma_H) + sum_k ( q_RS(mu_k, Sigma_k) + 1/2 u_k' R u_k ) dt ]

over controls, where Sigma_k is what the filter will have made of the prior along mu_0..mu_k, not along one
nominal for all (Assumption 1). A path to where the sensor is good is then charged for the smaller covariance that it
leads to, so that detours for information can be planned. docs/beyond/belief_joint.md says what it optimises.
"""

import jax
import jax.numpy as jnp
from jax import Array

from ..belief.cost import expected_terminal, risk_sensitive
from ..belief.gaussian import RootBelief, covariance, covariance_root
from ..belief.kalman import filter_step
from ..belief.schedule import gain_schedule
from ..numerics.scalarized import vmap_scalarized
from ..planning import path_integral as pi
from ..problem import Belief, Problem
from ..structs import choice, number, size, struct


@struct
class JointBelief:
    """Sampling planner on the belief; settings as in `MPPIBelief`, the diffusion is the matched one."""

    n_samples: int = size(500)
    horizon: int = size(30)
    temperature: float = number(1.0, gt=0)
    control_std: float | None = number(None, gt=0, optional=True)
    alpha: float | None = number(None, ge=0, le=1, optional=True)
    antithetic: bool = choice(False, True)
    theta: float = number(0.0, ge=0)
    risk: str = choice("penalty", "total")
    expectation: str = choice("exact", "at_mean")
    charge: str = choice("end", "start")

    def init(self, problem: Problem) -> Array:
        """The zero nominal (H, nu)."""
        return jnp.zeros((self.horizon, problem.cost.R.shape[0]))

    def act(
        self, problem: Problem, belief: Belief | RootBelief, plan: Array, key: Array
    ) -> tuple[Array, Array, pi.PlanInfo]:
        """The control (nu,), the nominal shifted by one step (H, nu), diagnostics."""
        start = RootBelief(belief.mean, covariance_root(belief))
        weight = pi.girsanov_weight(problem, self.temperature, self.control_std, self.alpha)

        def paths(key: Array, n: int) -> tuple[Array, Array, Array]:
            normals = pi.normals(key, (self.horizon, plan.shape[1], n), self.antithetic)
            increments = pi.matched_increments(problem, normals, self.temperature, self.control_std)
            costs, means = self.state_costs(problem, start, plan[:, :, None] + increments)
            return increments, costs + pi.girsanov(plan, increments, weight), means

        change, w, means = pi.weighted_in_blocks(paths, key, self.n_samples, self.temperature)
        improved = plan + change
        nominal_cost = self.state_costs(problem, start, plan[:, :, None])[0][0]
        planned = gain_schedule(problem, start, plan).cov
        info = pi.PlanInfo(pi.effective_sample_size(w), nominal_cost, planned, means, w)
        return improved[0], pi.receded(improved), info

    def state_costs(
        self, problem: Problem, start: RootBelief, controls: Array
    ) -> tuple[Array, Array]:
        """State costs (N,) and means (H, nx, N) of the paths that controls (H, nu, N) lead along."""
        samples = controls.shape[-1]

        def running(mean: Array, cov: Array) -> Array:
            return risk_sensitive(problem, mean, cov, self.theta, self.risk, self.expectation)

        move = vmap_scalarized(
            lambda mean, root, u: filter_step(problem, mean, root, u)[:2], (True, True, True)
        )
        spread = vmap_scalarized(covariance, (True,))
        charged = vmap_scalarized(running, (True, True))

        def advance(
            at: tuple[Array, Array, Array], u: Array
        ) -> tuple[tuple[Array, Array, Array], Array]:
            mean, root, total = at
            # the barriers keep XLA from computing the filter anew for every term of the cost
            after = jax.lax.optimization_barrier(move(mean, root, u))
            seen = after if self.charge == "end" else (mean, root)
            rate = charged(seen[0], jax.lax.optimization_barrier(spread(seen[1])))
            return (*after, total + rate * problem.dt), after[0]

        mean, root = (jnp.broadcast_to(part[..., None], (*part.shape, samples)) for part in start)
        (mean, root, total), means = jax.lax.scan(
            advance, (mean, root, jnp.zeros(samples)), controls
        )
        last = vmap_scalarized(
            lambda mean, root: expected_terminal(problem, mean, covariance(root)), (True, True)
        )
        return total + last(mean, root), means
