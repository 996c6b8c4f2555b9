"""Paths of the belief mean as the measurements will move it: Algorithm 1 as printed (line 8).

    mu_{k+1} = mu_k + (f(mu_k) + G nominal_k) dt + L_k eps_k,   L_k L_k' = D_k,   eps_k ~ N(0, I dt)

No control leads along such a path; the increment delta_k = R^-1 G' (G R^-1 G')^+ L_k eps_k / dt is
the one that comes closest to it (Theorem 6). Each step starts from the zero nominal, as printed.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jax import Array

from ...belief.schedule import diffusion_factors
from ...problem import Problem
from ...structs import choice, struct
from ..parts import Draw, DrawnPaths, PathCost, PlannedBelief
from ..path_integral import control_map, girsanov, girsanov_weight, normals, rollouts


@struct
class InnovationSampler:
    """Draws paths of the belief mean with the innovation diffusion D_k.

    Fields:
        antithetic: draw mirrored pairs: half the normals, less variance
    """

    antithetic: bool = choice(False, True, default=False)

    disturbs_mean: ClassVar[bool] = True

    def prepare(
        self,
        problem: Problem,
        path_cost: PathCost,
        planned: PlannedBelief,
        nominal: Array,
        temperature: Array | float,
    ) -> Draw:
        """Returns a function that draws paths about those of the nominal controls (H, nu)."""
        schedule = planned.moments.schedule
        R = problem.cost.R
        weight = girsanov_weight(problem, temperature, None, None)

        def draw(key: Array, n: int) -> DrawnPaths:
            factors, _ = diffusion_factors(schedule)
            eps = jnp.sqrt(problem.dt) * normals(
                key, (len(nominal), factors.shape[-1], n), self.antithetic
            )
            disturbance = jnp.einsum("hij,hjn->hin", factors, eps)

            # The controls that come closest to these disturbances.
            maps = jax.vmap(lambda mu: control_map(problem.system.G(mu), R))(schedule.mean[:-1])
            increments = jnp.einsum("hij,hjn->hin", maps, disturbance) / problem.dt

            controls = jnp.broadcast_to(nominal[:, :, None], increments.shape)
            means = rollouts(problem, schedule.mean[0], controls, disturbance)
            return DrawnPaths(increments, means, girsanov(nominal, increments, weight))

        return draw

    def warm_start(self, improved: Array) -> Array:
        """Returns the zero nominal (H, nu)."""
        return jnp.zeros_like(improved)
