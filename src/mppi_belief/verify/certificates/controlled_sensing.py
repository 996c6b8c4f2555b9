"""Exact matching by choosing what is sensed, in two to four states (after arXiv 2604.18941).

`scenarios.sensing_systems` states the recursions of covariance and value, and
`scenarios.steered_loops` runs Algorithm 1 in closed loop with such a sensor.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...belief.riccati import kalman_bucy_gain
from ...matching.sensor import matching_sensor
from ...matching.weights import matched_weight, residual
from ...numerics.square_root import psd_factor
from ...planning import path_integral as pi
from ...planning import path_weights as pw
from ...problem import Problem
from ...results.certificate import Certificate, Check, Line, Panel
from ..bands import EPSILON, at_most, largest_z, order, rounding
from ..compilation import quick_jit
from ..scenarios import steered_loops
from ..scenarios.matched_paths import sampled_costs
from ..scenarios.matched_scalar import SteadySchedule
from ..scenarios.sensing_systems import (
    SENSING_STEPS,
    SENSING_TEMPERATURE,
    SensingSchedule,
    coarser_problem,
    hamiltonian_value,
    integrated_value,
    matched_covariances,
    quadratic_bellman_residual,
    quadratic_forms,
    random_sensing_problem,
    sensing_schedule,
)

SYSTEM_SIZES = ((2, 2), (3, 2), (4, 2))  # states and controls
COARSENINGS = (4, 2, 1)  # steps put together, from which orders are observed
LIMITS = np.append(np.geomspace(0.1, 30.0, 12), 1e6)  # of the sensor; the last is no limit
PSI_KEYS = 40
PSI_PATHS = 2000
SYSTEMS_SEED = 0  # of the systems; the certificate's seed is that of the samples
SHOWN_TIMES = (0, 2, 8)  # indices of the covariances whose residuals are drawn
SENSING_TEXT = (
    "The observation matrix is chosen from the covariance so that (15) holds. In random systems of "
    "2, 3 and 4 states its residual is rounding, with a measurement at every step as in continuous "
    "time, and however the sensor is rotated. The covariance is then that of a linear recursion in "
    "which the sensor does not occur. -λ log Ψ tends to the value of the linear-quadratic problem "
    "and solves (13), both at order 1 in the step, and the sampled Ψ is the predicted integral. "
    "Algorithm 1 as printed, in closed loop on a platform with four states, costs c/N more than "
    "LQG with the same sensor, with c as Gaussian integrals give it, and no excess remains for "
    "N → ∞. A sensor with a limit leaves a residual that never rises with the limit, and an excess "
    "that more samples do not remove. The statement covers linear systems; where the covariance is "
    "used up, Σ < λGR⁻¹G'Δt, no sensor makes (15) hold."
)


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate: random systems, limited sensors, and closed loops of Algorithm 1."""
    rng = np.random.default_rng(SYSTEMS_SEED)
    schedules = [sensing_schedule(random_sensing_problem(rng, *size)) for size in SYSTEM_SIZES]
    largest = schedules[-1]
    limit_checks, limit_panel = limited_sensor_results(largest, rng)
    loop_checks, loop_panel = steered_loops.platform_results(seed)
    checks = [
        *matched_schedule_checks(schedules),
        *limit_checks,
        *value_checks(sensing_schedule(largest.problem, "riccati"), seed),
        *loop_checks,
    ]
    return Certificate(
        "controlled_sensing",
        "Exact matching by choosing what is sensed",
        SENSING_TEXT,
        checks,
        [limit_panel, loop_panel],
    )


def _rounding_scale(schedules: list[SensingSchedule]) -> tuple[float, float]:
    """Returns the operations of one solve and the largest condition of a covariance.

    The rounding of a solve grows by this condition.
    """
    operations = 4.0 * SYSTEM_SIZES[-1][0] ** 3
    conditions = [
        float(np.max(np.linalg.cond(np.asarray(sensing.schedule.cov)))) for sensing in schedules
    ]
    return operations, max(conditions)


def matched_schedule_checks(schedules: list[SensingSchedule]) -> list[Check]:
    """Returns checks of the residual at all steps, and of the covariance against NumPy."""
    operations, condition = _rounding_scale(schedules)
    covs = [np.asarray(sensing.schedule.cov) for sensing in schedules]
    gaps = [
        np.max(np.abs(cov - matched_covariances(sensing.problem)))
        for cov, sensing in zip(covs, schedules, strict=True)
    ]
    return [
        rounding(
            "2, 3, 4 states: residual of (15), a measurement every Δt",
            max(float(jnp.max(sensing.residuals)) for sensing in schedules),
            operations,
            condition,
        ),
        rounding(
            "covariance of the filter less F Σ F' + (Q - λGR⁻¹G')Δt",
            max(gaps),
            operations * SENSING_STEPS,
            max(float(np.max(np.abs(cov))) for cov in covs),
        ),
    ]


