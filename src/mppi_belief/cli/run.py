"""`mppi-belief run`: runs trials of a controller, or of a sweep over controllers and settings.

Collects and checks the configurations of all cells, runs what is missing as one plan, and prints
one table.
"""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..config.request import Request
from . import exit_codes
from .parser import CommandParser, configuration_parser, request_before, request_of

if TYPE_CHECKING:
    from ..config.cell import Cell
    from ..run.task import StudyOutcome

SUMMARY = "run trials of a controller, or of a sweep"
EXAMPLE = "mppi-belief run controller=belief theta=1"
PURPOSE = "Runs Monte Carlo trials of a controller, or of a sweep over controllers and settings."
EXAMPLES = """\
  mppi-belief run controller=belief theta=1
  mppi-belief run -m controller=belief,ce w_obs=100,500,2500
  mppi-belief run sweep=theta n_trials=50
  mppi-belief run experiment=table_1

Trials that are done are kept: the same command again runs nothing, and a larger n_trials adds
the rest."""


def parser() -> CommandParser:
    """Returns the parser of this command."""
    command = configuration_parser(
        "run",
        usage="mppi-belief run [KEY=VALUE ...] [-m] [OPTIONS]",
        description=f"{PURPOSE}\n\n{EXAMPLES}",
    )
    command.add_argument(
        "--retry-failed",
        action="store_true",
        help="run trials that ended without a result (error, crashed, timeout) again",
    )
    return command


def parse(args: Sequence[str]) -> Request:
    """Returns what the words of a `run` command ask for. Raises `ConfigError`."""
    namespace = parser().read(args)
    request = request_of(namespace, args, "run")
    return dataclasses.replace(request, retry_failed=namespace.retry_failed)


def main(args: Sequence[str]) -> int:
    """Runs the trials that a command line asks for; returns the exit code."""
    from ..config import environment
    from ..config.compose import collect
    from ..config.written_keys import written_keys
    from .show_configuration import groups_and_keys, show, wants_printing

    request = parse(args)
    if request.print_help:
        print(f"{parser().format_help()}\n{groups_and_keys(request)}", end="")
        return exit_codes.DONE
    if wants_printing(request):
        return show(request)
    configs = collect(request)
    variables = environment.prepare(configs[0]["platform"])
    with written_keys(request):
        return run(request, configs, variables)


def run(request: Request, configs: Sequence[dict[str, Any]], variables: dict[str, str]) -> int:
    """Runs the cells of some configurations and prints their table; returns the exit code.

    `variables` are those that workers need besides the environment of this process, which is
    prepared.
    """
    from ..config import environment
    from ..config.cell import Cell
    from ..config.targets import allow
    from ..run.plan import WHOLE, Shard
    from ..run.runner import run_study
    from ..run.start_workers import make_workers
    from ..run.task import StudyOrder, TrialFunctions
    from ..run.worker import WorkerSetup
    from ..trial import check, device, failed_row, record, run_trials, time_steps_and_load

    # What is run: the cells, and how much of each.
    settings = configs[0]
    cells = list({cell.id: cell for cell in map(Cell, configs)}.values())
    root = Path(settings["results_dir"])
    shard = WHOLE if settings["shard"] is None else Shard.parse(settings["shard"])
    order = StudyOrder(settings["n_trials"], shard, request.retry_failed, settings["trial_timeout"])
    functions = TrialFunctions(check, run_trials, time_steps_and_load, failed_row, record, device)

    # Who runs it.
    import_paths = [str(Path(folder).resolve()) for folder in request.config_dirs]
    allow(import_paths)
    one_process = settings["platform"] == "gpu" and settings["executor"]["kind"] == "local"
    count = 1 if one_process else settings["workers"]
    setup = WorkerSetup(import_paths, variables)
    workers = make_workers(settings["executor"], count, setup, environment.in_force())

    outcome = run_study(cells, order, root, functions, workers, list(request.command))
    return show_outcome(cells, root, settings["n_trials"], outcome, request.config_dirs)


def show_outcome(
    cells: "Sequence[Cell]",
    root: Path,
    n_trials: int,
    outcome: "StudyOutcome",
    config_dirs: Sequence[str] = (),
) -> int:
    """Prints the table, saves the pictures, prints where they are; returns the exit code.

    `config_dirs` are the folders of --config-dir.
    """
    from .overview import show_overview

    failed = show_overview(cells, root, n_trials, outcome, config_dirs)
    if outcome.stopped is not None:
        print("stopped; the same command goes on from here", file=sys.stderr)
        return exit_codes.SIGNALLED + int(outcome.stopped)
    return exit_codes.INCOMPLETE if failed else exit_codes.DONE


def complete(before: Sequence[str], last: str) -> list[str]:
    """Returns what the last word of a `run` command may become."""
    from .completion import complete_setting

    return complete_setting(request_before(parser(), before), last)
