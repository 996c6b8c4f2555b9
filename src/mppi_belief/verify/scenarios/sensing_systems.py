"""Random linear systems whose sensor makes matching hold (after arXiv 2604.18941).

    D = lambda G R^-1 G',  dSigma = A Sigma + Sigma A' + Q - lambda G R^-1 G',  -lambda log Psi = V

The observation matrix C is chosen from Sigma.

The systems are stable, and their process noise exceeds what matching requires, Q > lambda G R^-1
G'. For quadratic costs the sum over sampled paths is a Gaussian integral, -lambda log Psi = 1/2 mu'
P_j mu + c_j in discrete time,

    P_j = q dt + F' (P_{j+1}^-1 + D_j dt / lambda)^-1 F
    c_j = c_{j+1} + lambda / 2 log det(I + P_{j+1} D_j dt / lambda)

and V of (13) is known from the flow of its Hamiltonian, [X; Y]' = [A, -G R^-1 G'; -q, -A'] [X; Y],
P = Y X^-1.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.linalg import expm

from ...belief.prior import prior
from ...belief.schedule import GainSchedule, gain_schedule
from ...costs import GoalObstacleCost
from ...matching.weights import matched_weight, residual
from ...problem import Problem
from ...systems import Steered
from ..compilation import quick_jit

SENSING_TEMPERATURE = 0.7  # lambda
SENSING_DURATION = 2.0  # T
SENSING_STEPS = 80
SYSTEM_SIZES = ((2, 2), (3, 2), (4, 2))  # states and controls


class SensingSchedule(NamedTuple):
    """Holds a problem, its schedule without control, and what this leaves of (15)."""

    problem: Problem
    schedule: GainSchedule
    residuals: Array  # (T,), of (15)


class QuadraticValue(NamedTuple):
    """Holds V(0, mu) = 1/2 mu' P mu + constant, and V a step later."""

    P: np.ndarray  # (nx, nx)
    constant: float
    next_P: np.ndarray  # (nx, nx)
    next_constant: float


def random_sensing_problem(rng: np.random.Generator, nx: int, nu: int) -> Problem:
    """Returns a random problem; all eigenvalues of A have real parts of at most -0.3."""
    A = rng.normal(size=(nx, nx))
    A -= (np.max(np.linalg.eigvals(A).real) + 0.3) * np.eye(nx)
    B = rng.normal(size=(nx, nu))
    root = rng.normal(size=(nu, nu))
    R = root @ root.T + np.eye(nu)
    H = np.linalg.cholesky(SENSING_TEMPERATURE * B @ np.linalg.solve(R, B.T) + 0.2 * np.eye(nx))
    plant: dict[str, Any] = {
        "A": A,
        "B": B,
        "C": np.eye(nu, nx),
        "channel": H,
        "sensor_noise": np.full(nu, 0.4),
    }
    system = Steered(**plant, temperature=SENSING_TEMPERATURE, selector="matched")
    running, terminal = jnp.asarray(rng.uniform(0.5, 1.5, (2, nx)))
    return Problem(
        system,
        GoalObstacleCost(jnp.zeros(nx), running, terminal, jnp.asarray(R)),
        prior_mean=jnp.full(nx, 0.5),
        prior_std=jnp.asarray(rng.uniform(0.5, 1.0, nx)),
        dt=SENSING_DURATION / SENSING_STEPS,
        steps=SENSING_STEPS,
        noise_convention="intensity",
    )


def sensing_schedule(problem: Problem, method: str = "filter") -> SensingSchedule:
    """Returns the package's schedule; `method` is that of `gain_schedule`."""
    return SensingSchedule(problem, *_schedule_and_residuals(problem, method))


@partial(quick_jit, static_argnames="method")
def _schedule_and_residuals(problem: Problem, method: str) -> tuple[GainSchedule, Array]:
    controls = jnp.zeros((problem.steps, problem.cost.R.shape[0]))
    schedule = gain_schedule(problem, prior(problem), controls, method)
    G = problem.system.G(problem.prior_mean)
    W = matched_weight(problem.cost.R, SENSING_TEMPERATURE)
    return schedule, jax.vmap(residual, (0, None, None))(schedule.diffusion, G, W)


