"""Workers of a Dask scheduler: what the pool is told of them, and one run on real ones."""

import logging
import pickle
import re
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from types import SimpleNamespace
from typing import Any

import distributed
import pytest

from mppi_belief.config.cell import Cell
from mppi_belief.errors import ConfigError
from mppi_belief.results import table as results
from mppi_belief.results.contents import read_rows
from mppi_belief.run import dask as cluster
from mppi_belief.run import dask_worker
from mppi_belief.run.dask import DaskWorkers, SchedulerConnection
from mppi_belief.run.dask_worker import run_in_worker
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.plan import Chunk
from mppi_belief.run.pool import Pool
from mppi_belief.run.runner import run_study
from mppi_belief.run.signals import StoppedAtOnce
from mppi_belief.run.start_workers import make_workers
from mppi_belief.run.task import StudyOrder, TrialFunctions
from mppi_belief.run.worker import TimeLimitExceeded, WorkerSetup
from mppi_belief.run.workers import WorkerDied, WorkersGone
from study_helpers import TESTS, config, device, failed_row, limited, record, run_trials, time_steps

NOTHING = WorkerSetup([], {})


@pytest.fixture(autouse=True)
def in_time() -> Iterator[None]:
    levels = {name: logging.getLogger(name).level for name in logging.root.manager.loggerDict}
    with limited():
        yield
    for name, level in levels.items():
        logging.getLogger(name).setLevel(level)


class Handed:
    """A task that a fake scheduler was given; it ends as it is told."""

    def __init__(self, key: str) -> None:
        self.key = key
        self.ended: list[Any] = []
        self.outcome: Any = None
        self.cancelled = False

    def add_done_callback(self, callback: Any) -> None:
        self.ended.append(callback)
        if self.outcome is not None:
            callback(self)

    def end(self, outcome: Any) -> None:
        self.outcome = outcome
        for callback in self.ended:
            callback(self)

    def result(self) -> Any:
        if isinstance(self.outcome, BaseException):
            raise self.outcome
        return self.outcome

    def cancel(self) -> None:
        self.cancelled = True


class Client:
    """A fake connection to a scheduler with some workers."""

    def __init__(self, workers: int = 2, outcomes: Sequence[Any] = ()) -> None:
        self.outcomes = [*outcomes]
        self.names = [f"worker-{number}" for number in range(workers)]
        self.tasks: list[Handed] = []
        self.begun: list[str] = []
        self.looks = 0
        self.ran: list[Any] = []
        self.gone = False

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:
        self.looks += 1
        if self.gone:
            raise OSError("Timed out trying to connect")
        return {"workers": {f"tcp://{name}": {"name": name} for name in self.names}}

    def submit(self, function: Any, *args: Any, **how: Any) -> Handed:
        self.tasks.append(Handed(f"task-{len(self.tasks)}"))
        self.tasks[-1].outcome = self.outcomes.pop(0) if self.outcomes else None
        return self.tasks[-1]

    def processing(self) -> dict[str, tuple[str, ...]]:
        return {"tcp://worker-0": tuple(self.begun)}

    def run(self, *args: Any, **how: Any) -> None:
        self.ran.append((*args, how))

    def close(self, timeout: float) -> None:
        raise TimeoutError("the loop is gone")


def connected(client: Client, count: int = 2, **more: Any) -> DaskWorkers:
    return DaskWorkers(
        lambda: SchedulerConnection(client, more.pop("end", lambda: None), **more), count, NOTHING
    )


def test_there_is_room_for_one_chunk_a_worker_that_is_there(monkeypatch):
    monkeypatch.setattr(cluster, "POLL_INTERVAL", 1e9)
    client = Client(workers=3)
    workers = connected(client, count=5)
    assert workers.room() == 3
    workers.submit(print)
    workers.submit(print)
    assert workers.room() == 1
    assert client.looks == 1


def test_a_death_makes_it_look_again(monkeypatch):
    monkeypatch.setattr(cluster, "POLL_INTERVAL", 1e9)
    client = Client()
    names_seen: list[list[str]] = []
    workers = connected(client, replace_missing=names_seen.append)
    assert workers.room() == 2
    future = workers.submit(print)
    client.names.pop()
    client.tasks[0].end(distributed.KilledWorker("task-0", None, 0))
    assert future.done()
    with pytest.raises(WorkerDied):
        workers.collect(future)
    assert workers.room() == 1
    assert names_seen == [["worker-0", "worker-1"], ["worker-0"]]


def test_waiting_is_said_once(monkeypatch):
    lines_logged: list[str] = []
    monkeypatch.setattr(cluster, "log_on_terminal", lines_logged.append)
    monkeypatch.setattr(cluster, "POLL_INTERVAL", 0.0)
    workers = connected(Client(workers=0), count=7)
    assert [workers.room() for _ in range(3)] == [0, 0, 0]
    assert lines_logged == ["waiting for 7 workers"]


