"""The trajectory optimiser against Crocoddyl's DDP: the same optimum of a nonlinear problem,
written twice.

Crocoddyl is large, so this test has an environment and a target of its own: `make test-solver`.
"""

import crocoddyl
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from mppi_belief.planning import ilqr

DT = 0.05
HORIZON = 40
R = 0.1
QX = np.array([2.0, 0.2])
QT = np.array([20.0, 2.0])
SETTINGS = ilqr.ILQRSettings(
    tolerance=1e-12, max_iterations=300, damping=1e-6, damping_factor=4.0, damping_max=1e8
)


@mb.struct
class Pendulum:
    """theta'' = sin(theta) - 0.1 theta' + u, seen without error in this test."""

    @property
    def H(self):
        return jnp.zeros((2, 1))

    def f(self, x):
        return jnp.stack([x[1], jnp.sin(x[0]) - 0.1 * x[1]])

    def G(self, x):
        return jnp.array([[0.0], [1.0]])

    def c(self, x):
        return x

    def sigma_o(self, x):
        return jnp.eye(2)


class PendulumAction(crocoddyl.ActionModelAbstract):
    """One Euler step in plain NumPy; derivatives are left to Crocoddyl's finite differences."""

    def __init__(self, weight: np.ndarray, moves: bool) -> None:
        crocoddyl.ActionModelAbstract.__init__(self, crocoddyl.StateVector(2), 1, 3)
        self.weight = weight
        self.moves = moves

    def calc(self, data, x, u=None):
        effort = 0.0 if u is None else 0.5 * R * DT * float(u[0]) ** 2
        data.cost = 0.5 * float(self.weight @ (x * x)) + effort
        if self.moves and u is not None:
            data.xnext = x + DT * np.array([x[1], np.sin(x[0]) - 0.1 * x[1] + u[0]])
        else:
            data.xnext = x


def crocoddyl_optimum(start: np.ndarray) -> tuple[float, np.ndarray]:
    first, running, last = (
        crocoddyl.ActionModelNumDiff(PendulumAction(weight, moves))
        for weight, moves in ((0 * QX, True), (DT * QX, True), (DT * QX + QT, False))
    )
    solver = crocoddyl.SolverDDP(
        crocoddyl.ShootingProblem(start, [first] + [running] * (HORIZON - 1), last)
    )
    solver.th_stop = 1e-14
    solver.solve([], [], 500)
    return solver.cost, np.array(list(solver.us))


@pytest.mark.parametrize("start", [[2.5, 0.0], [1.0, -2.0], [-3.0, 1.0]])
def test_both_find_the_same_optimum(start):
    jax.config.update("jax_enable_x64", True)
    cost = mb.GoalObstacleCost([0, 0], QX, QT, [R])
    problem = mb.Problem(Pendulum(), cost, start, [0, 0], DT, HORIZON)
    objective = ilqr.state_cost(problem, cost.base, HORIZON, True)
    computed = ilqr.solve(
        problem, objective, ilqr.uncontrolled(problem, HORIZON), jnp.asarray(start), SETTINGS
    )
    value, controls = crocoddyl_optimum(np.array(start))
    assert computed.converged
    np.testing.assert_allclose(computed.cost, value, rtol=1e-4)
    np.testing.assert_allclose(
        computed.policy.controls, controls, atol=1e-3 * np.abs(controls).max()
    )
