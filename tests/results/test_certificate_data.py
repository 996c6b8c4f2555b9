"""What a check, its band and a certificate are; where bands come from."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from mppi_belief.results.certificate import Certificate, Check, Line, Panel, as_dict, from_dict
from mppi_belief.verify.bands import (
    EPSILON,
    FALSE_ALARM,
    at_least,
    at_most,
    largest_z,
    near,
    observed_orders,
    order,
    quantile,
    rounding,
    within_errors,
)

FINITE = st.floats(-1e6, 1e6)


def test_a_check_holds_within_its_band_ends_included():
    assert at_most("x", 1.0, 1.0, "").holds
    assert not at_most("x", np.nextafter(1, 2), 1.0, "").holds
    assert at_least("x", 1.0, 1.0, "").holds
    assert not at_least("x", 0.999, 1.0, "").holds
    assert near("x", 1.5, 1.0, 0.5, "").holds
    assert not near("x", 1.51, 1.0, 0.5, "").holds


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_does_not_hold(value):
    assert not near("x", value, 0.0, 1e9, "").holds
    assert not Check("x", math.nan, -math.inf, math.inf, "").holds


def test_bands_as_text():
    assert at_most("x", 0, 1e-12, "").band == "≤ 1e-12"
    assert at_least("x", 0, 0.25, "").band == "≥ 0.25"
    assert near("x", 0, 2.0, 0.015, "").band == "[1.985, 2.015]"
    assert near("x", 0, 1.0, 0.0, "").band == "= 1"
    assert near("x", 0, 0.8, 7e-13, "").band == "0.8 ± 7e-13"


def test_rounding_is_a_number_of_operations_on_numbers_of_a_size():
    assert rounding("x", -99 * EPSILON, operations=100).holds
    assert not rounding("x", 101 * EPSILON, operations=100).holds
    assert rounding("x", 101 * EPSILON, operations=100, scale=2.0).holds


def test_a_quantile_leaves_the_false_alarm_to_all_points_together():
    assert 2 * norm.sf(quantile()) == pytest.approx(FALSE_ALARM)
    assert 45 * 2 * norm.sf(quantile(45)) == pytest.approx(FALSE_ALARM)
    assert quantile(1, degrees=9) > quantile(1, degrees=99) > quantile()


def test_monte_carlo_checks_pass_and_fail_at_their_quantile():
    assert within_errors("x", 1 + 0.99 * quantile() * 0.1, 1.0, 0.1).holds
    assert not within_errors("x", 1 + 1.01 * quantile() * 0.1, 1.0, 0.1).holds
    assert within_errors("x", 1 + 1.01 * quantile() * 0.1, 1.0, 0.1, bias=0.01).holds
    inside = quantile(3) * np.array([0.99, -0.99, 0.5])
    assert largest_z("x", inside).holds
    assert not largest_z("x", 1.02 * inside).holds
    assert not largest_z("x", [0.1, math.nan]).holds


@pytest.mark.parametrize("seed", range(3))
def test_a_true_statement_hardly_ever_fails(seed):
    z = np.random.default_rng(seed).normal(size=(2000, 20))
    failures = sum(not largest_z("x", row).holds for row in z)
    assert failures <= 4  # 0.2 are expected


@given(st.floats(0.5, 4), st.floats(0.1, 1.5), st.floats(1e-6, 1e3))
def test_the_order_of_a_scheme_is_seen_through_its_next_term(p, c, size):
    h = 0.5 ** np.arange(2, 8)
    errors = size * h**p * (1 + c * h)
    assert order("x", p, errors).holds
    assert not order("x", p + 0.5, errors).holds
    np.testing.assert_allclose(observed_orders(size * h**p), p, rtol=1e-9)


def test_a_sequence_that_does_not_converge_has_no_order():
    assert not order("x", 1.0, [1.0, 0.9, 0.85, 0.8]).holds
    assert not order("x", 2.0, [1.0, 0.5, 0.25, 0.125]).holds


@given(st.floats(0.8, 3), st.floats(1e-4, 0.1))
def test_an_error_that_stalls_on_another_limit_has_no_order(p, limit):
    h = 0.5 ** np.arange(1, 6)
    assert not order("x", p, h**p + limit * h[-1] ** p).holds


def test_a_certificate_holds_if_all_its_checks_do():
    good, bad = at_most("x", 0, 1, ""), at_most("x", 2, 1, "")
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
    lines = [Line("one", np.array(curve), curve, "points", curve, None), Line("two", curve, curve)]
    made = Certificate("name", "Theorem 0", "text", checks, [Panel("t", "x", "y", lines, "x")])
    back = from_dict(json.loads(json.dumps(as_dict(made), allow_nan=False)))
    assert [check.band for check in back.checks] == [check.band for check in made.checks]
    assert [check.holds for check in back.checks] == [check.holds for check in made.checks]
    assert back.holds == made.holds
    assert list(back.panels[0].lines[0].y) == list(curve)
    assert back.panels[0].lines[0].high is None
    assert (back.name, back.statement, back.text, back.panels[0].log) == (
        "name",
        "Theorem 0",
        "text",
        "x",
    )
