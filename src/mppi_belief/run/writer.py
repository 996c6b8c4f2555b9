"""Buffers results and writes them to parquet in batches, so that a long run leaves few and large
files.

Results wait for a twentieth of the time that the run has taken, a quarter of a second at first and
half a minute at most: a power cut may cost so much work.
"""

import json
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from ..results import files, table
from ..results.trial_ranges import ranges
from .pool import CompletedBatch
from .task import TrialFunctions
from .worker import Failure

WAITING_SHARE = 0.05  # of the time since the run began
SHORTEST_WAIT = 0.25  # s
LONGEST_WAIT = 30.0  # s


class ResultsWriter:
    """Collects completed batches and writes the files of their cells."""

    def __init__(self, root: Path, functions: TrialFunctions, provenance: dict[str, Any]) -> None:
        # What the files say of this run; the runner adds to it before the first write.
        self.provenance = provenance
        self._root = root
        self._functions = functions
        self._waiting: dict[str, list[CompletedBatch]] = defaultdict(list)  # by cell id
        self._start_time = time.monotonic()
        self._write_time = self._start_time

    def add(self, batch: CompletedBatch) -> None:
        """Takes over some results."""
        self._waiting[batch.job.id].append(batch)

    def write_when_due(self) -> None:
        """Writes all results if they have waited long enough; raises OSError."""
        now = time.monotonic()
        wait = WAITING_SHARE * (now - self._start_time)
        if now - self._write_time >= min(max(wait, SHORTEST_WAIT), LONGEST_WAIT):
            self.write()

    def write(self) -> None:
        """Writes all results; raises OSError, and keeps what could not be written."""
        while self._waiting:
            cell_id, batches = next(iter(self._waiting.items()))
            self._write_cell(self._root / cell_id, batches)
            del self._waiting[cell_id]
        self._write_time = time.monotonic()

    def _write_cell(self, folder: Path, batches: list[CompletedBatch]) -> None:
        """Writes the results of one cell; the part file last, since it makes trials done."""
        self._write_paths_and_scene(folder, batches)

        # One source for each machine, with the trials that it computed.
        trials: dict[str, list[int]] = defaultdict(list)
        for batch in batches:
            trials[json.dumps(batch.machine)] += batch.trials
        elapsed = round(time.monotonic() - self._start_time, 1)
        run = {"config": batches[0].job.config, **self.provenance, "elapsed": elapsed}
        sources = [
            {"trials": ranges(computed), **run, **json.loads(machine)}
            for machine, computed in trials.items()
        ]

        rows: list[dict[str, Any]] = []
        for batch in batches:
            rows += self._rows(batch)
        table.write_rows(folder, rows, *sources)

    def _write_paths_and_scene(self, folder: Path, batches: list[CompletedBatch]) -> None:
        results = [batch.outcome for batch in batches if not isinstance(batch.outcome, Failure)]
        steps: list[dict[str, Any]] = []
        for result in results:
            steps += result.paths
        if steps:
            table.write_paths(folder, steps)
        scenes = [result.scene for result in results if result.scene is not None]
        if scenes and files.read_json(folder, "scene") is None:
            files.write_json(folder, "scene", scenes[0])

    def _rows(self, batch: CompletedBatch) -> list[dict[str, Any]]:
        if not isinstance(batch.outcome, Failure):
            return list(batch.outcome.rows)
        return [
            self._functions.failed_row(batch.job.config, trial, *batch.outcome)
            for trial in batch.trials
        ]
