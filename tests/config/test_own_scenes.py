"""Scenes of their own write out what the calibration of the paper's scene may change."""

from typing import Any

import pytest

from cli_helpers import CONF
from mppi_belief.config.yaml_files import read_yaml

COST_KEYS = {"goal", "running_weight", "terminal_weight", "control_weight"}
MOMENT_KEYS = {"variance_of", "expectation", "variance", "sigma_point_spread"}
PLANNER_KEYS = {"control_std", "at_step_end", *MOMENT_KEYS}
SCENES = [
    "system/beacons",
    "system/pendulum",
    "system/point_robot",
    "system/two_lanes",
    "experiment/information",
    "experiment/reference_scenario",
    "experiment/table_1_bumps",
]
WITHOUT_OBSTACLES = ["system/scalar_linear", "system/steered"]  # their costs are their own


def content(scene: str) -> dict[str, Any]:
    return dict(read_yaml(CONF / f"{scene}.yaml"))


@pytest.mark.parametrize("scene", [*SCENES, *WITHOUT_OBSTACLES])
def test_a_scene_says_how_its_steps_are_charged_and_its_moments_are_taken(scene):
    assert content(scene)["planner"].keys() >= PLANNER_KEYS


@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_with_the_common_cost_has_weights_and_a_penalty_of_its_own(scene):
    own = content(scene)
    assert own["cost"].keys() >= COST_KEYS
    assert "w_obs" in own or "w_obs" in own["cost"]
    assert {"override /cost/obstacle_penalty": "bump"} in own["defaults"]


@pytest.mark.parametrize("scene", [*SCENES, *WITHOUT_OBSTACLES])
def test_a_scene_has_a_start_of_its_own(scene):
    problem = content(scene)["problem"]
    assert problem.keys() >= {"noise_convention", "prior_mean", "prior_std", "steps"}
