"""Fake work for the pool and the runner. A worker imports this module, so it must not need JAX."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from mppi_belief.config.cell import Cell
from mppi_belief.errors import ConfigError
from mppi_belief.results.columns import Consistency, Metrics
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.plan import Chunk
from mppi_belief.run.pool import Pool
from mppi_belief.run.worker import WorkerSetup

TESTS = str(Path(__file__).resolve().parent)
METRICS = (*Metrics._fields, *Consistency._fields)


class Batch(NamedTuple):
    """What a runner expects of a task."""

    rows: list[dict[str, Any]]
    paths: list[dict[str, Any]]
    scene: dict[str, Any] | None


def config(seed: int = 0, batch: int = 1, **extra: Any) -> dict[str, Any]:
    """The configuration of a cell that means nothing; `extra` goes to its system, so it makes
    another cell.
    """
    groups: dict[str, Any] = {group: {} for group in ("cost", "problem", "filter", "controller")}
    names = {"system": "fake", "cost": "fake", "filter": "fake", "controller": "fake"}
    how = {"precision": "float32", "platform": "cpu", "batch": batch, "code": {}}
    return {"system": extra, **groups, "names": names, "swept": {}, "seed": seed, **how}


def row(trial: int, **values: Any) -> dict[str, Any]:
    """A row of a trial that went well."""
    numbers = {
        "theta": 1.0,
        "w_obs": 500.0,
        **dict.fromkeys(METRICS, 1.0),
        "running_cost": 2.0,
        "final_distance": 0.5,
        "cost": 3.0 + trial,
        "collided": False,
        "clearance": 0.25,
        "ess": 8.0,
        "nees": 4.5,
        "nis": 2.25,
    }
    return {
        "trial": trial,
        "seed": 0,
        "status": "ok",
        "controller": "fake",
        **numbers,
        "steps": 3,
        "error": None,
        **values,
    }


def failed_row(config: dict[str, Any], trial: int, status: str, error: str) -> dict[str, Any]:
    missing = dict.fromkeys(METRICS, float("nan"))
    return row(trial) | missing | {"collided": None, "steps": 0, "status": status, "error": error}


def answer(config: dict[str, Any], trials: Sequence[int]) -> list[tuple[int, int]]:
    """Seed and trial, after whatever misfortune the configuration asks for."""
    wishes = config["system"]
    for trial in trials:
        if trial == wishes.get("raises"):
            raise ValueError(f"trial {trial} is cursed")
        if trial == wishes.get("misses_its_device"):
            raise ConfigError("platform=gpu: none is there any more")
        if trial == wishes.get("exits"):
            os._exit(9)
        if trial == wishes.get("is_killed"):
            os.kill(os.getpid(), signal.SIGKILL)
        if trial == wishes.get("hangs"):
            time.sleep(3600)
        if trial == wishes.get("stops"):
            Path(wishes["stopped"]).write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGSTOP)
        if trial == wishes.get("dies_once") and claim(Path(wishes["flag"])):
            os._exit(9)
    return [(config["seed"], trial) for trial in trials]


class AgedWorkers(LocalWorkers):
    """Makes a worker overdue as soon as it has stopped itself, and no other."""

    def __init__(self, stopped: Path) -> None:
        super().__init__(1, WorkerSetup([TESTS], {}))
        self._stopped = stopped

    def age(self, future: Any) -> float:
        if self._stopped.exists() and is_stopped(int(self._stopped.read_text() or "0")):
            return 1e9
        return 0.0


def is_stopped(pid: int) -> bool:
    """Returns whether a process stands still after SIGSTOP."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"
    except OSError:
        return False


def claim(flag: Path) -> bool:
    """True for whoever comes first."""
    try:
        flag.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def leave_marks(config: dict[str, Any], trials: Sequence[int]) -> list[int]:
    """Say when a chunk starts and when it ends."""
    folder = Path(config["system"]["folder"])
    (folder / f"started-{trials[0]}").touch()
    time.sleep(0.05)
    (folder / f"finished-{trials[0]}").touch()
    return list(trials)


def path_and_environment(
    config: dict[str, Any], trials: Sequence[int]
) -> tuple[list[str], dict[str, str], int]:
    """Returns what a worker has been given."""
    return sys.path, dict(os.environ), os.getpid()


def run_trials(config: dict[str, Any], trials: Sequence[int]) -> Batch:
    """Rows for the runner."""
    answer(config, trials)
    return Batch([row(trial, seed=config["seed"]) for trial in trials], [], {"dt": 0.1})


def time_steps(config: dict[str, Any]) -> dict[str, Any]:
    """As if a control step took a millisecond; leaves a note of every call."""
    if "notes" in config["system"]:
        with Path(config["system"]["notes"]).open("a") as notes:
            notes.write("timed\n")
    return {"seconds": [1e-3, 2e-3, 3e-3], "cpu_share": 1.0, "load": 0.0}


def record(config: dict[str, Any]) -> dict[str, Any]:
    """One trial in detail."""
    return {"trial": config["record"], "collided_at": None, "samples": None, "matching": {}}


def device(config: dict[str, Any]) -> str:
    """Returns the name of the device and of the process that was asked."""
    answer(config, [-1])
    return f"{os.environ.get('DEVICE', 'none')} {os.getpid()}"


def hang(config: dict[str, Any], trials: Sequence[int]) -> None:
    """Say who is working, and go on until killed; an orphan that nobody kills ends by itself."""
    (Path(config["system"]["folder"]) / f"worker-{os.getpid()}").touch()
    time.sleep(3600)


def hanging_pool(folder: str) -> None:
    """A parent with two busy workers, to be run in a process of its own and killed."""
    pool = Pool(hang, LocalWorkers(2, WorkerSetup([TESTS], {})), print)
    for _ in pool.run([Chunk(Cell(config(folder=folder)), (trial,)) for trial in range(2)]):
        pass


def poll(condition: Callable[[], Any], seconds: float = 60) -> Any:
    """Returns what `condition` returns once that is true; fails when it never is."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        answer_of_condition = condition()
        if answer_of_condition:
            return answer_of_condition
        time.sleep(0.02)
    raise AssertionError(f"waited {seconds} s in vain")


def is_alive(pid: int) -> bool:
    """Returns whether a process runs; one that only waits to be reaped does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def ended(pids: Sequence[int]) -> Callable[[], bool]:
    return lambda: not any(is_alive(pid) for pid in pids)


def trials_of(chunks: Iterator[Chunk] | Sequence[Chunk]) -> list[int]:
    """All trials of some chunks, in their order."""
    return [trial for chunk in chunks for trial in chunk.trials]


@contextmanager
def limited(seconds: float = 100) -> Iterator[None]:
    """End a test that hangs."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"still not done after {seconds} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def members(group: int) -> list[int]:
    """The processes of a process group that still run."""
    answer_of_condition = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, _, of = (entry / "stat").read_text().rpartition(")")[2].split()[:3]
            except OSError:
                continue
            if int(of) == group and state != "Z":
                answer_of_condition.append(int(entry.name))
    return answer_of_condition


def workers_of(pid: int) -> list[int]:
    """The worker processes that a command has started."""
    return [
        child for child in members(pid) if child != pid and b"spawn_main" in _command_line(child)
    ]


def _command_line(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""
