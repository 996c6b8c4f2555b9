"""What a run leaves on the terminal and beside its results: a table, pictures, where things are."""

import sys
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from ..settings import labels
from ..study import results
from ..study.plan import Cell
from ..study.runner import Outcome
from . import figures
from .summary import as_text, summarise


def overview(cells: Sequence[Cell], root: Path, n_trials: int, outcome: Outcome) -> int:
    """Print and draw the first `n_trials` trials of each cell; the number of failed trials among them."""
    lines, failed, pictures = [], 0, []
    for cell in cells:
        folder = root / cell.id
        rows = results.read_rows(folder)
        rows = rows[rows["trial"] < n_trials]
        if rows.empty:
            continue
        bad = rows[rows["status"] != "ok"]
        failed += len(bad)
        for status, group in bad.groupby("status"):
            print(
                f"{cell.id}: {len(group)} {status}, e.g. trial {group.iloc[0]['trial']}: {group.iloc[0]['error']}",
                file=sys.stderr,
            )
        timing = results.read_json(folder, "timing")
        lines.append(summarise(rows, labels(cell.config), timing and timing["seconds"]))
        pictures.append(_draw(folder, cell, rows, fresh=outcome.ran[cell.id] > 0))
    if lines:
        print(as_text(lines))
    ran, found = sum(outcome.ran.values()), sum(outcome.found.values())
    print(f"{ran} trials run, {found} found done; results in {root}")
    drawn = [str(picture) for picture in pictures if picture is not None]
    if drawn:
        print(f"picture{'s' if len(drawn) > 1 else ''}: {drawn[0] if len(drawn) == 1 else root / '*' / figures.NAME}")
    return failed


def _draw(folder: Path, cell: Cell, rows: pd.DataFrame, *, fresh: bool) -> Path | None:
    picture, run = folder / figures.NAME, shown(folder, cell, rows)
    if run is not None and (fresh or not picture.exists()):
        figures.save(figures.trajectories(*run), picture)
    return picture if run is not None else None


def shown(folder: Path, cell: Cell, rows: pd.DataFrame) -> figures.Run | None:
    """What a picture can show of these rows' trials, None without kept paths."""
    paths, scene = results.read_paths(folder), results.read_json(folder, "scene")
    paths = paths[paths["trial"].isin(rows["trial"])]
    if paths.empty or scene is None:
        return None
    collided = set(rows.loc[rows["collided"].fillna(False).astype(bool), "trial"]) & set(paths["trial"])
    title = ", ".join(f"{name} {value}" for name, value in labels(cell.config).items() if value == value)
    return figures.Run(paths, scene, collided, title)
