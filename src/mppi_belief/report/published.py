"""The numbers that the paper prints of its experiments (Sec. VII), to compare ours with."""

from typing import NamedTuple

PAPER_TRIALS = 200  # Monte Carlo trials behind every number
PAPER_HORIZON = 30  # steps


class PublishedRow(NamedTuple):
    """Holds a row of Table I."""

    cost: float  # mean
    spread: float  # standard deviation of the cost
    collisions: int  # trials that collide, of `PAPER_TRIALS`
    time: float  # ms per control step


TABLE_1 = {
    "ilqg": PublishedRow(46.1, 6.2, 49, 148),
    "ce": PublishedRow(50.5, 6.2, 46, 13),
    "pipf": PublishedRow(47.6, 5.5, 36, 296),
    "belief": PublishedRow(56.5, 5.2, 0, 18),
}


class PublishedTheta(NamedTuple):
    """Holds what the text says of one theta; None where it says nothing."""

    collision_rate: tuple[float, float]  # lowest and highest rate that the text allows
    clearance: float | None = None  # m
    cost: float | None = None


PAPER_THETA = {
    0.0: PublishedTheta((0.23, 0.23), 0.11, 51.3),
    0.5: PublishedTheta((0.025, 0.025), 0.80),
    1.0: PublishedTheta((0.0, 0.0), 0.82, 56.6),
    2.0: PublishedTheta((0.005, 0.015)),
    5.0: PublishedTheta((0.005, 0.015)),
}

TABLE_1_THETA = 1.0  # theta of MPPI-Belief in Table I

BASELINES = ("ilqg", "ce", "pipf")
BASELINE_RANGE = (0.11, 0.33)  # collision rates of the baselines at every w_obs in [1e2, 1e4]
WEIGHT_RANGE = (1e2, 1e4)  # of the obstacle weight in Fig. 2
FIG_2_WEIGHTS = (100.0, 250.0, 500.0, 1000.0, 2500.0, 5000.0, 10000.0)  # of conf/sweep/w_obs.yaml
BELIEF_BELOW = {500.0: 0.01, 2500.0: 0.0}  # the highest rate of MPPI-Belief from this w_obs on


def belief_rate_bound(w_obs: float) -> float | None:
    """Returns the highest rate of MPPI-Belief that the text allows at a weight; None below all."""
    return min((rate for start, rate in BELIEF_BELOW.items() if w_obs >= start), default=None)


# Keys that the paper's sweeps vary; all others are as in Table I.
THETA_KEY = "controller.path_cost.theta"
EXPECTATION_KEY = "controller.path_cost.expectation"  # the paper leaves open which it uses
WEIGHT_KEY = "cost.w_obs"

RESIDUAL = 0.79  # epsilon*, the optimised matching residual

FITTED_SETTINGS = {
    "problem.prior_mean": "start (m, m/s)",
    "problem.prior_std": "initial uncertainty (m, m/s)",
    "problem.steps": "trial length",
    "cost.goal": "goal (m, m/s)",
    "cost.running_weight": "Q^x",
    "cost.terminal_weight": "terminal weight",
    "cost.control_weight": "R",
    "cost.obstacle_penalty.width": "width of the obstacle penalty (m)",
    "cost.obstacle_penalty.margin": "margin of the obstacle penalty (m)",
    "cost.w_obs": "weight of the obstacle penalty",
    "controller.sampler.control_std": "spread of sampled controls (m/s^2)",
}  # keys of the configuration whose numbers the paper does not give, with their meaning

BY_THE_SWEEPS = "with a look at the sweeps"
BY_HAND = "by hand"


class StructureChoice(NamedTuple):
    """Holds what a choice of the structure is about, and how it was made."""

    meaning: str
    chosen: str  # `BY_THE_SWEEPS` or `BY_HAND`


STRUCTURE = {
    "cost.obstacle_penalty._target_": StructureChoice(
        "shape of the obstacle penalty", BY_THE_SWEEPS
    ),
    "controller.path_cost.expectation": StructureChoice(
        "how the expectation (3) of the penalty is taken", BY_THE_SWEEPS
    ),
    "controller.path_cost.variance": StructureChoice(
        "how the variance of Remark 4 is taken", BY_THE_SWEEPS
    ),
    "controller.path_cost.sigma_point_spread": StructureChoice(
        "spread c of the sigma points", BY_THE_SWEEPS
    ),
    "problem.initial_draw": StructureChoice(
        "what the spread of the start is drawn for", BY_THE_SWEEPS
    ),
    "controller.path_cost.variance_of": StructureChoice(
        "of what Remark 4 takes the variance", BY_HAND
    ),
    "controller.path_cost.at_step_end": StructureChoice(
        "whether a step is charged at its end", BY_HAND
    ),
    "problem.noise_convention": StructureChoice("meaning of sigma_o", BY_HAND),
    "filter.noise_at": StructureChoice(
        "where the particle filter takes the measurement noise", BY_HAND
    ),
}  # keys of the configuration that the paper leaves open and that are no fitted number
