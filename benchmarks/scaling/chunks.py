"""Measures what it costs to hand chunks of trials to workers: empty chunks, executors in turns.

A worker returns the rows of ten trials at once. Wall time is that of two workers on this machine.
Processor time is that of this process, which holds the engine and Dask's scheduler; it bounds how
many chunks per second can be handed out, however many workers there are.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import rounds
from mppi_belief.config import environment
from mppi_belief.config.cell import IDENTITY, Cell
from mppi_belief.run.plan import Chunk
from mppi_belief.run.pool import Pool
from mppi_belief.run.start_workers import make_workers
from mppi_belief.run.worker import WorkerSetup
from mppi_belief.run.workers import Workers

from .sizes import Sizes

WORKERS = 2
TRIALS = 10
KINDS = {"local": {"kind": "local"}, "dask": {"kind": "dask", "address": None, "patience": 60.0}}


def row(trial: int) -> dict[str, Any]:
    """Returns a row as wide as a real one."""
    numbers = dict.fromkeys(
        ("theta", "w_obs", "cost", "running_cost", "terminal_cost", "clearance", "ess"), 0.1 * trial
    )
    return {
        "trial": trial,
        "seed": 0,
        "status": "ok",
        "controller": "belief",
        "collided": False,
        **numbers,
        "steps": 60,
    }


def empty_trials(config: dict[str, Any], trials: Sequence[int]) -> list[dict[str, Any]]:
    """Returns the rows of trials that take no time."""
    return [row(trial) for trial in trials]


def measure(sizes: Sizes, folder: Path) -> dict[str, Any]:
    """Returns milliseconds of wall and processor time per chunk, by executor.

    They are medians of interleaved rounds.
    """
    environment.prepare()
    setup = WorkerSetup([str(Path(__file__).resolve().parents[1])], {})
    workers_by_kind = {
        kind: make_workers(node, WORKERS, setup, environment.in_force())
        for kind, node in KINDS.items()
    }
    try:
        for workers in workers_by_kind.values():
            timed(workers, WORKERS)  # starts them
        times_by_kind: dict[str, list[tuple[float, float]]] = {kind: [] for kind in workers_by_kind}
        for round_number in range(sizes.chunk_rounds):
            rounds.say(f"chunks: round {round_number + 1} of {sizes.chunk_rounds}")
            for kind, workers in workers_by_kind.items():
                times_by_kind[kind].append(timed(workers, sizes.chunks))
    finally:
        for workers in workers_by_kind.values():
            workers.close()
    medians = {
        kind: [statistics.median(column) for column in zip(*times, strict=True)]
        for kind, times in times_by_kind.items()
    }
    return {kind: {"wall_ms": wall, "cpu_ms": cpu} for kind, (wall, cpu) in medians.items()} | {
        "chunks": sizes.chunks
    }


def timed(
    workers: Workers, count: int, clock: Callable[[], float] = time.perf_counter
) -> tuple[float, float]:
    """Returns wall and processor time per chunk, in ms, of `count` chunks.

    Each chunk has a cell of its own, since the pool would join chunks of one cell.
    """
    config: dict[str, Any] = {key: {} for key in IDENTITY}
    config |= {"names": {"controller": "none"}, "precision": "float32", "platform": "cpu"}
    cells = [Cell(config | {"seed": seed, "batch": 1}) for seed in range(count)]
    wall = clock()
    cpu = time.process_time()
    trials = tuple(range(TRIALS))
    returned_trials = sum(
        1
        for _ in Pool(empty_trials, workers, rounds.say).run(
            [Chunk(cell, trials) for cell in cells]
        )
    )
    if returned_trials != count * TRIALS:
        raise RuntimeError(f"{returned_trials} of {count * TRIALS} trials came back")
    return 1e3 * (clock() - wall) / count, 1e3 * (time.process_time() - cpu) / count


def markdown(numbers: dict[str, Any]) -> str:
    """Returns the table."""
    lines = [
        f"**Handing out a chunk**: medians over rounds of {numbers['chunks']} empty chunks of "
        f"{TRIALS} trials each, {WORKERS} workers on this machine.",
        "",
        "| | wall time ms | processor time of the engine ms | chunks a second at most |",
        "|---|---|---|---|",
    ]
    for kind in KINDS:
        wall = numbers[kind]["wall_ms"]
        cpu = numbers[kind]["cpu_ms"]
        lines.append(f"| `executor={kind}` | {wall:.1f} | {cpu:.1f} | {1e3 / cpu:.0f} |")
    return "\n".join(lines)