def limited_sensor_results(
    sensing: SensingSchedule, rng: np.random.Generator
) -> tuple[list[Check], Panel]:
    """Returns checks and figure of rotated sensors with a limit, at covariances of the schedule."""
    rotation, _ = np.linalg.qr(rng.normal(size=(2, 2)))
    covs = sensing.schedule.cov[1::8]
    residuals = np.asarray(_limited_residuals(sensing.problem, rotation, LIMITS, covs))
    operations, condition = _rounding_scale([sensing])
    checks = [
        rounding(
            "4 states, continuous, rotated sensor, no limit: residual of (15)",
            np.max(residuals[-1]),
            operations,
            condition,
        ),
        at_most(
            "the same: largest relative rise of the residual as the limit grows from 0.1",
            np.max(np.diff(residuals, axis=0) / residuals[:-1]),
            operations * EPSILON * condition,
            "rounding: D grows with the limit in the order of matrices",
        ),
    ]
    times = sensing.problem.dt * (1 + 8 * np.arange(residuals.shape[1]))
    lines = [
        Line(f"t = {times[k]:.1f}", LIMITS[5:-1].tolist(), residuals[5:-1, k].tolist())
        for k in SHOWN_TIMES
    ]
    panel = Panel(
        "What a limited sensor leaves of (15)",
        "largest signal-to-noise ratio of the sensor",
        "residual ε",
        lines,
        "x",
    )
    return checks, panel


@quick_jit
def _limited_residuals(problem: Problem, rotation: Array, limits: Array, covs: Array) -> Array:
    """Returns residuals (limits, covariances) of the continuous D."""
    G = problem.system.G(problem.prior_mean)
    noise = problem.system.sigma_o(problem.prior_mean)
    rotated = noise @ rotation @ jnp.linalg.inv(noise)

    def limited_residual(limit: Array, cov: Array) -> Array:
        C = rotated @ matching_sensor(
            jnp.linalg.cholesky(cov), G, problem.cost.R, SENSING_TEMPERATURE, noise, 0.0, limit
        )
        _, D = kalman_bucy_gain(cov, C, noise @ noise.T)
        return residual(D, G, matched_weight(problem.cost.R, SENSING_TEMPERATURE))

    over_covs = jax.vmap(limited_residual, (None, 0))
    return jax.vmap(over_covs, (0, None))(limits, covs)


def value_checks(sensing: SensingSchedule, seed: int) -> list[Check]:
    """Returns checks in four states of V, of (13), and of the sampled Psi."""
    return [
        rounding(
            "4 states: residual of (15), Riccati schedule",
            float(jnp.max(sensing.residuals)),
            *_rounding_scale([sensing]),
        ),
        *value_order_checks(sensing),
        _sampled_psi_check(sensing, seed),
    ]


def value_order_checks(sensing: SensingSchedule) -> list[Check]:
    """Returns checks that -lambda log Psi tends to V and solves (13), at order 1 in the step."""
    P, constant = hamiltonian_value(sensing.problem)
    means = np.random.default_rng(SYSTEMS_SEED).normal(size=(20, len(P)))
    errors = []
    residuals = []
    for together in COARSENINGS:
        problem = coarser_problem(sensing, together)
        D = np.asarray(sensing.schedule.diffusion)[::together]
        value = integrated_value(problem, D, np.zeros((problem.steps + 1, *P.shape)))
        gap = quadratic_forms(value.P - P, means) + value.constant - constant
        errors.append(np.max(np.abs(gap)))
        residuals.append(np.max(np.abs(quadratic_bellman_residual(problem, value, D[0], means))))
    return [
        order(
            "4 states: order of -λ log Ψ to the linear-quadratic value, Hamiltonian flow",
            1.0,
            errors,
        ),
        order("4 states: order of what -λ log Ψ leaves of (13) at t = 0", 1.0, residuals),
    ]


def _sampled_psi_check(sensing: SensingSchedule, seed: int) -> Check:
    """Checks Psi of the package's paths at two means against the integral."""
    every = COARSENINGS[0]
    problem = coarser_problem(sensing, every)
    D = np.asarray(sensing.schedule.diffusion)[::every]
    covs = np.asarray(sensing.schedule.cov)[::every]
    value = integrated_value(problem, D, covs)
    factors, ranks = jax.vmap(psd_factor)(jnp.asarray(D))
    schedule = SteadySchedule(jnp.asarray(covs), jnp.asarray(D), factors, ranks)

    nx = len(value.P)
    z = []
    for j, mean in enumerate([np.full(nx, 0.3), np.linspace(-0.5, 0.5, nx)]):
        V = float(quadratic_forms(value.P, mean[None])[0]) + value.constant
        keys = jax.random.split(jax.random.key(seed + j), PSI_KEYS)
        ratios = np.asarray(_relative_psi(problem, mean, schedule, V, keys))
        z.append((ratios.mean() - 1) / (ratios.std(ddof=1) / np.sqrt(PSI_KEYS)))
    return largest_z("4 states: sampled Ψ over the integral, less 1, at two means", z, PSI_KEYS - 1)


@quick_jit
def _relative_psi(
    problem: Problem, mean: Array, schedule: SteadySchedule, V: Array, keys: Array
) -> Array:
    """Returns Psi of `PSI_PATHS` paths over exp(-V / lambda), for each key (K,)."""

    def ratio(key: Array) -> Array:
        eps = jnp.sqrt(problem.dt) * pi.normals(key, (problem.steps, len(mean), PSI_PATHS), False)
        costs, _ = sampled_costs(problem, 0.0, mean, schedule, eps)
        return jnp.exp(pw.log_desirability(costs, SENSING_TEMPERATURE) + V / SENSING_TEMPERATURE)

    return jax.lax.map(ratio, keys)
