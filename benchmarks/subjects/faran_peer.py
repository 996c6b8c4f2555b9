"""Adapts faran: MPPI from composable parts, in JAX and in NumPy.

It is set up as its README does, with parts of `faran.jax` or `faran.numpy`, and each step starts
from the nominal of the last. A double integrator is not among its models, so the model is written
like its own integrators: a jitted `lax.scan` in JAX, running sums in NumPy. Its parts are jitted
one by one and joined in Python; running, terminal and control cost are one function here, which
saves calls. faran has no importance term, so the control cost is charged.

"faran_jax_one_jit" compiles the whole step into one program, which is possible but not documented.
NumPy draws in double precision only.
"""

from importlib.metadata import version
from typing import Any

import faran
import faran.jax
import faran.numpy
import jax
import jax.numpy as jnp
import numpy as np

from plant import Planner, Workload


def make(name: str, workload: Workload, dtype: str) -> Planner:
    """Returns the planner of a name."""
    jax.config.update("jax_enable_x64", dtype == "float64")
    jax.config.update("jax_cpu_enable_async_dispatch", False)  # as ours runs
    return {"faran_jax": FaranJax, "faran_jax_one_jit": FaranOneJit, "faran_numpy": FaranNumPy}[
        name
    ](workload, dtype)


def jax_simulate(dt: float) -> Any:
    """Returns faran's JAX integrator: (inputs (T, 2, M), start (4,)) -> states (T, 4, M)."""

    @jax.jit
    def simulate(inputs: jax.Array, start: jax.Array) -> jax.Array:
        def step(state: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array]:
            state = state + dt * jnp.concatenate([state[2:], u])
            return state, state

        return jax.lax.scan(step, jnp.broadcast_to(start[:, None], (4, inputs.shape[-1])), inputs)[
            1
        ]

    return simulate


def numpy_simulate(dt: float) -> Any:
    """Returns the map of `jax_simulate` with running sums, as faran's NumPy integrator does."""

    def simulate(inputs: np.ndarray, start: np.ndarray) -> np.ndarray:
        states = np.empty((len(inputs), 4, inputs.shape[-1]))
        states[:, 2:] = start[2:, None] + np.cumsum(dt * inputs, axis=0)
        states[0, :2] = (start[:2] + dt * start[2:])[:, None]
        states[1:, :2] = states[0, :2] + np.cumsum(dt * states[:-1, 2:], axis=0)
        return states

    return simulate


def stage_costs(xp: Any, workload: Workload) -> Any:
    """Returns the map (states (T, 4, M), inputs (T, 2, M)) -> costs (T, M).

    The terminal cost is added to that of the last step.
    """
    dt = workload["dt"]
    goal = workload["goal"]

    def costs(states: Any, inputs: Any) -> Any:
        squares = [(states[:, i] - goal[i]) ** 2 for i in range(4)]
        rate = sum(0.5 * w * d for w, d in zip(workload["running_weight"], squares, strict=True))
        for px, py in workload["centers"]:
            apart = (states[:, 0] - px) ** 2 + (states[:, 1] - py) ** 2
            rate = rate + workload["w_obs"] * xp.exp(-0.5 / workload["bump_width"] ** 2 * apart)
        rate = rate + sum(
            0.5 * r * inputs[:, i] ** 2 for i, r in enumerate(workload["control_weight"])
        )
        last = sum(
            0.5 * w * d[-1:] for w, d in zip(workload["terminal_weight"], squares, strict=True)
        )
        return xp.concatenate([rate[:-1] * dt, rate[-1:] * dt + last])

    return costs


class Faran(Planner):
    """Implements the planner of one backend, called as in faran's README."""

    def __init__(
        self, workload: Workload, dtype: str, backend: Any, mppi: Any, simulate: Any, costs: Any
    ) -> None:
        super().__init__(workload, dtype)
        self.versions = {name: version(name) for name in ("faran", "jax", "numpy")}
        self.backend = backend
        self.simple = backend.types.simple
        self.mppi = mppi
        self._simulate = simulate
        self._costs = costs
        self.planner = self.planner_with(seed=0)

    def planner_with(self, **randomness: Any) -> Any:
        """Returns a planner whose sampler has the given seed or key."""
        sampler = self.backend.sampler.gaussian(
            standard_deviation=np.full(2, self.workload["control_std"]),
            rollout_count=self.workload["n_samples"],
            to_batch=self.simple.control_input_batch.create,
            **randomness,
        )
        return self.mppi.create(model=self, cost_function=self.costs, sampler=sampler)

    def simulate(self, inputs: Any, initial_state: Any) -> Any:
        """Returns the states of a batch of inputs; faran calls it as a model."""
        return self.simple.state_batch.wrap(self._simulate(inputs.array, initial_state.array))

    def costs(self, *, inputs: Any, states: Any) -> Any:
        """Returns the costs of a batch of paths; faran calls it as a cost function."""
        return self.simple.costs(self._costs(states.array, inputs.array))

    def reset(self) -> None:
        self.nominal = self.simple.control_input_sequence.zeroes(
            horizon=self.workload["horizon"], dimension=2
        )

    def observe(self, x: list[float]) -> Any:
        return self.simple.state.create(np.array(x))

    def act(self, state: Any) -> Any:
        result = self.planner.step(
            temperature=self.workload["temperature"],
            nominal_input=self.nominal,
            initial_state=state,
        )
        self.nominal = result.nominal
        return jax.block_until_ready((result.optimal.array, result.nominal.array))[0]

    def control(self, result: Any) -> list[float]:
        return result[0].tolist()


class FaranNumPy(Faran):
    """Implements the planner of the NumPy backend."""

    settings = "NumPyMppi with a Gaussian sampler, as in its README"

    def __init__(self, workload: Workload, dtype: str) -> None:
        parts = numpy_simulate(workload["dt"]), stage_costs(np, workload)
        super().__init__(workload, dtype, faran.numpy, faran.NumPyMppi, *parts)


class FaranJax(Faran):
    """Implements the planner of the JAX backend, its parts jitted one by one."""

    settings = "JaxMppi with a Gaussian sampler, parts jitted one by one, as in its README"

    def __init__(self, workload: Workload, dtype: str) -> None:
        parts = jax_simulate(workload["dt"]), jax.jit(stage_costs(jnp, workload))
        super().__init__(workload, dtype, faran.jax, faran.JaxMppi, *parts)


class FaranOneJit(FaranJax):
    """Implements the planner of the JAX backend, the whole step in one program."""

    settings = "JaxMppi, the whole step in one jit (not in its documentation)"

    def __init__(self, workload: Workload, dtype: str) -> None:
        super().__init__(workload, dtype)

        @jax.jit
        def step(
            key: jax.Array, nominal: Any, x: jax.Array
        ) -> tuple[jax.Array, jax.Array, jax.Array]:
            planner = self.planner_with(key=key)
            sequence = self.simple.control_input_sequence(nominal)
            state = self.simple.state(x)
            result = planner.step(
                temperature=workload["temperature"], nominal_input=sequence, initial_state=state
            )
            return planner.sampler.key, result.nominal.array, result.optimal.array

        self.program = step
        self.key = jax.random.key(0)

    def reset(self) -> None:
        self.nominal = jnp.zeros((self.workload["horizon"], 2))

    def act(self, state: Any) -> Any:
        self.key, self.nominal, controls = jax.block_until_ready(
            self.program(self.key, self.nominal, state.array)
        )
        return controls
