"""How far one number is from another: z of no difference is a standard normal."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from helpers import SIGMAS
from mppi_belief.report.statistics import mean_z, proportion_z, spread_z

STUDIES = 3000
SIZES = st.integers(1, 300)


def assert_standard_normal(z: np.ndarray) -> None:
    """Mean 0 and standard deviation 1, within standard errors (of normal samples)."""
    assert abs(z.mean()) < SIGMAS / math.sqrt(len(z))
    assert abs(z.std(ddof=1) - 1) < SIGMAS / math.sqrt(2 * len(z))


def test_z_of_equal_means_is_a_standard_normal(rng):
    first = rng.normal(5, 3, size=(STUDIES, 80))
    second = rng.normal(5, 1, size=(STUDIES, 200))
    z = [
        mean_z(a.mean(), a.std(ddof=1), 80, b.mean(), b.std(ddof=1), 200)
        for a, b in zip(first, second, strict=True)
    ]
    assert_standard_normal(np.array(z))


def test_z_of_equal_spreads_is_a_standard_normal(rng):
    first = rng.normal(5, 3, size=(STUDIES, 150))
    second = rng.normal(1, 3, size=(STUDIES, 200))
    z = [
        spread_z(a.std(ddof=1), 150, b.std(ddof=1), 200) for a, b in zip(first, second, strict=True)
    ]
    assert_standard_normal(np.array(z))


@pytest.mark.parametrize(("rate", "n"), [(0.25, 200), (0.5, 100), (0.15, 400)])
def test_z_of_equal_proportions_is_a_standard_normal(rate, n, rng):
    first = rng.binomial(n, rate, size=STUDIES)
    second = rng.binomial(200, rate, size=STUDIES)
    assert_standard_normal(
        np.array([proportion_z(int(a), n, int(b), 200) for a, b in zip(first, second, strict=True)])
    )


def test_z_of_a_mean_is_welchs_t():
    expected = stats.ttest_ind_from_stats(56.1, 4.9, 60, 56.5, 5.2, 200, equal_var=False).statistic
    assert mean_z(56.1, 4.9, 60, 56.5, 5.2, 200) == pytest.approx(expected, rel=1e-12)
    assert mean_z(3.0, 2.0, 4, 1.0, 3.0, 9) == pytest.approx(2 / math.sqrt(2), rel=1e-12)


def test_z_of_a_spread_is_its_difference_in_standard_errors():
    assert spread_z(3.0, 10, 4.0, 9) == pytest.approx(-1 / math.sqrt(9 / 18 + 16 / 16), rel=1e-12)
    assert spread_z(4.0, 9, 3.0, 10) == -spread_z(3.0, 10, 4.0, 9)
    assert spread_z(5.0, 30, 5.0, 200) == 0


@given(SIZES, SIZES, st.data())
def test_z_of_a_proportion_is_the_signed_root_of_the_likelihood_ratio(n, m, data):
    hits = data.draw(st.integers(0, n))
    published_hits = data.draw(st.integers(0, m))
    z = proportion_z(hits, n, published_hits, m)
    if hits + published_hits not in (0, n + m):  # scipy refuses an empty column
        table = [[hits, n - hits], [published_hits, m - published_hits]]
        ratio = stats.chi2_contingency(table, correction=False, lambda_="log-likelihood").statistic
        assert z**2 == pytest.approx(ratio, rel=1e-9, abs=1e-9)
    difference = hits * m - published_hits * n
    assert z * difference >= 0
    assert (abs(z) > 1e-6) == (difference != 0)


@given(SIZES, SIZES, st.data())
def test_z_of_a_proportion_changes_sign_with_its_sides_and_with_what_is_counted(n, m, data):
    hits = data.draw(st.integers(0, n))
    published_hits = data.draw(st.integers(0, m))
    z = proportion_z(hits, n, published_hits, m)
    assert proportion_z(published_hits, m, hits, n) == pytest.approx(-z, abs=1e-6)
    assert proportion_z(n - hits, n, m - published_hits, m) == pytest.approx(-z, abs=1e-6)


def test_none_against_a_quarter_and_none_against_none():
    # log likelihoods of one rate, 49 of 400, and of two, 0 of 200 and 49 of 200, written out
    pooled_likelihood = 49 * math.log(49 / 400) + 351 * math.log(351 / 400)
    two = 49 * math.log(49 / 200) + 151 * math.log(151 / 200)
    z = proportion_z(0, 200, 49, 200)
    assert z == pytest.approx(-math.sqrt(2 * (two - pooled_likelihood)), rel=1e-12)
    assert z == pytest.approx(-8.65, abs=0.01)
    assert proportion_z(49, 200, 0, 200) == -z
    assert (
        proportion_z(0, 200, 0, 200)
        == proportion_z(0, 7, 0, 200)
        == proportion_z(200, 200, 3, 3)
        == 0
    )


def test_more_hits_are_farther_away():
    z = [proportion_z(hits, 200, 10, 200) for hits in range(201)]
    assert z == sorted(z)
    assert len(set(z)) == 201
