"""Which statements of the paper hold for one system, along the belief of one trial.

Theorem 1 and Proposition 2 require f and c to be affine, G and sigma_o to be constant
(`conditions.affine_conditions`); Proposition 3, Theorem 4, Corollary 5 and Theorem 6 require that D
matches the controls (`conditions.matching_conditions`); Remark 4 requires a decreasing expansion
(`conditions.expansion_conditions`).
"""

import jax

from ..numerics.jax_settings import pin_jax_settings
from ..problem import Controller, Filter, Problem, WeighsPaths
from ..results.certificate import Certificate
from .conditions.affine_conditions import affine_conditions
from .conditions.expansion_conditions import expansion_conditions
from .conditions.matching_conditions import matching_conditions
from .conditions.trial_path import simulated_path

EXACT = (
    "As far as the trial's belief reaches, it is exactly Gaussian and its covariance known in "
    "advance (Proposition 2)."
)
APPROXIMATE = (
    "The belief is Gaussian in approximation only, as linearised along the mean (Remark 3)."
)


def what_holds(
    problem: Problem,
    filter: Filter,
    controller: Controller,
    temperature: float,
    seed: int,
    name: str,
    settings: str,
) -> Certificate:
    """Returns the conditions of each statement for `problem`, in double precision.

    The conditions are examined along the belief of trial 0 of `controller`. lambda of (15) is the
    controller's temperature or, if it has none, `temperature`; theta and the risk of Remark 4 are
    those of the controller. A check that does not hold is no error: the statement does not apply,
    and the plan is an approximation. `name` is the certificate's name, and its statement says that
    it is about `settings`. Raises `ConfigError` if the trial diverges.
    """
    pin_jax_settings()
    with jax.enable_x64(True):
        path = simulated_path(problem, filter, controller, seed)
        exact = affine_conditions(problem, path)
        if isinstance(controller, WeighsPaths):
            temperature = float(controller.temperature)
        matched, matching = matching_conditions(problem, path, temperature)
        checks = [*exact, *matched, *expansion_conditions(problem, path, controller)]
    gaussian = all(check.holds for check in exact)
    statement = f"What holds for {settings}, along the belief of trial 0"
    text = f"{EXACT if gaussian else APPROXIMATE} {matching}"
    return Certificate(name, statement, text, checks)
