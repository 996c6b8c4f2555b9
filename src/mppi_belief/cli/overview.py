"""Prints the results of a run as a table, draws its trajectories and says where the results are."""

import shlex
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from ..config.cell import Cell
from ..config.reference import reference_folder
from ..errors import counted
from ..report.cell_results import CellResults, failure_kinds, read_cell_results
from ..report.drawing import drawn
from ..report.summary import BUSY_NOTE, aligned_text, label_text, summary_text
from ..run.task import StudyOutcome
from .results_request import ONLY_SETTING


def show_overview(
    cells: Sequence[Cell],
    root: Path,
    n_trials: int,
    outcome: StudyOutcome,
    config_dirs: Sequence[str] = (),
) -> int:
    """Prints and draws the first `n_trials` trials of each cell; returns how many failed.

    `config_dirs` are the folders of --config-dir, which a replay needs again.
    """
    results = [read_cell_results(cell, root, n_trials) for cell in cells]
    results = [cell for cell in results if len(cell.rows)]
    failed = sum(_print_failures(cell, root, config_dirs) for cell in results)
    if results:
        lines = [summary_text(cell.rows, cell.labels, cell.seconds, cell.busy) for cell in results]
        print(aligned_text(lines))
        if any(cell.busy for cell in results):
            print(BUSY_NOTE)
    ran = sum(outcome.ran.values())
    stored = sum(outcome.done_before.values())
    print(f"{counted(ran, 'trial')} run, {stored} already done; results in {root}")

    pictures = _save_pictures(results, root, outcome)
    if len(pictures) == 1:
        print(f"picture: {pictures[0]}")
    elif pictures:
        print(f"pictures: {root / '*' / pictures[0].name}")
    if results:
        trial = results[0].rows["trial"].min()
        print(f"one trial again: {replay_command(results[0].id, trial, root, config_dirs)}")
    return failed


def replay_command(cell_id: str, trial: int, root: Path, config_dirs: Sequence[str]) -> str:
    """Returns the command that replays a trial, to be copied into a shell."""
    words = ["mppi-belief", "replay", cell_id, str(trial)]
    if root != reference_folder(ONLY_SETTING):
        words.append(f"{ONLY_SETTING}={root}")
    for folder in config_dirs:
        words += ["--config-dir", folder]
    return shlex.join(words)


def _print_failures(cell: CellResults, root: Path, config_dirs: Sequence[str]) -> int:
    """Prints an example of each kind of failure to stderr, and for an exception the command that
    shows it; returns how many trials failed.
    """
    for kind in failure_kinds(cell):
        line = kind.line
        if kind.status == "error":
            line += f"; `{replay_command(cell.id, kind.trial, root, config_dirs)}` shows it"
        print(line, file=sys.stderr)
    return int((cell.rows["status"] != "ok").sum())


def _save_pictures(results: Sequence[CellResults], root: Path, outcome: StudyOutcome) -> list[Path]:
    """Draws the kept trials of each cell; returns the pictures that there are.

    A picture stays as it is if no trial of its cell was run. Where none can be drawn, one line on
    stderr says why.
    """
    pictures = []
    for cell in results:
        redraw = outcome.ran[cell.id] > 0
        picture = drawn(f"of {cell.id}", partial(_save_trajectories, root / cell.id, cell, redraw))
        for part, reason in ((cell.scene or {}).get("left_out") or {}).items():
            if redraw:
                print(f"{cell.id}: no {part} in the picture ({reason})", file=sys.stderr)
        if picture is not None:
            pictures.append(picture)
    return pictures


def _save_trajectories(folder: Path, cell: CellResults, redraw: bool) -> Path | None:
    """Draws the kept trials unless there is a picture and no `redraw`; None without any."""
    from ..report import figures  # imports Matplotlib, without which there is still a table

    panel = figures.kept_panel(cell, cell_title(cell))
    if panel is None:
        if not cell.paths.empty:
            print(f"{cell.id}: no picture, since all kept trials failed", file=sys.stderr)
        return None
    picture = folder / figures.TRAJECTORIES_PNG
    if redraw or not picture.exists():
        figures.save_png(figures.trajectories_figure(panel), picture)
    return picture


def cell_title(cell: CellResults) -> str:
    """Returns the labels of a cell as the title of its picture."""
    labels = [f"{name} {value}" for name, value in cell.labels.items() if label_text(value) != "-"]
    return ", ".join(labels)
