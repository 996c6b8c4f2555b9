"""Makes up results of studies and writes them as a run does; no trial is run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mppi_belief.config.cell import Cell
from mppi_belief.report.cell_results import CellResults, read_cell_results
from mppi_belief.results import files
from mppi_belief.results import table as results
from mppi_belief.results.columns import PATH_COLUMNS
from study_helpers import config, failed_row, row

SCENE: dict[str, Any] = {
    "dt": 0.1,
    "start": [1.0, 1.0],
    "goal": [7.0, 0.0],
    "obstacles": [[3.0, 1.0], [3.0, -1.0]],
    "radius": 0.65,
    "noise": {
        "x": [-4.0, 5.0, 12.0],
        "y": [-6.0, 6.0],
        "level": [[6.0, 0.1, 5.0], [6.0, 0.1, 5.0]],
    },
}


def cell_of(
    method: str = "belief", theta: float = 1.0, w_obs: float = 500.0, seed: int = 0, **swept: Any
) -> Cell:
    """Returns a cell with these labels."""
    base = config(seed)
    names = base["names"] | {"controller": method}
    groups = {"controller": {"path_cost": {"theta": theta}}, "cost": {"w_obs": w_obs}}
    return Cell(base | groups | {"names": names, "swept": swept})


def spread_values(n: int, mean: float, sd: float) -> np.ndarray:
    """Returns n values with exactly this mean and this standard deviation."""
    if n < 2 or sd == 0:
        return np.full(n, mean)
    values = np.linspace(-1.0, 1.0, n)
    return mean + sd * values / np.std(values, ddof=1)


def trial_rows(
    n: int,
    hits: int = 0,
    cost: tuple[float, float] = (50.0, 6.0),
    clearance: tuple[float, float] = (0.5, 0.2),
) -> list[dict[str, Any]]:
    """Returns rows of n trials with these means and standard deviations; `hits` of them collide."""
    columns = zip(spread_values(n, *cost), spread_values(n, *clearance), strict=True)
    return [
        row(trial, cost=c, clearance=far, collided=trial < hits)
        for trial, (c, far) in enumerate(columns)
    ]


def random_trials(
    rng: np.random.Generator, numbers: Sequence[int], rate: float, cost: float
) -> list[dict[str, Any]]:
    """Returns rows of these trials with random results."""
    return [
        row(
            trial,
            cost=float(rng.normal(cost, 6.0)),
            clearance=float(rng.normal(0.5, 0.2)),
            collided=rng.random() < rate,
        )
        for trial in map(int, numbers)
    ]


def failed_trial(trial: int) -> dict[str, Any]:
    return failed_row({}, trial, "error", "oh dear")


def results_of(
    cell: Cell,
    rows: Sequence[dict[str, Any]],
    wanted: int | None = None,
    sources: Sequence[dict[str, Any]] = (),
    departures: tuple[str, ...] | None = (),
) -> CellResults:
    """Returns the cell with these rows as its results; with the paper's settings, as it is."""
    table = pd.DataFrame(list(rows), columns=[*row(0)])
    wanted = len(rows) if wanted is None else wanted
    paths = pd.DataFrame(columns=[*PATH_COLUMNS])
    return CellResults(
        cell, wanted, table, paths, None, [], None, list(sources), departures=departures
    )


def store_results(
    root: Path,
    cell: Cell,
    rows: Sequence[dict[str, Any]],
    seconds: Sequence[float] = (),
    source: dict[str, Any] | None = None,
) -> Path:
    """Writes rows, ten per file, and wall times of control steps (s); returns the cell's folder."""
    folder = root / cell.id
    for start in range(0, len(rows), 10):
        results.write_rows(
            folder, rows[start : start + 10], {"config": cell.config, **(source or {})}
        )
    if seconds:
        files.write_json(folder, "timing", {"seconds": list(seconds)})
    return folder


def store_pictured(folder: Path, trial: int, steps: int = 3) -> None:
    """Writes what pictures need beside rows: the path of a trial, its scene and its recording."""
    where = [np.array([1.0 + k, 1.0 - k / 4, 1.0, -0.25]) for k in range(steps + 1)]
    cov = 0.02 * np.eye(4).ravel()
    u = np.zeros(2)
    results.write_paths(
        folder,
        [
            {"trial": trial, "step": k, "state": x, "mean": x + 0.1, "cov": cov, "control": u}
            for k, x in enumerate(where)
        ],
    )
    files.write_json(folder, "scene", SCENE)
    samples = [[[[*(x[:2] + h)] for h in (0.0, 0.5)] for _ in range(4)] for x in where[:-1]]
    curves = {"optimum": [0.9, 0.81, None][:steps], "imposed": [3.0, 2.0, 1.5][:steps]}
    files.write_json(
        folder,
        f"recording-{trial}",
        {
            "trial": trial,
            "collided_at": None,
            "samples": {"position": samples, "weight": [[0.4, 0.3, 0.2, 0.1]] * steps},
            "matching": {"sample": curves, "intensity": curves},
        },
    )


def read_all(root: Path, *cells: Cell, wanted: int = 200) -> list[CellResults]:
    """Reads cells as the report does, with the paper's settings; fails if it warns of anything."""
    complaints: list[str] = []
    cells_read = [read_cell_results(cell, root, wanted, complaints.append) for cell in cells]
    assert complaints == []
    return [cell._replace(departures=()) for cell in cells_read]


def rows_on_disk(root: Path, cell: Cell) -> pd.DataFrame:
    """Reads the good rows of a cell by pandas alone."""
    table = pd.concat(
        [pd.read_parquet(path) for path in sorted((root / cell.id).glob("part-*.parquet"))]
    )
    return table[table["status"] == "ok"].set_index("trial").sort_index()
