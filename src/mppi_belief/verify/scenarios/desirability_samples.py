"""Sampled desirabilities of the matched scalar problem, and their exact counterparts (Corollary 5).

    Psi(t, mu) = E_Q[ exp(-1/lambda int_t^T q_s(mu_s) ds - phi_T(mu_T) / lambda) | mu_t = mu ]  (17)

Q is the law of the uncontrolled mean (18). A finite step makes an error of first order in dt. Twice
the sample of the fine step less that of the coarse step, along one Brownian path, has an error of
second order (Richardson).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...planning import path_integral as pi
from ...planning import path_weights as pw
from ...problem import Problem
from ..compilation import quick_jit
from ..estimates import extrapolations
from ..solvers.discrete_expectation import DiscreteExpectation
from ..solvers.grid_solutions import solve_desirability
from ..solvers.scalar_equations import ScalarEquation, mean_grid
from .matched_paths import pooled_costs, sampled_costs
from .matched_scalar import MatchedProblem, SteadySchedule, with_time_grid

PSI_MEANS = np.linspace(-2, 2, 9)
PSI_TIMES = np.array([0.0, 0.2, 0.4, 0.6, 0.8])  # fractions of T
PSI_GRIDS = ((560, 40), (1120, 80))  # cells and steps of the solutions of (16)
COARSE_STEPS = 10  # from t to T; the fine step is half as long
PSI_LEVELS = (10, 20, 40, 80)  # steps of the exact discrete expectation
PSI_BATCHES = 64
PER_BATCH = 512  # paths
PSI_SIZES = 2 ** np.arange(6, 15)  # N at which the rate is estimated
PSI_RATE_MEAN = 1.0  # mu at which the rate is estimated


class DesirabilityPoints(NamedTuple):
    """Holds Psi at PSI_TIMES x PSI_MEANS, each array (times, means)."""

    exact: np.ndarray  # of (16)
    exact_error: np.ndarray
    sampled: np.ndarray  # of (17)
    error: np.ndarray  # standard error of `sampled`
    bias: np.ndarray  # bound on the bias that the extrapolation leaves

    @property
    def z(self) -> np.ndarray:
        """Returns distances in standard errors, less what bias and grid may explain."""
        unexplained = np.abs(self.sampled - self.exact) - self.bias - self.exact_error
        return np.maximum(unexplained, 0.0) / self.error


class DesirabilityRate(NamedTuple):
    """Holds errors of the sampled Psi at one mean for each N of PSI_SIZES."""

    rms: np.ndarray  # (J,), RMS errors over the batches
    relative: np.ndarray  # (J,), their relative standard errors
    squared: float  # mean of all squared errors as multiples of their variance
    squared_error: float  # its standard error
    mean: float  # Psi from all paths
    mean_error: float  # its standard error


def rate_paths() -> int:
    """Returns the number of paths from which the rate is estimated."""
    return int(PSI_BATCHES * PSI_SIZES.sum())


def discrete_desirability(equation: ScalarEquation, steps: int, times: np.ndarray) -> np.ndarray:
    """Returns exact discrete expectations (times, means), each over `steps` steps from t to T."""
    times_to_go = equation.duration * (1 - times)
    return np.exp(
        [
            DiscreteExpectation(equation, steps, duration).log_psi(PSI_MEANS)
            for duration in times_to_go
        ]
    )


def linear_equation_solution(equation: ScalarEquation) -> tuple[np.ndarray, np.ndarray]:
    """Returns Psi of (16) (times, means), extrapolated from two grids, and its error.

    The error is the distance of the extrapolated value from the finer grid's.
    """
    values = []
    for cells, steps in PSI_GRIDS:
        grid = mean_grid(equation, cells, steps)
        rows = np.rint(PSI_TIMES * steps).astype(int)
        columns = np.rint((PSI_MEANS + grid.points[-1]) / grid.h).astype(int)
        values.append(solve_desirability(equation, grid)[np.ix_(rows, columns)])
    coarse, fine = values
    return fine + (fine - coarse) / 3, np.abs(fine - coarse) / 3


def sample_points(
    matched: MatchedProblem, schedule: SteadySchedule, equation: ScalarEquation, key: Array
) -> DesirabilityPoints:
    """Returns sampled and exact Psi at all points; the means of one time share their paths."""
    samples = []
    for t, time_key in zip(PSI_TIMES, jax.random.split(key, len(PSI_TIMES)), strict=True):
        time_to_go = equation.duration * (1 - t)
        coarse = with_time_grid(matched, time_to_go, COARSE_STEPS)
        fine = with_time_grid(matched, time_to_go, 2 * COARSE_STEPS)
        log_psi = log_desirabilities(coarse, fine, matched, schedule, PSI_MEANS[:, None], time_key)
        samples.append(np.exp(log_psi))
    psi = np.stack(samples)  # (times, means, level, batches)
    extrapolated = 2 * psi[:, :, 1] - psi[:, :, 0]

    # The bias that is left is of second order: known from three levels without sampling.
    levels = [discrete_desirability(equation, steps, PSI_TIMES) for steps in PSI_LEVELS[:3]]
    first, second, *_ = extrapolations(levels)
    exact, exact_error = linear_equation_solution(equation)
    return DesirabilityPoints(
        exact=exact,
        exact_error=exact_error,
        sampled=extrapolated.mean(axis=-1),
        error=extrapolated.std(axis=-1, ddof=1) / np.sqrt(PSI_BATCHES),
        bias=4 / 3 * np.abs(first - second),
    )


@jax.jit
def log_desirabilities(
    coarse: Problem,
    fine: Problem,
    matched: MatchedProblem,
    schedule: SteadySchedule,
    means: Array,
    key: Array,
) -> Array:
    """Returns log Psi (means, 2, batches) for both steps along the same Brownian paths."""
    shape = (2 * COARSE_STEPS, 1, PSI_BATCHES * PER_BATCH)
    eps = jnp.sqrt(fine.dt) * pi.normals(key, shape, False)
    of_batches = jax.vmap(partial(pw.log_desirability, temperature=matched.temperature))

    def both_levels(mean: Array) -> Array:
        levels = ((coarse, eps[::2] + eps[1::2]), (fine, eps))
        costs = [
            sampled_costs(problem, matched.theta, mean, schedule, increments)[0]
            for problem, increments in levels
        ]
        return jnp.stack([of_batches(c.reshape(PSI_BATCHES, PER_BATCH)) for c in costs])

    return jax.lax.map(both_levels, means)


def sample_rate(
    matched: MatchedProblem, schedule: SteadySchedule, equation: ScalarEquation, key: Array
) -> DesirabilityRate:
    """Returns errors of independent batches of every size against the exact expectation."""
    costs, _ = pooled_costs(matched, schedule, PSI_RATE_MEAN, key, rate_paths())

    # The second moment of exp(-S / lambda) is the desirability at half the temperature.
    exact = rate_desirability(equation)
    halved = equation._replace(temperature=equation.temperature / 2)
    variance = rate_desirability(halved) - exact**2
    weights = np.exp(-costs / matched.temperature)
    excess_kurtosis = float(np.mean((weights - exact) ** 4) / variance**2 - 3)

    # Errors of each batch.
    estimate = quick_jit(jax.vmap(partial(pw.log_desirability, temperature=matched.temperature)))
    parts = np.split(costs, PSI_BATCHES * np.cumsum(PSI_SIZES)[:-1])
    errors = np.array([np.exp(estimate(part.reshape(PSI_BATCHES, -1))) - exact for part in parts])

    # A mean of n squared errors has relative variance (2 + excess kurtosis) / n, and the kurtosis
    # of an average of N is 1 / N of that of one.
    relative_variance = (2 + excess_kurtosis / PSI_SIZES) / PSI_BATCHES
    squared = np.mean(errors**2, axis=1) * PSI_SIZES / variance
    return DesirabilityRate(
        rms=np.sqrt(np.mean(errors**2, axis=1)),
        relative=np.sqrt(relative_variance) / 2,
        squared=float(np.mean(squared)),
        squared_error=float(np.sqrt(np.mean(relative_variance) / len(PSI_SIZES))),
        mean=float(np.mean(weights)),
        mean_error=float(np.sqrt(variance / len(weights))),
    )


def rate_desirability(equation: ScalarEquation) -> float:
    """Returns the exact discrete Psi at `PSI_RATE_MEAN`."""
    expectation = DiscreteExpectation(equation, COARSE_STEPS, equation.duration)
    return float(np.exp(expectation.log_psi(np.array([PSI_RATE_MEAN]))[0]))
