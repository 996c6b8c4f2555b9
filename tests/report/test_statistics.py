"""Paired differences of two methods; test_report.py tests the intervals of one method."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from helpers import SIGMAS
from mppi_belief.report import statistics
from mppi_belief.report.statistics import (
    NO_ESTIMATE,
    Estimate,
    holm_adjusted,
    lowest_apart,
    paired_mean_difference,
    paired_rate_difference,
    proportion_interval,
    two_sided_p,
)

SMALL_COUNTS = st.integers(0, 25)


def bca(
    values: np.ndarray, resamples: int, rng: np.random.Generator
) -> tuple[float, float, np.ndarray]:
    """Efron's (1987) interval of a mean, after his formulas, and the resampled means."""
    n = len(values)
    means = np.sort(rng.multinomial(n, np.full(n, 1 / n), size=resamples) @ values / n)
    bias = stats.norm.ppf(np.mean(means < values.mean()))
    away = values - values.mean()  # of the jackknifed means, up to a factor
    acceleration = np.sum(away**3) / (6 * np.sum(away**2) ** 1.5)
    ends = bias + stats.norm.ppf([0.025, 0.975])
    low, high = np.quantile(means, stats.norm.cdf(bias + ends / (1 - acceleration * ends)))
    return low, high, means


def test_a_mean_difference_has_efrons_interval(rng):
    first = rng.exponential(2.0, size=25) ** 1.5
    second = rng.normal(size=25)
    difference = first - second
    low, high, means = bca(difference, 200_000, np.random.default_rng(1))
    estimate = paired_mean_difference(first, second)
    assert estimate.value == pytest.approx(np.mean(difference), rel=1e-12)
    for got, expected, sign in ((estimate.low, low, 1), (estimate.high, high, -1)):
        # both the end's level and the bias, which shifts it twice, are fractions of the resamples
        level = np.mean(means <= expected)
        density = stats.gaussian_kde(means[::50])(expected)[0]
        z_error = 2 * 0.5 / stats.norm.pdf(0) * stats.norm.pdf(stats.norm.ppf(level))
        error = (
            math.hypot(math.sqrt(level * (1 - level)), z_error)
            / math.sqrt(statistics.RESAMPLES)
            / density
        )
        assert abs(got - expected) < SIGMAS * error
        # neither Student's interval nor the bootstrap's plain percentiles
        half = stats.t.ppf(0.975, 24) * stats.sem(difference)
        plain = np.quantile(means, 0.025 if sign > 0 else 0.975)
        for boundary in (estimate.value - sign * half, plain):
            assert abs(expected - boundary) > 2 * SIGMAS * error


def test_the_interval_of_a_mean_difference_covers_as_often_as_theory_says(rng, monkeypatch):
    monkeypatch.setattr(statistics, "RESAMPLES", 499)
    n = 600
    pairs = 20
    noise = rng.normal(0, 9, size=(n, pairs))  # met by both methods, so it must not count
    first, second = (noise + rng.normal(mean, 1, size=(n, pairs)) for mean in (3.0, 1.0))
    estimate = [paired_mean_difference(a, b) for a, b in zip(first, second, strict=True)]
    covered = np.mean([low <= 2 <= high for _, low, high in estimate])
    # For normal values the bootstrap is mean +- 1.96 s sqrt((n - 1) / n) / sqrt(n), which is a t
    # interval of a lower level.
    expected = 2 * stats.t.cdf(1.96 * math.sqrt((pairs - 1) / pairs), pairs - 1) - 1
    assert abs(covered - expected) < SIGMAS * math.sqrt(expected * (1 - expected) / n)


@pytest.mark.parametrize(
    ("first", "value"),
    [([], math.nan), ([2.5], 1.5), ([2.0, 5.0], 2.5)],
    ids=["none", "one", "two"],
)
def test_too_few_pairs_have_no_interval(first, value):
    estimate = paired_mean_difference(np.array(first), np.ones(len(first)))
    np.testing.assert_equal(tuple(estimate), (value, math.nan, math.nan))


