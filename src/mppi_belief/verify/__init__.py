"""Numerical certificates of the paper's statements, and their conditions for one system.

Each module of `certificates` has a function `certify(seed)`, which returns numbers with the bands
that they must lie in (`mppi_belief.results.certificate`), computed in double precision. The names
of the certificates are `mppi_belief.results.certificate.CERTIFICATE_NAMES`.

* `bands`, `estimates`: checks with derived bands; sizes, rates and limits of errors.
* `solvers`: numerical solutions of the paper's equations that use nothing of the planner.
* `scenarios`: problems with known answers, and these answers.
* `certificates`: the statement, the numbers and the bands of each certificate.
* `own_system`, `conditions`: which statements hold for a user's system.
* `compute`: computes one certificate by its name, for the process pool of `run`.
"""
