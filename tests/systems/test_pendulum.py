"""Tests the pendulum: its equation of motion, its measurement and how curved that is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import mppi_belief as mb
from helpers import quick_jit
from mppi_belief.matching.affine import outside_mean_tangent
from system_helpers import pendulum


@quick_jit
def measured_at(system: mb.Pendulum, angles: np.ndarray) -> jax.Array:
    """Returns the measurements (P,) at angles (P,)."""
    return jax.vmap(lambda a: system.c(jnp.stack([a, a]))[0])(angles)


@quick_jit
def outside(system: mb.Pendulum, mean: np.ndarray, cov: np.ndarray) -> tuple[jax.Array, jax.Array]:
    return outside_mean_tangent(system.c, mean, cov)


def test_it_obeys_its_equation_of_motion(rng):
    system = pendulum()
    for a, r in rng.normal(size=(5, 2)):
        np.testing.assert_allclose(
            system.f(jnp.array([a, r])), [r, -3 * np.sin(a) - 0.5 * r], rtol=1e-5
        )
    np.testing.assert_array_equal(system.G(jnp.zeros(2)), [[0], [1]])
    np.testing.assert_allclose(system.H, [[0], [0.3]], rtol=1e-6)
    np.testing.assert_allclose(system.sigma_o(jnp.zeros(2)), [[0.1]], rtol=1e-6)


@pytest.mark.parametrize("kappa", [1e-6, 0.3, 1.0, 2.5])
def test_it_is_measured_through_a_sine_about_the_anchor(x64, rng, kappa):
    a = rng.uniform(-3, 3, 6)
    expected = np.sin(1.2) + (np.sin(1.2 + kappa * (a - 1.2)) - np.sin(1.2)) / kappa
    np.testing.assert_allclose(measured_at(pendulum(curvature=kappa), a), expected, atol=1e-9)
    np.testing.assert_allclose(
        measured_at(pendulum(curvature=kappa, anchor=0.0), a), np.sin(kappa * a) / kappa, atol=1e-9
    )


def test_curvature_one_is_the_sine_and_zero_its_tangent():
    a = np.linspace(-3, 3, 13)
    sine = measured_at(pendulum(curvature=1.0), a)
    tangent = measured_at(pendulum(curvature=0.0), a)
    np.testing.assert_allclose(sine, np.sin(a), atol=1e-6)
    np.testing.assert_allclose(tangent, np.sin(1.2) + np.cos(1.2) * (a - 1.2), atol=1e-6)


def test_the_derivative_at_the_anchor_does_not_depend_on_curvature(x64):
    jacobian = quick_jit(lambda system: jax.jacfwd(system.c)(jnp.array([1.2, 0.0])))
    for kappa in (0.0, 1e-9, 1.0, 4.0):
        C = jacobian(pendulum(curvature=kappa))
        np.testing.assert_allclose(C, [[np.cos(1.2), 0]], atol=1e-12)


@pytest.mark.parametrize("kappa", [0.0, 0.5, 1.0, 2.0])
def test_theorem_1_leaves_the_closed_form(x64, kappa):
    """Compares with 1 - (E[c'] s)^2 / Var[c], by the characteristic function of a Gaussian."""
    mean = 0.9
    s = 0.4
    part, A = outside(pendulum(curvature=kappa), np.array([mean, 0.3]), np.diag([s**2, 0.1]))
    m = 1.2 + kappa * (mean - 1.2)
    v = (kappa * s) ** 2
    slope = np.cos(m) * np.exp(-v / 2)
    variance = -np.expm1(-v) * (1 + np.exp(-v) * np.cos(2 * m)) / 2 / (kappa or 1) ** 2
    np.testing.assert_allclose(A, [[slope, 0]], atol=1e-12)
    np.testing.assert_allclose(part, 1 - slope**2 * s**2 / variance if kappa else 0, atol=1e-10)


@pytest.mark.parametrize(
    ("field", "value"), [("sensor_noise", 0), ("gravity", -1), ("curvature", -0.1)]
)
def test_a_pendulum_refuses_numbers_without_meaning(field, value):
    with pytest.raises(ValueError, match=field):
        pendulum(**{field: value})