def test_pairs_that_differ_alike_have_an_interval_of_no_width(rng):
    second = np.round(rng.normal(size=9), 3)
    assert paired_mean_difference(np.arange(9) + 4.0, np.arange(9)) == Estimate(4.0, 4.0, 4.0)
    assert paired_mean_difference(second, second) == Estimate(0.0, 0.0, 0.0)
    rounded = paired_mean_difference(second + 0.1, second)
    np.testing.assert_allclose(rounded, 0.1, rtol=1e-14)


def test_a_mean_difference_is_always_the_same_and_mirrored_when_its_sides_change(rng):
    first = rng.exponential(size=30)
    second = rng.exponential(size=30)
    estimate = paired_mean_difference(first, second)
    rng.normal(size=5)
    np.random.default_rng(7).normal()
    assert paired_mean_difference(first, second) == estimate
    assert estimate.low < estimate.value < estimate.high
    value, low, high = paired_mean_difference(second, first)
    np.testing.assert_allclose((-value, -high, -low), estimate, rtol=1e-9)
    np.testing.assert_allclose(
        paired_mean_difference(10 * first + 3, 10 * second), 10 * np.array(estimate) + 3, rtol=1e-9
    )


def test_a_higher_level_has_a_wider_interval(rng):
    first = rng.normal(size=30)
    second = np.zeros(30)
    narrow, wide = (paired_mean_difference(first, second, level) for level in (0.5, 0.99))
    assert wide.low < narrow.low < narrow.high < wide.high
    assert wide.value == narrow.value


