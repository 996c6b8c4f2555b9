"""One plan, one pool, one progress bar: run what is missing of a study's cells."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from ..settings import ConfigError
from . import files, results
from .plan import Cell, Chunk, chunks
from .pool import Lost, Pool, WorkerDied
from .provenance import provenance
from .signals import StoppedAtOnce, polite_stop


class Task(NamedTuple):
    """What a study runs, as functions a worker can import.

    check(config) raises where a configuration cannot be run; run_trials(config, trials) returns an
    object with `rows`, `paths` and `scene`; time_steps(config) returns seconds of single control steps;
    failed_row(config, trial, status, error) is the row of a trial without result; record(config) returns
    one trial in detail as JSON, where a cell asks for it; device(config) names what computes it, and raises where
    that is not there.
    """

    check: Callable[..., None]
    run_trials: Callable[..., Any]
    time_steps: Callable[..., list[float]]
    failed_row: Callable[..., dict[str, Any]]
    record: Callable[..., dict[str, Any]]
    device: Callable[..., str]


class Outcome(NamedTuple):
    """How a study ended: trials run now and found done, by cell id, and the signal that stopped it, if any."""

    ran: dict[str, int]
    found: dict[str, int]
    stopped: int | None


def run_study(
    cells: Sequence[Cell],
    n_trials: int,
    root: Path,
    workers: int,
    task: Task,
    command: list[str],
    import_paths: Sequence[str] = (),
    variables: dict[str, str] | None = None,
) -> Outcome:
    """Run the missing trials of all cells and time their control steps; raises OSError where it cannot write.

    `import_paths` and `variables` are what the workers' module search path and environment have besides.
    """
    done = {cell.id: set(results.read_rows(root / cell.id, tqdm.write)["trial"]) for cell in cells}
    found = {cell.id: sum(trial < n_trials for trial in done[cell.id]) for cell in cells}
    todo = [chunk for cell in cells for chunk in chunks(cell, n_trials, done[cell.id], workers)]
    ran = dict.fromkeys(found, 0)
    pool = Pool(task.run_trials, workers, list(import_paths), tqdm.write, variables)
    started = provenance(command)

    def stop() -> None:
        pool.stop()
        tqdm.write("stopping: finishing the trials that run; once more to stop at once")

    with polite_stop(stop) as signal:
        try:
            started["device"] = _check(todo, root, task, pool if variables else None)
            with _progress(n_trials * len(cells), sum(found.values())) as bar:
                for chunk, batch in pool.run(todo):
                    _keep(root, chunk, batch, task, started)
                    ran[chunk.cell.id] += len(chunk.trials)
                    bar.update(len(chunk.trials))
            for cell in cells:
                if signal.number is None:
                    _extras(root, cell, pool, task)
            pool.close()
        except BaseException as error:
            pool.close(kill=True)
            if not isinstance(error, StoppedAtOnce):
                raise
    return Outcome(ran, found, signal.number)


def _check(todo: Sequence[Chunk], root: Path, task: Task, pool: Pool | None) -> str | None:
    """The device on which all is to run, of the pool's workers or of this process too, once all else is checked."""
    cells = list({chunk.cell.id: chunk.cell for chunk in todo}.values())
    device = _device(cells[0].config, task, pool) if cells else None
    for cell in cells:
        task.check(cell.config)
    files.probe(root)
    return device


def _device(config: dict[str, Any], task: Task, pool: Pool | None) -> str:
    try:
        return str(pool.call(task.device, config) if pool else task.device(config))
    except WorkerDied as error:
        raise ConfigError(f"platform={config['platform']}: {error} when it looked for its device") from error


def _progress(total: int, initial: int) -> Any:
    return tqdm(total=total, initial=initial, unit="trial", disable=None, smoothing=0.1, dynamic_ncols=True)


def _keep(root: Path, chunk: Chunk, batch: Any, task: Task, started: dict[str, Any]) -> None:
    """Write a chunk's results; the part file last, since it is what says that the trials are done."""
    folder, config = root / chunk.cell.id, chunk.cell.config
    if isinstance(batch, Lost):
        rows = [task.failed_row(config, trial, batch.status, batch.error) for trial in chunk.trials]
    else:
        rows = batch.rows
        if batch.paths:
            results.write_paths(folder, batch.paths)
        if batch.scene is not None:
            files.write_json(folder, "scene", batch.scene)
    elapsed = (datetime.now(UTC) - datetime.fromisoformat(started["started"])).total_seconds()
    results.write_rows(folder, rows, {"config": config, **started, "elapsed": round(elapsed, 1)})


def _extras(root: Path, cell: Cell, pool: Pool, task: Task) -> None:
    """What is made once for each cell, while no worker is busy: the Time column, a recording if it asks for one."""
    _once(root / cell.id, "timing", lambda: {"seconds": pool.call(task.time_steps, cell.config)})
    if cell.config.get("record") is not None:
        _once(root / cell.id, f"recording-{cell.config['record']}", lambda: pool.call(task.record, cell.config))


def _once(folder: Path, name: str, make: Callable[[], Any]) -> None:
    """Make a file that is not there; where that fails, it is said and the file is left out."""
    if files.read_json(folder, name) is not None:
        return
    try:
        content = make()
    except StoppedAtOnce:
        raise
    except Exception as error:
        tqdm.write(f"{folder.name}: no {name} ({type(error).__name__}: {error})")
        return
    files.write_json(folder, name, content)
