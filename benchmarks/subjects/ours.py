"""Times the controllers of mppi-belief as its own Time column does
(`mppi_belief.trial.time_steps`).

The step is compiled and runs in closed loop with measurements and a filter, which are not timed.
The state comes as a JAX array, and the clock waits for the control and for the next plan.
"""

import os
from importlib.metadata import version

from mppi_belief.config import environment

environment.prepare()

import jax  # the environment must be set before JAX starts
import jax.numpy as jnp

from mppi_belief.config.compose import collect
from mppi_belief.config.request import Request
from mppi_belief.numerics.jax_settings import pin_jax_settings
from mppi_belief.trial import build, time_steps
from plant import WARM_UP, Workload, judge, plant_step
from workload import SCENE

# JAX keeps the dispatch that it starts with, so this precedes the first computation.
pin_jax_settings()


def make(name: str, workload: Workload, dtype: str) -> "Controller":
    """Returns the controller of a name."""
    return Controller(name, workload, dtype)


def config_of(controller: str, dtype: str) -> dict:
    """Returns the configuration that `mppi-belief run controller=... precision=...` runs."""
    (config,) = collect(Request((*SCENE, f"controller={controller}", f"precision={dtype}")))
    return config


def versions() -> dict[str, str]:
    """Returns the versions of this package, JAX and NumPy."""
    return {name: version(name) for name in ("mppi-belief", "jax", "numpy")}


class Controller:
    """Measures a controller of `conf/controller`."""

    def __init__(self, name: str, workload: Workload, dtype: str) -> None:
        self.config = config_of(name, dtype)
        self.workload = workload
        self.versions = versions()
        self.settings = f"as configured; XLA_FLAGS={os.environ['XLA_FLAGS']}"

    def time(self, calls: int) -> list[float]:
        """Returns the seconds of single control steps."""
        return time_steps(self.config, WARM_UP + calls)[WARM_UP:]

    def closed_loop(self) -> dict[str, float]:
        """Runs a trial without noise from the prior mean and judges it.

        The filter is given the measurement that it expects there.
        """
        with jax.enable_x64(self.config["precision"] == "float64"):
            problem, filter, controller = build(self.config)
            act = jax.jit(lambda belief, plan, key: controller.act(problem, belief, plan, key)[:2])
            update = jax.jit(lambda belief, u, y, key: filter.update(problem, belief, u, y, key))
            key = jax.random.key(0)
            path = [self.workload["start"]]
            belief = filter.init(problem, key)
            plan = controller.init(problem)
            for k in range(self.workload["steps"]):
                u, plan = act(belief, plan, jax.random.fold_in(key, 2 * k))
                path.append(plant_step(self.workload, path[-1], u.tolist()))
                y = problem.system.c(jnp.array(path[-1]))
                belief = update(belief, u, y, jax.random.fold_in(key, 2 * k + 1))
        return judge(self.workload, path)
