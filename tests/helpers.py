"""Problems and statistics shared by the tests."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import mppi_belief as mb
from mppi_belief.belief.gaussian import covariance
from mppi_belief.belief.riccati import riccati_root
from mppi_belief.numerics.square_root import pivoted_cholesky

CENTERS = [[3, 1], [3, -1]]
# as compiled outside of the tests, see `compile_simply` in conftest.py
users_jit = partial(
    jax.jit,
    compiler_options={
        "xla_cpu_use_fusion_emitters": True,
        "xla_cpu_parallel_codegen_split_count": 32,
    },
)
# most tests compile more than they compute: without optimisation that takes half as long
quick_jit = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})

SIGMAS = 4.5  # a true statement fails such a test about once in 150 000


@contextmanager
def float64() -> Iterator[None]:
    """Closed forms are compared in double precision; without this, tests run in float32 as users
    do.
    """
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    try:
        yield
    finally:
        jax.config.update("jax_enable_x64", before)


def light_dark_problem(
    system: dict | None = None, cost: dict | None = None, **problem
) -> mb.Problem:
    """The reference scenario, with any of its numbers replaced."""
    obstacles = mb.Obstacles(centers=CENTERS, radius=0.65)
    noise = {"process_noise": 0.3, "light": 5, "noise_slope": 0.5**0.5, "noise_floor": 0.1}
    aims = {
        "goal": [7, 0, 0, 0],
        "running_weight": [1.5, 1.5, 0.6, 0.6],
        "terminal_weight": [5, 5, 0.15, 0.15],
        "control_weight": [0.035, 0.035],
        "w_obs": 500,
        "obstacle_penalty": mb.Bump(0.285),
    }
    rest = {
        "prior_mean": [1, 1, 0, 0],
        "prior_std": [0.2, 0.2, 0.05, 0.05],
        "dt": 0.1,
        "steps": 60,
        "obstacles": obstacles,
        "position": (0, 1),
    }
    return mb.Problem(
        mb.LightDark(**noise | (system or {})),
        mb.GoalObstacleCost(**aims | (cost or {})),
        **rest | problem,
    )


def plain_problem(cost: mb.Cost, **problem) -> mb.Problem:
    """A problem with this cost, whose state stays where it is and is measured with unit noise."""
    nx = len(cost.goal)
    rest = {"prior_mean": np.zeros(nx), "prior_std": np.ones(nx), "dt": 1.0, "steps": 1}
    eye = np.eye(nx)
    system = mb.Linear(0 * eye, eye, eye, 0 * eye, np.ones(nx))
    return mb.Problem(system, cost, **rest | problem)


class Scalar(NamedTuple):
    """Holds the scalar system of Remark 2 at its steady state, with D = lambda b^2 / R."""

    a: float = 0.3
    b: float = 0.8
    c: float = 1.2
    sigma_w: float = 0.7
    sigma_o: float = 0.5
    temperature: float = 0.6
    q: float = 1.3
    q_T: float = 0.9
    mean: float = 1.1
    duration: float = 1.0

    @property
    def variance(self) -> float:
        """Positive root of 2 a S + sigma_w^2 = (c S / sigma_o)^2."""
        p = (self.c / self.sigma_o) ** 2
        return (self.a + np.sqrt(self.a**2 + p * self.sigma_w**2)) / p

    @property
    def diffusion(self) -> float:
        return (self.c * self.variance / self.sigma_o) ** 2

    @property
    def R(self) -> float:
        return self.temperature * self.b**2 / self.diffusion

    def problem(self, steps: int = 10, noise_convention: str = "intensity") -> mb.Problem:
        system = mb.ScalarLinear(self.a, self.b, self.c, self.sigma_w, self.sigma_o)
        cost = mb.GoalObstacleCost(
            [0.0],
            [self.q],
            [self.q_T],
            [self.R],
        )
        prior = {"prior_mean": [self.mean], "prior_std": [np.sqrt(self.variance)]}
        return mb.Problem(
            system,
            cost,
            **prior,
            dt=self.duration / steps,
            steps=steps,
            noise_convention=noise_convention,
        )


class Info(NamedTuple):
    ess: Array


@mb.struct
class Feedback:
    """u = -gain (position of the believed mean): a controller that costs nothing to run."""

    gain: float = mb.number()

    def init(self, problem: mb.Problem) -> Array:
        return jnp.zeros(())

    def act(
        self, problem: mb.Problem, belief: mb.Belief, plan: Array, key: Array
    ) -> tuple[Array, Array, Info]:
        return -self.gain * problem.position_of(belief.mean), plan, Info(jnp.ones(()))


def random_spd(rng: np.random.Generator, n: int, low: float = 0.5, high: float = 2.0) -> np.ndarray:
    """A symmetric positive definite matrix with eigenvalues in [low, high]."""
    basis, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return basis @ np.diag(rng.uniform(low, high, n)) @ basis.T


@quick_jit
def riccati_step(cov: Array, A: Array, Q: Array, C: Array, R_o: Array, dt: Array | float) -> Array:
    """Returns the covariance that `riccati_root` gives after dt, from a covariance (nx, nx)."""
    return covariance(riccati_root(pivoted_cholesky(cov), A, Q, C, R_o, dt))


def assert_mean(samples: np.ndarray, target: np.ndarray | float, sigmas: float = SIGMAS) -> None:
    """The mean over the first axis lies within so many standard errors of the target (rounding:
    1e-12).
    """
    samples = np.asarray(samples, dtype=np.float64)
    error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples)) + 1e-12
    assert np.all(np.abs(samples.mean(axis=0) - target) <= sigmas * error), (
        samples.mean(axis=0),
        target,
        error,
    )


def assert_covariance(samples: np.ndarray, target: np.ndarray, sigmas: float = SIGMAS) -> None:
    """Zero-mean Gaussian samples (n, d) have the covariance `target` (d, d), within standard
    errors.
    """
    samples = np.asarray(samples, dtype=np.float64)
    diagonal = np.diag(target)
    error = np.sqrt((np.outer(diagonal, diagonal) + target**2) / len(samples))
    assert np.all(np.abs(samples.T @ samples / len(samples) - target) <= sigmas * error + 1e-12)
