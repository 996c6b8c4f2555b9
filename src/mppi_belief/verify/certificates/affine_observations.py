"""Theorem 1: the belief's diffusion is tangent to the Gaussian means for affine observations only.

    c(x) - E c = A(mu) (x - mu)  for all mu     if and only if     c(x) = A x + b             (7)

`scenarios.mean_tangent` derives the part of the diffusion that is not tangent.
"""

from functools import partial

import jax.numpy as jnp
import numpy as np

from ...results.certificate import Certificate, Check, Line, Panel
from ...systems import LightDark
from ..bands import EPSILON, at_least, rounding
from ..estimates import largest_magnitude
from ..scenarios import mean_tangent
from ..scenarios.mean_tangent import (
    Observation,
    S,
    TangentFit,
    cubic_mean_square,
    cubic_part,
    cubic_variance,
    sine_part,
    sine_variance,
    tangent_fits,
)
from ..scenarios.noise_information import noise_level_checks
from ..scenarios.section_vii import light_dark_numbers

MEAN_COUNT = 64
CURVE_POINTS = 121
BOX = 2.0  # |mu| <= 2
# States, measurements, and nodes per axis of the affine observations.
AFFINE_SHAPES = ((3, 2, 16), (8, 3, None))
AFFINE_TEXT = (
    "The part of the measurement's diffusion that is not tangent to the Gaussian means is computed "
    "for 64 means and a fixed covariance, by least squares on a Gauss-Hermite rule. It is zero for "
    "affine observations, including those of the light-dark system, the closed form for a cubic "
    "and a sine, and definitely positive for distance and bearing. The theorem assumes a constant "
    "sigma_o. Where sigma_o depends on the state, as in the light-dark system, the scatter of the "
    "measurements carries information about p_x too. With sigma_o a sample's deviation (of one "
    "measurement every Δt) this is 4 slope² = 2 times the information in the measured position; "
    "with sigma_o an intensity (of the noise of (1b) in continuous time) it would reveal |p_x - 5| "
    "at once, since with Δt the mean's information per measurement goes to zero and the scatter's "
    "does not. Equation (5), the EKF and the theorem do not use this information."
)


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate: Theorem 1 over 64 means, and the light-dark noise level."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(-BOX, BOX, MEAN_COUNT)
    curve = np.linspace(-np.pi, np.pi, CURVE_POINTS)
    fits = tangent_fits(
        [lambda x: 3 * x + 1, lambda x: x**3, jnp.sin],
        np.append(drawn, curve)[:, None],
        np.full((1, 1), S**2),
    )
    _, cubic, sine = (
        TangentFit(fit.part[:MEAN_COUNT], fit.A[:MEAN_COUNT], fit.operations) for fit in fits
    )
    checks = [
        *affine_checks(rng),
        *closed_form_checks(drawn, cubic, sine),
        *nonlinear_checks(rng, cubic, sine),
        *noise_level_checks(rng),
    ]
    panel = _part_panel(curve, [fit.part[MEAN_COUNT:] for fit in fits])
    return Certificate(
        "affine_observations", "Theorem 1, affine observations", AFFINE_TEXT, checks, [panel]
    )


def affine_checks(rng: np.random.Generator) -> list[Check]:
    """Returns checks of random affine c in several dimensions and of the light-dark c.

    The largest part outside and the spread of A are in units of their rounding.
    """
    cases: list[tuple[Observation, np.ndarray, np.ndarray, int | None]] = []
    for nx, ny, per_axis in AFFINE_SHAPES:
        A = rng.normal(size=(ny, nx))
        b = rng.normal(size=ny)
        cases.append((partial(mean_tangent.affine_observation, A, b), A, b, per_axis))
    cases.append((LightDark(**light_dark_numbers()).c, np.eye(2, 4), np.zeros(2), 5))

    parts = []
    spreads = []
    for c, A, b, per_axis in cases:
        nx = A.shape[1]
        basis, _ = np.linalg.qr(rng.normal(size=(nx, nx)))
        cov = basis * rng.uniform(0.1, 1, nx) @ basis.T
        means = rng.uniform(-BOX, BOX, (MEAN_COUNT, nx))
        (fit,) = tangent_fits([c], means, cov, per_axis)
        state_size = np.sqrt(np.max(np.sum(means**2, axis=1)) + np.trace(cov))
        size = np.linalg.norm(b) + np.linalg.norm(A) * state_size
        unit = fit.operations * EPSILON * size
        deviation = np.sqrt(np.trace(A @ cov @ A.T))
        parts.append(np.max(np.sqrt(fit.part)) / (unit / deviation))
        gaps = np.linalg.norm(fit.A - A, axis=(1, 2))
        spreads.append(np.max(gaps) * np.sqrt(np.linalg.eigvalsh(cov)[0]) / unit)
    derived = "rounding of c: 4 P operations for P nodes, over the deviation of c"
    return [
        Check(
            "affine c: root of the largest part outside, in units of its rounding",
            max(parts),
            0.0,
            1.0,
            derived,
        ),
        Check(
            "affine c: largest |A(mu) - A|, in units of its rounding",
            max(spreads),
            0.0,
            1.0,
            derived,
        ),
    ]


