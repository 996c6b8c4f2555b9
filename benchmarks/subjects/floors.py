"""Measures the floors of our controllers: what no planner of this kind can do without.

Each floor is one compiled program of our code. Its result is summed, so that large arrays need not
leave it. The parts are the normals of all samples (half of them where the controller mirrors them),
the bare rollouts of their controls, and the schedule of covariances along a nominal. "floor_ce" is
normals and rollouts together, "floor_belief" these and one schedule, "floor_pipf" normals and
rollouts of the samples of all particles. EKF-iLQG has no floor here, since its work depends on the
number of iterations.
"""

import time

from plant import WARM_UP, Workload
from subjects.ours import config_of, versions

import jax  # isort: skip  the environment that `ours` sets must be there before JAX starts
import jax.numpy as jnp

from mppi_belief.belief.prior import prior
from mppi_belief.belief.schedule import gain_schedule
from mppi_belief.numerics.normals import standard_normal
from mppi_belief.planning.path_integral import rollouts
from mppi_belief.trial import build

PARTS = {
    "normals": ("ce", ("normals",)),
    "rollout": ("ce", ("rollout",)),
    "schedule": ("belief", ("schedule",)),
    "floor_ce": ("ce", ("normals", "rollout")),
    "floor_belief": ("belief", ("normals", "rollout", "schedule")),
    "floor_pipf": ("pipf", ("normals", "rollout")),
}


def make(name: str, workload: Workload, dtype: str) -> "Floor":
    """Returns the floor of a name."""
    return Floor(name, dtype)


class Floor:
    """Computes parts of a controller's step."""

    settings = "one compiled program"

    def __init__(self, name: str, dtype: str) -> None:
        controller, self.parts = PARTS[name]
        config = config_of(controller, dtype)
        self.x64 = dtype == "float64"
        self.versions = versions()
        with jax.enable_x64(self.x64):
            self.problem, filter, self.controller = jax.device_put(build(config))
            samples = self.controller.n_samples * getattr(filter, "n_particles", 1)
            self.drawn = (samples + 1) // 2 if self.controller.sampler.antithetic else samples
            self.plan = self.controller.init(self.problem)
            self.controls = jax.random.normal(jax.random.key(1), (*self.plan.shape, samples))
            self.program = jax.jit(self._program)

    def _program(self, plan: jax.Array, controls: jax.Array, key: jax.Array) -> list[jax.Array]:
        """Returns the sum of the result of each part."""
        belief = prior(self.problem)
        sums = []
        if "normals" in self.parts:
            normals = standard_normal(key, (*plan.shape, self.drawn))
            half = self.drawn < controls.shape[-1]
            controls = (
                jnp.concatenate([normals, -normals], axis=-1)[..., : controls.shape[-1]]
                if half
                else normals
            )
            sums.append(jnp.sum(controls))
        if "rollout" in self.parts:
            sums.append(jnp.sum(rollouts(self.problem, belief.mean, plan[:, :, None] + controls)))
        if "schedule" in self.parts:
            sums.append(
                jnp.sum(
                    gain_schedule(self.problem, belief, plan, self.controller.schedule.method).cov
                )
            )
        return sums

    def time(self, calls: int) -> list[float]:
        """Returns the seconds of single calls."""
        with jax.enable_x64(self.x64):
            return [self._timed(k) for k in range(WARM_UP + calls)][WARM_UP:]

    def _timed(self, k: int) -> float:
        """Returns the seconds of call k."""
        key = jax.block_until_ready(jax.random.fold_in(jax.random.key(0), k))
        started = time.perf_counter()
        jax.block_until_ready(self.program(self.plan, self.controls, key))
        return time.perf_counter() - started

    def closed_loop(self) -> dict[str, float]:
        """Returns nothing to judge, since a floor controls nothing."""
        return {}
