"""From a configuration to objects, and from objects to rows."""

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
import pytest

import mppi_belief as mb
import user_parts
from cli_helpers import PLANNER, SMALL, compose
from compilation_helpers import TRACED, collect_events
from experiment_helpers import compiled_quickly
from mppi_belief.errors import ConfigError
from mppi_belief.trial import (
    KEPT_PATHS,
    build,
    check,
    failed_row,
    run_trials,
    time_steps,
    time_steps_and_load,
)
from user_parts import SPOILABLE

COLUMNS = [
    "trial",
    "seed",
    "status",
    "controller",
    "theta",
    "w_obs",
    "cost",
    "running_cost",
    "terminal_cost",
    "collided",
    "clearance",
    "final_distance",
    "ess",
    "nees",
    "nis",
    "steps",
    "error",
]


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


def users(
    system: dict[str, Any] | None = None,
    controller: dict[str, Any] | None = None,
    problem: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Returns a configuration of the parts in `user_parts`."""
    cost = {
        "_target_": "mppi_belief.GoalObstacleCost",
        "goal": [0, 0],
        "running_weight": [1, 1],
        "terminal_weight": [1, 1],
        "control_weight": [1],
    }
    prior = {"prior_mean": [1.0, 1.0], "prior_std": [0.1, 0.1], "dt": 0.1, "steps": 30}
    prior |= {"position": [0]} | (problem or {})
    return {
        "system": {"_target_": "user_parts.Drifting"} | (system or {}),
        "cost": cost,
        "problem": {"_target_": "mppi_belief.Problem"} | prior,
        "filter": {"_target_": "mppi_belief.EKF"},
        "controller": {"_target_": "user_parts.Constant"} | (controller or {}),
        "names": {"system": "drifting", "cost": "goal", "filter": "ekf", "controller": "constant"},
        "seed": 0,
        "precision": "float32",
        "platform": "cpu",
        "batch": 1,
        "swept": {},
    }


def test_build_makes_what_the_configuration_says():
    built = build(compose("theta=2", "w_obs=100", *PLANNER))
    assert isinstance(built.problem.system, mb.LightDark)
    assert isinstance(built.problem.obstacles, mb.Obstacles)
    assert isinstance(built.filter, mb.EKF)
    assert (
        built.controller.path_cost.theta,
        built.controller.n_samples,
        built.problem.cost.w_obs,
    ) == (
        2.0,
        16,
        100.0,
    )
    np.testing.assert_array_equal(built.problem.prior_mean, [1.1, 2.0, 0, 0])


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("controller.horizon=0", r"controller\.horizon must be at least 1"),
        (
            "controller.path_cost.at_step_end=never",
            r"controller\.path_cost\.at_step_end must be one of True, False",
        ),
        (
            "controller.sampler=laplace",
            r"controller\.sampler must be an object, .* controller/sampler=NAME",
        ),
        ("planner.temperature=0", r"controller\.temperature must be greater than 0"),
        ("system.noise_floor=0", r"system\.noise_floor must be greater than 0"),
        ("system.light=bright", r"system\.light must be a number"),
        ("problem.obstacles.centers=[1,2]", r"problem\.obstacles\.centers must have 2 dimension"),
        ("cost.goal=[a,b]", r"cost\.goal must be an array of numbers"),
        ("problem.prior_std=[-1,0,0,0]", r"problem\.prior_std must be at least 0"),
        ("problem.steps=1.5", r"problem\.steps must be a whole number"),
        ("+system.lihgt=3", r"unknown key 'system\.lihgt'; did you mean 'system\.light'"),
        ("+problem.obstacles.width=3", r"unknown key 'problem\.obstacles\.width'"),
        ("~cost.goal", r"cost\b.*goal"),
        (
            "controller._target_=nowhere.Controller",
            r"controller\._target_=nowhere\.Controller: must name a class of",
        ),
        (
            "controller._target_=mppi_belief.Nobody",
            r"controller\._target_=mppi_belief\.Nobody: .*Nobody",
        ),
        ("controller._target_=3", r"controller\._target_=3: "),
    ],
)
def test_a_bad_setting_is_named_with_its_group(change, reason):
    with pytest.raises(ConfigError, match=f"^{reason}") as caught:
        build(compose(change))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "target",
    ["user_parts.launch", "user_parts.Plain", "user_parts.PlainDataclass", "user_parts.CALLS"],
)
def test_what_is_not_a_struct_is_refused_and_not_called(target):
    user_parts.CALLS.clear()
    config = users(controller={"_target_": target})
    with pytest.raises(
        ConfigError, match=rf"^controller\._target_={target}: must name a class .*struct"
    ):
        build(config)
    assert user_parts.CALLS == []


def test_parts_that_fit_pass_the_check():
    check(users())
    for name in ("float32", "float64"):
        check(compose(f"precision={name}", *PLANNER))


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ("f", r"system\.f has shape \(2, 1\), must be \(2,\) for a state of shape \(2,\)"),
        ("G", r"system\.G has shape \(2, 1, 1\), must be \(2, 1\)"),
        ("H", r"system\.H has shape \(2, 2, 1\), must be \(2, \d\)"),
        ("c", r"system\.c has shape \(1, 1\), must be \(1,\)"),
        ("sigma_o", r"system\.sigma_o has shape \(1, 1, 1\), must be \(1, 1\)"),
        ("c raises", r"system\.c fails for a state of shape \(2,\): c is not feeling well"),
        ("H raises", r"system\.H fails for a state of shape \(2,\): H is not feeling well"),
        (
            "f branches",
            r"system\.f fails for a state of shape \(2,\): it needs the values of its state",
        ),
        (
            "c numpy",
            r"system\.c fails for a state of shape \(2,\): it needs the values of its state",
        ),
        ("f integer", r"system\.f returns int32, must return floating-point"),
        ("G complex", r"system\.G returns complex64, must return floating-point"),
        ("c list", r"system\.c returns a list, must return one array"),
        ("f none", r"system\.f returns a NoneType, must return one array"),
        ("c word", r"system\.c fails for a state of shape \(2,\): .*str"),
        ("c empty", r"system\.c is empty"),
        *(
            (f"{name} nan", rf"system\.{name}\b.* is not finite at the state \[1\.0, 1\.0\]: .*nan")
            for name in SPOILABLE
        ),
        ("sigma_o inf", r"system\.sigma_o is not finite at the state"),
        ("sigma_o zero", r"system\.sigma_o is singular at the state \[1\.0, 1\.0\]: \[\[0\.0\]\]"),
    ],
)
def test_a_function_that_returns_what_it_should_not_is_named(wrong, reason):
    name, _, how = wrong.partition(" ")
    with pytest.raises(ConfigError, match=f"^{reason}") as caught:
        check(users(system={"wrong": name, "how": how or "shape"}))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ("R negative", r"cost\.R=\[\[-1\.0\]\]: must be positive definite"),
        ("R zero", r"cost\.R=\[\[0\.0\]\]: must be positive definite"),
        ("goal integer", r"cost\.goal returns int32"),
        ("base shape", r"cost\.base has shape \(1,\), must be \(\)"),
        ("base inf", r"cost\.base is not finite"),
        ("penalty nan", r"cost\.penalty is not finite"),
        ("terminal nan", r"cost\.terminal is not finite"),
    ],
)
def test_a_cost_that_returns_what_it_should_not_is_named(wrong, reason):
    name, _, how = wrong.partition(" ")
    with pytest.raises(ConfigError, match=f"^{reason}"):
        check(users() | {"cost": {"_target_": "user_parts.Price", "wrong": name, "how": how}})


def test_what_a_system_may_do_without_is_allowed():
    check(users(system={"wrong": "H", "how": "zero"}))  # no process noise
    check(foggy("inf"))  # no obstacles
    check(users() | {"cost": {"_target_": "user_parts.Price"}})
    config = users()
    check(config | {"problem": config["problem"] | {"prior_std": [0, 0]}})


def foggy(how: str = "nothing") -> dict[str, Any]:
    """Returns a configuration with obstacles of the user's own, spoilt in the way of `how`."""
    obstacles = {"_target_": "user_parts.Fog", "how": how}
    return users(problem={"obstacles": obstacles}) | {"cost": {"_target_": "user_parts.Price"}}


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("shape", r"has shape \(1,\), must be \(\)"),
        ("bool", r"returns bool, must return floating-point"),
        ("word", r"fails for a state of shape \(2,\): .*str"),
        ("raises", r"fails for a state of shape \(2,\): clearance is not feeling well"),
        ("nan", r"is not finite at the state \[1\.0, 1\.0\]: nan"),
        ("-inf", r"is not finite at the state \[1\.0, 1\.0\]: -inf"),
    ],
)
def test_obstacles_that_return_what_they_should_not_are_named(how, reason):
    check(foggy())
    with pytest.raises(ConfigError, match=rf"^problem\.obstacles\.clearance {reason}") as caught:
        check(foggy(how))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("parts", "reason"),
    [
        ({"system": "Mute"}, r"system\.c is missing: Mute must have it"),
        (
            {"system": "Squally"},
            r"system\.H: Squally\.H is a method, must be the same for all states: write "
            r"`@property` above it and `def H\(self\)`$",
        ),
        (
            {"system": "Fixed"},
            r"system\.f: Fixed\.f is no method, must be a function of the state: write "
            r"`def f\(self, x\)`$",
        ),
        (
            {"system": "Rows"},
            r"system\.G fails for a state of shape \(2,\): it needs the value of Rows\.n, which "
            r"JAX traces; write `n: int = mppi_belief\.size\(default=2\)` "
            r"\(user_parts\.py, line \d+\)$",
        ),
        (
            {"system": "Switched"},
            r"system\.f fails .* jnp\.where and jnp\.\* for that; or it needs the value of "
            r"Switched\.on, which JAX traces; write `on: bool = "
            r"mppi_belief\.choice\(False, True, default=True\)` \(user_parts\.py, line \d+\)$",
        ),
        ({"cost": "Blind"}, r"cost\.penalty must take \(x, surroundings\): "),
        ({"obstacles": "Ghost"}, r"problem\.obstacles\.clearance is missing: Ghost must have it"),
        (
            {"obstacles": "SpoiltStep", "cost": "Price"},
            r"problem\.obstacles\.segment_clearance has shape \(1,\), must be \(\)",
        ),
    ],
)
def test_a_part_without_what_it_must_have_is_refused(parts, reason):
    config = users()
    for group, name in parts.items():
        part = {"_target_": f"user_parts.{name}"}
        if group == "obstacles":
            config["problem"]["obstacles"] = part
        else:
            config[group] = part
    with pytest.raises(ConfigError, match=f"^{reason}") as caught:
        check(config)
    assert len(str(caught.value).splitlines()) == 1


