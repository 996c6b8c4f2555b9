"""Proposition 3: its certificate, that it can fail, and the constructions of (i) and (ii)."""

import itertools

import numpy as np
import pytest

from helpers import float64, random_spd
from mppi_belief.matching.weights import (
    best_weight,
    feasible_control_weight,
    feasible_weight,
    numerical_rank,
    range_included,
)
from mppi_belief.verify.certificates import matching_feasibility
from mppi_belief.verify.scenarios import rank_patterns

RANKS, WEIGHT, NEGATIVE, CONTROL, DEFINITE, SINGULAR, LEAST, BOUND, VERDICTS, NEARLY = range(10)


@pytest.fixture(scope="module")
def certificate():
    with float64():
        return matching_feasibility.certify(1)


def failing(certificate):
    return {i for i, check in enumerate(certificate.checks) if not check.holds}


def test_the_certificate_holds(certificate):
    assert not failing(certificate), [check for check in certificate.checks if not check.holds]
    assert len(certificate.checks) == 10


def test_all_relations_of_the_ranges_occur():
    chosen = list(rank_patterns.rank_cases(np.random.default_rng(0)))
    assert {(case.included, case.equal) for case in chosen} == {
        (True, True),
        (True, False),
        (False, False),
    }
    assert {case.G.shape for case in chosen} == set(itertools.product(range(1, 6), repeat=2))
    for case in chosen:  # what is known of them, by NumPy alone
        rank = np.linalg.matrix_rank
        both = rank(
            np.hstack(
                [
                    case.G / max(np.linalg.norm(case.G), 1e-9),
                    case.D / max(np.linalg.norm(case.D), 1e-9),
                ]
            )
        )
        assert (both == rank(case.G)) == case.included
        assert (rank(case.D) == rank(case.G) and case.included) == case.equal


@pytest.mark.parametrize(
    ("name", "broken", "fails"),
    [
        # a verdict by rank alone; by nothing; the row space's part forgotten
        ("range_included", lambda D, G: numerical_rank(D) <= numerical_rank(G), {RANKS}),
        ("feasible_weight", lambda D, G, t: feasible_weight(D, G, t) * (1 + 1e-12), {WEIGHT}),
        (
            "feasible_weight",
            lambda D, G, t: feasible_weight(D, G, t) + 1e-6 * np.eye(G.shape[1]),
            {WEIGHT, SINGULAR},
        ),
        (
            "feasible_weight",
            lambda D, G, t: feasible_weight(D, G, t) - 1e-6 * np.eye(G.shape[1]),
            {NEGATIVE},
        ),
        (
            "feasible_control_weight",
            lambda D, G, t: 2 * feasible_control_weight(D, G, t),
            {CONTROL},
        ),
        ("best_weight", lambda D, G: 1.01 * best_weight(D, G), {LEAST}),
    ],
)
def test_what_is_broken_is_seen(name, broken, fails, x64, monkeypatch):
    monkeypatch.setattr(rank_patterns, name, broken)
    if name == "best_weight":  # what is compiled has the right one in it
        residuals = rank_patterns.stacked_residuals.__wrapped__
        monkeypatch.setattr(
            rank_patterns, "stacked_residuals", lambda *arguments: residuals(*arguments)
        )
    assert fails <= failing(matching_feasibility.certify(0))


def test_an_inner_weight_extended_by_too_much_is_seen(x64, monkeypatch):
    def stretched(D, G, temperature):
        R = feasible_control_weight(D, G, temperature)
        *_, Vt = np.linalg.svd(G)
        kernel = Vt[numerical_rank(G) :].T
        return R + 1e6 * np.linalg.norm(R) * kernel @ kernel.T

    monkeypatch.setattr(rank_patterns, "feasible_control_weight", stretched)
    assert DEFINITE in failing(matching_feasibility.certify(0))


def test_one_weight_of_many_controls():
    """Take two equal controls: R is lambda |G|^2 / D on their sum, and so on their difference."""
    G = np.array([[1.0, 1.0]])
    D = np.array([[3.0]])
    with float64():
        R = feasible_control_weight(D, G, 0.6)
        W = feasible_weight(D, G, 0.6)
    np.testing.assert_allclose(0.6 * G @ np.linalg.inv(R) @ G.T, D, rtol=1e-12)
    np.testing.assert_allclose(R, 0.6 * 2 / 3 * np.eye(2), atol=1e-12)
    np.testing.assert_allclose(W, np.full((2, 2), 3 / 4 / 0.6), rtol=1e-12)


def test_the_kernel_gets_the_geometric_mean(rng, x64):
    weight = random_spd(rng, 3)
    G = np.hstack([np.eye(3), np.zeros((3, 2))])
    R = feasible_control_weight(0.7 * np.linalg.inv(weight), G, 0.7)
    np.testing.assert_allclose(R[:3, :3], weight, atol=1e-12)
    np.testing.assert_allclose(R[3:, 3:], np.linalg.det(weight) ** (1 / 3) * np.eye(2), rtol=1e-12)


def test_no_control_and_no_diffusion_match_with_any_weight(x64):
    np.testing.assert_array_equal(
        feasible_control_weight(np.zeros((2, 2)), np.zeros((2, 3)), 1.0), np.eye(3)
    )
    np.testing.assert_array_equal(feasible_weight(np.zeros((2, 2)), np.ones((2, 1)), 1.0), [[0.0]])


def test_refusals_are_one_clear_line():
    G = np.eye(3)[:, :2]
    with pytest.raises(ValueError, match=r"no W >= 0 .*range\(D\) is not contained in range\(G\)$"):
        feasible_weight(np.eye(3), G, 1.0)
    with pytest.raises(ValueError, match=r"no R > 0 .*range\(D\) is not contained in range\(G\)$"):
        feasible_control_weight(np.eye(3), G, 1.0)
    with pytest.raises(ValueError, match=r"no R > 0 .*rank\(D\) = 1 < rank\(G\) = 2$"):
        feasible_control_weight(np.diag([1.0, 0, 0]), G, 1.0)


def test_a_weight_beyond_the_precision_is_refused_or_finite(rng):
    rows, columns = (np.linalg.qr(rng.normal(size=(4, 4)))[0] for _ in range(2))
    G = rows @ np.diag([1, 1e-5, 1e-9, 1e-13]) @ columns
    refused = 0
    for _ in range(20):
        D = random_spd(rng, 4)
        if range_included(D, G):
            try:
                assert np.all(np.isfinite(feasible_control_weight(D, G, 1.0)))
            except ValueError:
                refused += 1
    assert refused


def test_ranks_follow_the_precision_of_the_arrays():
    M = np.diag([1.0, 1e-9])
    assert numerical_rank(M) == 2
    assert numerical_rank(M.astype(np.float32)) == 1
    assert numerical_rank(np.zeros((3, 2))) == 0
    assert numerical_rank([[1, 2], [2, 4]]) == 1
    # a D in single precision says nothing finer about a G in double
    G = np.array([[1.0], [1.0]]) / 3
    D = (G @ G.T).astype(np.float32)
    assert range_included(D, G)
    assert not range_included(D + np.diag([0, 1e-3]), G)
