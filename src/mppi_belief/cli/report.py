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
KEY=VALUE are those of `run`: give the same ones. Numbers of the paper are shown beside cells with
the paper's settings only; any other study or sweep has a report of its own."""
SUMMARY = "tables, figures and a page from results"
EXAMPLE = "mppi-belief report experiment=table_1"
STUDY = "experiment="


def parser(studies: Sequence[str] = (), supplements: Sequence[str] = ()) -> CommandParser:
    """Returns the parser of this command; its help lists the studies of a whole report, and those
    that it shows where they have results.
    """
    return configuration_parser(
        "report",
        usage="mppi-belief report [experiment=NAME[,NAME...]] [KEY=VALUE ...] [-m] [OPTIONS]",
        description=REPORT_DESCRIPTION,
        epilog=(
            "  mppi-belief report\n"
            "  mppi-belief report experiment=table_1 n_trials=50\n"
            "  mppi-belief report -m controller=belief,ce w_obs=100,500,2500\n"
            "  mppi-belief report --config-dir examples/boat experiment=crossing\n\n"
            f"Without a name, a report has all of:\n{wrapped(studies)}\n"
            f"where they have results also:\n{wrapped(supplements)}\n"
            "and the certificates that `mppi-belief verify` has left in verify_dir. Settings that\n"
            "change a cell make it a report of the sweep that `run` would run.\n"
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
    from ..config.environment import set_matplotlib_folder

    set_matplotlib_folder()  # before Matplotlib is imported
    from ..report import build
    from .reported_studies import SWEEP, compose_studies, study_requests
    from .show_configuration import show, wants_printing

    chosen, request = parse(args)
    if request.print_help:
        print(parser(build.STUDIES, build.SUPPLEMENTARY).format_help(), end="")
        return exit_codes.DONE
    requests = study_requests(chosen, request)
    if wants_printing(request):
        return show(next(iter(requests.values())))
    composed = compose_studies(requests, request)
    is_whole = not chosen and SWEEP not in requests  # only the whole report has certificates
    verify_dir = Path(composed.settings["verify_dir"]) if is_whole else None
    folder = Path(composed.settings["report_dir"])
    complete = build.report_studies(
        composed.studies,
        composed.table_1,
        verify_dir,
        folder,
        supplements=() if chosen else build.SUPPLEMENTARY,
    )
    return exit_codes.DONE if complete else exit_codes.INCOMPLETE


def complete(before: Sequence[str], last: str) -> list[str]:
    """Returns what the last word of a `report` command may become."""
    from .completion import complete_setting

    return complete_setting(request_before(parser(), before), last)