def pairs(
    only_first: int, only_second: int, both: int = 0, neither: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """So many pairs of each kind."""
    kinds = [(True, False)] * only_first + [(False, True)] * only_second
    kinds += [(True, True)] * both + [(False, False)] * neither
    return tuple(np.array(kinds, dtype=bool).reshape(-1, 2).T)


def two_sided(wins: int, losses: int) -> Fraction:
    """Twice the tail of fair coins, at most one."""
    n = wins + losses
    tail = sum(math.comb(n, k) for k in range(min(wins, losses) + 1))
    return min(Fraction(1), Fraction(2 * tail, 2**n))


@given(SMALL_COUNTS, SMALL_COUNTS, SMALL_COUNTS, SMALL_COUNTS)
def test_the_p_value_is_that_of_the_sign_test(only_first, only_second, both, neither):
    first, second = pairs(only_first, only_second, both, neither)
    estimate, p = paired_rate_difference(first, second)
    if not len(first):
        assert math.isnan(p)
        assert all(map(math.isnan, estimate))
        return
    assert p == pytest.approx(float(two_sided(only_first, only_second)), rel=1e-9)
    assert estimate.value == pytest.approx(first.mean() - second.mean(), abs=1e-12)
    assert estimate.low <= estimate.value + 1e-12
    assert estimate.value <= estimate.high + 1e-12


@pytest.mark.parametrize("level", [0.95, 0.9, 0.5])
@given(only_first=SMALL_COUNTS, only_second=SMALL_COUNTS, neither=st.integers(1, 200))
def test_the_rate_interval_leaves_out_zero_exactly_where_the_test_rejects(
    level, only_first, only_second, neither
):
    (_, low, high), _ = paired_rate_difference(
        *pairs(only_first, only_second, neither=neither), level
    )
    p = two_sided(only_first, only_second)
    limit = 1 - Fraction(str(level))
    if p != limit:  # then the interval ends at zero, up to rounding
        assert (low > 0 or high < 0) == (p < limit)
    else:
        assert min(abs(low), abs(high)) < 1e-9


@given(SMALL_COUNTS, SMALL_COUNTS, st.integers(1, 200))
def test_a_rate_difference_is_mirrored_when_its_sides_change(only_first, only_second, neither):
    first, second = pairs(only_first, only_second, neither=neither)
    (value, low, high), p = paired_rate_difference(first, second)
    mirrored, same = paired_rate_difference(second, first)
    np.testing.assert_allclose((-value, -high, -low), mirrored, rtol=1e-9, atol=1e-12)
    assert p == pytest.approx(same, rel=1e-9)


def test_pairs_that_agree_say_nothing_for_either_side():
    estimate, p = paired_rate_difference(*pairs(0, 0, both=7, neither=30))
    assert (estimate.value, p) == (0.0, 1.0)
    assert estimate.low <= 0 <= estimate.high


@pytest.mark.parametrize(
    ("only_first", "only_second"),
    [(0.0, 0.23), (0.05, 0.0), (0.3, 0.1), (0.2, 0.2)],
    ids=lambda rate: f"{rate:g}",
)
def test_the_rate_interval_covers_the_difference_about_as_often_as_it_says(only_first, only_second):
    """Sums over all outcomes of 40 pairs, with given probabilities of both kinds."""
    n = 40
    covered = 0.0
    for wins in range(n + 1):
        for losses in range(n + 1 - wins):
            counts = [wins, losses, n - wins - losses]
            share = stats.multinomial.pmf(
                counts, n, [only_first, only_second, 1 - only_first - only_second]
            )
            if share > 1e-7:
                (_, low, high), _ = paired_rate_difference(*pairs(*counts[:2], neither=counts[2]))
                covered += share * (low - 1e-12 <= only_first - only_second <= high + 1e-12)
    assert covered > 0.93


def holm_by_hand(p_values: list[float]) -> list[float]:
    """Steps down: the k-th smallest of m counts m - k + 1 times, and no less than one before it."""
    adjusted = dict.fromkeys(range(len(p_values)), 0.0)
    before = 0.0
    remaining = len(p_values)
    for index in sorted(adjusted, key=lambda i: p_values[i]):
        before = max(before, min(1.0, remaining * p_values[index]))
        adjusted[index] = before
        remaining -= 1
    return [*adjusted.values()]


@given(st.lists(st.floats(0, 1), max_size=12))
def test_holms_p_values_are_those_of_his_procedure(p_values):
    np.testing.assert_allclose(holm_adjusted(p_values), holm_by_hand(p_values), rtol=1e-12)


def test_holms_own_example_and_tests_without_a_result():
    # p of 0.01, 0.02, 0.03, 0.04, 0.05: 5 x 0.01, 4 x 0.02, then no less than the one before
    np.testing.assert_allclose(
        holm_adjusted([0.05, 0.01, 0.02, 0.04, 0.03]), [0.09, 0.05, 0.08, 0.09, 0.09]
    )
    np.testing.assert_allclose(holm_adjusted([0.03, math.nan, 0.01]), [0.03, math.nan, 0.02])
    assert holm_adjusted([]) == []


def test_holm_keeps_the_probability_of_any_error(rng):
    """Of 48 equal numbers 2.4 lie beyond 1.96; after the correction one in 5 % of the studies."""
    z = rng.normal(size=(2000, 48))
    p = np.vectorize(two_sided_p)(z)
    assert abs((p < 0.05).sum(axis=1).mean() - 2.4) < SIGMAS * math.sqrt(48 * 0.05 * 0.95 / 2000)
    errors = np.mean([min(holm_adjusted(list(row))) < 0.05 for row in p])
    assert errors < 0.05 + SIGMAS * math.sqrt(0.05 * 0.95 / 2000)
    assert errors > 0.03  # it does not give away much


def test_two_sided_p_is_the_normal_tail_on_both_sides():
    for z in (0.0, 0.5, -1.96, 3.0):
        assert two_sided_p(z) == pytest.approx(2 * stats.norm.sf(abs(z)), rel=1e-12)
    assert math.isnan(two_sided_p(math.nan))


def test_the_lowest_is_apart_only_where_its_interval_is_below_all_others():
    low = Estimate(1.0, 0.0, 2.0)
    high = Estimate(5.0, 3.0, 7.0)
    assert lowest_apart([high, low, high]) == 1
    assert lowest_apart([high, low, Estimate(4.0, 2.0, 6.0)]) is None  # the intervals touch
    assert lowest_apart([high, low, Estimate(4.0, 1.5, 6.0)]) is None
    assert lowest_apart([low]) is None
    assert lowest_apart([]) is None
    assert lowest_apart([low, NO_ESTIMATE]) is None
    # none of 12 against 3 of 12: neither is certain
    assert lowest_apart([proportion_interval(0, 12), proportion_interval(3, 12)]) is None
    assert lowest_apart([proportion_interval(0, 200), proportion_interval(36, 200)]) == 0
