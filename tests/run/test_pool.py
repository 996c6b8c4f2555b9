"""The pool: every chunk comes back with its result or with why it has none, whatever happens to the
workers.
"""

import importlib.util
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mppi_belief.config.cell import Cell
from mppi_belief.errors import ConfigError
from mppi_belief.run.chunk_queue import ChunkQueue
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.plan import Chunk, NamedTask
from mppi_belief.run.pool import Pool
from mppi_belief.run.worker import Failure, TimeLimitExceeded, WorkerSetup
from mppi_belief.run.workers import WorkerDied, WorkersGone
from study_helpers import (
    TESTS,
    AgedWorkers,
    answer,
    config,
    ended,
    leave_marks,
    limited,
    path_and_environment,
    poll,
)

HERE = str(Path(__file__).resolve().parent)


@pytest.fixture(autouse=True)
def in_time() -> Iterator[None]:
    with limited():
        yield


def split(cell: Cell, n_trials: int, size: int) -> list[Chunk]:
    return [
        Chunk(cell, tuple(range(first, min(first + size, n_trials))))
        for first in range(0, n_trials, size)
    ]


def local_pool(work: Any, workers: int, log: Any = print, *paths: str, **how: Any) -> Pool:
    """A pool of so many workers on this machine."""
    return Pool(
        work,
        LocalWorkers(workers, WorkerSetup([TESTS, *paths], how.pop("variables", {}))),
        log,
        **how,
    )


class Ran:
    """What a pool made of some chunks."""

    def __init__(self, chunks: list[Chunk], workers: int = 2, work: Any = answer) -> None:
        self.log: list[str] = []
        pool = local_pool(work, workers, self.log.append)
        self.yielded = list(pool.run(chunks))
        pool.close()
        self.answers = [
            pair for done in self.yielded if isinstance(done.outcome, list) for pair in done.outcome
        ]
        self.lost = [
            (done.trials, done.outcome)
            for done in self.yielded
            if isinstance(done.outcome, Failure)
        ]


def test_all_chunks_run_once():
    chunks = split(Cell(config(seed=1)), 10, 4) + split(Cell(config(seed=2)), 5, 1)
    ran = Ran(chunks)
    assert sorted(ran.answers) == [(1, trial) for trial in range(10)] + [
        (2, trial) for trial in range(5)
    ]
    assert sorted(done.trials for done in ran.yielded) == sorted(
        (trial,) for chunk in chunks for trial in chunk.trials
    )
    assert (ran.lost, ran.log) == ([], [])


def test_more_workers_than_chunks_and_no_chunks_at_all():
    assert Ran(split(Cell(config()), 2, 2), workers=3).answers == [(0, 0), (0, 1)]
    assert Ran([]).yielded == []


def test_a_device_that_is_gone_is_no_trials_fault():
    """It ends the run: a result of any kind would say that its trials are done."""
    pool = local_pool(answer, 2)
    with pytest.raises(ConfigError, match="none is there any more"):
        list(pool.run(split(Cell(config(misses_its_device=5)), 9, 3)))
    pool.close(kill=True)


def test_an_exception_loses_its_batch_and_no_other():
    for batch, lost in ((1, (5,)), (2, (4, 5))):
        ran = Ran(split(Cell(config(batch=batch, raises=5)), 9, 6))
        assert ran.lost == [(lost, Failure("error", "ValueError: trial 5 is cursed"))]
        assert sorted(trial for _, trial in ran.answers) == [
            trial for trial in range(9) if trial not in lost
        ]


@pytest.mark.parametrize(("fate", "workers"), [("exits", 2), ("is_killed", 1)])
def test_a_trial_that_kills_its_worker_is_found_and_all_others_have_results(fate, workers):
    innocent = split(Cell(config(seed=7)), 4, 2)
    ran = Ran(split(Cell(config(**{fate: 5})), 12, 4) + innocent, workers)
    ((trials, lost),) = ran.lost
    assert (trials, lost.status) == ((5,), "crashed")
    others = [(0, trial) for trial in range(12) if trial != 5]
    assert sorted(ran.answers) == others + [(7, trial) for trial in range(4)]
    assert any("trial 5: it killed its worker 2 times" in line for line in ran.log)


def test_a_worker_that_dies_once_costs_no_trial(tmp_path):
    ran = Ran(split(Cell(config(dies_once=3, flag=str(tmp_path / "flag"))), 8, 2))
    assert sorted(trial for _, trial in ran.answers) == list(range(8))
    assert ran.lost == []
    assert "a worker died" in ran.log[0]


