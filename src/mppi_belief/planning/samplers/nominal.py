"""Paths about a warm-started nominal, as in MPPI: the matched diffusion.

    u_k = nominal_k + delta_k,   delta_k ~ N(0, S_u)        L_k L_k' = lambda G R^-1 G'

S_u = lambda R^-1 / dt samples the matched diffusion itself: G delta_k dt then is L_k eps_k of (18).
Any other S_u = control_std^2 I is an importance density with the Girsanov term gamma nominal'
S_u^-1 delta, gamma = lambda (1 - alpha) (Williams et al. 2018).
"""

from jax import Array

from ...problem import Problem
from ...structs import struct
from ..parts import Draw, DrawnPaths, PathCost, PlannedBelief
from ..path_integral import girsanov, girsanov_weight, matched_increments, normals
from .control_density import ControlDensity


@struct
class NominalSampler(ControlDensity):
    """Draws controls about the nominal plan."""

    def prepare(
        self,
        problem: Problem,
        path_cost: PathCost,
        planned: PlannedBelief,
        nominal: Array,
        temperature: Array | float,
    ) -> Draw:
        """Returns a function that draws paths about the nominal controls (H, nu)."""
        return self.around(problem, nominal, temperature)

    def around(self, problem: Problem, nominal: Array, temperature: Array | float) -> Draw:
        """Returns a function that draws paths; it needs neither path costs nor covariances."""
        weight = girsanov_weight(problem, temperature, self.control_std, self.alpha)

        def draw(key: Array, n: int) -> DrawnPaths:
            horizon, n_controls = nominal.shape
            eps = normals(key, (horizon, n_controls, n), self.antithetic)
            increments = matched_increments(problem, eps, temperature, self.control_std)
            return DrawnPaths(increments, None, girsanov(nominal, increments, weight))

        return draw