@pytest.mark.parametrize(
    ("outcome", "raised", "line"),
    [
        (CancelledError("scheduler-connection-lost"), WorkersGone, "scheduler is gone"),
        (OSError("Timed out"), WorkersGone, "scheduler is gone"),
        (
            ModuleNotFoundError("No module named 'mppi_belief'"),
            ConfigError,
            "No module named 'mppi_belief'",
        ),
        (("tcp://w", None, ConfigError("two threads")), ConfigError, "two threads"),
        (("tcp://w", None, TimeLimitExceeded("not done")), TimeLimitExceeded, "not done"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_went_wrong_is_told_apart(outcome, raised, line):
    client = Client()
    workers = connected(client)
    future = workers.submit(print)
    client.tasks[0].end(outcome)
    with pytest.raises(raised, match=line):
        workers.collect(future)


def test_a_scheduler_that_is_gone_ends_the_run():
    client = Client()
    client.gone = True
    with pytest.raises(WorkersGone, match="scheduler is gone"):
        connected(client).room()


def test_the_worker_of_a_trial_that_hangs_is_ended():
    client = Client()
    workers = connected(client)
    future = workers.submit(print)
    client.tasks[0].end(("tcp://worker-1", None, TimeLimitExceeded("not done")))
    with pytest.raises(TimeLimitExceeded):
        workers.collect(future)
    workers.discard(future)
    assert client.ran == [
        (
            dask_worker.exit_worker,
            {"workers": ["tcp://worker-1"], "wait": False, "on_error": "ignore"},
        )
    ]


def test_only_what_has_not_begun_is_taken_back():
    client = Client()
    workers = connected(client)
    futures = [workers.submit(print) for _ in range(3)]
    client.begun = ["task-0"]
    client.tasks[2].end(("tcp://worker-1", None, None))
    assert workers.withdraw(futures) == [futures[1]]
    assert [task.cancelled for task in client.tasks] == [False, True, False]


def test_only_the_pool_says_what_happens():
    logging.getLogger("distributed.client").setLevel(logging.WARNING)  # as it is after the import
    connected(Client()).room()
    for name in ("distributed.client", "distributed.utils", "tornado.application", "asyncio"):
        assert not logging.getLogger(name).isEnabledFor(logging.ERROR), name


def test_what_is_called_once_is_called_again_where_its_worker_died():
    died = distributed.KilledWorker("task-0", None, 0)
    answer = ("tcp://worker-1", 5, None)
    assert Pool(print, connected(Client(outcomes=[died, answer])), print).call(int) == 5
    with pytest.raises(WorkerDied):
        Pool(print, connected(Client(outcomes=[died, died, answer])), print).call(int)


def test_a_stop_ends_the_waiting_for_workers():
    pool = Pool(print, connected(Client(workers=0)), print)
    pool.stop()
    with pytest.raises(StoppedAtOnce):
        pool.call(int)


def test_a_worker_that_refuses_is_no_trials_fault():
    refusal = ("tcp://worker-1", None, ConfigError("it has two threads"))
    pool = Pool(print, connected(Client(outcomes=[refusal])), print)
    with pytest.raises(ConfigError, match="two threads"):
        list(pool.run([Chunk(Cell(config()), (0, 1))]))


def test_closing_never_fails():
    ended: list[str] = []

    def end() -> None:
        ended.append("once")
        raise AssertionError("status is created")

    workers = connected(Client(), end=end)
    workers.room()
    workers.close()
    workers.close(kill=True)
    assert ended == ["once"]


class Unpicklable(Exception):
    """It cannot be made again from its one argument."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first} {second}")


def unpicklable() -> None:
    raise Unpicklable("two", "words")


def there(
    monkeypatch,
    function: Any = int,
    setup: WorkerSetup = NOTHING,
    threads: int = 1,
    **versions: str,
) -> Any:
    """Returns what a worker answers that was just started."""
    worker = SimpleNamespace(address="tcp://w:1", state=SimpleNamespace(nthreads=threads))
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    monkeypatch.setattr(dask_worker, "applied_setups", [])
    python = sys.version_info[0], int(versions.pop("minor", sys.version_info[1]))
    given = pickle.dumps(
        (
            setup,
            {name: dask_worker.version(name) for name in dask_worker.SAME_VERSIONS} | versions,
            python,
        )
    )
    return run_in_worker(given, pickle.dumps((function, ())))


def test_a_worker_answers_with_its_address(monkeypatch):
    assert there(monkeypatch) == ("tcp://w:1", 0, None)


@pytest.mark.parametrize(
    ("how", "line"),
    [
        ({"jax": "0.1"}, r"the worker tcp://w:1 has jax \d.*, here it is 0.1"),
        ({"minor": "2"}, r"runs Python 3\.\d+"),
        ({"threads": 2}, "2 threads: start it with --nthreads 1"),
        ({"setup": WorkerSetup(["/not/here"], {})}, "--config-dir: .* does not see /not/here"),
    ],
)
def test_a_worker_that_would_give_other_results_refuses(how, line, monkeypatch):
    _, _, error = there(monkeypatch, **how)
    assert isinstance(error, ConfigError)
    assert re.search(line, str(error))


def test_an_exception_that_cannot_be_sent_is_told_in_words(monkeypatch):
    _, _, error = there(monkeypatch, unpicklable)
    assert (type(error), str(error)) == (RuntimeError, "Unpicklable: two words")


def test_real_workers_one_of_which_is_killed_give_the_same_results(tmp_path):
    task = TrialFunctions(lambda config: (), run_trials, time_steps, failed_row, record, device)
    hashes = {}
    flag = tmp_path / "flag"
    for kind in ("local", "dask"):
        flag.touch() if kind == "local" else flag.unlink()  # nobody dies here
        cell = Cell(config(dies_once=13, flag=str(flag)))
        workers = make_workers({"kind": kind}, 2, WorkerSetup([TESTS], {}), {})
        assert isinstance(workers, LocalWorkers if kind == "local" else DaskWorkers)
        outcome = run_study(
            [cell], StudyOrder(40, seconds=60.0), tmp_path / kind, task, workers, ["test"]
        )
        assert outcome.ran == {cell.id: 40}
        hashes[kind] = results.result_hash(read_rows(tmp_path / kind / cell.id))
    assert flag.exists()
    assert hashes["dask"] == hashes["local"]
    assert {*read_rows(tmp_path / "dask" / cell.id)["status"]} == {"ok"}
