"""A check with its band, a certificate, and both as JSON."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mppi_belief.results.certificate import (
    Certificate,
    Check,
    Line,
    Panel,
    as_dict,
    from_dict,
)
from mppi_belief.verify.bands import at_least, at_most, near

FINITE = st.floats(-1e6, 1e6)


def test_a_check_holds_within_its_band_ends_included():
    assert at_most("x", 1.0, 1.0, "").holds
    assert not at_most("x", np.nextafter(1, 2), 1.0, "").holds
    assert at_least("x", 1.0, 1.0, "").holds
    assert not at_least("x", 0.999, 1.0, "").holds
    assert near("x", 1.5, 1.0, 0.5, "").holds
    assert not near("x", 1.51, 1.0, 0.5, "").holds


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_no_number_does_not_hold(value):
    assert not near("x", value, 0.0, 1e9, "").holds
    assert not Check("x", math.nan, -math.inf, math.inf, "").holds


def test_bands_as_text():
    assert at_most("x", 0, 1e-12, "").band == "≤ 1e-12"
    assert at_least("x", 0, 0.25, "").band == "≥ 0.25"
    assert near("x", 0, 2.0, 0.015, "").band == "[1.985, 2.015]"
    assert near("x", 0, 1.0, 0.0, "").band == "= 1"
    assert near("x", 0, 0.8, 7e-13, "").band == "0.8 ± 7e-13"


def test_a_certificate_holds_if_all_its_checks_do():
    good = at_most("x", 0, 1, "")
    bad = at_most("x", 2, 1, "")
    assert Certificate("n", "s", "t", [good, good]).holds
    assert not Certificate("n", "s", "t", [good, bad]).holds
    assert not Certificate("n", "s", "t", []).holds


@given(
    st.lists(st.tuples(FINITE | st.just(math.nan), FINITE), min_size=1, max_size=3),
    st.lists(FINITE, max_size=4),
)
def test_a_certificate_survives_json(numbers, curve):
    checks = [at_most("≤", value, bound, "d") for value, bound in numbers]
    checks += [at_least("≥", value, bound, "d") for value, bound in numbers]
    lines = [
        Line("first", np.array(curve), curve, "points", curve, None),
        Line("second", curve, curve),
    ]
    certificate = Certificate(
        "name", "Theorem 0", "text", checks, [Panel("t", "x", "y", lines, "x")]
    )
    back = from_dict(json.loads(json.dumps(as_dict(certificate), allow_nan=False)))
    assert [check.band for check in back.checks] == [check.band for check in certificate.checks]
    assert [check.holds for check in back.checks] == [check.holds for check in certificate.checks]
    assert back.holds == certificate.holds
    assert list(back.panels[0].lines[0].y) == list(curve)
    assert back.panels[0].lines[0].high is None
    assert (back.name, back.statement, back.text, back.panels[0].log) == (
        "name",
        "Theorem 0",
        "text",
        "x",
    )