def closed_form_checks(mu: np.ndarray, cubic: TangentFit, sine: TangentFit) -> list[Check]:
    """Returns checks of the quadrature against the closed forms.

    The root mean square of c over its deviation magnifies rounding.
    """
    cubic_scale = np.sqrt(cubic_mean_square(mu) / cubic_variance(mu))
    sine_scale = 2 / np.sqrt(sine_variance(np.min(np.cos(mu) ** 2)))

    # The cubic's part rises up to mu^2 = s^2 / 3 and falls from there, the sine's rises with
    # sin^2(mu).
    cubic_floor = cubic_part(np.array([0, BOX])).min()
    sine_floor = 1 - S**2 / np.sinh(S**2)
    floor_source = "least of the closed form over |mu| ≤ 2"
    return [
        rounding(
            "x³: largest error of the part outside",
            largest_magnitude(cubic.part - cubic_part(mu)),
            cubic.operations,
            2 * cubic_scale.max(),
        ),
        rounding(
            "sin x: largest error of the part outside",
            largest_magnitude(sine.part - sine_part(mu)),
            sine.operations,
            sine_scale,
        ),
        at_least("x³: least part outside", cubic.part.min(), cubic_floor, floor_source),
        at_least("sin x: least part outside", sine.part.min(), sine_floor, floor_source),
    ]


def nonlinear_checks(rng: np.random.Generator, cubic: TangentFit, sine: TangentFit) -> list[Check]:
    """Returns checks of distance and bearing, away from the origin and the cut.

    A(mu) must not be constant for any of the three observations.
    """
    means = np.column_stack([rng.uniform(3, 6, MEAN_COUNT), rng.uniform(-3, 3, MEAN_COUNT)])
    cov = 0.3**2 * np.eye(2)
    coarse, fine = (
        tangent_fits([mean_tangent.distance_and_bearing], means, cov, per_axis)[0]
        for per_axis in (32, 48)
    )
    size = 2 * np.hypot(np.max(np.linalg.norm(means, axis=1)), 1) / 0.3
    noise = fine.operations * EPSILON * size
    part_error = np.max(np.abs(fine.part - coarse.part)) + noise
    gradient_error = np.max(np.abs(fine.A - coarse.A)) + noise
    spread = min(np.ptp(fit.A, axis=0).max() for fit in (cubic, sine, fine))
    error_source = "the quadrature's error: 32 against 48 points an axis, and rounding"
    return [
        at_least(
            "distance and bearing: least part outside", fine.part.min(), part_error, error_source
        ),
        at_least(
            "x³, sin x, distance and bearing: least spread of A(mu) over mu",
            spread,
            gradient_error,
            error_source,
        ),
    ]


def _part_panel(mu: np.ndarray, parts: list[np.ndarray]) -> Panel:
    labels = ("affine, 3x + 1", "cubic, x³", "sine, sin x")
    lines = [
        Line(label, mu.tolist(), part.tolist()) for label, part in zip(labels, parts, strict=True)
    ]
    for name, closed_form in (("cubic", cubic_part), ("sine", sine_part)):
        points = mu[::6]
        lines.append(
            Line(f"{name}, closed form", points.tolist(), closed_form(points).tolist(), "points")
        )
    return Panel(
        f"Part of the diffusion outside the mean tangent space, standard deviation {S}",
        "belief mean μ",
        "part outside (share of the mean square)",
        lines,
    )
