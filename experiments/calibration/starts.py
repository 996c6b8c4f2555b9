"""Candidates from which the search starts."""

from typing import Any

from structure import BUMPS, MARGIN

# The scenario of conf/experiment/reference_scenario.yaml.
REFERENCE: dict[str, Any] = BUMPS | {
    "start_x": 1.0,
    "start_y": 1.0,
    "goal_x": 7.0,
    "prior_std": 0.2,
    "q_position": 1.5,
    "q_velocity": 0.6,
    "terminal_position": 5.0,
    "terminal_velocity": 0.15,
    "r": 0.035,
    "width": 0.285,
    "w_obs": 500.0,
    "control_std": 2.75,
}
# The result of the first calibration, with bumps: conf/experiment/table_1_bumps.yaml.
CALIBRATED_BUMPS = REFERENCE | {
    "start_x": 0.9,
    "start_y": 1.9,
    "prior_std": 0.25,
    "q_position": 1.0,
    "q_velocity": 2.0,
    "r": 0.2,
    "width": 0.26,
    "w_obs": 300.0,
}
# Found with an independent program, to show that this structure has the shape of the paper's
# sweeps; the second and third draw the true start instead of the first mean.
MEASURED = MARGIN | {
    "start_x": 0.375,
    "start_y": 1.854,
    "goal_x": 7.0,
    "prior_std": 0.205,
    "q_position": 0.90,
    "q_velocity": 1.34,
    "terminal_position": 6.5,
    "terminal_velocity": 0.15,
    "r": 0.117,
    "margin": 0.131,
    "w_obs": 6900.0,
    "control_std": 2.76,
}
# The start is known to the filter, which does not know that it is. Found with a program that is not
# kept, which varied one choice after the other.
KNOWN_START = MEASURED | {
    "penalty": "squared_hinge",
    "initial_draw": "none",
    "start_x": 0.93,
    "start_y": 2.0,
    "prior_std": 0.39,
    "q_position": 1.0,
    "q_velocity": 2.0,
    "terminal_position": 5.5,
    "r": 0.125,
    "margin": 0.11,
    "w_obs": 2000.0,
    "control_std": 2.2,
}
EARLIER = MEASURED | {
    "initial_draw": "state",
    "start_x": 0.18,
    "start_y": 1.51,
    "prior_std": 0.28,
    "q_position": 0.84,
    "q_velocity": 1.44,
    "terminal_position": 3.4,
    "r": 0.12,
    "margin": 0.185,
    "w_obs": 4100.0,
    "control_std": 2.9,
}

STARTS = (
    KNOWN_START,
    KNOWN_START | {"penalty": "hinge", "w_obs": 600.0},
    KNOWN_START | {"penalty": "smooth_step"},
    KNOWN_START | {"penalty": "indicator"},
    KNOWN_START | {"sigma_point_spread": 3.0},
    KNOWN_START | {"variance_of": "total"},
    KNOWN_START | {"expectation": "sigma_points"},
    KNOWN_START | {"variance": "exact", "w_obs": 300.0},
    KNOWN_START | {"variance": "delta"},
    KNOWN_START | {"initial_draw": "mean"},
    KNOWN_START | {"initial_draw": "state"},
    KNOWN_START | {"at_step_end": False},
    MEASURED,
    MEASURED | {"penalty": "squared_hinge"},
    MEASURED | {"initial_draw": "none"},
    EARLIER,
    CALIBRATED_BUMPS,
)
