"""What a check says of derivatives that are missing and of expectations that are slow."""

from collections.abc import Iterator
from typing import Any

import pytest

from cli_helpers import PLANNER, compose
from experiment_helpers import compiled_quickly
from mppi_belief.errors import FieldError
from mppi_belief.trial import build, check, run_trials
from mppi_belief.trial.derivatives import derivative_notes
from mppi_belief.trial.validate import checked_states

FLAT = "it counts as flat there; write a distance |x| as sqrt(|x|^2 + eps^2)"
DIVERGES = (
    "a filter or planner that linearises it there diverges; "
    "write a distance |x| as sqrt(|x|^2 + eps^2)"
)


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


def taxi(controller: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Returns the configuration of a point that starts at its goal and pays for the distance."""
    zeros = [[0.0, 0.0], [0.0, 0.0]]
    eye = [[1.0, 0.0], [0.0, 1.0]]
    linear = {"A": zeros, "B": eye, "C": eye, "channel": zeros, "sensor_noise": [0.2, 0.2]}
    parts = {
        "system": {"_target_": "mppi_belief.Linear"} | linear,
        "cost": {"_target_": "user_parts.Fare", "goal": [0.0, 0.0], "smoothing": 0.0},
        "problem": {
            "_target_": "mppi_belief.Problem",
            "prior_mean": [0.0, 0.0],
            "prior_std": [0.1, 0.1],
            "dt": 0.1,
            "steps": 5,
        },
        "filter": {"_target_": "mppi_belief.EKF"},
        "controller": controller,
        "names": {"system": "taxi", "cost": "fare", "filter": "ekf", "controller": "any"},
        "seed": 0,
        "precision": "float32",
        "platform": "cpu",
        "batch": 1,
        "swept": {},
    }
    return parts | changes


ILQG = {"_target_": "mppi_belief.EKFiLQG", "horizon": 3}
MPPI = {"_target_": "mppi_belief.MPPI", "n_samples": 8, "horizon": 3}
LAPLACE = MPPI | {"sampler": {"_target_": "mppi_belief.LaplaceSampler", "control_std": 1.0}}


@pytest.mark.parametrize("controller", [ILQG, LAPLACE])
def test_a_distance_is_named_where_it_is_differentiated_and_all_trials_run(controller):
    config = taxi(controller)
    assert check(config) == [
        f"cost.base has no finite derivatives at [0.0, 0.0]: {FLAT}",
        f"cost.terminal has no finite derivatives at [0.0, 0.0]: {FLAT}",
    ]
    assert [row["status"] for row in run_trials(config, range(3)).rows] == ["ok"] * 3


def test_a_path_cost_by_the_delta_rule_differentiates_the_cost():
    path_cost = {"_target_": "mppi_belief.RiskSensitive", "theta": 1.0, "variance": "delta"}
    notes = check(taxi(MPPI | {"path_cost": path_cost}))
    assert f"cost.base has no finite derivatives at [0.0, 0.0]: {FLAT}" in notes
    assert check(taxi(MPPI | {"path_cost": path_cost | {"variance": "sigma_points"}})) == []


@pytest.mark.parametrize(("penalty", "count"), [("indicator", 1), ("hinge", 0)])
def test_a_penalty_that_changes_in_jumps_alone_is_named(penalty, count):
    choices = (f"cost/obstacle_penalty={penalty}", "planner.variance=delta")
    problem, _, controller = build(compose(*choices, *PLANNER))
    states = checked_states(problem).astype("float32")
    assert derivative_notes(problem, controller, states) == count * [
        "cost.penalty changes in jumps alone, so its derivatives are zero: a planner that "
        "differentiates it does not see it; take another penalty, or moments by sigma_points"
    ]


def test_sigma_points_with_a_negative_weight_are_refused_before_any_trial():
    path_cost = {"_target_": "mppi_belief.RiskSensitive", "variance": "sigma_points"}
    close = path_cost | {"variance_of": "total", "sigma_point_spread": 1.5}
    with pytest.raises(FieldError) as refused:
        check(taxi(MPPI | {"path_cost": close}))
    assert str(refused.value) == (
        "controller.path_cost.sigma_point_spread must be at least 2, the number of components of "
        "the state that the function depends on, got 1.5"
    )


def test_nothing_is_said_where_the_distance_is_rounded_off_or_not_differentiated():
    assert check(taxi(MPPI)) == []
    config = taxi(ILQG)
    assert check(config | {"cost": config["cost"] | {"smoothing": 1e-3}}) == []


def test_a_measured_distance_is_named_with_the_state():
    system = {"_target_": "user_parts.RangeOnly"}
    assert check(taxi(MPPI, system=system)) == [
        f"system.c has no finite derivative at [0.0, 0.0]: {DIVERGES}"
    ]


def test_a_penalty_of_many_components_is_named_with_the_way_out(recwarn):
    zeros = [0.0] * 6
    square = [zeros] * 6
    eye = [[float(i == j) for j in range(6)] for i in range(6)]
    linear = {"A": square, "B": eye, "C": eye, "channel": square, "sensor_noise": [1.0] * 6}
    config = taxi(
        MPPI,
        system={"_target_": "mppi_belief.Linear"} | linear,
        cost={"_target_": "user_parts.Crowded", "goal": zeros},
        problem={
            "_target_": "mppi_belief.Problem",
            "prior_mean": zeros,
            "prior_std": [0.1] * 6,
            "dt": 0.1,
            "steps": 2,
        },
    )
    (note,) = check(config)
    assert note.startswith("cost.penalty of Crowded depends on 6 components of the state")
    assert "mppi_belief.ClosedFormCost" in note
    run_trials(config, [0])
    assert not recwarn.list
