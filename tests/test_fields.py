"""Tests the rules of fields: what they accept, and what they say of a refused value."""

import dataclasses
import math

import pytest

from cli_helpers import python
from mppi_belief.fields import Choice, Number, Text, WholeNumber, checked, ruled, rules


@dataclasses.dataclass
class Settings:
    """Holds fields with rules, and one without."""

    theta: float = ruled(Number(ge=0), 1.0)
    workers: int = ruled(WholeNumber(ge=1, le=1024), 2)
    platform: str = ruled(Choice(("cpu", "gpu")), "cpu")
    memory: str = ruled(Text(r"\d+GB", "an amount such as 2GB"), "2GB")
    label: str = ""


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("theta", -1, "theta must be at least 0, got -1"),
        ("theta", -0.5, "theta must be at least 0, got -0.5"),
        ("theta", math.nan, "theta must be finite, got nan"),
        ("theta", 10**400, "theta must be finite, got 1000"),
        ("theta", "1", "theta must be a number, got '1'"),
        ("theta", True, "theta must be a number, got True"),
        ("theta", None, "theta must be a number, got None"),
        ("workers", 0, "workers must be at least 1, got 0"),
        ("workers", 1025, "workers must be at most 1024, got 1025"),
        ("workers", 2.0, "workers must be a whole number, got 2.0"),
        ("workers", True, "workers must be a whole number, got True"),
        ("platform", "tpu", "platform must be one of cpu, gpu, got 'tpu'"),
        ("platform", None, "platform must be one of cpu, gpu, got None"),
        ("memory", "2", "memory must be an amount such as 2GB, got '2'"),
        ("memory", 2, "memory must be an amount such as 2GB, got 2"),
    ],
)
def test_a_refused_value_is_named_with_what_is_allowed(name, value, message):
    with pytest.raises(ValueError) as caught:
        checked(name, value, rules(Settings)[name])
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("name", "value"),
    [("theta", 0.0), ("workers", 1), ("workers", 1024), ("platform", "gpu"), ("memory", "16GB")],
)
def test_a_value_within_its_bounds_is_returned(name, value):
    assert checked(name, value, rules(Settings)[name]) == value


def test_a_number_becomes_a_float_and_none_passes_only_where_it_is_optional():
    assert type(Number().check(2)) is float
    assert Number(optional=True).check(None) is None
    assert WholeNumber(optional=True).check(None) is None
    with pytest.raises(ValueError, match="greater than 0, got 0"):
        Number(gt=0).check(0)


def test_only_fields_with_a_rule_are_listed():
    assert list(rules(Settings)) == ["theta", "workers", "platform", "memory"]


def test_fields_load_neither_jax_nor_numpy(tmp_path):
    code = (
        "import sys, mppi_belief.fields; print([m for m in ('jax', 'numpy') if m in sys.modules])"
    )
    assert python(code, tmp_path) == "[]"
