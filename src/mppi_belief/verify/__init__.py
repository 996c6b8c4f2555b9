"""Numerical certificates of the paper's statements: each module's `certify(seed)` computes one.

A certificate returns numbers with the bands they must lie in (`mppi_belief.certificate`), in double precision.
"""

NAMES = (
    "affine_observations",
    "belief_dynamics",
    "deterministic_covariance",
    "matching_feasibility",
    "matching_residual",
    "cole_hopf",
    "feynman_kac",
    "control_law",
    "entropic_risk",
    "algorithm_1",
)  # modules of this package, in the order of the paper
