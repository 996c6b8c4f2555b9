"""What a worker runs: build a cell's objects, simulate its trials, time its control step."""

import jax

from .build import Experiment, build, check
from .device import device
from .recording import record
from .timing import time_steps
from .trials import KEPT_PATHS, Batch, failed_row, run_trials

__all__ = [
    "KEPT_PATHS",
    "Batch",
    "Experiment",
    "build",
    "check",
    "device",
    "failed_row",
    "record",
    "run_trials",
    "time_steps",
]

# What is computed here takes less time than handing it to another thread and waiting; before JAX's first computation.
jax.config.update("jax_cpu_enable_async_dispatch", False)
