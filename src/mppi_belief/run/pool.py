"""Who runs it: chunks are handed to workers, and whatever happens to those, every trial gets a result.

A chunk whose worker died is halved, down to the one trial, which after a second strike is given up as crashed; most
are innocent and do well the second time. A trial that hangs is given up at once; its worker is ended, and what it had
not begun is run again.
"""

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, NamedTuple, Protocol

from ..config.cell import Cell, batches
from ..errors import ConfigError
from .local import WorkerDied, WorkersGone
from .plan import Chunk
from .signals import StoppedAtOnce
from .worker import Lost, Overtime, Report, run_chunk, within

STRIKES = 2
PATIENCE = 30.0  # s beyond the time that a chunk may take, before its worker is ended from outside
TICK = 0.25  # s


class Workers(Protocol):
    """Whoever works, on this machine (`lanes`) or on others (`cluster`).

    count      how many, about                    elsewhere   whether this process tells nothing of their device
    grain      seconds a chunk should take        room()      how many chunks they would take
    submit     let one of them do something       collect     what came of it
    withdraw   take back what none has begun      discard     end the worker that a future was given to
    age        seconds since it certainly began   close       end them all
    """

    count: int
    elsewhere: bool
    grain: float

    def room(self) -> int: ...
    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]: ...
    def collect(self, future: Future[Any]) -> Any: ...
    def discard(self, future: Future[Any]) -> None: ...
    def withdraw(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]: ...
    def age(self, future: Future[Any]) -> float: ...
    def close(self, *, kill: bool = False) -> None: ...


class Done(NamedTuple):
    """Trials of a cell with what their worker made of them, or `Lost`, and where it was."""

    cell: Cell
    trials: tuple[int, ...]
    outcome: Any
    where: dict[str, str]


