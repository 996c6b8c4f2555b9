"""Defines what a pool needs of workers, of this machine (`local.py`) or others (`dask.py`)."""

from collections.abc import Callable, Iterable
from concurrent.futures import Future
from typing import Any, Protocol


class WorkerDied(Exception):
    """Says that a worker ended before its function did."""


class WorkersGone(Exception):
    """Says that no worker is left and none can be started; the message is the cause in one line."""


class Workers(Protocol):
    """Runs functions in other processes, one at a time in each."""

    count: int  # number of workers, about
    own_environment: bool  # whether their device may be another than that of this process
    grain: float  # s, the time that a chunk should take, so that handing it out costs little

    def room(self) -> int:
        """Returns how many more functions would begin at once."""

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Lets a worker call a function; the future is done when that has ended in some way."""

    def collect(self, future: Future[Any]) -> Any:
        """Returns what a function returned, and frees its worker.

        Raises what the function raised, `WorkerDied`, `WorkersGone`, or `ConfigError` for a worker
        that refuses.
        """

    def withdraw(self, futures: Iterable[Future[Any]]) -> list[Future[Any]]:
        """Takes back functions that no worker has begun; returns their futures."""

    def discard(self, future: Future[Any]) -> None:
        """Ends the worker that got a function; `collect` then raises `WorkerDied` if the function
        had not ended.
        """

    def age(self, future: Future[Any]) -> float:
        """Returns the seconds (s) for which a function has certainly run; 0 where only its worker
        knows.
        """

    def close(self, *, kill: bool = False) -> None:
        """Ends all workers: when they are idle, or at once."""
