"""The command line: `mppi-belief run ...`, `mppi-belief report ...`. The only file that imports Hydra.

Collect, then execute: Hydra composes one configuration per job of a sweep and hands it to a function
that only puts it on a list; when all are there they are checked as a whole and run as one plan.
"""

import contextlib
import io
import json
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from . import __version__
from .complaints import one_line
from .settings import ConfigError, Settings
from .settings import check as check_settings
from .study.signals import held

INPUT_ERROR, SOME_FAILED, CANNOT_WRITE = 2, 3, 74
RUNTIME_KEYS = ("n_trials", "workers", "results_dir", "report_dir", "record")  # they do not change what a trial is
COMMANDS = ("run", "report")
FIRST_WORDS = (*COMMANDS, "--help", "--version")
NAMED_GROUPS = ("system", "cost", "filter", "controller")

USAGE = """\
usage: mppi-belief COMMAND [ARGS]

  run         run trials of a controller, or of a sweep     mppi-belief run controller=belief theta=1
              all keys and options:                         mppi-belief run --help
  report      tables, figures and a page from results       mppi-belief report
              of some studies, with other settings:         mppi-belief report experiment=table_1 n_trials=50

  --version   print the version
  --help      print this

Tab completion in bash: eval "$(mppi-belief -sc install=bash)"
"""

REPORT_USAGE = """\
usage: mppi-belief report [experiment=NAME[,NAME...]] [KEY=VALUE ...]

Reads what `mppi-belief run experiment=NAME` has left in results_dir, runs nothing, and writes tables
(LaTeX, Markdown, CSV), figures (PNG, PDF) and a page (index.html) into report_dir. KEY=VALUE as for run:
give the same settings. Without a name, all of: {studies}

Exit codes: 0 done, 2 bad input, 3 trials are missing (the report has what there is, and says how to run
the rest), 74 the report cannot be written.
"""


def main() -> int:
    """Entry point of the `mppi-belief` command; returns its exit code."""
    args = sys.argv[1:]
    if any(arg in ("-sc", "--shell-completion") for arg in args):
        return _guarded(lambda: _complete(args))
    if not args or args[0] in ("-h", "--help"):
        print(USAGE, end="")
        return 0
    if args[0] == "--version":
        print(f"mppi-belief {__version__}")
        return 0
    if args[0] == "run":
        with held():
            return _guarded(lambda: run(args[1:]))
    if args[0] == "report":
        return _guarded(lambda: report(args[1:]))
    guess = f"; did you mean `mppi-belief run {' '.join(args)}`?" if "=" in args[0] or args[0].startswith("-") else ""
    return _complain(f"unknown command '{args[0]}'{guess or '; see mppi-belief --help'}", INPUT_ERROR)


def _guarded(command: Callable[[], int]) -> int:
    """Run a command; a person's mistake becomes one line on stderr and an exit code."""
    try:
        return command()
    except ConfigError as error:
        return _complain(str(error), INPUT_ERROR)
    except OSError as error:
        where = f": {error.filename}" if error.filename else ""
        return _complain(f"cannot write results: {error.strerror or error}{where}", CANNOT_WRITE)


def _complain(line: str, code: int) -> int:
    print(f"mppi-belief: {line}", file=sys.stderr)
    return code


def conf_dir() -> Path:
    """The configuration of the checkout this file is in, or the copy installed beside it."""
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "pyproject.toml").is_file() and (checkout / "conf").is_dir():
        return checkout / "conf"
    return Path(__file__).resolve().parent / "conf"


def compose(args: Sequence[str], job: Callable[[Any], None]) -> None:
    """Let Hydra compose the configuration of each job and call `job` with it; raises `ConfigError`."""
    import hydra
    from hydra.core.config_store import ConfigStore

    ConfigStore.instance().store(name="schema", node=Settings)
    os.environ["HYDRA_FULL_ERROR"] = "1"  # exceptions come to us, not to Hydra's own printer
    sys.argv = ["mppi-belief", *_flags_first(args)]
    said = io.StringIO()
    with tempfile.TemporaryDirectory(prefix="mppi-belief-") as scratch:
        os.environ["MPPI_BELIEF_SCRATCH"] = scratch  # Hydra writes multirun.yaml somewhere
        try:
            with contextlib.redirect_stderr(said):
                hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(job)()
        except SystemExit as stop:
            if stop.code not in (None, 0):
                raise ConfigError(said.getvalue().strip().splitlines()[-1].partition("error: ")[2]) from None
        except Exception as error:
            raise ConfigError(one_line(error, conf_dir())) from error


def _flags_first(args: Sequence[str]) -> list[str]:
    """The arguments in the only order that argparse takes: flags before all overrides."""
    flags, overrides, left = [], [], list(args)
    while left:
        arg = left.pop(0)
        if arg in ("--config-dir", "-cd") and left:
            flags += [arg, left.pop(0)]
        elif arg in ("-m", "--multirun") or arg.startswith("--config-dir="):
            flags.append(arg)
        else:
            overrides.append(arg)
    return flags + overrides


