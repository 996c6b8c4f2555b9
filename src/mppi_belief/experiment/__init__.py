"""What a worker runs: build a cell's objects, simulate its trials, time its control step."""

from .build import GROUPS, Experiment, build, check
from .timing import time_steps
from .trials import KEPT_PATHS, Batch, failed_row, run_trials

__all__ = [
    "GROUPS",
    "KEPT_PATHS",
    "Batch",
    "Experiment",
    "build",
    "check",
    "failed_row",
    "run_trials",
    "time_steps",
]