class CountingWorkers(LocalWorkers):
    """Workers that note how many trials they are given."""

    def __init__(self, count: int) -> None:
        super().__init__(count, WorkerSetup([TESTS], {}))
        self.sizes: list[int] = []

    def submit(self, function: Any, *args: Any) -> Any:
        self.sizes.append(len(args[2]))
        return super().submit(function, *args)


def test_short_chunks_are_run_together_and_everybody_has_some():
    workers = CountingWorkers(2)
    with Pool(answer, workers, print) as pool:
        batches = list(pool.run(split(Cell(config()), 1000, 1)))
    assert sorted(batch.trials[0] for batch in batches) == list(range(1000))
    sizes = workers.sizes
    assert sizes[0] == 1
    assert 50 < max(sizes) <= 250  # a quarter of what is left, or half a second
    assert sizes[-1] < max(sizes)


def queue_of(cell: Cell, n_trials: int, size: int, pace: float) -> ChunkQueue:
    """Returns the queue of one worker, which takes half a second at a time, with another long chunk
    behind.
    """
    queue = ChunkQueue(grain=0.5, workers=1)
    for chunk in split(cell, n_trials, size):
        queue.add(chunk)
    queue.add(Chunk(cell, tuple(range(n_trials, 10 * n_trials))))
    queue.set_pace(cell.id, pace)
    return queue


def test_chunks_are_run_together_up_to_the_time_that_they_should_take():
    cell = Cell(config())
    queue = queue_of(cell, 10, 2, pace=0.2)
    assert [queue.next().trials for _ in range(5)] == [(0, 1), (2, 3), (4, 5), (6, 7), (8, 9)]
    queue = queue_of(cell, 10, 2, pace=0.1)
    assert [queue.next().trials for _ in range(3)] == [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9)]


def test_the_shortest_pace_counts_since_the_first_trial_compiles():
    cell = Cell(config())
    queue = queue_of(cell, 10, 2, pace=0.1)
    queue.set_pace(cell.id, 30.0)
    assert queue.next().trials == (0, 1, 2, 3)


def test_what_must_run_again_comes_first():
    cell = Cell(config())
    queue = ChunkQueue(grain=0.5, workers=1)
    queue.add(Chunk(cell, (9,)))
    queue.repeat(Chunk(cell, (3,)))
    queue.repeat_next(Chunk(cell, (1,)), Chunk(cell, (2,)))
    assert len(queue) == 4
    assert [queue.next().trials for _ in range(4)] == [(1,), (2,), (3,), (9,)]
    assert not queue


def named_answer(config: dict[str, Any], trials: Any) -> str:
    """Returns the name of a task, after whatever misfortune it asks for."""
    answer({"seed": 0, "system": config}, trials)
    return str(config["name"])


def test_named_tasks_run_as_chunks_do():
    wishes = {"fine": {}, "cursed": {"raises": 0}, "fatal": {"exits": 0}}
    tasks = [NamedTask(name, {"name": name, **wish}) for name, wish in wishes.items()]
    log: list[str] = []
    with local_pool(named_answer, 2, log.append, HERE) as pool:
        batches = list(pool.run([Chunk(task, (0,)) for task in tasks]))
    assert {batch.job.id: batch.outcome for batch in batches} == {
        "fine": "fine",
        "cursed": Failure("error", "ValueError: trial 0 is cursed"),
        "fatal": Failure("crashed", "the worker process died 2 times in this task"),
    }
    assert log == [
        "fatal: its worker died; running it again",
        "fatal: it killed its worker 2 times; given up",
    ]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_trial_that_hangs_is_given_up_and_its_worker_ended(workers, tmp_path):
    log: list[str] = []
    pool = local_pool(answer, workers, log.append, seconds=2.0)
    done = {done.trials[0]: done.outcome for done in pool.run(split(Cell(config(hangs=5)), 12, 4))}
    pool.close()
    assert done.pop(5) == Failure("timeout", "not done after 2 s")
    assert done == {trial: [(0, trial)] for trial in range(12) if trial != 5}
    assert [line for line in log if "trial 5: not done after 2 s; given up" in line] == log


def test_a_worker_that_cannot_even_look_at_the_clock_is_ended(tmp_path):
    log: list[str] = []
    stopped = tmp_path / "stopped"
    pool = Pool(answer, AgedWorkers(stopped), log.append, seconds=60.0)
    cell = Cell(config(stops=1, stopped=str(stopped)))
    done = {done.trials[0]: done.outcome for done in pool.run(split(cell, 3, 2))}
    pool.close()
    assert done.pop(1) == Failure("timeout", "not done after 60 s")
    assert done == {trial: [(0, trial)] for trial in (0, 2)}
    assert ["ended a worker that hangs" in log[0], "it hangs; given up" in log[1], len(log)] == [
        True,
        True,
        2,
    ]