class Pool:
    """Runs `work(config, trials)` on chunks; a batch of trials may take `seconds` (None: as long as it likes)."""

    def __init__(
        self,
        work: Callable[..., Any],
        workers: Workers,
        log: Callable[[str], None],
        seconds: float | None = None,
    ) -> None:
        self._work, self._workers, self._log, self._seconds = work, workers, log, seconds
        self._waiting, self._again = deque[Chunk](), deque[Chunk]()
        self._left: Counter[str] = Counter()  # trials that wait, by cell
        self._pace: dict[str, float] = {}  # s a trial, by cell
        self._running: dict[Future[Any], Chunk] = {}
        self._overdue: set[Future[Any]] = set()
        self._strikes: Counter[tuple[str, int]] = Counter()
        self._stopping = threading.Event()

    def stop(self) -> None:
        """Start no more chunks; those running are finished."""
        self._stopping.set()

    def close(self, *, kill: bool = False) -> None:
        """End the workers: when they are idle, or at once."""
        self._workers.close(kill=kill)

    def run(
        self, chunks: Iterable[Chunk], tick: Callable[[], object] = lambda: None
    ) -> Iterator[Done]:
        """Yield every trial with its result, or with `Lost`, as they come, and call `tick` now and then.

        Raises `ConfigError` where the work does, `WorkersGone` if there is nobody to do it.
        """
        for chunk in chunks:
            self._waiting.append(chunk)
            self._left[chunk.cell.id] += len(chunk.trials)
        while self._running or ((self._waiting or self._again) and not self._stopping.is_set()):
            if self._stopping.is_set():
                for future in self._workers.withdraw([*self._running]):
                    del self._running[future]
            self._fill()
            settled, trouble = self._gather(
                wait(self._running, timeout=TICK, return_when=FIRST_COMPLETED).done
            )
            if trouble is None:
                self._fill()  # nobody waits while results are written
            yield from settled
            if trouble is not None:
                raise trouble
            self._look_at_the_clock()
            tick()

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        """Run one function in a worker while the others are idle, a second time where the worker died; raises
        `WorkerDied`, `Overtime` if it takes as long as a batch of trials may, or `StoppedAtOnce` if it has not begun
        when all is to stop."""
        for _ in range(STRIKES - 1):
            try:
                return self._call(function, *args)
            except WorkerDied:
                self._stop_waiting()
        return self._call(function, *args)

    def _call(self, function: Callable[..., Any], *args: Any) -> Any:
        while self._workers.room() <= 0:
            self._stop_waiting()
            time.sleep(TICK)
        future, overdue = self._workers.submit(within, self._seconds, function, *args), False
        while not wait([future], timeout=TICK).done:
            if self._stopping.is_set() and self._workers.withdraw([future]):
                self._stop_waiting()
            if (
                not overdue
                and self._seconds is not None
                and self._workers.age(future) > self._seconds + PATIENCE
            ):
                self._workers.discard(future)  # it cannot look at the clock itself
                overdue = True
        try:
            return self._workers.collect(future)
        except WorkerDied as error:
            if overdue:
                raise Overtime(f"not done after {self._seconds:g} s") from error
            raise
        except Overtime:
            self._workers.discard(future)
            raise

    def _stop_waiting(self) -> None:
        if self._stopping.is_set():
            raise StoppedAtOnce

    def _gather(self, ended: Iterable[Future[Any]]) -> tuple[list[Done], Exception | None]:
        """What has ended, and what of it ends the run."""
        settled: list[Done] = []
        trouble: Exception | None = None
        for future in ended:
            try:
                settled.extend(self._settle(future))
            except (ConfigError, WorkersGone) as error:
                trouble = error
        return settled, trouble

    def _fill(self) -> None:
        while (
            (self._waiting or self._again)
            and not self._stopping.is_set()
            and self._workers.room() > 0
        ):
            chunk = self._again.popleft() if self._again else self._next()
            future = self._workers.submit(
                run_chunk, self._work, chunk.cell.config, chunk.trials, self._seconds
            )
            self._running[future] = chunk

    def _next(self) -> Chunk:
        """The next chunk, with those after it if they are short; at the end everybody shall have one."""
        chunk = self._waiting.popleft()
        trials, cell = [*chunk.trials], chunk.cell
        pace = self._pace.get(cell.id, math.inf)
        most = min(
            self._workers.grain / max(pace, 1e-9), self._left[cell.id] / (2 * self._workers.count)
        )
        while (
            self._waiting
            and (after := self._waiting[0]).cell is cell
            and len(trials) + len(after.trials) <= most
        ):
            trials += self._waiting.popleft().trials
        self._left[cell.id] -= len(trials)
        return chunk._replace(trials=tuple(trials))

    def _settle(self, future: Future[Any]) -> Iterator[Done]:
        """The trials of a chunk that has ended; those that have no result yet wait again."""
        chunk, overdue = self._running.pop(future), future in self._overdue
        self._overdue.discard(future)
        try:
            report: Report = self._workers.collect(future)
        except WorkerDied:
            yield from self._bury(chunk, overdue)
            return
        except (ConfigError, WorkersGone):
            raise
        except Exception as error:
            yield Done(*chunk, Lost("error", f"{type(error).__name__}: {error}"), {})
            return
        pace = report.seconds / max(sum(len(trials) for trials, _ in report.done), 1)
        self._pace[chunk.cell.id] = min(
            pace, self._pace.get(chunk.cell.id, math.inf)
        )  # the first compiles
        for trials, outcome in report.done:
            yield Done(chunk.cell, trials, outcome, report.where)
            if isinstance(outcome, Lost) and outcome.status == "timeout":
                self._log(f"{_name(chunk.cell, trials)}: {outcome.error}; given up")
                self._workers.discard(future)
        if report.unfinished:
            self._again.append(chunk._replace(trials=report.unfinished))
        if (
            report.mistake is not None
        ):  # no trial's own fault: nothing of this chunk may count as done
            raise ConfigError(report.mistake)

    def _bury(self, chunk: Chunk, overdue: bool) -> Iterator[Done]:
        """What to do about a chunk whose worker died."""
        name = _name(chunk.cell, chunk.trials)
        if len(chunk.trials) > 1:
            self._log(
                f"{name}: {'ended a worker that hangs' if overdue else 'a worker died'}; running them again"
            )
            middle = len(chunk.trials) // 2
            parts = chunk.trials[middle:], chunk.trials[:middle]
            self._again.extendleft(chunk._replace(trials=part) for part in parts)
            return
        accused = (chunk.cell.id, chunk.trials[0])
        self._strikes[accused] += 1
        if overdue:
            self._log(f"{name}: it hangs; given up")
            yield Done(*chunk, Lost("timeout", f"not done after {self._seconds:g} s"), {})
        elif self._strikes[accused] < STRIKES:
            self._log(f"{name}: its worker died; running it again")
            self._again.appendleft(chunk)
        else:
            self._log(f"{name}: it killed its worker {STRIKES} times; given up")
            yield Done(
                *chunk,
                Lost("crashed", f"the worker process died {STRIKES} times in this trial"),
                {},
            )

    def _look_at_the_clock(self) -> None:
        """End workers that are so late that they cannot even look at the clock themselves."""
        if self._seconds is None:
            return
        for future, chunk in self._running.items():
            count = len([*batches(chunk.trials, chunk.cell.config["batch"])])
            if (
                future not in self._overdue
                and self._workers.age(future) > self._seconds * count + PATIENCE
            ):
                self._overdue.add(future)
                self._workers.discard(future)


def _name(cell: Cell, trials: tuple[int, ...]) -> str:
    return f"{cell.id} trial{'' if len(trials) == 1 else 's'} {trials[0]}" + (
        f"..{trials[-1]}" if len(trials) > 1 else ""
    )
