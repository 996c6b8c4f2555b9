"""Says whether the Time column of a cell was measured while other work kept the machine busy.

The file timing.json of a cell holds

    seconds    wall times (s) of single control steps
    cpu_share  CPU time of the measuring process over these wall times; null on a GPU
    load       load average of the last minute per core, at the end of the measurement

A step that waits for a core takes wall time without CPU time. A load above one per core means that
others computed: the workers of the measuring command alone bring it to one.
"""

import os
from typing import Any

LEAST_CPU_SHARE = 0.9  # a choice
HIGHEST_LOAD = 1.25  # per core; a choice


def machine_load() -> float:
    """Returns the load average of the last minute per core; 0 where the system has none."""
    try:
        return os.getloadavg()[0] / (os.cpu_count() or 1)
    except OSError:
        return 0.0


def measured_busy(timing: dict[str, Any]) -> bool:
    """Returns whether times were measured on a busy machine; False where the load is not known."""
    share = timing.get("cpu_share")
    load = timing.get("load")
    waited = isinstance(share, float) and share < LEAST_CPU_SHARE
    return waited or (isinstance(load, float) and load > HIGHEST_LOAD)


def to_be_measured(timing: dict[str, Any] | None, load: float) -> bool:
    """Returns whether to time a cell while the load per core is `load`.

    A cell without times is timed in any case. Times of a busy machine, or of an unknown load, are
    measured again once the machine is calm.
    """
    if timing is None:
        return True
    return load <= HIGHEST_LOAD and ("load" not in timing or measured_busy(timing))


def better_timing(stored: dict[str, Any] | None, new: dict[str, Any]) -> dict[str, Any]:
    """Returns the times of the calmer machine, the new ones in doubt."""
    if stored is None or "load" not in stored or not measured_busy(new):
        return new
    return new if _waiting(new) <= _waiting(stored) else stored


def _waiting(timing: dict[str, Any]) -> tuple[float, float]:
    """Returns the part of the wall time without CPU time, and the load."""
    return 1.0 - (timing.get("cpu_share") or 1.0), timing.get("load") or 0.0
