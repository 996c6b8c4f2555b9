"""Time steps and the two meanings of sigma_o."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import light_dark_problem, random_spd
from mppi_belief import discretise

DT = 0.1
X = np.array([3.0, 1.0, 0.5, -0.2])


def problem(convention: str) -> mb.Problem:
    return light_dark_problem(noise_convention=convention)


def test_euler_step_by_hand(x64):
    u = jnp.array([2.0, -4.0])
    after = discretise.euler_step(problem("sample").system, jnp.asarray(X), u, DT)
    np.testing.assert_allclose(after, [3.05, 0.98, 0.7, -0.6], rtol=1e-14)


def test_sigma_o_is_a_samples_standard_deviation_or_an_intensity(x64):
    variance = (2 / np.sqrt(2) + 0.1) ** 2
    sample = problem("sample")
    intensity = problem("intensity")
    np.testing.assert_allclose(
        discretise.measurement_cov(sample, X), variance * np.eye(2), rtol=1e-14
    )
    np.testing.assert_allclose(
        discretise.measurement_intensity(sample, X), variance * DT * np.eye(2), rtol=1e-14
    )
    np.testing.assert_allclose(
        discretise.measurement_cov(intensity, X), variance / DT * np.eye(2), rtol=1e-14
    )
    np.testing.assert_allclose(
        discretise.measurement_intensity(intensity, X), variance * np.eye(2), rtol=1e-14
    )


@pytest.mark.parametrize("convention", ["sample", "intensity"])
def test_factor_covariance_and_intensity_agree_for_a_full_noise_matrix(convention, x64, rng):
    # neither diagonal nor symmetric, so that a transpose would show
    sigma = random_spd(rng, 2) @ np.array([[1.0, 0.7], [0.0, 1.0]])
    sensor = SimpleNamespace(
        noise_convention=convention, dt=DT, system=SimpleNamespace(sigma_o=lambda x: sigma)
    )
    factor = discretise.measurement_factor(sensor, X)
    R_s = discretise.measurement_cov(sensor, X)
    R_o = discretise.measurement_intensity(sensor, X)
    np.testing.assert_allclose(factor @ factor.T, R_s, rtol=1e-13)
    np.testing.assert_allclose(R_o, R_s * DT, rtol=1e-13)
    np.testing.assert_allclose(R_s if convention == "sample" else R_o, sigma @ sigma.T, rtol=1e-13)
