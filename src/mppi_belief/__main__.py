"""Where the command begins: signals wait from here on, for a half-done import answers them with a traceback.

`run` lets them in once it can stop politely, `report` and `verify` once they can end with one word. Those that come
when all is done are not answered: the command ends anyway.
"""

import signal
import sys
from types import FrameType


def main() -> int:
    """Entry point of the `mppi-belief` command; returns its exit code."""
    signals = {signal.SIGINT, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    for number in signals:  # threads that are begun while signals are let in get them later, too
        signal.signal(number, _do_nothing)
    from .cli.main import main as command

    code = command()
    for (
        number
    ) in signals:  # Python takes handlers away before its last threads have ended, but not this
        signal.signal(number, signal.SIG_IGN)
    return code


def _do_nothing(number: int, frame: FrameType | None) -> None:
    """Whoever has an answer sets another handler."""


if __name__ == "__main__":
    sys.exit(main())
