"""Which cells may stand beside the paper's numbers: those with the settings of its own study."""

import pytest

from cli_helpers import collect
from mppi_belief.report import published
from mppi_belief.report.paper_settings import are_part_of, departures, table_1_departures
from report_helpers import cell_of, results_of

TABLE_1 = ["experiment=table_1"]


def departures_of(*args: str) -> tuple[str, ...] | None:
    (config,) = collect(*args)
    return table_1_departures(config, collect(*TABLE_1))


@pytest.mark.parametrize("method", ["belief", "ce", "pipf", "ilqg"])
def test_table_1_has_its_own_settings(method):
    assert departures_of(f"controller={method}") == ()


@pytest.mark.parametrize(
    "words", [["seed=3", "n_trials=7"], ["precision=float64", "batch=4"], ["w_obs=350"]]
)
def test_how_trials_are_computed_and_how_a_number_is_written_is_no_departure(words):
    assert departures_of(*words) == ()


@pytest.mark.parametrize(
    ("word", "keys"),
    [
        ("theta=0.5", {published.THETA_KEY}),
        ("w_obs=2500", {published.WEIGHT_KEY}),
        ("problem.steps=40", {"problem.steps"}),
        ("planner.n_samples=100", {"controller.n_samples"}),
        ("cost.goal=[6,0,0,0]", {"cost.goal"}),
    ],
)
def test_a_departure_is_named_by_its_key(word, keys):
    assert set(departures_of(word)) == keys


def test_another_system_departs_and_another_method_is_not_compared():
    assert "system._target_" in departures_of("system=point_robot", "cost=goal_obstacles")
    assert departures_of("controller=oracle") is None


def test_the_papers_sweeps_vary_one_key_each():
    for study, key in (("theta_sweep", published.THETA_KEY), ("w_obs_sweep", published.WEIGHT_KEY)):
        for config in collect(f"experiment={study}"):
            assert set(table_1_departures(config, collect(*TABLE_1))) <= {key}


def test_the_weights_of_the_claims_are_those_of_the_sweep():
    weights = {config["cost"]["w_obs"] for config in collect("experiment=w_obs_sweep")}
    assert weights == set(published.FIG_2_WEIGHTS)
    assert (min(weights), max(weights)) == published.WEIGHT_RANGE


def test_a_part_of_a_study_is_known_by_its_settings():
    part = collect("experiment=table_1", "controller=ce,pipf", "seed=4")
    assert are_part_of(part, collect(*TABLE_1))
    assert not are_part_of([*part, *collect("theta=2")], collect(*TABLE_1))


def test_absent_keys_and_empty_groups_count():
    first = {"system": {"a": {}}, "cost": {}, "problem": {}, "filter": {}, "controller": {"n": 1}}
    assert departures(first, first) == ()
    assert departures(first | {"system": {}}, first) == ("system", "system.a")
    assert departures(first | {"controller": {"n": None}}, first) == ("controller.n",)
    assert departures(first | {"controller": {"n": 1.0}}, first) == ()


def test_only_the_varied_keys_may_differ():
    cell = results_of(cell_of(), [], departures=(published.WEIGHT_KEY,))
    assert not cell.has_paper_settings()
    assert cell.has_paper_settings(published.WEIGHT_KEY)
    assert not cell.has_paper_settings(published.THETA_KEY)
    unknown = cell._replace(departures=None)
    assert not unknown.has_paper_settings(published.WEIGHT_KEY)
