"""Exact matching by choosing what is sensed, in two to four states (after arXiv 2604.18941).

`scenarios.sensing_systems` states the recursions of covariance and value, and
`scenarios.steered_loops` runs Algorithm 1 in closed loop with such a sensor.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...numerics.square_root import psd_factor
from ...planning import path_integral as pi
from ...planning import path_weights as pw
from ...problem import Problem
from ...results.certificate import Certificate, Check
from ..bands import largest_z, order, rounding
from ..compilation import quick_jit
from ..scenarios.limited_sensors import limited_sensor_results
from ..scenarios.matched_paths import sampled_costs
from ..scenarios.matched_scalar import SteadySchedule
from ..scenarios.sensing_systems import (
    SENSING_STEPS,
    SENSING_TEMPERATURE,
    SYSTEM_SIZES,
    SensingSchedule,
    coarser_problem,
    hamiltonian_value,
    integrated_value,
    matched_covariances,
    quadratic_bellman_residual,
    quadratic_forms,
    random_sensing_problem,
    rounding_scale,
    sensing_schedule,
)
from ..scenarios.steered_checks import platform_results

COARSENINGS = (4, 2, 1)  # steps put together, from which orders are observed
PSI_KEYS = 40
PSI_PATHS = 2000
SYSTEMS_SEED = 0  # of the systems; the certificate's seed is that of the samples
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
    loop_checks, loop_panel = platform_results(seed)
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


def matched_schedule_checks(schedules: list[SensingSchedule]) -> list[Check]:
    """Returns checks of the residual at all steps, and of the covariance against NumPy."""
    operations, condition = rounding_scale(schedules)
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


def value_checks(sensing: SensingSchedule, seed: int) -> list[Check]:
    """Returns checks in four states of V, of (13), and of the sampled Psi."""
    return [
        rounding(
            "4 states: residual of (15), Riccati schedule",
            float(jnp.max(sensing.residuals)),
            *rounding_scale([sensing]),
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
