"""Searches the open choices and numbers for the scenario whose Table I is closest to the paper's.

    python experiments/calibration/search.py --minutes 30 --processes 2
    python experiments/calibration/search.py --fix penalty=hinge --fix variance=sigma_points

The loss is the sum of squared standard errors of Table I's twelve numbers. All candidates are
evaluated with common random numbers. The quickest methods are tried on 24 trials, then on 72 and
200 with EKF-iLQG, and PIPF only for the remaining candidates; hopeless candidates stop early. The
study is a journal file: the same command continues it. A choice that is fixed is not searched.
"""

import argparse
import csv
import math
import multiprocessing
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

import scenario
import structure
from mppi_belief.config import environment
from starts import STARTS

QUICKEST = ("belief", "ce")
QUICK = ("belief", "ce", "ilqg")
STAGES = ((QUICKEST, 24), (QUICK, 72), (QUICK, 200), (("pipf",), 50))


def suggest(trial: optuna.Trial, fixed: dict[str, Any]) -> dict[str, Any]:
    """Returns a candidate, with the choices that are fixed."""
    candidate: dict[str, Any] = {}
    for name, options in structure.CHOICES.items():
        if name in fixed:
            candidate[name] = fixed[name]
        else:
            candidate[name] = trial.suggest_categorical(name, options)
    for name, (low, high, log) in scenario.OPEN.items():
        if scenario.is_open(name, candidate):
            candidate[name] = trial.suggest_float(name, low, high, log=log)
    return candidate


def objective(
    trial: optuna.Trial, bases: dict[str, dict[str, Any]], fixed: dict[str, Any]
) -> float:
    """Returns the loss of one candidate and reports it after every stage."""
    candidate = suggest(trial, fixed)
    trial.set_user_attr("candidate", candidate)
    rows = {method: [] for method in scenario.METHODS}
    loss = {}
    for stage, (methods, n) in enumerate(STAGES):
        for method in methods:
            rows[method] += scenario.run(
                scenario.configure(bases[method], candidate), range(len(rows[method]), n)
            )
            measured = scenario.measure(rows[method])
            trial.set_user_attr(method, [round(value, 4) for value in measured])
            loss[method] = sum(z * z for z in scenario.deviations(method, measured))
        total = sum(loss.values())
        if not math.isfinite(total):
            raise optuna.TrialPruned
        trial.report(total, stage)
        if stage < len(STAGES) - 1 and trial.should_prune():
            raise optuna.TrialPruned
    return total


def open_study(path: Path, seed: int) -> optuna.Study:
    """Opens the study, or creates it."""
    return optuna.create_study(
        study_name="table_1",
        storage=JournalStorage(JournalFileBackend(str(path))),
        sampler=optuna.samplers.TPESampler(
            seed=seed, multivariate=True, group=True, constant_liar=True, n_startup_trials=12
        ),
        pruner=optuna.pruners.PercentilePruner(50.0, n_startup_trials=10),
        load_if_exists=True,
    )


def work(path: Path, minutes: float, seed: int, fixed: dict[str, Any]) -> None:
    """Runs one process of the search."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    bases = scenario.base_configs()
    study = open_study(path, seed)
    study.optimize(lambda trial: objective(trial, bases, fixed), timeout=60 * minutes)


def save_log(study: optuna.Study, path: Path) -> None:
    """Writes a line per candidate: its numbers, its results, and the stage that it reached."""
    names = [*structure.CHOICES, *scenario.OPEN]
    columns = [
        f"{method}_{name}" for method in scenario.METHODS for name in scenario.Measured._fields
    ]
    with path.open("w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["trial", "state", "stage", "loss", *names, *columns])
        for trial in study.get_trials(deepcopy=False):
            if not trial.state.is_finished() or not trial.intermediate_values:
                continue
            stage, loss = max(trial.intermediate_values.items())
            candidate = trial.user_attrs["candidate"]
            tried = [
                structure.shown(candidate[name]) if name in candidate else "" for name in names
            ]
            measured = [
                value for m in scenario.METHODS for value in trial.user_attrs.get(m, [""] * 5)
            ]
            out.writerow(
                [trial.number, trial.state.name.lower(), stage, f"{loss:.2f}", *tried, *measured]
            )


def fixed_choices(words: Sequence[str]) -> dict[str, Any]:
    """Returns the choices that words `NAME=OPTION` fix; raises `SystemExit` for any other."""
    fixed = {}
    for word in words:
        name, _, option = word.partition("=")
        named = {str(each): each for each in structure.CHOICES.get(name, ())}
        if option not in named:
            allowed = ", ".join(named) or f"one of {', '.join(structure.CHOICES)} before the ="
            sys.exit(f"--fix {word}: must be {allowed}")
        fixed[name] = named[option]
    return fixed


def main() -> int:
    """Searches, writes the log and prints the best candidate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--fix", action="append", default=[], metavar="NAME=OPTION")
    parser.add_argument("--journal", type=Path, default=Path("outputs/calibration/journal.log"))
    parser.add_argument("--log", type=Path, default=Path("outputs/calibration/trials.csv"))
    args = parser.parse_args()
    fixed = fixed_choices(args.fix)
    environment.prepare()
    args.journal.parent.mkdir(parents=True, exist_ok=True)
    study = open_study(args.journal, 0)
    for start in STARTS:
        if all(start[name] == option for name, option in fixed.items()):
            study.enqueue_trial(start, skip_if_exists=True)
    context = multiprocessing.get_context("spawn")
    seeds = [time.time_ns() % 2**31 + i for i in range(args.processes)]
    workers = [
        context.Process(target=work, args=(args.journal, args.minutes, seed, fixed))
        for seed in seeds
    ]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    save_log(study, args.log)
    if study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.COMPLETE,)):
        print(study.best_trial.number, study.best_trial.value, study.best_trial.user_attrs)
    return max(abs(worker.exitcode or 0) for worker in workers)


if __name__ == "__main__":
    sys.exit(main())
