"""The command line: `mppi-belief run`, `report`, `verify`, `results`, `replay`."""

import contextlib
import io
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from .. import __version__
from ..config.compose import RUNTIME_KEYS, collect, parse
from ..errors import ConfigError, plain_line, unknown_key
from ..run.signals import STOPPING, held
from ..run.workers import WorkersGone
from . import usage
from .completion import complete

NOT_HELD, INPUT_ERROR, SOME_FAILED, CANNOT_WRITE, NOBODY_WORKS, CUT_OFF = 1, 2, 3, 74, 75, 141
GRACE = 10.0  # s that a command has to end once it is told to


def main() -> int:
    """The `mppi-belief` command; returns its exit code."""
    args = sys.argv[1:]
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # Greek letters on a terminal that has none
    if any(arg in ("-sc", "--shell-completion") for arg in args):
        return _guarded(lambda: complete(args))
    if not args or args[0] in ("-h", "--help"):
        return _guarded(lambda: _show(usage.USAGE))
    if args[0] == "--version":
        return _guarded(lambda: _show(f"mppi-belief {__version__}\n"))
    if args[0] == "run":
        with held():
            return _guarded(lambda: run(args[1:]))
    if args[0] == "report":
        return _guarded(lambda: _stoppable(lambda: report(args[1:])))
    if args[0] == "verify":
        return _guarded(lambda: _stoppable(lambda: verify(args[1:])))
    if args[0] in ("results", "replay"):
        return _guarded(lambda: _stoppable(lambda: _tool(args[0], args[1:])))
    guess = (
        f"; did you mean `mppi-belief run {' '.join(args)}`?"
        if "=" in args[0] or args[0].startswith("-")
        else ""
    )
    return _complain(
        f"unknown command '{args[0]}'{guess or '; see mppi-belief --help'}", INPUT_ERROR
    )


def _guarded(command: Callable[[], int]) -> int:
    """Run a command; a person's mistake becomes one line on stderr and an exit code."""
    try:
        code = command()
        sys.stdout.flush()  # Python's own way of saying that it cannot be written is another
        return code
    except ConfigError as error:
        return _complain(str(error), INPUT_ERROR)
    except WorkersGone as error:
        return _complain(f"{error}; the same command goes on", NOBODY_WORKS)
    except BrokenPipeError:  # the reader of our output went away; nothing is left to tell
        _tell_nobody()
        return CUT_OFF
    except OSError as error:
        try:
            sys.stdout.flush()
        except OSError:
            _tell_nobody()
        where = f": {error.filename}" if error.filename else ""
        return _complain(f"cannot write results: {error.strerror or error}{where}", CANNOT_WRITE)


def _tell_nobody() -> None:
    """What is left to print has nowhere to go."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _show(text: str) -> int:
    print(text, end="")
    return 0


def _stoppable(command: Callable[[], int]) -> int:
    """Run a command that keeps nothing half done: Ctrl-C or SIGTERM ends it with one word and 128 + signal."""

    def stop(number: int, frame: FrameType | None) -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)  # once is enough
        # what is imported or called meanwhile may take the exception for one of its own
        signal.signal(signal.SIGALRM, lambda *_: os._exit(_complain("stopped", 128 + number)))
        signal.setitimer(signal.ITIMER_REAL, GRACE)
        raise KeyboardInterrupt(number)

    before = {number: signal.signal(number, stop) for number in STOPPING}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    try:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
        return command()
    except KeyboardInterrupt as stopped:
        return _complain("stopped", 128 + (stopped.args[0] if stopped.args else signal.SIGINT))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _complain(line: str, code: int) -> int:
    print(f"mppi-belief: {plain_line(line)}", file=sys.stderr)
    return code


def run(args: Sequence[str]) -> int:
    """`mppi-belief run`: collect, check everything, run one plan, print one table."""
    retry_failed, command = "--retry-failed" in args, ["mppi-belief", "run", *args]
    args = [arg for arg in args if arg != "--retry-failed"]
    configs = collect(args)
    if not configs:  # --help, --cfg, --info
        return 0
    from ..config import environment

    first = configs[0]
    variables = environment.prepare(first["platform"])
    from ..config.cell import Cell
    from ..config.targets import allow
    from ..run.plan import WHOLE, Shard
    from ..run.runner import run_study
    from ..run.start_workers import make_workers
    from ..run.task import StudyOrder, TrialFunctions
    from ..run.worker import WorkerSetup
    from ..trial import check, device, failed_row, record, run_trials, time_steps

    import_paths = [str(Path(folder).resolve()) for folder in parse(args)[2]]
    allow(import_paths)
    cells = {cell.id: cell for cell in map(Cell, configs)}
    root, n_trials = Path(first["results_dir"]), first["n_trials"]
    shard = WHOLE if first["shard"] is None else Shard.parse(first["shard"])
    order = StudyOrder(n_trials, shard, retry_failed, first["trial_timeout"])
    count = (
        1
        if first["platform"] == "gpu" and first["executor"]["kind"] == "local"
        else first["workers"]
    )
    setup = WorkerSetup(import_paths, variables)
    workers = make_workers(first["executor"], count, setup, environment.in_force())
    functions = TrialFunctions(check, run_trials, time_steps, failed_row, record, device)
    outcome = run_study(list(cells.values()), order, root, functions, workers, command)
    return _tell(list(cells.values()), root, n_trials, outcome)


def report(args: Sequence[str]) -> int:
    """`mppi-belief report`: what the studies' results show, as tables, figures and a page; runs nothing."""
    from ..config.cell import Cell
    from ..report.build import STUDIES
    from ..report.build import report_studies as write

    if any(arg in ("-h", "--help") for arg in args):
        print(usage.REPORT.format(studies=" ".join(STUDIES)), end="")
        return 0
    chosen = [arg.partition("=")[2].split(",") for arg in args if arg.startswith("experiment=")]
    overrides = [arg for arg in args if not arg.startswith("experiment=")]
    names = [name for part in chosen for name in part] or list(STUDIES)
    composed = {name: collect([f"experiment={name}", *overrides]) for name in names}
    studies = {name: [Cell(config) for config in configs] for name, configs in composed.items()}
    if not all(composed.values()):  # --cfg, --info
        return 0
    first = composed[names[0]][0]
    theory = (
        None if chosen else Path(first["verify_dir"])
    )  # chosen studies are a report of those alone
    return 0 if write(studies, theory, Path(first["report_dir"]), overrides) else SOME_FAILED


