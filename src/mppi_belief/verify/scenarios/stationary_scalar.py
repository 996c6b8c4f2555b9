"""A scalar problem, matched at the steady state, and the predicted excess cost of Algorithm 1.

The system is scalar (Remark 2), D = lambda b^2 / R (15) at the steady state of (8b), and the
terminal weight is the stationary P of the discrete control Riccati equation: the optimal gain K is
then the same at every step, whatever the horizon. With u_k = -K mu_k + e_k, completing the square
gives for any control, in expectation,

    J(u) - J* = sum_k 1/2 S e_k^2,      S = R dt + B P B,  B = b dt

What (19) makes of e_k follows from Gaussian integrals. With P_j the curvature of -lambda log Psi
(17) in discrete time,

    P_j = q dt + F^2 P_{j+1} / (1 + P_{j+1} D_j dt / lambda)

which is the control Riccati equation where D_j = lambda b^2 / R. So N -> infinity leaves no error
except that of D_j: the sampled filter settles slightly off the steady state of (8b). N samples add
the variance of a ratio of averages, of order 1/N.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.linalg import solve_discrete_are

from ...belief.prior import prior
from ...belief.schedule import gain_schedule
from ...costs import GoalObstacleCost
from ...problem import Belief, Problem
from ...systems import ScalarLinear

DRIFT = 0.0  # a
CONTROL_GAIN = 1.0  # b
STATE_WEIGHT = 2.0  # q
SCALAR_TEMPERATURE = 1.0  # lambda
SCALAR_NOISE = 0.5  # sigma_w and sigma_o
SCALAR_DT = 0.2
SCALAR_STEPS = 10  # of a trial
SCALAR_HORIZON = 5  # H of the planner


class ScalarOptimum(NamedTuple):
    """Holds the optimum of the discrete problem."""

    value: float  # P
    gain: float  # K
    hessian: float  # S, of the cost in one control


class WeightedPaths(NamedTuple):
    """Holds the law of the mean's paths under the weights exp(-S / tau), for each step.

    E exp(-S / tau) = exp(-value mu^2 / (2 tau) - constant). Under these weights the first step of
    the mean has the law N(-pull mu, spread).
    """

    value: np.ndarray  # (K,)
    constant: np.ndarray  # (K,)
    pull: np.ndarray  # (K,)
    spread: np.ndarray  # (K,)


class PredictedExcess(NamedTuple):
    """Holds the predicted excess cost: floor + per_sample / N."""

    floor: float  # a, for N -> infinity
    per_sample: float  # c
    next_term: float  # the next term is `next_term` / N of c / N

    def excess(self, samples: Any) -> Any:
        """Returns the excess over the optimum for N = `samples`."""
        return self.floor + self.per_sample / samples


def stationary_problem() -> tuple[Problem, ScalarOptimum]:
    """Returns the problem with R = lambda b^2 / D at the steady state, and its discrete optimum."""
    steady_variance = SCALAR_NOISE * SCALAR_NOISE  # 0 = sigma_w^2 - Sigma^2 / sigma_o^2, for a = 0
    R = SCALAR_TEMPERATURE * CONTROL_GAIN**2 / (steady_variance / SCALAR_NOISE) ** 2
    F = 1 + DRIFT * SCALAR_DT
    B = CONTROL_GAIN * SCALAR_DT
    P = float(
        solve_discrete_are([[F]], [[B]], [[STATE_WEIGHT * SCALAR_DT]], [[R * SCALAR_DT]])[0, 0]
    )
    hessian = R * SCALAR_DT + B * P * B

    system = ScalarLinear(DRIFT, CONTROL_GAIN, 1.0, SCALAR_NOISE, SCALAR_NOISE)
    unit = jnp.ones(1)
    cost = GoalObstacleCost(0 * unit, STATE_WEIGHT * unit, P * unit, R * unit)
    std = math.sqrt(steady_variance) * unit
    problem = Problem(
        system, cost, unit, std, SCALAR_DT, SCALAR_STEPS, noise_convention="intensity"
    )
    return problem, ScalarOptimum(P, F * P * B / hessian, hessian)


def scalar_optimal_cost(problem: Problem, optimum: ScalarOptimum, covs: np.ndarray) -> float:
    """Returns the cost of LQG by the separation principle.

    It is the cost of the start, of the process noise, and of the feedback on the estimation error
    with variances `covs` (K,).
    """
    start = float(problem.prior_mean[0] ** 2 + problem.prior_std[0] ** 2)
    noise = optimum.value * SCALAR_NOISE**2 * SCALAR_DT
    return 0.5 * (
        optimum.value * start
        + SCALAR_STEPS * noise
        + optimum.gain**2 * optimum.hessian * float(np.sum(covs))
    )


def filter_law(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Returns the Kalman filter's covariances before each step and its innovation variances.

    Both are (K,).
    """
    schedule = gain_schedule(problem, prior(problem), jnp.zeros((SCALAR_STEPS, 1)), "filter")
    return np.asarray(schedule.cov)[:-1, 0, 0], np.asarray(schedule.diffusion)[:, 0, 0] * SCALAR_DT


