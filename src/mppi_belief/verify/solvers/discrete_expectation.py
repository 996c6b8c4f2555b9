"""The expectations of (17) and (19) over the Euler-Maruyama paths (18), without sampling.

    Psi_k(mu) = exp(-q(mu) dt / lambda) E[Psi_{k+1}(mu + a mu dt + L eps)]

The running cost is charged at the start of each step. The expectation is a Gauss-Hermite sum, and
log Psi_k is interpolated by a spline: it is nearly quadratic where its argument is large, which
splines represent well.
"""

from functools import cached_property

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from scipy.interpolate import BSpline, make_interp_spline
from scipy.special import logsumexp

from .scalar_equations import ScalarEquation

HERMITE_NODES = 24  # of the Gauss-Hermite rule
KNOT_SPACING = 0.04  # of the splines
SPLINE_DEGREE = 5


class DiscreteExpectation:
    """Computes exact expectations over `steps` steps of dt = duration / steps."""

    def __init__(self, equation: ScalarEquation, steps: int, duration: float):
        self.equation = equation
        self.steps = steps
        self.dt = duration / steps

    def log_psi(self, mu: np.ndarray) -> np.ndarray:
        """Returns log Psi_0 (n,) at means (n,)."""
        return self._backward_step(mu, self._log_psi_after_first, self.equation.running(mu))

    def increment(self, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the weighted mean and variance (n,) of L eps_0 / dt at means (n,).

        The control map applied to this mean is the expectation of (19).
        """
        log_terms, pushed = self._node_terms(mu, self._log_psi_after_first)
        weights = np.exp(log_terms - logsumexp(log_terms, axis=-1, keepdims=True))
        mean = weights @ pushed / self.dt
        return mean, weights @ (pushed / self.dt) ** 2 - mean**2

    @cached_property
    def _log_psi_after_first(self) -> BSpline:
        """Returns log Psi_1 as a spline."""
        equation = self.equation
        reach = equation.reach
        points = np.linspace(-reach, reach, round(2 * reach / KNOT_SPACING) + 1)
        values = -equation.terminal(points) / equation.temperature
        log_psi = make_interp_spline(points, values, SPLINE_DEGREE)
        running = equation.running(points)
        for _ in range(self.steps - 1):
            values = self._backward_step(points, log_psi, running)
            log_psi = make_interp_spline(points, values, SPLINE_DEGREE)
        return log_psi

    def _backward_step(self, mu: np.ndarray, log_psi: BSpline, running: np.ndarray) -> np.ndarray:
        log_terms, _ = self._node_terms(mu, log_psi)
        charge = running * self.dt / self.equation.temperature
        return logsumexp(log_terms, axis=-1) - charge

    def _node_terms(self, mu: np.ndarray, log_psi: BSpline) -> tuple[np.ndarray, np.ndarray]:
        """Returns the log of node weight times Psi (n, nodes), and L eps at the nodes (nodes,)."""
        nodes, weights = hermegauss(HERMITE_NODES)
        pushed = np.sqrt(self.equation.diffusion * self.dt) * nodes
        drifted = np.asarray(mu)[:, None] * (1 + self.equation.drift * self.dt)
        return log_psi(drifted + pushed) + np.log(weights / weights.sum()), pushed
