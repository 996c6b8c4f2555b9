"""Adapts jax_mppi: MPPI as pure functions.

It is set up as its README advises "for performance": `jax.jit(mppi.command)` with static cost and
dynamics functions. It rolls out one sample at a time under `vmap` and charges a step's start. Its
importance term is 1/2 eps' Sigma^-1 eps, without the nominal. The configuration is static too (its
fields are plain numbers).
"""

from functools import partial
from importlib.metadata import version

import jax
import jax.numpy as jnp
from jax_mppi import mppi

from plant import Planner, Workload


def make(name: str, workload: Workload, dtype: str) -> Planner:
    """Returns the planner."""
    return JaxMppi(workload, dtype)


class JaxMppi(Planner):
    """Implements MPPI by `jax_mppi.mppi.command`."""

    settings = "jax.jit(mppi.command), functions static"

    def __init__(self, workload: Workload, dtype: str) -> None:
        super().__init__(workload, dtype)
        jax.config.update("jax_enable_x64", dtype == "float64")
        jax.config.update("jax_cpu_enable_async_dispatch", False)  # as ours runs
        self.versions = {name: version(name) for name in ("jax-mppi", "jax", "numpy")}
        self.config, self.first = mppi.create(
            nx=4,
            nu=2,
            noise_sigma=jnp.eye(2) * workload["control_std"] ** 2,
            num_samples=workload["n_samples"],
            horizon=workload["horizon"],
            lambda_=workload["temperature"],
        )
        dynamics, running, terminal = functions(workload)
        command = partial(
            mppi.command, dynamics=dynamics, running_cost=running, terminal_cost=terminal
        )
        self.command = jax.jit(command, static_argnums=0)

    def reset(self) -> None:
        self.state = self.first

    def observe(self, x: list[float]) -> jax.Array:
        return jax.block_until_ready(jnp.array(x))

    def act(self, state: jax.Array) -> jax.Array:
        u, self.state = jax.block_until_ready(self.command(self.config, self.state, state))
        return u

    def control(self, result: jax.Array) -> list[float]:
        return result.tolist()


def functions(workload: Workload) -> tuple:
    """Returns dynamics, running and terminal cost of one state (4,) and action (2,)."""
    dt = workload["dt"]
    goal = jnp.array(workload["goal"])
    weight = jnp.array(workload["running_weight"])
    last_weight = jnp.array(workload["terminal_weight"])
    centers = jnp.array(workload["centers"])

    def dynamics(x: jax.Array, u: jax.Array) -> jax.Array:
        return x + dt * jnp.concatenate([x[2:], u])

    def running(x: jax.Array, u: jax.Array) -> jax.Array:
        squared = jnp.sum((x[:2] - centers) ** 2, axis=-1)
        bumps = jnp.sum(jnp.exp(-0.5 / workload["bump_width"] ** 2 * squared))
        return dt * (0.5 * jnp.sum(weight * (x - goal) ** 2) + workload["w_obs"] * bumps)

    def terminal(x: jax.Array, u: jax.Array) -> jax.Array:
        return 0.5 * jnp.sum(last_weight * (x - goal) ** 2)

    return dynamics, running, terminal
