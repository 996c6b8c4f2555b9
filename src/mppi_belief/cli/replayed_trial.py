"""Runs one trial of a cell again, compares it bit for bit with what was kept of it, and draws it.

Nothing that a results folder names is looked for on the disk: a user's own code comes from
--config-dir alone.
"""

import os
import sys
import traceback
from pathlib import Path
from typing import Any, NamedTuple

from ..config import environment
from ..config.cell import ALGORITHM_VERSION, IDENTITY, labels
from ..config.targets import allow, fingerprints
from ..errors import ConfigError, counted
from ..report.drawing import drawn
from ..results.contents import CellContents, belongs, path_of, read_cell
from ..results.folder import choose_cell
from ..results.provenance import provenance
from ..results.sources import row_of
from ..run.slow_starts import announced
from . import exit_codes
from .results_request import ResultsRequest
from .tables import commit_label

UNFINISHED = ("crashed", "timeout")  # statuses of trials that no process survived or waited for
LIBRARIES = ("python", "jax", "jaxlib", "numpy", "mppi-belief")  # their versions may change digits


class StoredTrial(NamedTuple):
    """Holds a trial as a results folder has it."""

    folder: Path  # of its cell
    trial: int
    row: dict[str, Any]
    path: list[dict[str, Any]]  # one dict per step; empty where the path was not kept
    source: dict[str, Any]  # metadata of the run that it comes from

    @property
    def config(self) -> dict[str, Any]:
        """Returns the configuration that its row was made with; empty where there is none."""
        config = self.source.get("config")
        return config if isinstance(config, dict) else {}


def replay_trial(request: ResultsRequest, command: list[str]) -> int:
    """Runs the trial of a request again, prints what differs, draws it; returns the exit code."""
    cell, word = request.words
    stored = _stored_trial(read_cell(choose_cell(request.root, cell)), word)
    if stored.row["status"] in UNFINISHED and not request.options.force:
        raise ConfigError(
            f"trial {stored.trial} {stored.row['status']}: {stored.row['error']}; "
            "--force runs it again, in this process"
        )
    variables = environment.prepare(stored.config["platform"])
    source_now = provenance(command)
    os.environ.update(variables)
    folders = request.options.config_dir
    allow(folders)
    source_now["code"] = fingerprints(stored.config, folders)
    return _run_and_compare(stored, source_now)


