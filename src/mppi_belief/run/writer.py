"""What is written when: results wait a moment for others, so that a long run leaves few and large files.

The moment is a twentieth of the time that the run has taken, a quarter of a second at first and half a minute at most:
so much work a power cut may cost.
"""

import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from ..results import files
from ..results import table as results
from ..results.trial_ranges import ranges
from .pool import Done
from .task import Task
from .worker import Lost

SHARE, SHORTEST, LONGEST = 0.05, 0.25, 30.0


class Ledger:
    """Collects results and writes them in time; `started` is what its files say of this run."""

    def __init__(self, root: Path, task: Task, started: dict[str, Any]) -> None:
        self._root, self._task, self.started = root, task, started
        self._kept: dict[str, list[Done]] = defaultdict(list)
        self._began = self._written = time.monotonic()

    def keep(self, done: Done) -> None:
        """Take over some results."""
        self._kept[done.cell.id].append(done)

    def write_in_time(self) -> None:
        """Write all that has waited long enough; raises OSError."""
        now = time.monotonic()
        if now - self._written >= min(max(SHARE * (now - self._began), SHORTEST), LONGEST):
            self.write()

    def write(self) -> None:
        """Write all; raises OSError."""
        while self._kept:
            cell, kept = next(iter(self._kept.items()))
            self._write(self._root / cell, kept)
            del self._kept[cell]
        self._written = time.monotonic()

    def _write(self, folder: Path, kept: list[Done]) -> None:
        """The results of one cell; the part file last, since it is what says that trials are done."""
        paths = [
            row for done in kept if not isinstance(done.outcome, Lost) for row in done.outcome.paths
        ]
        if paths:
            results.write_paths(folder, paths)
        for done in kept:
            scene = None if isinstance(done.outcome, Lost) else done.outcome.scene
            if scene is not None and files.read_json(folder, "scene") is None:
                files.write_json(folder, "scene", scene)
        trials: dict[tuple[tuple[str, str], ...], list[int]] = defaultdict(list)
        for done in kept:
            trials[tuple(done.where.items())] += done.trials
        told = {
            "config": kept[0].cell.config,
            **self.started,
            "elapsed": round(time.monotonic() - self._began, 1),
        }
        sources = [
            {"trials": ranges(some), **told, **dict(place)} for place, some in trials.items()
        ]
        results.write_rows(folder, [row for done in kept for row in self._rows(done)], *sources)

    def _rows(self, done: Done) -> list[dict[str, Any]]:
        if not isinstance(done.outcome, Lost):
            return list(done.outcome.rows)
        status, error = done.outcome
        return [
            self._task.failed_row(done.cell.config, trial, status, error) for trial in done.trials
        ]
