"""Computes one certificate by the name of its module.

`cli/certify_on_pool.py` computes many of them side by side.
"""

import time
from collections.abc import Sequence
from importlib import import_module
from typing import Any, NamedTuple

import jax

from ..numerics.jax_settings import pin_jax_settings
from ..results.certificate import Certificate


class CertificateOutcome(NamedTuple):
    """Holds the certificate of one module, or the error that prevented it."""

    name: str
    certificate: Certificate | None
    error: str  # one line, "" if there is a certificate
    seconds: float  # s, computing time


def compute_certificate(config: dict[str, Any], trials: Sequence[int]) -> CertificateOutcome:
    """Computes the certificate of the module `config["name"]` for the seed `config["seed"]`.

    All is computed in double precision. The signature is that of work for `run.pool.Pool`, whose
    named tasks have the trial 0 only. Raises what the module raises.
    """
    start = time.perf_counter()
    name = config["name"]
    pin_jax_settings()
    with jax.enable_x64(True):
        module = import_module(f"mppi_belief.verify.certificates.{name}")
        certificate = module.certify(config["seed"])
    return CertificateOutcome(name, certificate, "", time.perf_counter() - start)
