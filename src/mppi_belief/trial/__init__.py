"""Does the work of a worker: builds a cell's objects, simulates its trials, times its steps."""

from .build import CellParts, build, check
from .device import device
from .recording import record
from .timing import time_steps, time_steps_and_load
from .trials import KEPT_PATHS, Batch, failed_row, run_trials

__all__ = [
    "KEPT_PATHS",
    "Batch",
    "CellParts",
    "build",
    "check",
    "device",
    "failed_row",
    "record",
    "run_trials",
    "time_steps",
    "time_steps_and_load",
]
