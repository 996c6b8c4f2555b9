"""The line about a key that the configuration does not have leads to the key that was meant."""

import pytest

from mppi_belief.config.misspelt_keys import unknown_key_line


@pytest.mark.parametrize(
    ("key", "meant"),
    [
        ("controller.path_cost.thta", "controller.path_cost.theta"),
        ("controller.path_cots.theta", "controller.path_cost.theta"),
        ("controller.path_cots.thta", "controller.path_cost.theta"),
        ("problem.obstacle.radius", "problem.obstacles.radius"),
        ("controller/samplr", "controller/sampler"),
        ("controler/sampler", "controller/sampler"),
        # The name is right, and the place is another.
        ("controller.theta", "controller.path_cost.theta"),
        ("controller.control_std", "controller.sampler.control_std"),
        ("controller.antithetic", "controller.sampler.antithetic"),
        ("system.noise_convention", "problem.noise_convention"),
        ("system.obstacles.radius", "problem.obstacles.radius"),
        ("planner.n_trials", "n_trials"),
    ],
)
def test_the_nearest_key_is_found_at_every_depth(key, meant):
    assert unknown_key_line(key) == f"unknown key '{key}'; did you mean '{meant}'?"


@pytest.mark.parametrize("key", ["controller.foo", "controller.foo.bar", "foo", "foo/bar"])
def test_a_key_that_is_near_to_none_gets_no_suggestion(key):
    assert unknown_key_line(key) == f"unknown key '{key}'; see mppi-belief run --help"


def test_a_renamed_key_leads_to_its_replacement():
    assert unknown_key_line("controller.proposal") == (
        "unknown key 'controller.proposal'; use controller/sampler=nominal or =laplace instead"
    )
    assert unknown_key_line("cost.bump_width") == (
        "unknown key 'cost.bump_width'; use cost.obstacle_penalty.width instead"
    )


@pytest.mark.parametrize(
    ("key", "group"),
    [
        ("controller.damping", "controller"),
        ("controller.path_cost.theta", "controller/path_cost"),
        ("controller.schedule.method", "controller/schedule"),
        ("filter.noise_at", "filter"),
    ],
)
def test_a_key_of_another_option_names_the_innermost_group(key, group):
    line = unknown_key_line(key)
    assert line.startswith(f"'{key}' is a key of another {group} than the one chosen; ")


def test_a_group_that_the_chosen_controller_does_not_have_is_no_misspelling():
    line = unknown_key_line("controller/sampler")
    assert line.startswith("the chosen controller has no 'controller/sampler'; ")


def test_keys_of_a_folder_of_ones_own_are_candidates_too(tmp_path):
    (tmp_path / "system").mkdir()
    (tmp_path / "system" / "boat.yaml").write_text("_target_: boat.Boat\ncurrent: 1.0\n")
    (tmp_path / "system" / "broken.yaml").write_text("{")
    line = unknown_key_line("system.curent", [str(tmp_path)])
    assert line == "unknown key 'system.curent'; did you mean 'system.current'?"
