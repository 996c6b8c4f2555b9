"""`mppi-belief replay CELL TRIAL`: runs a trial again and compares it with what was kept."""

from collections.abc import Sequence

from ..errors import ConfigError
from . import exit_codes
from .parser import CommandParser
from .results_request import ResultsRequest, matching_cells, read_request

REPLAY_DESCRIPTION = """\
Runs one trial of a cell again, from the configuration that its row was made with, compares all that
is kept of it bit for bit, and draws it into the cell's folder. CELL is the beginning of a cell's
id, or the path of its folder. A controller or system of your own is looked for in --config-dir, and
nowhere else."""
SUMMARY = "run one trial again and compare"
EXAMPLE = "mppi-belief replay CELL TRIAL"


def parser() -> CommandParser:
    """Returns the parser of this command."""
    command = CommandParser(
        "replay",
        usage="mppi-belief replay CELL TRIAL [results_dir=DIR] [--config-dir DIR] [--force]",
        description=REPLAY_DESCRIPTION,
    )
    command.add_argument(
        *("--config-dir", "-cd"),
        action="append",
        default=[],
        metavar="DIR",
        help="a folder with the Python modules that the configuration names",
    )
    command.add_argument(
        "--force",
        action="store_true",
        help="run, in this process, also a trial that crashed or did not end (timeout)",
    )
    return command


def parse(args: Sequence[str]) -> ResultsRequest:
    """Returns what the words of a `replay` command ask for. Raises `ConfigError`."""
    return read_request(parser(), args)


def main(args: Sequence[str]) -> int:
    """Carries out a `replay` command and returns the exit code."""
    request = parse(args)
    if request.options.help:
        print(parser().format_help(), end="")
        return exit_codes.DONE
    if len(request.words) != 2:
        raise ConfigError("replay: name a cell and a trial; see mppi-belief replay --help")
    from .replayed_trial import replay_trial

    return replay_trial(request, ["mppi-belief", "replay", *args])


def complete(before: Sequence[str], last: str) -> list[str]:
    """Returns what the last word of a `replay` command may become."""
    try:
        request = parse(before)
    except ConfigError:
        return []
    names = [] if request.words else matching_cells(request.root, last)
    return [name for name in [*names, "results_dir="] if name.startswith(last)]
