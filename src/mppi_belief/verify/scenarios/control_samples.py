"""The control law (19) on the matched scalar problem: expectation, samples, optimum (Theorem 6).

    u_0   = sum_i w_i u^(i),   w_i ~ exp(-S_i / lambda)                              (19)
    u^(i) = R^-1 G' (G R^-1 G')^+ L_0 eps_0^(i) / dt

tends to u = E[exp(-S / lambda) u^(i)] / E[exp(-S / lambda)] as N grows, and this to -R^-1 G' V_mu
as dt decreases. For finite N, with primes for half the temperature,

    bias     = -(Psi' / Psi^2) (u' - u) / N + O(1 / N^2)
    variance = (Psi' / Psi^2) E'[(u^(i) - u)^2] / N + O(1 / N^2).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...controllers import LQG
from ...planning import path_integral as pi
from ...planning import path_weights as pw
from ...problem import Belief, Problem
from ..compilation import quick_jit
from ..estimates import RepeatedControls
from ..solvers.discrete_expectation import DiscreteExpectation
from ..solvers.grid_solutions import solve_desirability
from ..solvers.scalar_equations import ScalarEquation, first_difference, mean_grid
from .matched_paths import first_controls, pooled_costs, printed_algorithm
from .matched_scalar import MatchedProblem, SteadySchedule

CONTROL_MEANS = np.linspace(-2, 2, 9)
CONTROL_GRIDS = ((560, 40), (1120, 80))  # cells and steps of the solutions of (16)
CONTROL_KEYS = 64
CONTROL_SAMPLES = 2048  # N of the sampled controls
CONTROL_BATCHES = 64  # of each size
CONTROL_SIZES = 2 ** np.arange(8, 14)  # N at which the rate is estimated
CONTROL_RATE_MEAN = 1.0  # mu at which the rate is estimated


class ControlEstimate(NamedTuple):
    """Holds the control without sampling and the leading errors of its estimate, each (means,)."""

    control: np.ndarray  # u
    bias: np.ndarray  # N times the leading bias
    variance: np.ndarray  # N times the leading variance


class ControlRate(NamedTuple):
    """Holds errors of the sampled control at each N of CONTROL_SIZES."""

    rms: np.ndarray  # (J,), RMS errors
    squared: np.ndarray  # (J,), squared errors over their leading variance


def optimal_control(
    matched: MatchedProblem, equation: ScalarEquation, means: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Returns -R^-1 G' V_mu (means,) at t = 0 from (16) and its error.

    The value is extrapolated from two grids, which must contain the means. The error is the
    distance of the finer grid's value from it.
    """
    G = np.asarray(matched.problem.system.G(jnp.zeros(1)))
    R = np.asarray(matched.problem.cost.R)
    gradients = []
    for cells, steps in CONTROL_GRIDS:
        grid = mean_grid(equation, cells, steps)
        index = np.rint((means + equation.reach) / grid.h).astype(int)
        neighbours = np.stack([index - 1, index, index + 1], axis=-1)
        psi = solve_desirability(equation, grid)[0, neighbours]
        V = -equation.temperature * np.log(psi)
        gradients.append(first_difference(V, grid.h)[:, 0])
    coarse, fine = gradients
    gain = np.linalg.solve(R, G.T)[0, 0]
    correction = (fine - coarse) / 3
    return -gain * (fine + correction), gain * np.abs(correction)


def exact_control(
    matched: MatchedProblem, equation: ScalarEquation, steps: int, means: np.ndarray
) -> np.ndarray:
    """Returns the exact expectation (means,) of (19) in `steps` steps."""
    expectation = DiscreteExpectation(equation, steps, equation.duration)
    return _control_map(matched) * expectation.increment(means)[0]


def control_estimate(
    matched: MatchedProblem, equation: ScalarEquation, means: np.ndarray
) -> ControlEstimate:
    """Returns what (19) makes of N samples, to leading order in 1 / N."""
    steps = matched.problem.steps
    control_map = _control_map(matched)
    halved = equation._replace(temperature=equation.temperature / 2)
    expectation = DiscreteExpectation(equation, steps, equation.duration)
    half_expectation = DiscreteExpectation(halved, steps, equation.duration)
    ratio = np.exp(half_expectation.log_psi(means) - 2 * expectation.log_psi(means))
    mean, _ = expectation.increment(means)
    half_mean, half_variance = half_expectation.increment(means)
    shift = half_mean - mean
    return ControlEstimate(
        control=control_map * mean,
        bias=-ratio * control_map * shift,
        variance=ratio * control_map**2 * (half_variance + shift**2),
    )


def _control_map(matched: MatchedProblem) -> float:
    G = matched.problem.system.G(jnp.zeros(1))
    return float(pi.control_map(G, matched.problem.cost.R)[0, 0])


def sample_controls(
    matched: MatchedProblem, equation: ScalarEquation, key: Array
) -> RepeatedControls:
    """Returns the controls of Algorithm 1 as printed at every mean."""
    planner = printed_algorithm(
        CONTROL_SAMPLES,
        matched.problem,
        matched.temperature,
        theta=matched.theta,
        variance_of="total",
    )
    keys = jax.random.split(key, CONTROL_KEYS)
    controls = quick_jit(first_controls)(
        planner, matched.problem, CONTROL_MEANS[:, None], matched.cov, keys
    )
    estimate = control_estimate(matched, equation, CONTROL_MEANS)
    expected = estimate.control + estimate.bias / CONTROL_SAMPLES
    return RepeatedControls(np.asarray(controls)[:, :, 0], expected)


def sample_control_rate(
    matched: MatchedProblem, schedule: SteadySchedule, equation: ScalarEquation, key: Array
) -> ControlRate:
    """Returns errors of independent batches of every size at one mean."""
    paths = int(CONTROL_BATCHES * CONTROL_SIZES.sum())
    pools = pooled_costs(matched, schedule, CONTROL_RATE_MEAN, key, paths)
    estimate = control_estimate(matched, equation, np.array([CONTROL_RATE_MEAN]))
    of_batches = quick_jit(
        jax.vmap(lambda S, u: pw.weighted_increments(pw.weights(S, matched.temperature), u))
    )
    cuts = CONTROL_BATCHES * np.cumsum(CONTROL_SIZES)[:-1]
    costs, increments = (
        [part.reshape(CONTROL_BATCHES, -1) for part in np.split(pool, cuts)] for pool in pools
    )
    errors = np.array(
        [of_batches(S, u) - estimate.control[0] for S, u in zip(costs, increments, strict=True)]
    )
    mean_square = np.mean(errors**2, axis=1)
    return ControlRate(np.sqrt(mean_square), mean_square * CONTROL_SIZES / estimate.variance[0])


def lqg_controls(problem: Problem, cov: np.ndarray) -> np.ndarray:
    """Returns the package's LQG control (means,) at t = 0 and `CONTROL_MEANS`."""

    @quick_jit
    def act(problem: Problem, means: Array) -> Array:
        controller = LQG(horizon=0, at_step_end=False)
        plan = controller.init(problem)
        belief = partial(Belief, cov=jnp.asarray(cov))
        return jax.vmap(
            lambda mean: controller.act(problem, belief(mean), plan, jax.random.key(0))[0][0]
        )(means)

    return np.asarray(act(problem, CONTROL_MEANS[:, None]))
