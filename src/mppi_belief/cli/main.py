"""The command `mppi-belief`: calls the module of the command, and reports errors in one line.

Each command is a module of this room with

    SUMMARY, EXAMPLE         its line in `mppi-belief --help`
    parser()                 its parser, from which its help and tab completion derive
    parse(args)              the words as a request
    main(args)               does what the words ask for and returns the exit code
    complete(before, last)   what the last word of a line may become

Imports in the bodies of functions have one of two reasons. Help, completion and complaints must not
wait for what is slow to load. And what imports JAX is imported only after `environment.prepare` has
set the variables that JAX reads on import.
"""

import contextlib
import io
import os
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .. import __version__
from ..config.environment import prepare_drawing
from ..errors import ConfigError, plain_line
from ..run.signals import ended_by_signals, held
from ..run.workers import WorkersGone
from . import exit_codes, replay, report, results, run, verify

COMMANDS: dict[str, Any] = {
    "run": run,
    "report": report,
    "verify": verify,
    "results": results,
    "replay": replay,
}
COMPLETION = ("-sc", "--shell-completion")


def main() -> int:
    """Carries out the command line of this process and returns its exit code."""
    args = sys.argv[1:]
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # Greek letters on a terminal that has none
    prepare_drawing()
    if any(arg in COMPLETION for arg in args):
        from .completion import answer_completion

        return guarded(lambda: answer_completion(args, COMMANDS))
    if not args or args[0] in ("-h", "--help"):
        return guarded(lambda: _print(overview()))
    if args[0] == "--version":
        return guarded(lambda: _print(f"mppi-belief {__version__}\n"))
    if args[0] not in COMMANDS:
        return complain(_unknown_command(args), exit_codes.BAD_INPUT)
    return guarded(lambda: carry_out(args[0], args[1:]))


def carry_out(command: str, args: list[str]) -> int:
    """Runs one command; `run` handles signals itself, the others end at the first one."""
    _check_working_directory()
    if command == "run":
        with held():
            return int(COMMANDS[command].main(args))
    return ended_by_signals(
        lambda: int(COMMANDS[command].main(args)),
        on_stop=lambda: print("mppi-belief: stopped", file=sys.stderr),
    )


def overview() -> str:
    """Returns what `mppi-belief --help` prints."""
    lines = ["usage: mppi-belief COMMAND [ARGS]", ""]
    for name, command in COMMANDS.items():
        lines.append(f"  {name:10}{command.SUMMARY:46}{command.EXAMPLE}")
    lines += [
        "",
        "  mppi-belief COMMAND --help   print arguments, options and exit codes of a command",
        "  mppi-belief run --help       print all settings, too",
        "  mppi-belief --version        print the version",
        "",
        'Tab completion in bash: eval "$(mppi-belief -sc install=bash)"',
    ]
    return "\n".join(lines) + "\n"


def guarded(command: Callable[[], int]) -> int:
    """Runs a command; a mistake of its user becomes one line on stderr and an exit code."""
    try:
        code = command()
        sys.stdout.flush()  # here, so that a failure is reported in our words
        return code
    except ConfigError as error:
        return complain(str(error), exit_codes.BAD_INPUT)
    except WorkersGone as error:
        return complain(f"{error}; the same command goes on", exit_codes.NO_WORKERS)
    except BrokenPipeError:  # whoever reads our output is gone
        _discard_output()
        return exit_codes.READER_GONE
    except OSError as error:
        try:
            sys.stdout.flush()
            _check_working_directory()
        except OSError:
            _discard_output()
        except ConfigError as gone:
            return complain(str(gone), exit_codes.CANNOT_WRITE)
        where = f": {error.filename}" if error.filename else ""
        reason = error.strerror or error
        return complain(f"cannot write results: {reason}{where}", exit_codes.CANNOT_WRITE)


def complain(line: str, code: int) -> int:
    """Prints one line on stderr and returns the given exit code."""
    with contextlib.suppress(OSError):  # nobody reads it, or it cannot be written
        print(f"mppi-belief: {plain_line(line)}", file=sys.stderr)
    return code


def _check_working_directory() -> None:
    """Raises `ConfigError` where the working directory is gone, to which all paths are relative."""
    try:
        Path.cwd()
    except FileNotFoundError:
        raise ConfigError("the working directory was deleted; change to one that exists") from None


def _unknown_command(args: list[str]) -> str:
    word = args[0]
    if "=" in word or word.startswith("-"):
        return f"unknown command '{word}'; did you mean `mppi-belief run {shlex.join(args)}`?"
    return f"unknown command '{word}'; see mppi-belief --help"


def _discard_output() -> None:
    """Drops what stdout has buffered, since nobody reads it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print(text: str) -> int:
    print(text, end="")
    return exit_codes.DONE
