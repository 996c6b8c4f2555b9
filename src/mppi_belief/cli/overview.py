"""What a run leaves on the terminal and beside its results: a table, pictures, where things are."""

import sys
from collections.abc import Sequence
from pathlib import Path

from ..config.cell import Cell
from ..report import figures
from ..report.cell_results import CellResults, read_cell_results
from ..report.summary import aligned_text, label_text, summary_text
from ..run.task import Outcome


def show_overview(cells: Sequence[Cell], root: Path, n_trials: int, outcome: Outcome) -> int:
    """Print and draw the first `n_trials` trials of each cell; the number of failed trials among them."""
    founds = [read_cell_results(cell, root, n_trials) for cell in cells]
    founds = [found for found in founds if len(found.rows)]
    bad = [_tell_failures(found) for found in founds]
    if founds:
        print(
            aligned_text(
                [summary_text(found.rows, found.labels, found.seconds) for found in founds]
            )
        )
    ran, done = sum(outcome.ran.values()), sum(outcome.found.values())
    print(f"{ran} trials run, {done} found done; results in {root}")
    pictures = [
        _draw(root / found.cell.id, found, fresh=outcome.ran[found.cell.id] > 0) for found in founds
    ]
    drawn = [str(picture) for picture in pictures if picture is not None]
    if drawn:
        print(
            f"picture{'s' if len(drawn) > 1 else ''}: {drawn[0] if len(drawn) == 1 else root / '*' / figures.TRAJECTORIES_PNG}"
        )
    return sum(bad)


def _tell_failures(found: CellResults) -> int:
    """Say on stderr what went wrong, an example of each kind; how many trials did."""
    bad = found.rows[found.rows["status"] != "ok"]
    for status, group in bad.groupby("status"):
        example = group.iloc[0]
        line = f"{found.cell.id}: {len(group)} {status}, e.g. trial {example['trial']}: {example['error']}"
        print(line, file=sys.stderr)
    return len(bad)


def _draw(folder: Path, found: CellResults, *, fresh: bool) -> Path | None:
    picture, run = folder / figures.TRAJECTORIES_PNG, as_run(found)
    if run is not None and (fresh or not picture.exists()):
        figures.save_png(figures.trajectories_figure(*run), picture)
    return picture if run is not None else None


def as_run(found: CellResults) -> figures.PathPanel | None:
    """What a picture of the kept trials shows, None without any."""
    if found.paths.empty or found.scene is None:
        return None
    hit = found.rows["collided"].fillna(False).astype(bool)
    collided = set(found.rows.loc[hit, "trial"]) & set(found.paths["trial"])
    title = ", ".join(
        f"{name} {value}" for name, value in found.labels.items() if label_text(value) != "-"
    )
    return figures.PathPanel(found.paths, found.scene, collided, title)
