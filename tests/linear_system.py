"""Makes linear systems of any size, for tests that have a closed form."""

import numpy as np

import mppi_belief as mb


def random_problem(
    rng: np.random.Generator, nx: int = 3, nu: int = 2, steps: int = 12
) -> mb.Problem:
    """Returns a random linear-quadratic problem whose goal is not an equilibrium."""
    A = rng.normal(size=(nx, nx))
    B = rng.normal(size=(nx, nu))
    system = mb.Linear(A, B, np.eye(1, nx), 0.2 * np.eye(nx), [0.3])
    running, terminal, control = (np.diag(rng.uniform(0.5, 2, n)) for n in (nx, nx, nu))
    cost = mb.GoalObstacleCost(rng.normal(size=nx), running, terminal, control)
    return mb.Problem(system, cost, rng.normal(size=nx), np.full(nx, 0.1), dt=0.1, steps=steps)


def lqr(problem: mb.Problem, start: np.ndarray, charged: np.ndarray) -> np.ndarray:
    """Returns the optimal controls (H, nu) from `start` by one dense least-squares solve."""
    system = problem.system
    cost = problem.cost
    dt = problem.dt
    nx = len(start)
    nu = cost.R.shape[0]
    horizon = len(charged) - 1
    F = np.eye(nx) + dt * np.asarray(system.A)
    B = dt * np.asarray(system.B)
    free = np.concatenate(
        [np.linalg.matrix_power(F, k) @ start - cost.goal for k in range(horizon + 1)]
    )
    forced = np.zeros(((horizon + 1) * nx, horizon * nu))
    for k in range(1, horizon + 1):
        for j in range(k):
            forced[k * nx : (k + 1) * nx, j * nu : (j + 1) * nu] = (
                np.linalg.matrix_power(F, k - 1 - j) @ B
            )
    weight = np.kron(np.diag(charged), dt * np.asarray(cost.running_weight))
    weight[-nx:, -nx:] += np.asarray(cost.terminal_weight)
    R = np.kron(np.eye(horizon), dt * np.asarray(cost.control_weight))
    return np.linalg.solve(forced.T @ weight @ forced + R, -forced.T @ weight @ free).reshape(
        horizon, nu
    )
