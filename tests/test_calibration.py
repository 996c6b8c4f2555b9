"""The calibration's scenario is what a run would have, and its log says what the search said."""

import csv
import importlib.util
import sys
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
def scenario() -> ModuleType:
    spec = importlib.util.spec_from_file_location("scenario", FOLDER / "scenario.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_reference_as_a_candidate_is_the_reference_as_a_study(scenario):
    for config in collect("experiment=reference_scenario", f"seed={scenario.SEED}"):
        (base,) = collect(f"controller={config['names']['controller']}", f"seed={scenario.SEED}")
        candidate = scenario.configure(base, scenario.REFERENCE)
        assert all(
            candidate[group] == config[group]
            for group in ("system", "problem", "cost", "filter", "controller")
        )


def test_every_open_number_reaches_the_configuration(scenario):
    (base,) = collect("controller=belief")
    before = scenario.configure(base, scenario.REFERENCE)
    for name in (*scenario.OPEN, "steps"):
        after = scenario.configure(base, scenario.REFERENCE | {name: scenario.REFERENCE[name] * 2})
        assert after != before, name
        build(after)


def flattened(config: dict[str, Any], path: str = "") -> dict[str, Any]:
    """Returns the values of a configuration by their dotted keys."""
    values: dict[str, Any] = {}
    for key, value in config.items():
        if isinstance(value, dict):
            values |= flattened(value, f"{path}{key}.")
        else:
            values[path + key] = value
    return values


def test_the_open_numbers_are_those_that_the_report_lists(scenario):
    (base,) = collect("controller=belief")
    first, second = (
        scenario.configure(
            base, {name: value * factor for name, value in scenario.REFERENCE.items()}
        )
        for factor in (1, 2)
    )
    before = flattened(first)
    after = flattened(second)
    fitted = published.FITTED_SETTINGS.keys() & before.keys()  # of the penalty that is set
    assert {key for key in before if before[key] != after[key]} == fitted


def test_the_log_is_whole_and_within_the_ranges(scenario):
    with (FOLDER / "trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 100
    finished = [row for row in rows if row["state"] == "complete"]
    for row in finished:
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
        for name, (low, high, _) in scenario.OPEN.items():
            assert low * 0.999 <= float(row[name]) <= high * 1.001
