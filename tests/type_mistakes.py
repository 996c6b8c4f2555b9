"""Mistakes of users, which type checkers must find: `test_types.py` compares line by line.

A comment names the error of mypy and that of pyright. The program is never run.
"""

import jax.numpy as jnp
from jax import Array

import mppi_belief as mb
from mppi_belief import Nobody  # mypy: attr-defined, pyright: reportAttributeAccessIssue
from mppi_belief.controllers import MPPI
from mppi_belief.systems import LightDark


@mb.struct
class Boat:
    radar: mb.ArrayField = mb.array(ndim=1)
    shore: mb.OptionalArrayField = mb.array(default=None, ndim=1, optional=True)
    speed: float = mb.number(default=1.0, ge=0)
    crew: int = mb.size(default=2)
    sail: str = mb.choice("main", "jib", default="main")


@mb.struct
class Wrong:
    positional: float = mb.number(1.0)  # mypy: call-overload, pyright: reportCallIssue
    misspelt: float = mb.number(least=0)  # mypy: call-overload, pyright: reportCallIssue
    text: str = mb.number()  # mypy: assignment, pyright: reportAssignmentType
    count: str = mb.size()  # mypy: assignment, pyright: reportAssignmentType
    axes: int = mb.indices()  # mypy: assignment, pyright: reportAssignmentType
    mode: int = mb.choice("a", "b")  # mypy: assignment, pyright: reportAssignmentType
    missing: float = mb.number(default=None)  # mypy: call-overload, pyright: reportArgumentType
    free: mb.ArrayField = mb.array()  # mypy: call-arg, pyright: reportCallIssue


# Names that are not there.
print(mb.nothing_at_all)  # mypy: attr-defined, pyright: reportAttributeAccessIssue
mb.MPPIBelief()  # mypy: attr-defined, pyright: reportAttributeAccessIssue
print(Nobody)

# Arguments that are not there, that are missing, or of the wrong type.
mb.MPPI(thetaa=1)  # mypy: call-arg, pyright: reportCallIssue
MPPI(thetaa=1)  # mypy: call-arg, pyright: reportCallIssue
mb.MPPI(n_samples=0.5)  # mypy: arg-type, pyright: reportArgumentType
mb.MPPI(path_cost="risk")  # mypy: arg-type, pyright: reportArgumentType
mb.MPPI(sampler=mb.RiskSensitive())  # mypy: arg-type, pyright: reportArgumentType
mb.MPPI(schedule=mb.NominalSampler())  # mypy: arg-type, pyright: reportArgumentType
mb.RiskSensitive(theta="high")  # mypy: arg-type, pyright: reportArgumentType
mb.NominalSampler(control_std=[1.0])  # mypy: arg-type, pyright: reportArgumentType
mb.ParticleFilter(n_particles="many")  # mypy: arg-type, pyright: reportArgumentType
mb.Obstacles("here", 1)  # mypy: arg-type, pyright: reportArgumentType
mb.Obstacles(centers=3, radius=1)  # mypy: arg-type, pyright: reportArgumentType
mb.Obstacles(centers=[[3, 1]])  # mypy: call-arg, pyright: reportCallIssue
mb.LightDark()  # mypy: call-arg, pyright: reportCallIssue
LightDark()  # mypy: call-arg, pyright: reportCallIssue
mb.GoalObstacleCost([7, 0], [1, 1], [1, 1])  # mypy: call-arg, pyright: reportCallIssue

# A problem of the wrong parts.
discs = mb.Obstacles(centers=[[3, 1], [3, -1]], radius=1)
system = mb.LightDark(process_noise=0.3, light=5, noise_slope=1, noise_floor=0.1)
cost = mb.GoalObstacleCost([7, 0, 0, 0], [1] * 4, [1] * 4, [1, 1], obstacle_penalty=mb.Hinge(0.3))
problem = mb.Problem(system, cost, [0] * 4, [1] * 4, dt=0.1, steps=6, obstacles=discs)
mb.Problem(cost, system, [0] * 4, [1] * 4, 0.1, 6)  # mypy: arg-type, pyright: reportArgumentType
mb.Problem(system, cost, [0] * 4, [1] * 4, 0.1)  # mypy: call-arg, pyright: reportCallIssue
mb.Problem(system, cost, None, [1] * 4, 0.1, 6)  # mypy: arg-type, pyright: reportArgumentType
mb.simulate_trial(problem, mb.MPPI(), mb.EKF(), 0, 0)  # mypy: arg-type, pyright: reportArgumentType
mb.metrics(problem)  # mypy: call-arg, pyright: reportCallIssue

# Results that are not what they are taken for.
trial = mb.simulate_trial(problem, mb.EKF(), mb.MPPI(), 0, 0)
print(trial.state)  # mypy: attr-defined, pyright: reportAttributeAccessIssue
print(mb.metrics(problem, trial).costs)  # mypy: attr-defined, pyright: reportAttributeAccessIssue
name: str = cost.goal  # mypy: assignment, pyright: reportAssignmentType
cost.goal = jnp.zeros(4)  # mypy: misc, pyright: reportAttributeAccessIssue

# A struct of the user's own.
boat = Boat([3.0, 0.0])
goal: Array = boat.radar
Boat()  # mypy: call-arg, pyright: reportCallIssue
Boat(radar=None)  # mypy: arg-type, pyright: reportArgumentType
Boat([3.0], speed="fast")  # mypy: arg-type, pyright: reportArgumentType
Boat([3.0], crew=1.5)  # mypy: arg-type, pyright: reportArgumentType
Boat([3.0], sail=2)  # mypy: arg-type, pyright: reportArgumentType
shore: Array = boat.shore  # mypy: assignment, pyright: reportAssignmentType
