"""What a run leaves on the terminal and beside its results: a table, pictures, where things are."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import pandas as pd

from ..study import results
from . import figures
from .summary import as_text, summarise


class _Cell(Protocol):
    @property
    def config(self) -> dict[str, Any]: ...

    @property
    def id(self) -> str: ...


class _Outcome(Protocol):
    @property
    def ran(self) -> dict[str, int]: ...

    @property
    def found(self) -> dict[str, int]: ...


def overview(cells: Sequence[_Cell], root: Path, n_trials: int, outcome: _Outcome) -> int:
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
        lines.append(summarise(rows, _labels(cell.config), timing and timing["seconds"]))
        pictures.append(_draw(folder, cell, rows, fresh=outcome.ran[cell.id] > 0))
    if lines:
        print(as_text(lines))
    ran, found = sum(outcome.ran.values()), sum(outcome.found.values())
    print(f"{ran} trials run, {found} found done; results in {root}")
    drawn = [str(picture) for picture in pictures if picture is not None]
    if drawn:
        print(f"picture{'s' if len(drawn) > 1 else ''}: {drawn[0] if len(drawn) == 1 else root / '*' / figures.NAME}")
    return failed


def _labels(config: dict[str, Any]) -> dict[str, Any]:
    nothing = float("nan")
    labels = {
        "controller": config["names"]["controller"],
        "theta": config["controller"].get("theta", nothing),
        "w_obs": config["cost"].get("w_obs", nothing),
        "seed": config["seed"],
    }
    return labels | {name: value for name, value in config["swept"].items() if name not in labels}


def _draw(folder: Path, cell: _Cell, rows: pd.DataFrame, *, fresh: bool) -> Path | None:
    picture, run = folder / figures.NAME, shown(folder, cell, rows)
    if run is not None and (fresh or not picture.exists()):
        figures.save(figures.trajectories(*run), picture)
    return picture if run is not None else None


def shown(folder: Path, cell: _Cell, rows: pd.DataFrame) -> figures.Run | None:
    """What a picture can show of these rows' trials, None without kept paths."""
    paths, scene = results.read_paths(folder), results.read_json(folder, "scene")
    paths = paths[paths["trial"].isin(rows["trial"])]
    if paths.empty or scene is None:
        return None
    collided = set(rows.loc[rows["collided"].fillna(False).astype(bool), "trial"]) & set(paths["trial"])
    title = ", ".join(f"{name} {value}" for name, value in _labels(cell.config).items() if value == value)
    return figures.Run(paths, scene, collided, title)
