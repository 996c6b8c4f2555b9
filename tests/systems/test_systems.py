"""Tests the systems of the paper against their formulas."""

import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import light_dark_problem
from reference import light_dark as numpy_light_dark


def test_light_dark_is_the_double_integrator_of_the_paper(x64, rng):
    system = light_dark_problem().system
    model = numpy_light_dark(sampled=True, dt=1.0)
    x = jnp.asarray(rng.normal(size=4))
    np.testing.assert_allclose(system.f(x), model.A @ x)
    np.testing.assert_allclose(system.G(x), model.B)
    np.testing.assert_allclose(system.c(x), model.C @ x)
    np.testing.assert_allclose(system.H @ system.H.T, model.Q, atol=1e-15)


@pytest.mark.parametrize(
    ("p_x", "sigma"), [(5.0, 0.1), (3.0, 2**0.5 + 0.1), (7.0, 2**0.5 + 0.1), (1.0, 8**0.5 + 0.1)]
)
def test_light_dark_noise_is_least_in_the_light(light_dark, p_x, sigma):
    noise = light_dark.system.sigma_o(jnp.array([p_x, -2.0, 1.0, 1.0]))
    np.testing.assert_allclose(noise, sigma * np.eye(2), rtol=1e-6)


def test_light_dark_distances_ignore_the_velocity(light_dark):
    x = jnp.array([3.0, 0.0, 5.0, -5.0])
    np.testing.assert_array_equal(light_dark.position_of(x), x[:2])
    assert light_dark.clearance(x) == pytest.approx(0.35)


def test_scalar_linear_is_its_five_numbers():
    system = mb.ScalarLinear(0.3, 0.8, 1.2, 0.7, 0.5)
    x = jnp.array([2.0])
    values = [system.f(x), system.G(x), system.c(x), system.H, system.sigma_o(x)]
    for value, expected in zip(values, ([0.6], [[0.8]], [2.4], [[0.7]], [[0.5]]), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("field", "value"),
    [("noise_floor", 0), ("noise_slope", -1), ("process_noise", -1)],
)
def test_light_dark_refuses_numbers_without_meaning(field, value):
    with pytest.raises(ValueError, match=field):
        light_dark_problem(system={field: value})
