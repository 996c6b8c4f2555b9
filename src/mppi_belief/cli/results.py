"""`mppi-belief results`: lists the cells of a results folder; shows, exports, checks them."""

from collections.abc import Sequence
from typing import NamedTuple

from ..errors import ConfigError, unknown_key
from . import exit_codes
from .parser import CommandParser
from .results_request import ResultsRequest, matching_cells, read_request

SUMMARY = "what is in the results folder"
EXAMPLE = "mppi-belief results show CELL"


class Form(NamedTuple):
    """Describes a subcommand; `results_actions` has a function for each."""

    usage: str
    meaning: str


SUBCOMMANDS = {
    "show": Form("CELL", "configuration, runs, failures, a summary, files"),
    "export": Form("[CELL ...] [--csv] [--to FILE]", "all rows as one CSV, numbers bit for bit"),
    "compact": Form("[CELL ...]", "merge the small files of a cell into one of each kind"),
    "verify": Form("[CELL ...]", "check every file against its hash, its cell and the others"),
}


def parser() -> CommandParser:
    """Returns the parser of this command."""
    forms = [f"  {name:9} {form.usage:32} {form.meaning}" for name, form in SUBCOMMANDS.items()]
    command = CommandParser(
        "results",
        usage="mppi-belief results [WORD] [CELL ...] [results_dir=DIR] [OPTIONS]",
        description="\n".join(
            [
                "Lists the cells of a results folder: trials by status, settings, files, size,",
                "age, commit. With one of these words it does something else:",
                "",
                *forms,
                "",
                "CELL is the beginning of a cell's id, or the path of its folder. Without CELL,",
                "all cells are meant; export then leaves out those that are superseded. Compact",
                "may run while a study is running.",
            ]
        ),
    )
    command.add_argument("--csv", action="store_true", help="with export: the only format")
    command.add_argument(
        "--to", action="append", default=[], metavar="FILE", help="with export: write into FILE"
    )
    return command


def parse(args: Sequence[str]) -> ResultsRequest:
    """Returns what the words of a `results` command ask for. Raises `ConfigError`."""
    if any(word.startswith("--csv=") for word in args):
        raise ConfigError("--csv: takes no value; a file to write into is given with --to FILE")
    request = read_request(parser(), args)
    subcommand = request.words[0] if request.words else None
    if subcommand is not None and subcommand not in SUBCOMMANDS:
        see = "mppi-belief results --help"
        raise ConfigError(unknown_key(subcommand, [*SUBCOMMANDS], "command", see))
    for option in ("csv", "to"):
        if getattr(request.options, option) and subcommand != "export":
            raise ConfigError(f"--{option} is an option of mppi-belief results export")
    if len(request.options.to) > 1:
        raise ConfigError("--to: one file at a time")
    return request


def main(args: Sequence[str]) -> int:
    """Carries out `mppi-belief results ...`; returns the exit code."""
    request = parse(args)
    if request.options.help:
        print(parser().format_help(), end="")
        return exit_codes.DONE
    from . import results_actions

    if not request.words:
        return results_actions.list_cells(request)
    subcommand, *words = request.words
    return results_actions.ACTIONS[subcommand](request._replace(words=words))


def complete(before: Sequence[str], last: str) -> list[str]:
    """Returns what the last word of a `results` command may become: a subcommand, then cells."""
    try:
        request = parse(before)
    except ConfigError:
        return []
    names = matching_cells(request.root, last) if request.words else [*SUBCOMMANDS]
    return [name for name in [*names, "results_dir="] if name.startswith(last)]
