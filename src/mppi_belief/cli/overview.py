"""Prints the results of a run as a table, draws its trajectories and says where the results are."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from ..config.cell import Cell
from ..errors import counted
from ..report import figures
from ..report.cell_results import CellResults, read_cell_results
from ..report.summary import aligned_text, label_text, summary_text
from ..run.task import StudyOutcome
from .results_request import default_root


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
        lines = [summary_text(cell.rows, cell.labels, cell.seconds) for cell in results]
        print(aligned_text(lines))
    ran = sum(outcome.ran.values())
    stored = sum(outcome.done_before.values())
    print(f"{counted(ran, 'trial')} run, {stored} already done; results in {root}")

    pictures = []
    for cell in results:
        picture = _save_trajectories(root / cell.id, cell, redraw=outcome.ran[cell.id] > 0)
        if picture is not None:
            pictures.append(picture)
    if len(pictures) == 1:
        print(f"picture: {pictures[0]}")
    elif pictures:
        print(f"pictures: {root / '*' / figures.TRAJECTORIES_PNG}")
    if results:
        trial = results[0].rows["trial"].min()
        print(f"one trial again: {replay_command(results[0].id, trial, root, config_dirs)}")
    return failed


def replay_command(cell_id: str, trial: int, root: Path, config_dirs: Sequence[str]) -> str:
    """Returns the command that replays a trial, to be copied into a shell."""
    words = ["mppi-belief", "replay", cell_id, str(trial)]
    if root != Path(default_root()):
        words.append(f"results_dir={root}")
    for folder in config_dirs:
        words += ["--config-dir", folder]
    return shlex.join(words)


def _print_failures(cell: CellResults, root: Path, config_dirs: Sequence[str]) -> int:
    """Prints an example of each kind of failure to stderr, and for an exception the command that
    shows it; returns how many trials failed.
    """
    failed = cell.rows[cell.rows["status"] != "ok"]
    for status, rows in failed.groupby("status"):
        first = rows.iloc[0]
        trial = first["trial"]
        line = f"{cell.id}: {len(rows)} {status}, e.g. trial {trial}: {first['error']}"
        if status == "error":
            line += f"; `{replay_command(cell.id, trial, root, config_dirs)}` shows it"
        print(line, file=sys.stderr)
    return len(failed)


def _save_trajectories(folder: Path, cell: CellResults, *, redraw: bool) -> Path | None:
    """Draws the kept trials unless there is a picture and no `redraw`; None without any."""
    panel = overview_panel(cell)
    if panel is None:
        return None
    picture = folder / figures.TRAJECTORIES_PNG
    if redraw or not picture.exists():
        figures.save_png(figures.trajectories_figure(panel), picture)
    return picture


def overview_panel(cell: CellResults) -> figures.PathPanel | None:
    """Returns a panel of all kept trials, titled with the labels of the cell; None without any."""
    if cell.paths.empty or cell.scene is None:
        return None
    rows = cell.rows
    collided = set(rows.loc[rows["collided"].fillna(False).astype(bool), "trial"])
    labels = [f"{name} {value}" for name, value in cell.labels.items() if label_text(value) != "-"]
    drawn_trials = set(cell.paths["trial"])
    return figures.PathPanel(cell.paths, cell.scene, collided & drawn_trials, ", ".join(labels))
