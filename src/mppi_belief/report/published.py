"""What the paper prints of its experiments (Sec. VII), the numbers a reproduction is held against."""

from typing import NamedTuple

TRIALS = 200  # Monte Carlo trials behind every number
HORIZON = 30


class Row(NamedTuple):
    """A row of Table I: mean and standard deviation of the cost, collisions among `TRIALS`, ms per step."""

    cost: float
    spread: float
    collisions: int
    time: float


TABLE_1 = {
    "ilqg": Row(46.1, 6.2, 49, 148),
    "ce": Row(50.5, 6.2, 46, 13),
    "pipf": Row(47.6, 5.5, 36, 296),
    "belief": Row(56.5, 5.2, 0, 18),
}


class Sweep(NamedTuple):
    """What the text says of one theta; None where it says nothing."""

    collision_rate: tuple[float, float]  # lowest and highest that the text allows
    clearance: float | None = None  # m
    cost: float | None = None


THETA = {
    0.0: Sweep((0.23, 0.23), 0.11, 51.3),
    0.5: Sweep((0.025, 0.025), 0.80),
    1.0: Sweep((0.0, 0.0), 0.82, 56.6),
    2.0: Sweep((0.005, 0.015)),
    5.0: Sweep((0.005, 0.015)),
}

TABLE_1_THETA = 1.0  # of MPPI-Belief in Table I

BASELINES = ("ilqg", "ce", "pipf")
BASELINE_RANGE = (0.11, 0.33)  # collision rates of the baselines at every w_obs in [1e2, 1e4]
BELIEF_BELOW = {500.0: 0.01, 2500.0: 0.0}  # the rate of MPPI-Belief from this w_obs on

RESIDUAL = 0.79  # epsilon*, the optimised matching residual

OPEN = {
    "problem.prior_mean": "start (m, m/s)",
    "problem.prior_std": "initial uncertainty (m, m/s)",
    "problem.steps": "trial length",
    "cost.goal": "goal (m, m/s)",
    "cost.running_weight": "Q^x",
    "cost.terminal_weight": "terminal weight",
    "cost.control_weight": "R",
    "cost.bump_width": "width of the obstacle penalty (m)",
    "cost.w_obs": "obstacle weight (1/s)",
    "controller.control_std": "spread of sampled controls (m/s^2)",
}  # what the paper does not give