def test_a_system_that_has_what_is_the_problems_is_refused():
    with pytest.raises(ConfigError) as caught:
        build(users() | {"system": {"_target_": "user_parts.Moored"}})
    message = str(caught.value)
    assert message.startswith("problem.system: Moored has position, clearance, noise_convention;")
    assert "these are the problem's, give it position (components of the state" in message


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"noise_convention": "neither"}, r"noise_convention must be one of sample, intensity"),
        ({"position": [0, 2]}, r"position=\[0, 2\]: the state has components 0\.\.1"),
        ({"position": [0, 0]}, r"position must be one or more distinct whole numbers"),
        ({"position": []}, r"position must be one or more distinct whole numbers"),
        ({"position": [0.5]}, r"position must be a whole number, got 0\.5"),
        ({"position": 0}, r"position must be a list of whole numbers, got 0"),
        ({"position": [-1]}, r"position must be at least 0, got -1"),
    ],
)
def test_what_is_given_to_the_problem_is_checked(change, reason):
    with pytest.raises(ConfigError, match=rf"^problem\.{reason}"):
        check(users(problem=change))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("theta=1e39", r"controller\.path_cost\.theta=1e\+39: too large for float32"),
        ("system.light=-1e39", r"system\.light=-1e\+39: too large for float32"),
        ("problem.dt=1e-50", r"problem\.dt=1e-50: too small for float32"),
    ],
)
def test_numbers_are_those_of_the_precision(change, reason):
    with pytest.raises(ConfigError, match=f"^{reason}"):
        check(compose(change, *PLANNER))
    check(compose("theta=1e39", "precision=float64", *PLANNER))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("cost.goal=[1]", r"cost\.goal has shape \(1,\), must be \(4,\)"),
        ("problem.prior_std=[1]", r"problem\.prior_std has shape \(1,\), must be \(4,\)"),
        ("cost.control_weight=[1]", r"system\.G has shape \(4, 2\), must be \(4, 1\)"),
        ("controller=pipf filter=ekf", r"filter or controller .*particle"),
        ("~controller._target_", r"controller has no _target_"),
        ("~system._target_", r"system has no _target_"),
    ],
)
def test_parts_that_do_not_fit_each_other_are_refused(change, reason):
    with pytest.raises(ConfigError, match=f"^{reason}") as caught:
        check(compose(*change.split(), *PLANNER))
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    "change",
    [
        "cost.running_weight=[1.5,0.6]",
        "cost.running_weight=[1,1,1,1,1]",
        "cost.terminal_weight=[5.0,0.15]",
        "cost.terminal_weight=[[5,0],[0,5]]",
        "problem.obstacles.centers=[[3.0]]",
        "problem.obstacles.centers=[[3.0,1.0,0.0]]",
    ],
)
def test_numbers_of_the_wrong_length_are_refused(change):
    """Checks what JAX does not: it clamps an index that is out of range."""
    with pytest.raises(ConfigError):
        check(compose(change, "controller=ce", *PLANNER))


