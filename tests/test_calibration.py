"""The calibration's scenario is what a run would have, and its log says what the search said."""

import csv
import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cli_helpers import collect
from mppi_belief.report import published
from mppi_belief.trial import build

FOLDER = Path(__file__).parents[1] / "experiments" / "calibration"


@pytest.fixture(scope="module")
def scripts() -> Iterator[dict[str, ModuleType]]:
    """The modules of the calibration by name; they import each other, as scripts do."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(FOLDER))
        names = ("structure", "scenario", "starts")
        yield {name: importlib.import_module(name) for name in names}


@pytest.fixture(scope="module")
def scenario(scripts) -> ModuleType:
    return scripts["scenario"]


def test_the_reference_as_a_candidate_is_the_reference_as_a_study(scenario, scripts):
    for config in collect("experiment=reference_scenario", f"seed={scenario.SEED}"):
        (base,) = collect(f"controller={config['names']['controller']}", f"seed={scenario.SEED}")
        candidate = scenario.configure(base, scripts["starts"].REFERENCE)
        assert all(
            candidate[group] == config[group]
            for group in ("system", "problem", "cost", "filter", "controller")
        )


def changed(candidate: dict[str, Any], name: str, scripts: dict[str, ModuleType]) -> dict[str, Any]:
    """A candidate with another choice or another number of this name."""
    options = scripts["structure"].CHOICES.get(name)
    if options is None:
        return candidate | {name: candidate[name] + 0.125}
    return candidate | {name: next(each for each in options if each != candidate[name])}


def test_every_choice_and_every_open_number_reaches_the_configuration(scenario, scripts):
    (base,) = collect("controller=belief")
    bumps = scripts["starts"].CALIBRATED_BUMPS | {"margin": 0.1}
    compact = scripts["starts"].KNOWN_START | {"width": 0.3}
    reached = set()
    for candidate in (bumps, compact):
        before = scenario.configure(base, candidate)
        for name in (*scripts["structure"].CHOICES, *scenario.open_names(candidate)):
            after = scenario.configure(base, changed(candidate, name, scripts))
            assert after != before, name
            build(after)
            reached.add(name)
    assert reached == {*scripts["structure"].CHOICES, *scenario.OPEN}


@pytest.mark.parametrize("start", ["KNOWN_START", "CALIBRATED_BUMPS"])
def test_starts_of_the_search_are_within_the_ranges(scenario, scripts, start):
    candidate = getattr(scripts["starts"], start)
    assert {*scripts["structure"].CHOICES} <= {*candidate}
    for name in scenario.open_names(candidate):
        low, high, _ = scenario.OPEN[name]
        assert low <= candidate[name] <= high


def flattened(config: dict[str, Any], path: str = "") -> dict[str, Any]:
    """Returns the values of a configuration by their dotted keys."""
    values: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, dict):
            values |= flattened(value, f"{path}{key}.")
        else:
            values[path + key] = value
    return values


def test_the_open_numbers_are_those_that_the_report_lists(scenario, scripts):
    """All but the trial's length, which is a choice among a few."""
    (base,) = collect("controller=belief")
    keys = set()
    for start in ("KNOWN_START", "CALIBRATED_BUMPS"):
        candidate = getattr(scripts["starts"], start)
        moved = candidate | {
            name: candidate[name] + 0.125 for name in scenario.open_names(candidate)
        }
        before, after = (flattened(scenario.configure(base, each)) for each in (candidate, moved))
        keys |= {key for key in before if before[key] != after[key]}
    assert keys | {"problem.steps"} == set(published.FITTED_SETTINGS)


def test_the_structure_that_the_search_chooses_is_what_the_report_lists(scenario, scripts):
    (base,) = collect("controller=belief")
    start = scripts["starts"].KNOWN_START
    keys = set()
    for name in scripts["structure"].CHOICES:
        before, after = (
            flattened(scenario.configure(base, each))
            for each in (start, changed(start, name, scripts))
        )
        keys |= {key for key in before if before[key] != after.get(key)}
    assert keys - set(published.FITTED_SETTINGS) <= set(published.STRUCTURE)


@pytest.mark.parametrize(("log", "candidates"), [("trials.csv", 5), ("trials_bumps.csv", 100)])
def test_the_log_is_whole(scenario, log, candidates):
    with (FOLDER / log).open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= candidates
    for row in [row for row in rows if row["state"] == "complete"]:
        measured = {
            method: scenario.Measured(
                *(float(row[f"{method}_{name}"]) for name in scenario.Measured._fields)
            )
            for method in scenario.METHODS
        }
        loss = sum(
            z * z
            for method, values in measured.items()
            for z in scenario.deviations(method, values)
        )
        np.testing.assert_allclose(float(row["loss"]), loss, rtol=0.02, atol=0.1)


def test_candidates_of_the_log_are_within_the_ranges(scenario):
    with (FOLDER / "trials.csv").open() as file:
        numbers = [int(row["trial"]) for row in csv.DictReader(file)]
    for number in numbers:
        candidate = scenario.logged_candidate(FOLDER / "trials.csv", number)
        for name in scenario.open_names(candidate):
            low, high, _ = scenario.OPEN[name]
            assert low * 0.999 <= candidate[name] <= high * 1.001
