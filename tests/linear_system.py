"""A linear system of any size, for tests that have a closed form."""

import jax.numpy as jnp
import numpy as np
from jax import Array

import mppi_belief as mb


@mb.struct
class Linear:
    """dx = (A x + B u) dt + H dw, measured through C with standard deviations `noise` of each sample."""

    A: Array = mb.array(ndim=2)
    B: Array = mb.array(ndim=2)
    C: Array = mb.array(ndim=2)
    channel: Array = mb.array(ndim=2)
    noise: Array = mb.array(ndim=1)
    noise_convention: str = mb.choice("sample", "intensity")

    @property
    def H(self) -> Array:
        return jnp.asarray(self.channel)

    def f(self, x: Array) -> Array:
        return jnp.asarray(self.A) @ x

    def G(self, x: Array) -> Array:
        return jnp.asarray(self.B)

    def c(self, x: Array) -> Array:
        return jnp.asarray(self.C) @ x

    def sigma_o(self, x: Array) -> Array:
        return jnp.diag(jnp.asarray(self.noise))

    def position(self, x: Array) -> Array:
        return x

    def clearance(self, x: Array) -> Array:
        return jnp.asarray(jnp.inf)


def random_problem(rng: np.random.Generator, nx: int = 3, nu: int = 2, steps: int = 12) -> mb.Problem:
    """A random linear-quadratic problem without obstacles, its goal not an equilibrium."""
    system = Linear(rng.normal(size=(nx, nx)), rng.normal(size=(nx, nu)), np.eye(1, nx), 0.2 * np.eye(nx), [0.3])
    running, terminal, control = (np.diag(rng.uniform(0.5, 2, n)) for n in (nx, nx, nu))
    cost = mb.GoalObstacleCost(rng.normal(size=nx), running, terminal, control, mb.Obstacles([], 0), 0, 1)
    return mb.Problem(system, cost, rng.normal(size=nx), np.full(nx, 0.1), dt=0.1, steps=steps)


def lqr(problem: mb.Problem, start: np.ndarray, charged: np.ndarray) -> np.ndarray:
    """Optimal controls (H, nu) from `start` by one dense least-squares solve: no recursion at all."""
    system, cost, dt = problem.system, problem.cost, problem.dt
    nx, nu, horizon = len(start), cost.R.shape[0], len(charged) - 1
    F, B = np.eye(nx) + dt * np.asarray(system.A), dt * np.asarray(system.B)
    free = np.concatenate([np.linalg.matrix_power(F, k) @ start - cost.goal for k in range(horizon + 1)])
    forced = np.zeros(((horizon + 1) * nx, horizon * nu))
    for k in range(1, horizon + 1):
        for j in range(k):
            forced[k * nx : (k + 1) * nx, j * nu : (j + 1) * nu] = np.linalg.matrix_power(F, k - 1 - j) @ B
    weight = np.kron(np.diag(charged), dt * np.asarray(cost.running_weight))
    weight[-nx:, -nx:] += np.asarray(cost.terminal_weight)
    R = np.kron(np.eye(horizon), dt * np.asarray(cost.control_weight))
    return np.linalg.solve(forced.T @ weight @ forced + R, -forced.T @ weight @ free).reshape(horizon, nu)
