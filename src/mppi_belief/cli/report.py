"""`mppi-belief report`: shows the results of studies as tables, figures and a page."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from ..config.request import Request
from . import exit_codes
from .parser import CommandParser, configuration_parser, request_before, request_of, wrapped

REPORT_DESCRIPTION = """\
Reads what `mppi-belief run experiment=NAME` has left in results_dir, runs nothing, and writes
tables (LaTeX, Markdown, CSV), figures (PNG, PDF) and a page (index.html) into report_dir. Settings
KEY=VALUE are those of `run`: give the same ones."""
SUMMARY = "tables, figures and a page from results"
EXAMPLE = "mppi-belief report experiment=table_1"
STUDY = "experiment="


def parser(studies: Sequence[str] = ()) -> CommandParser:
    """Returns the parser of this command; its help lists the studies of a whole report."""
    return configuration_parser(
        "report",
        usage="mppi-belief report [experiment=NAME[,NAME...]] [KEY=VALUE ...] [OPTIONS]",
        description=REPORT_DESCRIPTION,
        epilog=(
            f"Without a name, a report has all of:\n{wrapped(studies)}\n"
            "and the certificates that `mppi-belief verify` has left in verify_dir.\n"
            "Where results are missing, the report has the others and says how to run the rest."
        ),
    )


def parse(args: Sequence[str]) -> tuple[list[str], Request]:
    """Returns the studies that are named, and what else the words of a `report` command ask for."""
    request = request_of(parser().read(args), args, "report")
    names: list[str] = []
    overrides = []
    for word in request.overrides:
        if word.startswith(STUDY):
            names += word.removeprefix(STUDY).split(",")
        else:
            overrides.append(word)
    return names, dataclasses.replace(request, overrides=tuple(overrides))


def main(args: Sequence[str]) -> int:
    """Writes the report that a command line asks for; returns the exit code."""
    from ..config.cell import Cell
    from ..config.compose import collect
    from ..config.environment import set_matplotlib_folder

    set_matplotlib_folder()  # before Matplotlib is imported
    from ..report import build
    from .show_configuration import show, wants_printing

    chosen, request = parse(args)
    if request.print_help:
        print(parser(build.STUDIES).format_help(), end="")
        return exit_codes.DONE
    requests = {
        name: dataclasses.replace(request, overrides=(f"{STUDY}{name}", *request.overrides))
        for name in chosen or build.STUDIES
    }
    first_request = next(iter(requests.values()))
    if wants_printing(request):
        return show(first_request)
    configs = {name: collect(study) for name, study in requests.items()}
    studies = {name: [Cell(config) for config in configs[name]] for name in configs}
    settings = next(iter(configs.values()))[0]
    verify_dir = None if chosen else Path(settings["verify_dir"])  # chosen studies stand alone
    complete = build.report_studies(
        studies, verify_dir, Path(settings["report_dir"]), request.words
    )
    return exit_codes.DONE if complete else exit_codes.INCOMPLETE


def complete(before: Sequence[str], last: str) -> list[str]:
    """Returns what the last word of a `report` command may become."""
    from .completion import complete_setting

    return complete_setting(request_before(parser(), before), last)
