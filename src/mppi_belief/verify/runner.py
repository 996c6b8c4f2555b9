"""All certificates at once: one process each at a time in a pool, a progress bar, nothing that stops at a failure."""

import multiprocessing
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import import_module
from typing import NamedTuple

import jax
from tqdm import tqdm

from ..certificate import Certificate, Check


class Done(NamedTuple):
    """A certificate and the seconds it took."""

    certificate: Certificate
    seconds: float


def certify(name: str, seed: int) -> Done:
    """Compute one certificate of `mppi_belief.verify.NAMES`, in double precision.

    What it raises becomes a check that fails, so that the others are still seen.
    """
    began = time.perf_counter()
    try:
        with jax.enable_x64(True):
            made = import_module(f"mppi_belief.verify.{name}").certify(seed)
    except Exception as error:
        raised = Check(f"{type(error).__name__}: {error}", float("nan"), 0.0, 0.0, "it must not raise")
        made = Certificate(name, name, "The certificate could not be computed.", [raised])
    return Done(made, time.perf_counter() - began)


def certify_all(names: Sequence[str], seed: int, workers: int, initializer: Callable[[], object] | None) -> list[Done]:
    """Every certificate of `names`, in their order; `initializer` starts each of the `workers` processes."""
    context = multiprocessing.get_context("spawn")
    found: dict[str, Done] = {}
    with ProcessPoolExecutor(min(workers, len(names)), context, initializer=initializer) as pool:
        waiting = {pool.submit(certify, name, seed): name for name in names}
        bar = tqdm(as_completed(waiting), total=len(names), unit="certificate", disable=not sys.stderr.isatty())
        for future in bar:
            name = waiting[future]
            found[name] = future.result()
            bar.set_postfix_str(name)
    return [found[name] for name in names]