def coarser_problem(sensing: SensingSchedule, together: int) -> Problem:
    """Returns the problem in steps of `together` of its own."""
    problem = sensing.problem
    return replace(problem, dt=together * problem.dt, steps=SENSING_STEPS // together)


def control_authority(problem: Problem) -> np.ndarray:
    """Returns G R^-1 G' (nx, nx)."""
    G = np.asarray(problem.system.G(problem.prior_mean))
    return G @ np.linalg.solve(np.asarray(problem.cost.R), G.T)


def matched_covariances(problem: Problem) -> np.ndarray:
    """Returns Sigma (T+1, nx, nx) of a filter with a matched sensor: the sensor does not occur."""
    system: Any = problem.system
    F = np.eye(len(system.A)) + problem.dt * np.asarray(system.A)
    Q = np.asarray(system.H @ system.H.T)
    growth = (Q - SENSING_TEMPERATURE * control_authority(problem)) * problem.dt
    covs = [np.diag(np.asarray(problem.prior_std) ** 2)]
    for _ in range(problem.steps):
        covs.append(F @ covs[-1] @ F.T + growth)
    return np.array(covs)


def integrated_value(problem: Problem, diffusions: np.ndarray, covs: np.ndarray) -> QuadraticValue:
    """Returns -lambda log of E exp(-S / lambda) by Gaussian integrals.

    `diffusions` (T, nx, nx) holds D_k, and `covs` (T+1, nx, nx) the covariances that the cost
    charges too.
    """
    cost: Any = problem.cost
    system: Any = problem.system
    q = np.diag(cost.running_weight)
    phi = np.diag(cost.terminal_weight)
    F = np.eye(len(q)) + problem.dt * np.asarray(system.A)
    P = phi
    constant = 0.5 * float(np.sum(phi * covs[-1]))
    next_P = P
    next_constant = constant
    for D, cov in zip(diffusions[::-1], covs[-2::-1], strict=True):
        next_P = P
        next_constant = constant
        growth = np.eye(len(q)) + P @ D * problem.dt / SENSING_TEMPERATURE
        charge = 0.5 * problem.dt * float(np.sum(q * cov))
        constant += 0.5 * SENSING_TEMPERATURE * np.linalg.slogdet(growth)[1] + charge
        P = q * problem.dt + F.T @ np.linalg.solve(growth, P) @ F
        P = (P + P.T) / 2
    return QuadraticValue(P, constant, next_P, next_constant)


def quadratic_forms(P: np.ndarray, means: np.ndarray) -> np.ndarray:
    """Returns 1/2 mu' P mu (n,) at means (n, nx)."""
    return 0.5 * np.einsum("pi,ij,pj->p", means, P, means)


def quadratic_bellman_residual(
    problem: Problem, value: QuadraticValue, D: np.ndarray, means: np.ndarray
) -> np.ndarray:
    """Returns what V leaves of (13) at t = 0 and means (n, nx).

    The time derivative is a difference.
    """
    cost: Any = problem.cost
    system: Any = problem.system
    A = np.asarray(system.A)
    authority = control_authority(problem)
    change = quadratic_forms(value.next_P - value.P, means) + value.next_constant - value.constant
    time_derivative = change / problem.dt
    q = np.diag(np.asarray(cost.running_weight))
    gradient = means @ value.P
    drift = np.einsum("pi,ij,pj->p", gradient, A, means)
    control = 0.5 * np.einsum("pi,ij,pj->p", gradient, authority, gradient)
    diffusion = 0.5 * np.sum(D * value.P)
    return time_derivative + quadratic_forms(q, means) + drift - control + diffusion


def hamiltonian_value(problem: Problem) -> tuple[np.ndarray, float]:
    """Returns P(0) and the constant 1/2 int tr(P D) of V for D = lambda G R^-1 G'.

    Both come from the Hamiltonian flow over T.
    """
    cost: Any = problem.cost
    system: Any = problem.system
    A = np.asarray(system.A)
    authority = control_authority(problem)
    q = np.diag(cost.running_weight)
    phi = np.diag(cost.terminal_weight)
    n = len(A)
    duration = problem.dt * problem.steps
    flow = expm(-duration * np.block([[A, -authority], [-q, -A.T]]))
    X = flow[:n, :n] + flow[:n, n:] @ phi
    Y = flow[n:, :n] + flow[n:, n:] @ phi
    # d/dt log det X = tr(A - G R^-1 G' P), and X(T) = I.
    log_determinant = float(np.trace(A) * duration + np.linalg.slogdet(X)[1])
    return Y @ np.linalg.inv(X), 0.5 * SENSING_TEMPERATURE * log_determinant


def rounding_scale(schedules: list[SensingSchedule]) -> tuple[float, float]:
    """Returns the operations of one solve and the largest condition of a covariance.

    The rounding of a solve grows by this condition.
    """
    operations = 4.0 * SYSTEM_SIZES[-1][0] ** 3
    conditions = [
        float(np.max(np.linalg.cond(np.asarray(sensing.schedule.cov)))) for sensing in schedules
    ]
    return operations, max(conditions)
