"""The belief obeys the Kushner-Stratonovich equation (5), with the channels (6a)(6b).

    dpi = a^u(pi) dt + b(pi) dy~,   a^u = a^0 - (G u pi)',   b = pi (c - pi(c)) R_o^-1

On a line (5) is solved on a grid (`solvers.kushner`). Where c is linear its solution is Gaussian,
and the Kalman filters must agree with it (`scenarios.linear_filtering`);
`scenarios.belief_channels` examines (6a)(6b), and `scenarios.curved_measurement` a measurement for
which the belief is not Gaussian.
"""

import numpy as np

from ...results.certificate import Certificate, Line, Panel
from ..scenarios.belief_channels import channel_check, step_order_checks
from ..scenarios.curved_measurement import (
    CURVATURES,
    CURVED_STEPS,
    PARTICLE_CURVATURES,
    PARTICLES,
    CurvedResults,
    curved_results,
    ekf_checks,
    particle_check,
)
from ..scenarios.linear_filtering import rms_over, space_order_checks, time_order_checks
from ..solvers.kushner import Moments


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate; `seed` draws the paths and the particles."""
    results = curved_results(seed)
    panels = [_filter_error_panel(results), _path_panel(results)]
    checks = [
        *space_order_checks(),
        *time_order_checks(seed),
        channel_check(),
        *step_order_checks(),
        particle_check(results),
        *ekf_checks(results.ekf, results.exact, results.grid_error),
    ]
    text = _dynamics_text(least_curvature_where_ekf_is_worse(panels[0]))
    return Certificate("belief_dynamics", "Eqs. (5)(6), belief dynamics", text, checks, panels)


def _dynamics_text(worse_from: float) -> str:
    compared = ", ".join(f"{CURVATURES[i]:g}" for i in PARTICLE_CURVATURES)
    return (
        "The Kushner-Stratonovich equation is solved on a grid by splitting, for one state. Where "
        "the measurement is linear, the package's Kalman filter and Kalman-Bucy's equations are "
        "recovered at the orders of the scheme; one step of the solver is the drift (6a) and the "
        "diffusion (6b). Where the measurement is curved, c(x) = x + κx²/2, the particle filter "
        "has no visible bias, while the Gaussian belief of the EKF errs by O(κ). Of κ = "
        f"{compared}, its mean has a larger error than that of {PARTICLES} particles, which "
        f"scatter, from {worse_from:g} on. The statement is checked for one state and constant "
        "noise, not for infinite dimensions as such."
    )


def least_curvature_where_ekf_is_worse(panel: Panel) -> float:
    """Returns the least kappa from which on the EKF's mean is worse than the particle filter's.

    Only the curvatures of the particle filter are compared; the result is inf if there is none.
    """
    ekf, _, particles, _ = panel.lines
    ekf_errors = dict(zip(ekf.x, ekf.y, strict=True))
    better = [
        kappa
        for kappa, particle_error in zip(particles.x, particles.y, strict=True)
        if ekf_errors[kappa] <= particle_error
    ]
    last_better = max(better, default=0.0)
    return min((kappa for kappa in particles.x if kappa > last_better), default=float("inf"))


def _filter_error_panel(results: CurvedResults) -> Panel:
    """Returns RMS errors over time and paths, in posterior standard deviations, over kappa."""
    everything = list(range(len(CURVATURES)))
    lines = [
        *_error_lines("EKF", results.ekf, results.exact, everything, "line"),
        *_error_lines(
            f"{PARTICLES} particles",
            results.particles,
            results.exact,
            PARTICLE_CURVATURES,
            "points",
        ),
    ]
    title = "Errors against the Kushner-Stratonovich equation"
    return Panel(title, "curvature κ of the measurement", "RMS error (× posterior sd)", lines, "xy")


def _error_lines(
    name: str, moments: Moments, exact: Moments, indices: list[int], look: str
) -> list[Line]:
    kappa = [CURVATURES[i] for i in indices]
    mean = exact.mean[indices]
    std = np.sqrt(exact.variance[indices])
    mean_errors = rms_over((moments.mean - mean) / std, axis=(1, 2)).tolist()
    std_errors = rms_over(np.sqrt(moments.variance) / std - 1, axis=(1, 2)).tolist()
    return [
        Line(f"{name}, mean", kappa, mean_errors, look),
        Line(f"{name}, std", kappa, std_errors, look),
    ]


def _path_panel(results: CurvedResults) -> Panel:
    """Returns one path at the largest kappa."""
    time = np.linspace(0, 1, CURVED_STEPS + 1).tolist()
    mean = results.exact.mean[-1, 0]
    std = np.sqrt(results.exact.variance[-1, 0])
    lines = [
        Line(
            "grid, ± 2 std",
            time,
            mean.tolist(),
            "line",
            (mean - 2 * std).tolist(),
            (mean + 2 * std).tolist(),
        ),
        Line("EKF", time, results.ekf.mean[-1, 0].tolist(), "dashed"),
        Line("particle filter", time, results.particles.mean[-1, 0].tolist(), "points"),
    ]
    title = f"Belief mean along one path, κ = {CURVATURES[-1]:g}"
    return Panel(title, "time (s)", "belief mean μ", lines)
