"""One plan, one pool, one progress bar: run what is missing of a study's cells."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm import tqdm

from ..config.cell import Cell
from ..errors import ConfigError
from ..results import files
from ..results.columns import FINAL_STATUSES
from ..results.contents import read_rows
from ..results.provenance import provenance
from .local import WorkerDied
from .log import note, say
from .plan import Chunk, chunks
from .pool import Pool, Workers
from .signals import StoppedAtOnce, polite_stop
from .task import Order, Outcome, Task
from .writer import Ledger


def run_study(
    cells: Sequence[Cell],
    order: Order,
    root: Path,
    task: Task,
    workers: Workers,
    command: list[str],
) -> Outcome:
    """Run the missing trials of all cells and time their control steps.

    Raises OSError where it cannot write, `ConfigError` where a cell cannot be run, `WorkersGone` if nobody can run it.
    """
    done = {cell.id: _done(read_rows(root / cell.id, say), order.retry_failed) for cell in cells}
    found = {cell.id: sum(trial < order.n_trials for trial in done[cell.id]) for cell in cells}
    todo = [
        chunk
        for place, cell in enumerate(cells)
        for chunk in chunks(cell, order.n_trials, done[cell.id], workers.count, order.shard, place)
    ]
    ran = dict.fromkeys(found, 0)
    pool = Pool(task.run_trials, workers, say, order.seconds)
    ledger = Ledger(root, task, provenance(command))

    def stop() -> None:
        pool.stop()
        say("stopping: finishing the trials that run; once more to stop at once")

    with polite_stop(stop) as signal:
        try:
            ledger.started["device"] = _check(todo, root, task, pool, workers)
            _run(pool, todo, ledger, ran, sum(found.values()))
            for cell in cells if order.shard.i == 1 else ():
                if signal.number is None:
                    _extras(root, cell, pool, task)
            pool.close()
        except BaseException as error:
            pool.close(kill=True)
            if not isinstance(error, StoppedAtOnce):
                raise
    return Outcome(ran, found, signal.number)


def _done(rows: pd.DataFrame, retry_failed: bool) -> set[int]:
    return set(
        rows["trial"][rows["status"].isin(FINAL_STATUSES)] if retry_failed else rows["trial"]
    )


def _run(
    pool: Pool, todo: Sequence[Chunk], ledger: Ledger, ran: dict[str, int], found: int
) -> None:
    """Run all chunks; whatever ends this, what has come back is written."""
    total = sum(len(chunk.trials) for chunk in todo)
    if found and total:
        note(f"going on: {found} trials found done, {total} to run")
    try:
        with _progress(found + total, found) as bar:
            for done in pool.run(todo, ledger.write_in_time):
                ledger.keep(done)
                ran[done.cell.id] += len(done.trials)
                bar.update(len(done.trials))
    finally:
        ledger.write()


def _check(
    todo: Sequence[Chunk], root: Path, task: Task, pool: Pool, workers: Workers
) -> str | None:
    """The device on which all is to run, once it is clear that all can be; None if there is nothing to run."""
    cells = list({chunk.cell.id: chunk.cell for chunk in todo}.values())
    device = None if workers.elsewhere or not cells else task.device(cells[0].config)
    for cell in cells:
        task.check(cell.config)
    if workers.elsewhere and cells:
        device = _device_of_workers(cells[0].config, task, pool)
    files.probe(root)
    return device


def _device_of_workers(config: dict[str, Any], task: Task, pool: Pool) -> str:
    try:
        return str(pool.call(task.device, config))
    except WorkerDied as error:
        raise ConfigError(
            f"platform={config['platform']}: {error} when it looked for its device"
        ) from error


def _progress(total: int, initial: int) -> Any:
    return tqdm(
        total=total, initial=initial, unit="trial", disable=None, smoothing=0.1, dynamic_ncols=True
    )


def _extras(root: Path, cell: Cell, pool: Pool, task: Task) -> None:
    """What is made once for each cell, while no worker is busy: the Time column, a recording if it asks for one."""
    _once(root / cell.id, "timing", lambda: {"seconds": pool.call(task.time_steps, cell.config)})
    if cell.config.get("record") is not None:
        _once(
            root / cell.id,
            f"recording-{cell.config['record']}",
            lambda: pool.call(task.record, cell.config),
        )


def _once(folder: Path, name: str, make: Callable[[], Any]) -> None:
    """Make a file that is not there; where that fails, it is said and the file is left out."""
    if files.read_json(folder, name) is not None:
        return
    try:
        content = make()
    except StoppedAtOnce:
        raise
    except Exception as error:
        say(f"{folder.name}: no {name} ({type(error).__name__}: {error})")
        return
    files.write_json(folder, name, content)
