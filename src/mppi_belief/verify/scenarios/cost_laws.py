"""The law of a running cost under a Gaussian belief: cumulants and entropic risk (Remark 4).

    rho(theta) = 1/theta log E[exp(theta q(x))],   x ~ N(mu, Sigma)

For q = 1/2 (x - r)' W (x - r), M = Sigma W, d = mu - r:

    theta rho = -1/2 log det(I - theta M) + theta/2 d' W (I - theta M)^-1 d
    kappa_3   = tr M^3 + 3 d' W M^2 d

rho is infinite from theta lambda_max(M) = 1 on.

For costs with bumps, expectations are trapezoidal sums in the plane. They converge faster than any
power of the step for smooth functions that decay like a Gaussian; the sum over every other point
tells their error.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from ...problem import Belief, Problem

SUM_REACH = 9.5  # of the sums, in standard deviations


class PlaneLaw(NamedTuple):
    """Represents the law of a cost by a trapezoidal sum in the plane."""

    cost: np.ndarray  # (n, n), at points of the plane
    weight: np.ndarray  # (n, n), of the points

    def mean(self, values: np.ndarray) -> float:
        """Returns the expectation of values (n, n)."""
        return float(np.sum(self.weight * values))

    def coarser(self) -> "PlaneLaw":
        """Returns the sum over every other point."""
        return PlaneLaw(self.cost[::2, ::2], 4 * self.weight[::2, ::2])

    def cumulants(self) -> tuple[float, float, float]:
        """Returns the first three cumulants."""
        mean = self.mean(self.cost)
        deviation = self.cost - mean
        return mean, self.mean(deviation**2), self.mean(deviation**3)

    def entropic_risk(self, theta: float) -> float:
        """Returns rho(theta)."""
        largest = float(np.max(self.cost))
        mean = self.mean(self.cost)
        # Where exp would soon overflow, E exp - 1 no longer cancels.
        if theta * (largest - mean) > 30:
            scaled = self.mean(np.exp(theta * (self.cost - largest)))
            return largest + math.log(scaled) / theta
        return mean + math.log1p(self.mean(np.expm1(theta * (self.cost - mean)))) / theta


class QuadraticLaw(NamedTuple):
    """Represents the law of 1/2 (x - r)' W (x - r) under N(mu, Sigma)."""

    spread: np.ndarray  # (n, n), M = Sigma W
    offset: np.ndarray  # (n,), d = mu - r
    gradient: np.ndarray  # (n,), W d

    @property
    def pole(self) -> float:
        """Returns the theta from which on rho is infinite."""
        return float(1 / np.max(np.linalg.eigvals(self.spread).real))

    def cumulants(self) -> tuple[float, float, float]:
        """Returns the first three cumulants."""
        M, d, Wd = self
        mean = 0.5 * (np.trace(M) + d @ Wd)
        variance = 0.5 * np.trace(M @ M) + Wd @ M @ d
        third = np.trace(M @ M @ M) + 3 * Wd @ M @ M @ d
        return float(mean), float(variance), float(third)

    def entropic_risk(self, theta: float) -> float:
        """Returns rho(theta)."""
        if theta >= self.pole:
            return math.inf
        remainder = np.eye(len(self.offset)) - theta * self.spread
        log_determinant = np.linalg.slogdet(remainder)[1]
        quadratic = self.gradient @ np.linalg.solve(remainder, self.offset)
        return float(-0.5 * log_determinant / theta + 0.5 * quadratic)


CostLaw = PlaneLaw | QuadraticLaw


@jax.jit
def _base_and_penalty(problem: Problem, points: Array) -> tuple[Array, Array]:
    return jax.vmap(problem.cost.base)(points), jax.vmap(problem.penalty)(points)


def plane_law(problem: Problem, belief: Belief, risk: str, step: float) -> PlaneLaw:
    """Returns the law of the penalty (`risk` "penalty") or of the whole running cost ("total").

    The cost depends on a position (2,); `step` is in standard deviations of the belief.
    """
    # Points of an even grid, in the coordinates of the belief's Cholesky factor.
    steps = round(SUM_REACH / step)
    z = step * np.arange(-steps, steps + 1)
    standardised = np.stack(np.meshgrid(z, z, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.asarray(belief.mean) + standardised @ np.linalg.cholesky(belief.cov).T

    base, penalty = (
        np.asarray(values).reshape(len(z), len(z))
        for values in _base_and_penalty(problem, jnp.asarray(points))
    )
    density = step / math.sqrt(2 * math.pi) * np.exp(-(z**2) / 2)
    return PlaneLaw(penalty if risk == "penalty" else base + penalty, np.outer(density, density))
