"""Tests the scene of a picture: maps of sigma_o and of obstacles of any shape, labels and units."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from cli_helpers import PLANNER, compose
from helpers import CENTERS, light_dark_problem
from mppi_belief.structs import ArrayField
from mppi_belief.trial import run_trials
from mppi_belief.trial.scene import describe_scene

ROWS = np.array([[1.0, 0.2, 0.3], [4.0, -0.6, 0.9]])  # x, y, radius of each, m


@mb.struct
class DiscsOfTheirOwn:
    """Represents discs of different sizes, in a field named as that of another class."""

    centers: ArrayField = mb.array(ndim=2)  # rows [x, y, radius], m

    def clearance(self, position: Array) -> Array:
        rows = jnp.asarray(self.centers)
        return jnp.min(jnp.hypot(*(rows[:, :2] - position).T) - rows[:, 2])


@mb.struct
class NotFarAway:
    """Represents obstacles that fail for many positions at once, as on a grid."""

    def clearance(self, position: Array) -> Array:
        raise ValueError("only near the start")


@mb.struct
class Labelled(mb.LightDark):
    """Represents the light-dark vehicle that is seen as a distance and an angle."""

    state_labels = ("east (km)", "north (km)", "a", "b")
    measurement_units = ("km", "rad")

    def sigma_o(self, x: Array) -> Array:
        return jnp.diag(jnp.array([3.0, 400.0]))


def test_obstacles_of_any_shape_are_a_map_of_their_clearance():
    scene = describe_scene(light_dark_problem(obstacles=DiscsOfTheirOwn(ROWS)))
    x, y, level = (np.asarray(scene["clearance"][name]) for name in ("x", "y", "level"))
    expected = np.min(
        [np.hypot(x - px, y[:, None] - py) - radius for px, py, radius in ROWS], axis=0
    )
    np.testing.assert_allclose(level, expected, atol=2e-3)
    assert scene["obstacles"] == []
    assert "left_out" not in scene


def test_discs_are_drawn_exactly_and_need_no_map():
    scene = describe_scene(light_dark_problem())
    assert scene["obstacles"] == CENTERS
    assert "clearance" not in scene
    assert "clearance" not in describe_scene(light_dark_problem(obstacles=None))


def test_the_maps_reach_beyond_everything_by_its_own_extent():
    problem = light_dark_problem()
    x = describe_scene(problem)["noise"]["x"]
    assert x[0] < 0.9 - 6.1
    assert x[-1] > 7.0 + 6.1
    spread = replace(problem, prior_std=[50.0, 50.0, 0.05, 0.05])
    assert describe_scene(spread)["noise"]["x"][0] < -150


def test_labels_and_units_are_those_of_the_system():
    scene = describe_scene(light_dark_problem())
    assert scene["labels"] == ["$p_x$ (m)", "$p_y$ (m)"]
    assert (scene["noise"]["unit"], scene["noise"]["partial"]) == ("m", False)
    continuous = describe_scene(light_dark_problem(noise_convention="intensity"))
    assert continuous["noise"]["unit"] == r"m $\sqrt{\mathrm{s}}$"


def test_measurements_of_another_unit_are_not_mixed_in():
    problem = light_dark_problem()
    system = Labelled(0.3, 5.0, 0.7, 0.1)
    scene = describe_scene(replace(problem, system=system, position=(1, 0)))
    assert scene["labels"] == ["north (km)", "east (km)"]
    np.testing.assert_allclose(scene["noise"]["level"], 3.0, rtol=1e-4)
    assert (scene["noise"]["unit"], scene["noise"]["partial"]) == ("km", True)


@pytest.mark.parametrize(
    ("changed", "part", "reason"),
    [
        ({"obstacles": NotFarAway()}, "obstacles", "ValueError: only near the start"),
        ({"state_labels": ("x",)}, "labels", "ValueError: state_labels has 1 labels for a state"),
        ({"measurement_units": ()}, "sigma_o", "ValueError: measurement_units has 0 units for 2"),
    ],
)
def test_what_cannot_be_described_is_left_out_with_the_reason(changed, part, reason, monkeypatch):
    problem = light_dark_problem()
    if part == "obstacles":
        problem = replace(problem, **changed)
    for name, value in changed.items() if part != "obstacles" else ():
        monkeypatch.setattr(mb.LightDark, name, value)
    scene = describe_scene(problem)
    assert [*scene["left_out"]] == [part]
    assert scene["left_out"][part].startswith(reason)
    assert scene["goal"] == [7.0, 0.0]


def test_a_scene_that_cannot_be_drawn_fails_no_trial(monkeypatch):
    monkeypatch.setattr(mb.LightDark, "measurement_units", 3, raising=False)
    config = compose(*PLANNER) | {"controller": {"_target_": "user_parts.Constant"}}
    batch = run_trials(config, [0, 1])
    assert [row["status"] for row in batch.rows] == ["ok", "ok"]
    assert [*batch.scene["left_out"]] == ["sigma_o"]