def test_a_call_that_hangs_is_given_up(tmp_path):
    pool = local_pool(answer, 1, seconds=2.0)
    with pytest.raises(TimeLimitExceeded):
        pool.call(answer, config(hangs=1), [1])
    assert pool.call(answer, config(), [1]) == [(0, 1)]
    pool.close()


def test_workers_that_die_while_they_start_end_the_run():
    """Else every trial would be written down as crashed, one after the other."""
    pool = local_pool(answer, 1, variables={"": "an environment no process can have"})
    with pytest.raises(WorkersGone, match="3 worker processes in a row died while they started"):
        list(pool.run(split(Cell(config()), 9, 3)))
    pool.close(kill=True)


def test_a_worker_killed_while_it_starts_or_has_nothing_to_do_costs_nothing():
    workers = LocalWorkers(1, WorkerSetup([TESTS], {}))
    pool = Pool(answer, workers, print)
    for wait_for_it in (False, True):
        future = workers.submit(answer, config(), [1])
        if wait_for_it:
            assert workers.collect(future) == [(0, 1)]
        os.kill(workers.process_ids[0], signal.SIGKILL)
        poll(lambda: workers.process_ids == [])
        if not wait_for_it:
            with pytest.raises(WorkerDied):
                workers.collect(future)
    assert [done.outcome for done in pool.run(split(Cell(config()), 2, 1))] == [[(0, 0)], [(0, 1)]]
    pool.close()


def test_stop_finishes_what_runs_and_starts_no_more(tmp_path):
    pool = local_pool(leave_marks, 2)
    trials = []
    for done in pool.run(split(Cell(config(folder=str(tmp_path))), 30, 1)):
        trials += done.outcome
        pool.stop()
    pool.close()
    started = {int(path.name.partition("-")[2]) for path in tmp_path.glob("started-*")}
    finished = {int(path.name.partition("-")[2]) for path in tmp_path.glob("finished-*")}
    assert started == finished == set(trials)
    assert 1 <= len(trials) < 30


def test_a_stopped_pool_runs_nothing(tmp_path):
    pool = local_pool(leave_marks, 2)
    pool.stop()
    assert list(pool.run(split(Cell(config(folder=str(tmp_path))), 3, 1))) == []
    pool.close()
    assert list(tmp_path.iterdir()) == []


def test_call_returns_a_result_or_says_that_its_worker_died():
    pool = local_pool(answer, 1)
    assert pool.call(answer, config(seed=4), [1]) == [(4, 1)]
    with pytest.raises(WorkerDied):
        pool.call(answer, config(exits=1), [1])
    assert pool.call(answer, config(seed=5), [1]) == [(5, 1)]
    with pytest.raises(ValueError, match="trial 1 is cursed"):
        pool.call(answer, config(raises=1), [1])
    pool.close()


def test_workers_are_given_import_paths_and_end_with_the_pool(tmp_path, monkeypatch):
    (tmp_path / "users_module.py").write_text(
        "def double(config, trials): return [2 * trial for trial in trials]\n"
    )
    spec = importlib.util.spec_from_file_location("users_module", tmp_path / "users_module.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(sys.modules, "users_module", module)
    pool = local_pool(module.double, 1, print, str(tmp_path))
    assert [done.outcome for done in pool.run(split(Cell(config()), 2, 2))] == [[0], [2]]
    path, environment, pid = pool.call(path_and_environment, config(), [0])
    assert path[:2] == [TESTS, str(tmp_path)]
    assert pid != os.getpid()
    assert environment.keys() >= os.environ.keys()
    pool.close()
    poll(ended([pid]), 10)


def test_variables_are_the_workers_alone(monkeypatch):
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    pool = local_pool(answer, 1, variables={"JAX_PLATFORMS": "cuda"})
    _, environment, _ = pool.call(path_and_environment, config(), [0])
    assert (environment["JAX_PLATFORMS"], os.environ["JAX_PLATFORMS"]) == ("cuda", "cpu")
    pool.close()


def test_workers_die_with_a_parent_that_is_killed(tmp_path):
    script = (
        f"import sys; sys.path.insert(0, {TESTS!r}); "
        f"from study_helpers import *; hanging_pool({str(tmp_path)!r})"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", script], cwd=Path.cwd(), stderr=subprocess.DEVNULL
    )
    try:
        poll(lambda: len(list(tmp_path.glob("worker-*"))) == 2)
        workers = [int(path.name.partition("-")[2]) for path in tmp_path.glob("worker-*")]
        assert not ended(workers)()
        parent.send_signal(signal.SIGKILL)
        parent.wait(10)
        poll(ended(workers), 10)
    finally:
        parent.kill()
        parent.wait(10)
