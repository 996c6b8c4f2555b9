"""Bands: where they come from, and how often a true statement fails."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from mppi_belief.verify.bands import (
    EPSILON,
    FALSE_ALARM,
    largest_z,
    observed_orders,
    order,
    quantile,
    rounding,
    within_errors,
)


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
