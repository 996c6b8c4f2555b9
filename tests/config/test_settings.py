"""Types and ranges of a configuration, and numbers that are not finite, wherever they hide."""

import copy
import math
from typing import Any

import pytest

from mppi_belief.config.cell import batches, canonical
from mppi_belief.config.settings import batch_size, check_settings
from mppi_belief.errors import ConfigError, plain_line, unknown_key


def settings(**changes: Any) -> dict[str, Any]:
    top = {
        "theta": 1.0,
        "w_obs": 500.0,
        "seed": 0,
        "n_trials": 10,
        "workers": 2,
        "precision": "float32",
    }
    how = {"platform": "cpu", "batch": None}
    planner = {"n_samples": 16, "horizon": 4, "temperature": 1.0, "control_std": None}
    groups: dict[str, Any] = {
        group: {} for group in ("problem", "system", "cost", "filter", "controller")
    }
    places = {
        "results_dir": "outputs",
        "report_dir": "outputs",
        "verify_dir": "outputs",
        "record": None,
    }
    places |= {"trial_timeout": 60.0, "shard": None, "executor": {"kind": "local"}}
    return {**top, **how, **places, "planner": planner, **groups, **changes}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("theta", 0),
        ("theta", 1e300),
        ("w_obs", 0.0),
        ("seed", 0),
        ("seed", 2**31 - 1),
        ("n_trials", 1),
        ("n_trials", 10**7),
        ("workers", 1),
        ("precision", "float64"),
        ("platform", "gpu"),
        ("batch", None),
        ("batch", 1),
        ("batch", 10**5),
        ("record", 0),
        ("trial_timeout", None),
        ("trial_timeout", 0.001),
        ("record", None),
        ("system", {"drift": -1e300, "centers": [[]], "note": "nan"}),
    ],
)
def test_what_is_in_range_passes_and_stays_as_it_is(key, value):
    given = settings(**{key: value})
    before = copy.deepcopy(given)
    check_settings(given)
    assert given == before


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("theta", -1e-9, "at least 0"),
        ("record", -1, "at least 0"),
        ("trial_timeout", 0.0, "at least 0.001"),
        ("trial_timeout", math.inf, "must be finite"),
        ("report_dir", " ", "must name a folder"),
        ("verify_dir", "", "must name a folder"),
        ("theta", math.nan, "finite"),
        ("theta", math.inf, "finite"),
        ("w_obs", -5.0, "at least 0"),
        ("w_obs", -math.inf, "finite"),
        ("seed", -1, "at least 0"),
        ("seed", 2**31, "at most"),
        ("n_trials", 0, "at least 1"),
        ("n_trials", 10**7 + 1, "at most"),
        ("workers", 0, "at least 1"),
        ("workers", 1025, "at most 1024"),
        ("precision", "float16", "one of float32, float64"),
        ("platform", "tpu", "one of cpu, gpu"),
        ("batch", 0, "at least 1"),
        ("batch", 10**5 + 1, "at most"),
        ("results_dir", "", "name a folder"),
        ("results_dir", "  ", "name a folder"),
    ],
)
def test_what_is_out_of_range_is_refused_by_name_in_one_line(key, value, reason):
    with pytest.raises(ConfigError, match=rf"^{key}\b.*{reason}") as caught:
        check_settings(settings(**{key: value}))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("group", "wrap", "path"),
    [
        ("system", lambda x: {"light": x}, r"system\.light "),
        (
            "problem",
            lambda x: {"obstacles": {"centers": [[1.0, 2.0], [3.0, x]]}},
            r"problem\.obstacles\.centers ",
        ),
        ("planner", lambda x: {"temperature": x}, r"planner\.temperature "),
        ("controller", lambda x: {"a": [{"b": x}]}, r"controller\.a\.b "),
    ],
)
def test_a_number_that_is_not_finite_is_found_however_deep(number, group, wrap, path):
    with pytest.raises(ConfigError, match=f"^{path}.*finite"):
        check_settings(settings(**{group: wrap(number)}))


@pytest.mark.parametrize("key", ["foo", "thetta", "hydra", "names"])
def test_unknown_keys_are_refused(key):
    with pytest.raises(ConfigError, match=f"unknown key '{key}'"):
        check_settings(settings(**{key: 1}))


def test_a_misspelt_key_gets_the_nearest_known_one():
    assert (
        unknown_key("thetta", ["w_obs", "theta"]) == "unknown key 'thetta'; did you mean 'theta'?"
    )
    assert unknown_key("xyz", ["w_obs", "theta"]) == "unknown key 'xyz'; see mppi-belief run --help"


@pytest.mark.parametrize(
    ("platform", "batch", "size"),
    [("cpu", None, 1), ("gpu", None, 200), ("cpu", 8, 8), ("gpu", 1, 1)],
)
def test_a_batch_that_is_not_given_is_what_suits_the_platform(platform, batch, size):
    assert batch_size(settings(platform=platform, batch=batch)) == size


def test_a_trial_is_in_the_same_batch_whichever_are_missing():
    assert list(batches(range(7), 3)) == [(0, 1, 2), (3, 4, 5), (6,)]
    assert list(batches([1, 5, 6, 11], 3)) == [(1,), (5,), (6,), (11,)]
    assert list(batches([4, 9], 1)) == [(4,), (9,)]
    assert list(batches([], 3)) == []


def test_a_whole_number_is_the_same_however_it_is_written():
    given = {
        "a": 0.0,
        "b": [1.0, 2.5, {"c": -3.0}],
        "d": True,
        "e": "1.0",
        "f": None,
        "g": 2,
        "h": 1e300,
    }
    values = canonical(given)
    assert repr(values) == repr(
        {
            "a": 0,
            "b": [1, 2.5, {"c": -3}],
            "d": True,
            "e": "1.0",
            "f": None,
            "g": 2,
            "h": int(1e300),
        }
    )
    assert given["a"].__class__ is float


@pytest.mark.parametrize("value", [b"x", {1: 2}, {"a": {None: 1}}, object(), 10**400, [{2.5: 1}]])
def test_values_that_are_no_configuration_are_refused(value):
    with pytest.raises(ConfigError, match=r"^system"):
        check_settings(settings(system={"a": value} if not isinstance(value, dict) else value))


def test_a_complaint_is_one_line_that_a_terminal_can_print():
    assert plain_line("a\nb\x1b[0m\udcff σ") == r"a\nb\x1b[0m\udcff σ"
    assert len(str(ConfigError("x" * 10_000))) == 600