@pytest.mark.parametrize(
    ("wrong", "reason"), [("shape", ""), ("info", "ess"), ("raises", "no plan survives")]
)
def test_a_controller_that_does_not_fit_is_refused(wrong, reason):
    with pytest.raises(
        ConfigError, match=f"^filter or controller does not fit the problem: .*{reason}"
    ) as caught:
        check(users(controller={"wrong": wrong}))
    assert len(str(caught.value).splitlines()) == 1


@pytest.fixture(scope="module")
def small() -> dict[str, Any]:
    return compose(*SMALL, "seed=3", "theta=2")


def test_a_row_has_every_column_and_what_was_swept(small):
    rows = run_trials(small, [4, 7]).rows
    swept = {
        "planner.n_samples": 16,
        "planner.horizon": 4,
        "problem.steps": 3,
        "system": "scalar_linear",
    }
    for trial, row in zip((4, 7), rows, strict=True):
        assert set(row) == {*COLUMNS, *swept}
        labels = {
            "trial": trial,
            "seed": 3,
            "status": "ok",
            "controller": "belief",
            "theta": 2.0,
            "w_obs": 0.0,
        }
        assert (
            row.items() >= (labels | swept | {"steps": 3, "error": None, "collided": False}).items()
        )
        assert row["cost"] == pytest.approx(row["running_cost"] + row["terminal_cost"], rel=1e-6)
        assert row["clearance"] == np.inf
    assert rows[0]["cost"] != rows[1]["cost"]


