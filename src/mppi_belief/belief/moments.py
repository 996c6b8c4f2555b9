"""Moments of quadratics and Gaussian bumps under x ~ N(mean, cov), in closed form.

    quadratic   q(x) = 1/2 (x - r)' W (x - r)
    bump        b(p) = exp(-|p - z|^2 / (2 l^2)),   p the first d components of x

Every covariance is written as a product of positive terms or through log1p and expm1, never as
E[q^2] - E[q]^2: at penalty weights of 1e4 that difference has no correct digit in float32.
With A = Sigma_p / l^2, M1 = (I + A)^-1, M2 = (I + 2A)^-1 (all functions of the covariance alone):

    log E[b_i]               = -1/2 log det(I + A) - 1/2 d_i' M1 d_i / l^2,   d_i = mu_p - z_i
    log E[b_i b_j] / (E E)   = 1/2 log det(I + A M2 A) + m' M1 A M2 m / l^2 - 1/4 e' M1 A e / l^2

where m = (d_i + d_j) / 2 and e = z_i - z_j.
"""

import jax.numpy as jnp
from jax import Array

from ..numerics.linalg import (
    Vector,
    as_matrix,
    dot,
    log_det_1p,
    matvec,
    minus,
    quadratic_form,
    spd_inverse,
    symmetrise,
)


def quadratic_moments(
    mean: Vector, cov: Array, reference: Array, weight: Array
) -> tuple[Array, Array]:
    """Returns expectation (eq. (4)) and variance of the quadratic, both ().

    The weight is a diagonal (nx,) or a matrix (nx, nx).
    """
    offset = minus(mean, reference)
    spread = as_matrix(weight) @ cov
    expectation = 0.5 * (dot(matvec(weight, offset), offset) + jnp.trace(spread))
    variance = 0.5 * jnp.sum(spread * spread.T) + quadratic_form(cov, matvec(weight, offset))
    return expectation, variance


def bump_sum(x: Vector, centers: Array, width: Array | float) -> Array:
    """Returns the sum () of bumps at centers (n, d), at one point (d or more,)."""
    offsets = [minus(x, center) for center in jnp.asarray(centers)]
    return sum((jnp.exp(-0.5 / width**2 * dot(d, d)) for d in offsets), jnp.zeros_like(x[0]))


def bump_sum_moments(
    mean: Vector, cov: Array, centers: Array, width: Array | float
) -> tuple[Array, Array]:
    """Returns expectation and variance, both (), of the sum of bumps at centers (n, d)."""
    A, M1 = _scaled(cov, centers, width)
    M2 = spd_inverse(jnp.eye(len(A), dtype=A.dtype) + 2 * A)
    spread = symmetrise(M1 @ A @ M2) / width**2
    shrink = symmetrise(M1 @ A) / width**2
    log_gain = 0.5 * log_det_1p(symmetrise(A @ M2 @ A))
    logs = _log_expectations(mean, A, M1, centers, width)
    variance = jnp.zeros_like(logs[0])
    for i, z in enumerate(centers):
        for j in range(i):
            separation = jnp.asarray(z - centers[j])
            log_ratio = (
                log_gain
                - 0.25 * separation @ shrink @ separation
                + quadratic_form(spread, minus(mean, (z + centers[j]) / 2))
            )
            variance += 2 * _product_gap(logs[i] + logs[j], log_ratio)
        variance += _product_gap(2 * logs[i], log_gain + quadratic_form(spread, minus(mean, z)))
    return sum((jnp.exp(log) for log in logs), jnp.zeros_like(variance)), variance


def quadratic_bump_covariance(
    mean: Vector, cov: Array, reference: Array, weight: Array, centers: Array, width: Array | float
) -> Array:
    """Returns the covariance () of the quadratic with the sum of bumps.

    A bump times the Gaussian is a Gaussian again, moved by shift = -K d with
    K = Sigma_{x p} (l^2 I + Sigma_p)^-1 and tightened by K Sigma_{p x}; the quadratic's mean under
    the two differs by just that.
    """
    A, M1 = _scaled(cov, centers, width)
    K = cov[:, : len(A)] @ M1 / width**2
    tightened = 0.5 * jnp.sum(as_matrix(weight) * (K @ cov[: len(A), :]))
    gradient = matvec(weight, minus(mean, reference))
    total = jnp.zeros_like(mean[0])
    for log, center in zip(_log_expectations(mean, A, M1, centers, width), centers, strict=True):
        shift = matvec(-K, minus(mean, center))
        total += jnp.exp(log) * (
            dot(shift, gradient) + 0.5 * quadratic_form(weight, shift) - tightened
        )
    return total


def _scaled(cov: Array, centers: Array, width: Array | float) -> tuple[Array, Array]:
    """Returns A = Sigma_p / l^2 and M1 = (I + A)^-1, both (d, d)."""
    d = centers.shape[-1]
    A = cov[:d, :d] / width**2
    return A, spd_inverse(jnp.eye(d, dtype=cov.dtype) + A)


def _log_expectations(
    mean: Vector, A: Array, M1: Array, centers: Array, width: Array | float
) -> list[Array]:
    """Returns log E[b_i] () of each bump."""
    normaliser = 0.5 * log_det_1p(A)
    form = 0.5 * M1 / width**2
    return [
        -normaliser - quadratic_form(form, minus(mean, center)) for center in jnp.asarray(centers)
    ]


def _product_gap(log_product: Array, log_ratio: Array) -> Array:
    """Returns exp(log_product) (exp(log_ratio) - 1), without overflow where one factor is huge.

    1 - exp(-r) = 2 t / (1 + t) with t = tanh(r / 2): as accurate as expm1 for small r, and one
    function for two. Measured gain: the costs of one MPPI-Belief step take 0.060 ms instead of
    0.084 ms (docs/benchmarks_more.md).
    """
    larger = jnp.exp(log_product + jnp.maximum(log_ratio, 0.0))
    t = jnp.tanh(0.5 * log_ratio)
    return larger * (2 * t / (1 + jnp.abs(t)))
