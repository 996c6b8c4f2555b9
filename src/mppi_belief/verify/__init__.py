"""Numerical certificates of the paper's statements: each module's `certify(seed)` computes one.

A certificate returns numbers with the bands they must lie in (`mppi_belief.results.certificate`), in double precision.
"""