def test_a_trial_does_not_depend_on_the_trials_it_runs_with(small):
    alone = run_trials(small, [2])
    together = run_trials(small, [1, 2, 3])
    assert together.rows[1] == alone.rows[0]
    assert run_trials(small | {"seed": 4}, [2]).rows[0]["cost"] != alone.rows[0]["cost"]
    for expected, got in zip(
        alone.paths, [step for step in together.paths if step["trial"] == 2], strict=True
    ):
        for name, value in expected.items():
            np.testing.assert_array_equal(got[name], value)


def test_paths_are_kept_for_the_first_trials_only(small):
    batch = run_trials(small, [KEPT_PATHS - 1, KEPT_PATHS])
    assert KEPT_PATHS == 50
    assert [(step["trial"], step["step"]) for step in batch.paths] == [
        (KEPT_PATHS - 1, k) for k in range(4)
    ]
    shapes = {name: batch.paths[0][name].shape for name in ("state", "mean", "cov", "control")}
    assert shapes == {"state": (1,), "mean": (1,), "cov": (1,), "control": (1,)}
    assert np.all(np.isfinite(np.concatenate([step["control"] for step in batch.paths[:-1]])))
    assert np.all(np.isnan(batch.paths[-1]["control"]))
    assert batch.scene is not None
    assert run_trials(small, [KEPT_PATHS]).scene is None


