"""Rules for expectations under Gaussians: what they integrate exactly, and no negative weight."""

from itertools import combinations_with_replacement

import numpy as np
import pytest

from mppi_belief.numerics import quadrature

RULES = {"cost": quadrature.cost_rule, "degree five": quadrature.degree_five_rule}
STEEPNESS = 0.25  # standard deviations over which a logistic edge rises


def normal_moment(powers: np.ndarray) -> float:
    """E prod x_i^p_i for independent standard normals: a product of double factorials."""
    return float(np.prod([0 if p % 2 else np.prod(np.arange(p - 1, 0, -2)) for p in powers]))


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("n", range(1, 13))
def test_every_monomial_up_to_degree_five_is_exact(n, rule):
    points, weights = RULES[rule](n)
    assert points.shape == (len(weights), n)
    for degree in range(6):
        for factors in combinations_with_replacement(range(n), degree):
            computed = weights @ np.prod(points[:, list(factors)], axis=1)
            expected = normal_moment(np.bincount(factors, minlength=n))
            assert computed == pytest.approx(expected, abs=1e-11), factors


@pytest.mark.parametrize("rule", [*RULES.values(), quadrature.sigma_points])
@pytest.mark.parametrize("n", range(1, 13))
def test_no_weight_is_negative_and_all_add_up_to_one(n, rule):
    _, weights = rule(n)
    assert weights.min() >= 0
    assert weights.sum() == pytest.approx(1, abs=1e-13)


@pytest.mark.parametrize("n", range(1, 13))
def test_the_expectation_of_a_function_that_is_nowhere_negative_is_not(n, rng):
    points, weights = quadrature.cost_rule(n)
    for direction in rng.normal(size=(50, n)):
        edge = rng.uniform(0, 3) * np.linalg.norm(direction)
        values = np.maximum(points @ direction - edge, 0.0) ** 2
        mean = weights @ values
        assert mean >= 0
        assert weights @ (values - mean) ** 2 >= 0


def test_rules_for_many_components_grow_by_fewer_points_than_two_n_squared():
    sizes = [len(quadrature.cost_rule(n)[1]) for n in range(1, 13)]
    assert sizes == [37, 37, 27, 25, 42, 44, 78, 144, 146, 276, 278, 280]


@pytest.mark.parametrize(("n", "error"), [(1, 0.001), (2, 0.03), (3, 0.13)])
def test_a_steep_edge_of_few_components_is_integrated(n, error, rng):
    """The rules of a few components resolve what rises within a quarter of a standard deviation."""
    axis = np.linspace(-6, 6, (2001, 201, 49)[n - 1])
    fine = np.stack(np.meshgrid(*[axis] * n), axis=-1).reshape(-1, n)
    fine_weights = np.exp(-0.5 * np.sum(fine**2, axis=1))
    fine_weights = fine_weights / fine_weights.sum()
    points, weights = quadrature.cost_rule(n)
    errors = []
    for centre in rng.normal(size=(40, n)):
        centre = centre * rng.uniform(1.5, 3.5) / np.linalg.norm(centre)

        def danger(x: np.ndarray, centre: np.ndarray = centre) -> np.ndarray:
            clearance = np.linalg.norm(x - centre, axis=1) - 1.5
            return 1 / (1 + np.exp(clearance / STEEPNESS))

        exact = fine_weights @ danger(fine)
        errors.append((weights @ danger(points) - exact) / max(exact, 0.05))
    assert np.sqrt(np.mean(np.square(errors))) < error


@pytest.mark.parametrize("n", [2, 4, 6])
def test_degree_six_is_beyond_the_rule(n):
    points, weights = quadrature.degree_five_rule(n)
    assert abs(weights @ points[:, 0] ** 6 - 15) > 1
