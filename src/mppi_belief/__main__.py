"""Where the command `mppi-belief` begins: it blocks signals and opens streams that are closed, then
imports the rest; see `run/signals.py` and `run/streams.py`.
"""

import sys

from .run import signals, streams


def main() -> int:
    """Runs the `mppi-belief` command; returns its exit code."""
    signals.block()
    streams.open_closed_streams()
    from .cli.main import main as command  # after signals are blocked

    code = command()
    signals.ignore()  # Python removes handlers before its last threads have ended, but not this
    return code


if __name__ == "__main__":
    sys.exit(main())