def test_the_scene_of_the_plane_shows_where_measurements_are_good():
    scene = run_trials(users_light_dark(), [0]).scene
    noise = {name: np.asarray(value) for name, value in scene["noise"].items()}
    assert noise["level"].shape == (len(noise["y"]), len(noise["x"]))
    expected = 0.5**0.5 * np.abs(noise["x"] - 5) + 0.1
    np.testing.assert_allclose(noise["level"], np.tile(expected, (len(noise["y"]), 1)), atol=1e-3)
    np.testing.assert_allclose(scene["start"], [1.1, 2.0], rtol=1e-6)
    assert (scene["goal"], scene["radius"], scene["dt"]) == ([7, 0], 0.65, 0.1)
    assert scene["obstacles"] == [[3, 1], [3, -1]]


def users_light_dark() -> dict[str, Any]:
    """Returns the light-dark system with the cheapest controller."""
    return compose(*PLANNER) | {"controller": {"_target_": "user_parts.Constant"}}


def test_a_state_that_leaves_the_finite_numbers_is_called_diverged():
    (row,) = run_trials(users(system={"growth": 1e6}), [0]).rows
    assert (row["status"], row["steps"]) == ("diverged", 30)
    assert "finite" in row["error"]
    assert not np.isfinite(row["cost"])


def test_a_controller_that_raises_costs_its_trials_only_their_results():
    rows = run_trials(users(controller={"wrong": "raises"}), [0, 1]).rows
    for trial, row in enumerate(rows):
        assert (row["trial"], row["status"], row["steps"], row["collided"]) == (
            trial,
            "error",
            0,
            None,
        )
        assert row["error"].startswith("RuntimeError: no plan survives")
        assert np.isnan(row["cost"])
        assert set(row) == set(COLUMNS)


def test_a_failed_row_has_the_columns_of_a_good_one(small):
    row = failed_row(small, 5, "crashed", "gone")
    assert set(row) == set(run_trials(small, [5]).rows[0])
    assert (row["trial"], row["status"], row["error"], row["theta"]) == (5, "crashed", "gone", 2.0)


def test_precision_is_that_of_the_configuration(small):
    single, double = (
        run_trials(small | {"precision": name}, [0]) for name in ("float32", "float64")
    )
    assert single.paths[1]["state"].dtype == np.float32
    assert double.paths[1]["state"].dtype == np.float64
    assert double.paths[1]["state"][0] != np.float32(double.paths[1]["state"][0])
    assert not jax.config.jax_enable_x64


def test_sweeps_over_numbers_compile_once_and_over_sizes_again():
    run_trials(compose(*PLANNER), [0])
    with collect_events(TRACED) as traced:
        sample_sizes = [
            run_trials(compose(*PLANNER, *change), [0]).rows[0]["ess"]
            for change in (
                ["cost.goal=[6,0,0,0]"],
                ["cost.control_weight=[1,1]"],
                ["theta=0", "planner.control_std=1"],
                ["system.process_noise=1"],
                ["seed=5"],
            )
        ]
    assert traced.count("simulate_and_judge") == 0
    assert len(set(sample_sizes)) == 5
    with collect_events(TRACED) as traced:
        for steps in (27, 28):
            run_trials(users(problem={"steps": steps}), [0])
    assert traced.count("simulate_and_judge") == 2


def test_control_steps_are_timed_one_by_one(small):
    for calls in (2, 7):
        seconds = time_steps(small, calls)
        assert len(seconds) == calls
        assert all(0 < second < 60 for second in seconds)
    timing = time_steps_and_load(small, 3, load=lambda: 1.75)
    assert len(timing["seconds"]) == 3
    assert 0 <= timing["cpu_share"] <= 1
    assert timing["load"] == 1.75
