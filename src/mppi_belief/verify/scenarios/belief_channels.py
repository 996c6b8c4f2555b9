"""The channels (6a)(6b) of control and innovation, and one step of the grid filter.

    dpi = a^u(pi) dt + b(pi) dy~,   a^u = a^0 - (G u pi)',   b = pi (c - pi(c)) R_o^-1

Both channels conserve the mass. The first moves the mean by E[f + G u], the second by the gain of
(8a).
"""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from ...belief.prior import prior
from ...belief.riccati import kalman_bucy_gain
from ...results.certificate import Check
from ..bands import order, rounding
from ..estimates import rms
from ..solvers import kushner
from ..solvers.kushner import Reals
from .curved_measurement import curved_problem
from .linear_filtering import LINE_A, LINE_B, LINE_C, linear_problem
from .scalar_paths import PRIOR_MEAN, PRIOR_STD, STATE_REACH


def channel_check(u: float = 0.7) -> Check:
    """Returns the check that both channels conserve the mass and move the mean as they should.

    (6a) moves the mean by A mu + B u, (6b) by the gain K of (8a).
    """
    problem = linear_problem(LINE_A, 1.0, 1)
    grid = kushner.state_grid(-STATE_REACH, STATE_REACH, 400)
    model = kushner.coefficients(problem, grid)
    p = kushner.gaussian_density(grid, PRIOR_MEAN, PRIOR_STD**2)[:, None]
    c = model.c[:, None]
    bands = kushner.fokker_planck_bands(grid, model, u)
    K, _ = kalman_bucy_gain(prior(problem).cov, jnp.array([[LINE_C]]), jnp.array([[model.R_o]]))

    # Each channel, the sizes of what it sums, and the motion of the mean.
    channels = (
        (
            kushner.drift_channel(bands, p),
            kushner.drift_channel(np.abs(bands), p),
            LINE_A * PRIOR_MEAN + LINE_B * u,
        ),
        (
            kushner.diffusion_channel(grid, p, c, model.R_o),
            p * (np.abs(c) + LINE_C * PRIOR_MEAN) / model.R_o,
            float(K[0, 0]),
        ),
    )
    errors = []
    for channel, summands, motion in channels:
        for test_function, expected in ((np.ones_like(grid.x), 0.0), (grid.x, motion)):
            error = abs(test_function @ channel[:, 0] * grid.h - expected)
            errors.append(error / (np.abs(test_function) @ summands[:, 0] * grid.h))
    return rounding(
        "(6a)(6b): change of the mass, and of the mean less Aμ + Bu and K, over the summands' size",
        float(np.max(errors)),
        len(grid.x),
    )


def closed_drift_channel(x: Reals, u: float, Q: float) -> Reals:
    """Returns (6a) for the density of the prior: -((f + G u) pi)' + Q pi'' / 2.

    The system has f = -sin x and G = 1 + 0.3 cos x.
    """
    variance = PRIOR_STD**2
    score = (x - PRIOR_MEAN) / variance
    pi = np.exp(-(score**2) * variance / 2) / np.sqrt(2 * np.pi * variance)
    drift = -np.sin(x) + (1 + 0.3 * np.cos(x)) * u
    drift_gradient = -np.cos(x) - 0.3 * np.sin(x) * u
    diffusion = Q / 2 * (score**2 - 1 / variance)
    return np.asarray((drift * score - drift_gradient + diffusion) * pi)


def step_order_checks(u: float = 0.8) -> list[Check]:
    """Returns checks of one step of the grid filter with the innovations +-sqrt(R_o dt).

    Half the sum of the two densities moves by a^u dt + O(dt^2) + O(dt h^2), and half their
    difference is b sqrt(R_o dt) + O(dt^(3/2)). f, G and c are all nonlinear.
    """
    drift_errors = []
    diffusion_errors = []
    for level in range(4):
        grid = kushner.state_grid(-STATE_REACH, STATE_REACH, 100 * 2**level)
        dt = 0.032 / 4.0**level
        model = kushner.coefficients(replace(curved_problem(0.8), dt=dt), grid)
        model = model._replace(f=-np.sin(grid.x), G=1 + 0.3 * np.cos(grid.x))
        p = kushner.gaussian_density(grid, PRIOR_MEAN, PRIOR_STD**2)[:, None]
        c = model.c[:, None]

        # The densities after both innovations.
        innovation = np.sqrt(model.R_o * dt)
        dy = np.sum(p * c) * grid.h * dt + innovation * np.array([1.0, -1.0])
        bands = kushner.fokker_planck_bands(grid, model, u)
        predicted = kushner.transport(bands, p, dt)
        after = kushner.observe(grid, predicted, c, model.R_o, dy, dt)

        a = closed_drift_channel(grid.x, u, model.Q)
        b = kushner.diffusion_channel(grid, p, c, model.R_o)
        half_difference = (after[:, :1] - after[:, 1:]) / 2
        drift_errors.append(rms((after.mean(axis=1) - p[:, 0]) / dt - a))
        diffusion_errors.append(rms(half_difference / innovation - b))
    return [
        order(
            "order in h, dt ~ h², of one step's density, mean over dỹ = ±√(R_o dt), against (6a)",
            2,
            drift_errors,
        ),
        order(
            "order in h, dt ~ h², of one step's density, half difference over ±, against b of (6b)",
            2,
            diffusion_errors,
        ),
    ]
