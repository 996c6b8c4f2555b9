"""Adapts crocoddyl: DDP beside our EKF-iLQG, both replanned to convergence at every step.

Each step starts from the last plan, shifted. Everything is in crocoddyl's C++ models, as its
documentation advises, with no Python in the solver: a unit mass on two sliding joints (Pinocchio),
quadratic costs, and obstacles as `ActivationModelQuadFlatExp`, 1 - exp(-r^2 / alpha), of negative
weight, which is a Gaussian bump less a constant. Its Euler step moves the position with the new
velocity, not the old one; the plans differ by that. With a tighter stopping threshold the control
changes by less than 0.1 %. Double precision only.
"""

from importlib.metadata import version

import crocoddyl
import numpy as np
import pinocchio as pin

from plant import Planner, Workload

THRESHOLD = 1e-5
ITERATIONS = 50


def make(name: str, workload: Workload, dtype: str) -> Planner:
    """Returns the planner."""
    return Crocoddyl(workload, dtype)


class Crocoddyl(Planner):
    """Implements DDP by crocoddyl's `SolverDDP`."""

    settings = f"SolverDDP, C++ models, th_stop={THRESHOLD}, warm start shifted"

    def __init__(self, workload: Workload, dtype: str) -> None:
        super().__init__(workload, dtype)
        self.versions = {name: version(name) for name in ("crocoddyl", "pin")}
        self.solver = solver(workload)

    def reset(self) -> None:
        self.controls = [np.zeros(2)] * self.workload["horizon"]

    def observe(self, x: list[float]) -> np.ndarray:
        return np.array(x)

    def act(self, state: np.ndarray) -> np.ndarray:
        self.solver.problem.x0 = state
        self.solver.solve(
            self.solver.problem.rollout(self.controls), self.controls, ITERATIONS, True
        )
        controls = list(self.solver.us)
        self.controls = [*controls[1:], np.zeros(2)]
        return controls[0]

    def control(self, result: np.ndarray) -> list[float]:
        return result.tolist()


def solver(workload: Workload) -> crocoddyl.SolverDDP:
    """Returns the receding-horizon problem, each state but the first charged as by our planners."""
    state = point_mass()
    dt = workload["dt"]
    effort = {"effort": control_cost(state, workload)}
    rate = state_costs(state, workload)
    last = {name: (cost, weight * dt) for name, (cost, weight) in rate.items()}
    last["goal at the end"] = quadratic(state, workload["goal"], workload["terminal_weight"]), 1.0
    first, running, end = (
        crocoddyl.IntegratedActionModelEuler(dynamics(state, costs), step)
        for costs, step in ((effort, dt), (effort | rate, dt), (last, 0.0))
    )
    middle = [running] * (workload["horizon"] - 1)
    ddp = crocoddyl.SolverDDP(
        crocoddyl.ShootingProblem(np.array(workload["start"]), [first, *middle], end)
    )
    ddp.th_stop = THRESHOLD
    ddp.problem.nthreads = 1
    return ddp


def point_mass() -> crocoddyl.StateMultibody:
    """Returns a unit mass in the plane: its centre of mass is its position."""
    model = pin.Model()
    here = pin.SE3.Identity()
    slider = model.addJoint(
        model.addJoint(0, pin.JointModelPX(), here, "x"), pin.JointModelPY(), here, "y"
    )
    model.appendBodyToJoint(slider, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), here)
    model.gravity.setZero()
    return crocoddyl.StateMultibody(model)


def dynamics(
    state: crocoddyl.StateMultibody, costs: dict
) -> crocoddyl.DifferentialActionModelFreeFwdDynamics:
    """Returns the dynamics of the point mass with a sum of costs."""
    total = crocoddyl.CostModelSum(state, 2)
    for name, (cost, weight) in costs.items():
        total.addCost(name, cost, weight)
    model = crocoddyl.DifferentialActionModelFreeFwdDynamics(
        state, crocoddyl.ActuationModelFull(state), total
    )
    model.armature = np.zeros(2)  # given, it has all terms computed, the centre of mass too
    return model


def quadratic(
    state: crocoddyl.StateMultibody, goal: list[float], weight: list[float]
) -> crocoddyl.CostModelResidual:
    """Returns the quadratic cost of the distance of a state from the goal."""
    activation = crocoddyl.ActivationModelWeightedQuad(np.array(weight))
    residual = crocoddyl.ResidualModelState(state, np.array(goal), 2)
    return crocoddyl.CostModelResidual(state, activation, residual)


def control_cost(state: crocoddyl.StateMultibody, workload: Workload) -> tuple:
    """Returns the quadratic control cost and its weight 1."""
    activation = crocoddyl.ActivationModelWeightedQuad(np.array(workload["control_weight"]))
    return crocoddyl.CostModelResidual(
        state, activation, crocoddyl.ResidualModelControl(state, 2)
    ), 1.0


def state_costs(state: crocoddyl.StateMultibody, workload: Workload) -> dict:
    """Returns cost and weight of each part of the running cost by its name."""
    costs = {"goal": (quadratic(state, workload["goal"], workload["running_weight"]), 1.0)}
    for i, center in enumerate(workload["centers"]):
        residual = crocoddyl.ResidualModelCoMPosition(state, np.array([*center, 0.0]), 2)
        activation = crocoddyl.ActivationModelQuadFlatExp(3, 2 * workload["bump_width"] ** 2)
        costs[f"obstacle {i}"] = (
            crocoddyl.CostModelResidual(state, activation, residual),
            -workload["w_obs"],
        )
    return costs