def changes_since(then: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Returns what has changed since a run of all that may change a trial's last digits."""
    versions_then = then.get("versions") or {}
    code_then = (then.get("config") or {}).get("code") or {}
    threads_then = then.get("threads") or {}
    pairs = [(name, versions_then.get(name), now["versions"][name]) for name in LIBRARIES]
    for name in ("algorithm", "processor", "platform", "device"):
        pairs.append((name, then.get(name), now[name]))
    if then.get("commit"):
        pairs.append(("commit", commit_label(then), commit_label(now)))
    pairs += [(f"code of {name}", code_then.get(name), code) for name, code in now["code"].items()]
    pairs += [(name, threads_then.get(name), value) for name, value in now["threads"].items()]
    if "settings" in then:
        names = sorted({*then["settings"], *now["settings"]})
        for name in names:
            pairs.append((name, then["settings"].get(name, ""), now["settings"].get(name, "")))
    return [
        f"{name} {before}, now {after}"
        for name, before, after in pairs
        if before is not None and before != after
    ]


def _stored_trial(contents: CellContents, word: str) -> StoredTrial:
    """Returns a trial of a cell. Raises `ConfigError` if there is none, or no configuration to run
    it with.
    """
    for line in contents.problems:
        print(line, file=sys.stderr)
    folder = contents.folder
    if not (word.isascii() and word.isdigit()):
        raise ConfigError(f"trial '{word}': must be a whole number, 0 or above")
    row_and_source = row_of(contents, int(word))
    if row_and_source is None:
        trials = contents.rows["trial"]
        extent = (
            f"{counted(len(trials), 'trial')}, {trials.min()} to {trials.max()}"
            if len(trials)
            else "none"
        )
        raise ConfigError(f"{folder.name} has no trial {word}: it has {extent}")
    row, source = row_and_source
    stored = StoredTrial(folder, int(word), row, path_of(contents, int(word)), source)
    missing = [key for key in IDENTITY if key not in stored.config]
    if missing:
        raise ConfigError(
            f"{folder.name} says nothing of '{missing[0]}': "
            "it was made by another version of mppi-belief"
        )
    if source.get("algorithm") == ALGORITHM_VERSION and not belongs(stored.config, folder):
        raise ConfigError(
            f"{folder.name}: the configuration of trial {word} is not that of this cell"
        )
    return stored


def _run_and_compare(stored: StoredTrial, source_now: dict[str, Any]) -> int:
    """Runs the trial, prints what differs, draws it; returns the exit code."""
    from ..trial import device  # imports JAX, for which the environment is prepared by now
    from ..trial.rerun import differences, rerun

    # What is run, and what has changed since.
    config = stored.config
    row = stored.row
    source_now["device"] = device(config)
    origin = f"of {stored.source.get('started', 'an unknown time')}"
    origin += f" at {commit_label(stored.source)}"
    print(
        f"{stored.folder.name}, trial {stored.trial}: "
        f"{row['status']}, cost {row['cost']!r}, {origin}"
    )
    changes = changes_since(stored.source, source_now)
    if changes:
        print(f"not as it was then: {'; '.join(changes)}")

    # The comparison.
    with announced(f"{stored.folder.name}: compiling and computing trial {stored.trial}"):
        batch = rerun(config, stored.trial, traceback.print_exception)
    deviations = differences(row, batch.rows[0], stored.path, batch.paths, config["precision"])
    for difference in deviations:
        print(_difference_line(difference, config["precision"]))
    steps = (
        f"{counted(len(stored.path), 'step')} of its path" if stored.path else "no path was kept"
    )
    verdict = "NOT reproduced" if deviations else "reproduced bit for bit"
    print(f"{verdict}: {len(row)} values of its row, {steps}")
    sys.stdout.flush()
    drawn(f"of trial {stored.trial}", lambda: _draw(stored, batch))
    return exit_codes.INCOMPLETE if deviations else exit_codes.DONE


def _difference_line(difference: Any, precision: str) -> str:
    """Returns a difference as a line: what, where, then and now, and how far apart."""
    where = ""
    if difference.location:
        where = f" at {difference.location}, the first of {difference.values}"
    distance = ""
    if difference.ulp is not None:
        at_most = "at most " if difference.values > 1 else ""
        distance = f"; {at_most}{difference.ulp} ulp of {precision} apart"
    return f"{difference.name}{where}: {difference.then!r}, now {difference.now!r}{distance}"


def _draw(stored: StoredTrial, batch: Any) -> None:
    """Draws the trial as it ran now into the folder of its cell."""
    import pandas as pd

    from ..report import figures
    from ..report.positions import position_first
    from ..report.summary import label_text
    from ..trial.recording import sampled_paths
    from ..trial.rerun import finite_steps

    path = pd.DataFrame(list(finite_steps(batch.paths)))
    steps, scene = position_first(path, batch.scene)
    if len(steps) < 2 or scene is None:
        print("no picture: it has no path")
        return
    try:
        samples = sampled_paths(stored.config, stored.trial)
    except Exception as error:  # a user's own system may lack what sampled paths need
        print(f"no sampled paths in the picture ({type(error).__name__}: {error})", file=sys.stderr)
        samples = None
    texts = {
        name: label_text(value)
        for name, value in (labels(stored.config) | {"trial": stored.trial}).items()
    }
    title = ", ".join(f"{name} {text}" for name, text in texts.items() if text != "-")
    controller = stored.config["names"]["controller"]
    rows: Any = steps.to_dict("records")
    figure = figures.one_trial_figure(rows, scene, samples, controller, title)
    picture = stored.folder / f"replay-{stored.trial}.png"
    figures.save_png(figure, picture)
    print(f"picture: {picture}")