def collect(args: Sequence[str]) -> list[dict[str, Any]]:
    """The configurations the arguments ask for, checked for types, ranges and spelling."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import DictConfig, OmegaConf

    configs: list[dict[str, Any]] = []
    labels: list[dict[str, Any]] = []

    def job(composed: DictConfig) -> None:
        config: Any = OmegaConf.to_container(composed, resolve=True)
        settings = HydraConfig.get()
        names = {group: settings.runtime.choices[group] for group in NAMED_GROUPS}
        keys = [override.lstrip("+~").partition("=")[0] for override in settings.overrides.task]
        swept = [key for key in keys if key not in (*RUNTIME_KEYS, "sweep", "experiment")]
        configs.append(config)
        labels.append({"names": names, "swept": {key: names.get(key) or _scalar(config, key) for key in swept}})

    for group in ("sweep", "experiment"):
        if any(arg.startswith(f"{group}=") and "," in arg for arg in args):
            raise ConfigError(f"{group}: choose one")
    compose(args, job)
    for config in configs:
        check_settings(config)
    for key in RUNTIME_KEYS:
        if any(config[key] != configs[0][key] for config in configs):
            raise ConfigError(f"{key} cannot be swept: it does not change what a trial is")
    return [config | label for config, label in zip(configs, labels, strict=True)]


def _scalar(config: dict[str, Any], key: str) -> Any:
    """What `key` (dotted) is set to, lists and dicts as JSON, so that it fits a column."""
    value: Any = config
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return json.dumps(value) if isinstance(value, list | dict) else value


def run(args: Sequence[str]) -> int:
    """`mppi-belief run`: collect, check everything, run one plan, print one table."""
    configs = collect(args)
    if not configs:  # --help, --cfg, --info
        return 0
    from .study import environment

    environment.prepare()
    from .experiment import check, failed_row, record, run_trials, time_steps
    from .study.plan import Cell
    from .study.runner import Task, run_study

    import_paths = [str(Path(folder).resolve()) for folder in _config_dirs(args)]
    sys.path[:0] = import_paths
    cells = {cell.id: cell for cell in map(Cell, configs)}
    first = configs[0]
    root, n_trials = Path(first["results_dir"]), first["n_trials"]
    task = Task(check, run_trials, time_steps, failed_row, record)
    command = ["mppi-belief", "run", *args]
    outcome = run_study(list(cells.values()), n_trials, root, first["workers"], task, command, import_paths)
    return _tell(list(cells.values()), root, n_trials, outcome)


def report(args: Sequence[str]) -> int:
    """`mppi-belief report`: what the studies' results show, as tables, figures and a page; runs nothing."""
    from .report.write import STUDIES
    from .report.write import report as write
    from .study.plan import Cell

    if any(arg in ("-h", "--help") for arg in args):
        print(REPORT_USAGE.format(studies=" ".join(STUDIES)), end="")
        return 0
    chosen = [arg.partition("=")[2].split(",") for arg in args if arg.startswith("experiment=")]
    overrides = [arg for arg in args if not arg.startswith("experiment=")]
    names = [name for part in chosen for name in part] or list(STUDIES)
    composed = {name: collect([f"experiment={name}", *overrides]) for name in names}
    studies = {name: [Cell(config) for config in configs] for name, configs in composed.items()}
    if not all(composed.values()):  # --cfg, --info
        return 0
    folder = Path(composed[names[0]][0]["report_dir"])
    return 0 if write(studies, folder, overrides) else SOME_FAILED


def _config_dirs(args: Sequence[str]) -> list[str]:
    """What --config-dir names: modules beside a user's yaml can be named in it."""
    given = [arg.partition("=")[2] for arg in args if arg.startswith("--config-dir=")]
    return given + [after for arg, after in pairwise(args) if arg in ("--config-dir", "-cd")]


def _tell(cells: list[Any], root: Path, n_trials: int, outcome: Any) -> int:
    """Print the table, save the pictures, say where everything is."""
    from .report.overview import overview

    failed = overview(cells, root, n_trials, outcome)
    if outcome.stopped is not None:
        print("stopped; the same command goes on from here", file=sys.stderr)
        return 128 + int(outcome.stopped)
    return SOME_FAILED if failed else 0


def _complete(args: Sequence[str]) -> int:
    """Shell completion is Hydra's; the command word is ours and taken out of the line it sees."""
    line = os.environ.get("COMP_LINE", "")
    words = line.split()
    if any(arg.startswith("query=") for arg in args):
        if len(words) < 2 or (len(words) == 2 and words[1] not in COMMANDS and not line.endswith(" ")):
            print(" ".join(word for word in FIRST_WORDS if len(words) < 2 or word.startswith(words[1])))
            return 0
        os.environ["COMP_LINE"] = line.replace(f" {words[1]}", "", 1)
    compose(args, lambda config: None)
    return 0
