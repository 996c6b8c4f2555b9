"""Runs what is missing of a study's cells: one plan, one pool, one progress bar."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from ..config.cell import Cell
from ..errors import ConfigError, counted
from ..results import files
from ..results.columns import FINAL_STATUSES
from ..results.contents import read_rows
from ..results.provenance import provenance
from ..results.timing_load import better_timing, machine_load, to_be_measured
from .log import log_event, log_on_terminal
from .plan import Chunk, chunks
from .pool import Pool
from .signals import polite_stop
from .slow_starts import announced
from .task import StudyOrder, StudyOutcome, TrialFunctions
from .workers import WorkerDied, Workers
from .writer import ResultsWriter


def run_study(
    cells: Sequence[Cell],
    order: StudyOrder,
    root: Path,
    functions: TrialFunctions,
    workers: Workers,
    command: list[str],
) -> StudyOutcome:
    """Runs the missing trials of all cells and times their control steps.

    Raises OSError where it cannot write, `ConfigError` where a cell cannot be run, and
    `WorkersGone` if no worker is left.
    """
    # What is done, and what is missing.
    done = {
        cell.id: _done_trials(read_rows(root / cell.id, log_event), order.retry_failed)
        for cell in cells
    }
    done_before = {
        cell.id: sum(trial < order.n_trials for trial in done[cell.id]) for cell in cells
    }
    missing: list[Chunk] = []
    for position, cell in enumerate(cells):
        missing += chunks(cell, order.n_trials, done[cell.id], workers.count, order.shard, position)
    ran = dict.fromkeys(done_before, 0)
    pool = Pool(functions.run_trials, workers, log_event, order.seconds)
    writer = ResultsWriter(root, functions, provenance(command))

    def stop() -> None:
        pool.stop()
        log_event("stopping: finishing the trials that run; once more to stop at once")

    with polite_stop(stop) as stop_request, pool:
        with announced("compiling and checking what is to be run"):
            writer.provenance["device"] = _check_all(missing, root, functions, pool, workers)
        _run_chunks(pool, missing, writer, ran, sum(done_before.values()))
        for cell in cells if order.shard.i == 1 else ():
            if stop_request.number is None:
                _make_extras(root, cell, pool, functions)
    return StudyOutcome(ran, done_before, stop_request.number)


def _done_trials(rows: pd.DataFrame, retry_failed: bool) -> set[int]:
    return set(
        rows["trial"][rows["status"].isin(FINAL_STATUSES)] if retry_failed else rows["trial"]
    )


def _run_chunks(
    pool: Pool,
    missing: Sequence[Chunk],
    writer: ResultsWriter,
    ran: dict[str, int],
    done_before: int,
) -> None:
    """Runs all chunks and counts their trials in `ran`; whatever ends this, what has come back is
    written.
    """
    total = sum(len(chunk.trials) for chunk in missing)
    if done_before and total:
        log_on_terminal(f"going on: {counted(done_before, 'trial')} already done, {total} to run")
    try:
        with _progress_bar(done_before + total, done_before) as bar:
            for batch in pool.run(missing, writer.write_when_due):
                writer.add(batch)
                ran[batch.job.id] += len(batch.trials)
                bar.update(len(batch.trials))
    finally:
        writer.write()


def _progress_bar(total: int, initial: int) -> Any:
    return tqdm(
        total=total, initial=initial, unit="trial", disable=None, smoothing=0.1, dynamic_ncols=True
    )


def _check_all(
    missing: Sequence[Chunk], root: Path, functions: TrialFunctions, pool: Pool, workers: Workers
) -> str | None:
    """Checks that all cells can be run and written; returns the device, None if there is nothing to
    run.
    """
    configs = list({chunk.job.id: chunk.job.config for chunk in missing}.values())
    device = None
    if configs and not workers.own_environment:
        device = functions.device(configs[0])
    notes: dict[str, None] = {}
    for config in configs:
        notes |= dict.fromkeys(functions.check(config))
    for note in notes:
        log_event(f"note: {note}")
    if configs and workers.own_environment:
        device = _device_of_workers(configs[0], functions, pool)
    files.probe(root)
    return device


def _device_of_workers(config: dict[str, Any], functions: TrialFunctions, pool: Pool) -> str:
    try:
        return str(pool.call(functions.device, config))
    except WorkerDied as error:
        raise ConfigError(
            f"platform={config['platform']}: {error} when it looked for its device"
        ) from error


def _make_extras(root: Path, cell: Cell, pool: Pool, functions: TrialFunctions) -> None:
    """Makes what is made once for each cell while no worker is busy: the Time column, a recording
    if asked for.

    Times that were measured while the machine was busy are measured again.
    """
    folder = root / cell.id
    stored = files.read_json(folder, "timing")
    if to_be_measured(stored, machine_load()):

        def make_timing() -> dict[str, Any]:
            return better_timing(stored, pool.call(functions.time_steps, cell.config))

        _make(folder, "timing", make_timing)
    trial = cell.config.get("record")
    if trial is not None and files.read_json(folder, f"recording-{trial}") is None:
        _make(folder, f"recording-{trial}", lambda: pool.call(functions.record, cell.config))


def _make(folder: Path, name: str, make: Callable[[], Any]) -> None:
    """Makes a JSON file; logs a failure and leaves the file as it is."""
    try:
        with announced(f"{folder.name}: compiling and computing its {name}"):
            content = make()
    except Exception as error:
        log_event(f"{folder.name}: no {name} ({type(error).__name__}: {error})")
        return
    files.write_json(folder, name, content)