def verify(args: Sequence[str]) -> int:
    """`mppi-belief verify`: certificates of the paper's statements, or what holds for one system."""
    from ..results.certificate import CERTIFICATE_NAMES

    if any(arg in ("-h", "--help") for arg in args):
        print(usage.VERIFY.format(names=" ".join(CERTIFICATE_NAMES)), end="")
        return 0
    flags, words, folders = parse(args)
    overrides = [word for word in words if "=" in word or word.startswith(("+", "~"))]
    names = list(dict.fromkeys(word for word in words if word not in overrides))
    for name in names:
        if name not in CERTIFICATE_NAMES:
            raise ConfigError(
                unknown_key(
                    name, CERTIFICATE_NAMES, what="certificate", see="mppi-belief verify --help"
                )
            )
    configs = collect([*flags, *overrides])
    if not configs:  # --cfg, --info
        return 0
    if len(configs) > 1:
        raise ConfigError("verify: one system at a time")
    if configs[0]["platform"] != "cpu":
        raise ConfigError(f"platform={configs[0]['platform']}: verify computes on the CPU")
    about_system = [
        word
        for word in overrides
        if _key(word) not in ("seed", "precision", "platform", "batch", *RUNTIME_KEYS)
    ]
    if about_system and names:
        raise ConfigError(
            f"verify: either certificates or a system, not '{names[0]}' with '{about_system[0]}'"
        )
    if folders and not about_system:
        raise ConfigError("verify: --config-dir is for a system; name it with system=NAME")
    from ..config import environment

    environment.prepare()
    command = ["mppi-belief", "verify", *args]
    if about_system:
        return _what_holds(configs[0], about_system, folders, command)
    return _certify(configs[0], names or CERTIFICATE_NAMES, command)


def _tool(name: str, args: Sequence[str]) -> int:
    """`mppi-belief results` and `replay`: what is there already, looked at and looked after."""
    from .replay import replay
    from .results import results

    return results(args) if name == "results" else replay(args)


def _key(override: str) -> str:
    return override.lstrip("+~").partition("=")[0]


def _certify(config: dict[str, Any], names: Sequence[str], command: list[str]) -> int:
    """Compute, store and show certificates; the exit code."""
    from tqdm import tqdm

    from ..report.certificate_tables import show_certificates
    from ..results.certificate_files import StoredCertificate, load_certificates, store_certificate
    from ..results.files import probe
    from ..results.provenance import provenance
    from .certify_on_pool import certify_all

    folder, lost = Path(config["verify_dir"]), []
    probe(folder)
    source = provenance(command) | {"seed": config["seed"]}
    with contextlib.closing(certify_all(names, config["seed"], config["workers"])) as done:
        for one in tqdm(done, total=len(names), unit="certificate", disable=None):
            if one.certificate is None:
                lost.append(one.name)
                tqdm.write(f"{one.name} could not be computed: {one.error}", file=sys.stderr)
            else:
                store_certificate(folder, StoredCertificate(one.certificate, one.seconds, source))
    held = show_certificates(
        load_certificates(folder, [name for name in names if name not in lost]),
        load_certificates(folder),
        folder,
    )
    return 0 if held and not lost else NOT_HELD


def _what_holds(
    config: dict[str, Any], overrides: Sequence[str], folders: Sequence[str], command: list[str]
) -> int:
    """Say which statements hold for the system of one configuration."""
    from ..config.targets import allow
    from ..report.certificate_tables import show_system_certificate
    from ..results.certificate_files import StoredCertificate, store_certificate
    from ..results.files import probe
    from ..results.provenance import provenance
    from ..trial import build, check
    from ..verify.own_system import what_holds

    folder = Path(config["verify_dir"]) / "systems"
    probe(folder)
    allow(folders)
    check(config)
    began = time.perf_counter()
    chosen = {group: config["names"][group] for group in ("system", "controller")}
    others = [word for word in overrides if _key(word) not in chosen]
    settings = ", ".join([*(f"{group}={name}" for group, name in chosen.items()), *others])
    temperature, name = config["planner"]["temperature"], "-".join(chosen.values())
    made = what_holds(*build(config), temperature, config["seed"], name, settings)
    store_certificate(
        folder,
        StoredCertificate(
            made, time.perf_counter() - began, provenance(command) | {"seed": config["seed"]}
        ),
    )
    show_system_certificate(made, folder)
    return 0


def _tell(cells: list[Any], root: Path, n_trials: int, outcome: Any) -> int:
    """Print the table, save the pictures, say where everything is."""
    from .overview import show_overview

    failed = show_overview(cells, root, n_trials, outcome)
    if outcome.stopped is not None:
        print("stopped; the same command goes on from here", file=sys.stderr)
        return 128 + int(outcome.stopped)
    return SOME_FAILED if failed else 0
