"""Where the command begins: signals wait from here on, for a half-done import answers them with a traceback.

`run` lets them in once it can stop politely, `report` and `verify` once they can end with one word. Those that come
when a command is over are not answered: it ends.
"""

import signal


def main() -> int:
    """Entry point of the `mppi-belief` command; returns its exit code."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    from .cli import main as command

    return command()