def planned_diffusions(problem: Problem, covs: np.ndarray) -> np.ndarray:
    """Returns D_j (K, H) of the plans from the filter's covariances (K,): line 1 of Algorithm 1."""

    def diffusions(cov: Array) -> Array:
        belief = Belief(jnp.zeros(1), cov.reshape(1, 1))
        return gain_schedule(problem, belief, jnp.zeros((SCALAR_HORIZON, 1)), "riccati").diffusion[
            :, 0, 0
        ]

    return np.asarray(jax.jit(jax.vmap(diffusions))(jnp.asarray(covs)))


def weighted_paths(diffusions: np.ndarray, terminal: float, tau: float) -> WeightedPaths:
    """Returns the Gaussian integral over the mean's paths for D_j (K, H) and a terminal weight."""
    F = 1 + DRIFT * SCALAR_DT
    value = np.full(len(diffusions), terminal)
    constant = np.zeros(len(diffusions))
    pull = constant
    spread = constant
    for D in diffusions.T[::-1]:
        gain = value * D * SCALAR_DT / tau
        pull = F * gain / (1 + gain)
        spread = D * SCALAR_DT / (1 + gain)
        constant = constant + 0.5 * np.log1p(gain)
        value = STATE_WEIGHT * SCALAR_DT + F**2 * value / (1 + gain)
    return WeightedPaths(value, constant, pull, spread)


def predicted_excess(
    problem: Problem, optimum: ScalarOptimum, covs: np.ndarray, innovations: np.ndarray
) -> PredictedExcess:
    """Returns the excess cost of Algorithm 1.

    `covs` and `innovations`, both (K,), are those of `filter_law`. A ratio of averages
    sum w x / sum w has variance E[w^2 (x - x*)^2] / (N E[w]^2) and bias
    -E[w^2 (x - x*)] / (N E[w]^2); the square of a weight is the weight at half the temperature.
    """
    diffusions = planned_diffusions(problem, covs)
    B = CONTROL_GAIN * SCALAR_DT
    paths, half_paths = (
        weighted_paths(diffusions, optimum.value, tau)
        for tau in (SCALAR_TEMPERATURE, SCALAR_TEMPERATURE / 2)
    )
    mean, variance = mean_law(float(problem.prior_mean[0]), paths.pull, innovations)

    # E[w^2] / E[w]^2 = exp(rate mu^2 + ...): another Gaussian integral, over the law of mu_k.
    rate = (paths.value - half_paths.value) / SCALAR_TEMPERATURE
    narrowing = 1 - 2 * rate * variance
    exponent = rate * mean**2 / narrowing + 2 * paths.constant - half_paths.constant
    ratio = np.exp(exponent) / np.sqrt(narrowing)
    second_moment = ratio * ((mean / narrowing) ** 2 + variance / narrowing)

    # Variance and bias of the sampled control, and the error that no number of samples removes.
    pull_change = paths.pull - half_paths.pull
    gain_error = optimum.gain - paths.pull / B
    variance_term = (pull_change**2 * second_moment + half_paths.spread * ratio) / B**2
    sampling = variance_term - 2 * gain_error * pull_change * second_moment / B
    floor = 0.5 * optimum.hessian * np.sum(gain_error**2 * (mean**2 + variance))
    per_sample = 0.5 * optimum.hessian * np.sum(sampling)
    return PredictedExcess(float(floor), float(per_sample), float(np.max(ratio)))


def mean_law(
    start: float, pulls: np.ndarray, innovations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns means and variances (K,) of mu_k under mu' = (F - pull) mu + innovation."""
    law = [(start, 0.0)]
    for pull, innovation in zip(pulls[:-1], innovations[:-1], strict=True):
        factor = 1 + DRIFT * SCALAR_DT - pull
        mean, variance = law[-1]
        law.append((factor * mean, factor**2 * variance + innovation))
    means, variances = np.array(law).T
    return means, variances
