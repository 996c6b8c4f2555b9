"""Holds what samplers of controls about a nominal plan share: the density, the warm start.

    delta_k ~ N(0, S_u)

S_u = lambda R^-1 / dt samples the matched diffusion itself; any other S_u = control_std^2 I is an
importance density with the Girsanov term gamma nominal' S_u^-1 delta, gamma = lambda (1 - alpha)
(Williams et al. 2018).
"""

from typing import ClassVar

from jax import Array

from ...structs import choice, number, struct
from ..path_integral import shifted


@struct
class ControlDensity:
    """Holds the density of the controls of a path that costs nothing, N(nominal, S_u).

    Fields:
        control_std: standard deviation of sampled controls; None for S_u = lambda R^-1 / dt
        alpha: of the Girsanov term; None for nominal' R delta dt, which is alpha = 0 in the exact
            case
        antithetic: draw mirrored pairs: half the normals, less variance
    """

    control_std: float | None = number(default=None, gt=0, optional=True)
    alpha: float | None = number(default=None, ge=0, le=1, optional=True)
    antithetic: bool = choice(False, True, default=False)

    disturbs_mean: ClassVar[bool] = False

    def warm_start(self, improved: Array) -> Array:
        """Returns the improved plan (H, nu) one step later."""
        return shifted(improved)
