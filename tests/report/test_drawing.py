"""Tests that pictures show what there is, and that none ends a command whose results are safe."""

import copy
import math
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure

from mppi_belief.cli.overview import show_overview
from mppi_belief.report import figures
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.drawing import drawn
from mppi_belief.report.elements import write_picture
from mppi_belief.report.figures import lines, plane
from mppi_belief.results import files
from mppi_belief.results import table as results
from report_helpers import SCENE, cell_of, read_all, trial_rows
from study_helpers import failed_row, row

ORDER = np.array([2, 3, 0, 1])  # a state that begins with the velocity
STEPS = 4
GRID = np.linspace(-2.0, 10.0, 241)
DISC = (5.0, 0.5, 0.8)  # x, y, radius, m
SHAPED = {
    **SCENE,
    "obstacles": [],
    "radius": 0.0,
    "clearance": {
        "x": GRID.tolist(),
        "y": GRID.tolist(),
        "level": (np.hypot(GRID - DISC[0], GRID[:, None] - DISC[1]) - DISC[2]).tolist(),
    },
}  # a disc of another type, known by its clearance alone


def path_rows(trial: int, nx: int = 4, order: Any = None) -> list[dict[str, Any]]:
    """Returns a straight path with a belief beside it, in another order of the state."""
    chosen = np.arange(nx) if order is None else order
    cov = (0.01 * (np.diag(np.arange(1.0, nx + 1)) + 0.2))[np.ix_(chosen, chosen)]
    rows = []
    for k in range(STEPS + 1):
        state = np.array([1.0 + k + 0.1 * trial, 1.0 - 0.3 * k, 1.0, -0.3, 0.5])[:nx][chosen]
        values = {"state": state, "mean": state + 0.1, "cov": cov.ravel()}
        rows.append({"trial": trial, "step": k, **values, "control": np.zeros(1)})
    return rows


def stored_cell(
    root: Path,
    rows: list[dict[str, Any]],
    paths: list[dict[str, Any]],
    scene: dict[str, Any],
    seed: int = 0,
) -> CellResults:
    """Writes results as a run does and reads them as every command does."""
    cell = cell_of(seed=seed)
    folder = root / cell.id
    results.write_paths(folder, paths)
    results.write_rows(folder, rows, {"config": cell.config})
    files.write_json(folder, "scene", scene)
    return read_all(root, cell)[0]


def outcome(cell: CellResults, ran: int = 1) -> Any:
    return SimpleNamespace(ran={cell.id: ran}, done_before={cell.id: 0})


def line_data(axes: Axes) -> list[np.ndarray]:
    return [np.asarray(line.get_xydata(), dtype=float) for line in axes.lines]


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_permuted_state_gives_the_same_picture(tmp_path):
    permuted_scene = SCENE | {"position": [2, 3]}
    cells = [
        stored_cell(tmp_path / "a", trial_rows(2, hits=1), path_rows(0), SCENE),
        stored_cell(
            tmp_path / "b", trial_rows(2, hits=1), path_rows(0, order=ORDER), permuted_scene
        ),
    ]
    for draw in (
        lambda cell: figures.trajectories_figure(figures.kept_panel(cell, "")),
        lambda cell: figures.figure_1([cell]),
        lambda cell: figures.one_trial_figure(
            cell.paths.to_dict("records"), cell.scene, None, "belief", ""
        ),
    ):
        first, second = (draw(cell).axes[0] for cell in cells)
        assert len(first.lines) >= 3
        for line, same in zip(line_data(first), line_data(second), strict=True):
            np.testing.assert_allclose(same, line)
        corners = [axes.viewLim.get_points() for axes in (first, second)]
        np.testing.assert_allclose(*corners)
        shapes = [[patch.get_path().vertices for patch in axes.patches] for axes in (first, second)]
        assert len(shapes[0]) == len(shapes[1])


def test_obstacles_of_any_shape_are_drawn_where_their_clearance_is_zero():
    panel = figures.PathPanel(pd.DataFrame(path_rows(0)), SHAPED, set(), "")
    axes = figures.trajectories_figure(panel).axes[0]
    fill, outline = (item for item in axes.collections if isinstance(item, ContourSet))
    for contour in (fill, outline):
        vertices = np.concatenate([path.vertices for path in contour.get_paths()])
        distances = np.hypot(vertices[:, 0] - DISC[0], vertices[:, 1] - DISC[1])
        np.testing.assert_allclose(distances, DISC[2], atol=2e-3)
    assert plane.has_obstacles(SHAPED)


def test_a_wall_to_the_edge_of_the_map_does_not_widen_the_picture():
    wall = copy.deepcopy(SHAPED)
    wall["clearance"]["level"] = np.tile(9.0 - GRID, (241, 1)).tolist()
    box = plane.view_box([np.array([[1.0, 1.0], [6.0, 0.0]])], wall)
    assert box[1, 0] < 8.0
    assert plane.view_box([np.array([[1.0, 1.0]])], SHAPED)[1, 1] > DISC[1] + 0.9 * DISC[2]


@pytest.mark.parametrize(
    "scene",
    [
        {"obstacles": [[2.45], [9.0]], "radius": 0.35},
        {
            "obstacles": [],
            "radius": 0.0,
            "clearance": {
                "x": GRID.tolist(),
                "level": np.minimum(np.abs(GRID - 2.45), np.abs(GRID - 9.0)) - 0.35,
            },
        },
    ],
    ids=["discs", "any shape"],
)
def test_obstacles_on_a_line_are_bands(scene):
    line = {"dt": 0.1, "start": [0.0], "goal": [1.0], **scene}
    bands = lines.obstacle_bands(line)
    np.testing.assert_allclose(bands, [(2.1, 2.8), (8.65, 9.35)], atol=0.051)
    steps = pd.DataFrame(path_rows(0, nx=1))
    figure = figures.trajectories_figure(figures.PathPanel(steps, line, set(), ""))
    assert legend(figure) == ["1 path", "goal", "obstacle"]
    assert figure.axes[0].get_ylabel() == "x"
    collides = figures.trajectories_figure(figures.PathPanel(steps, line, {0}, "", failed=2))
    texts = ["0 paths", "1 that collides", "2 failed, not drawn", "goal", "obstacle"]
    assert legend(collides) == texts
    assert collides.axes[0].lines[0].get_color() == figures.ORANGE


def test_every_coordinate_of_a_position_in_space_has_a_panel():
    space = {"dt": 0.5, "start": [0, 0, 0], "goal": [1, 2, 3], "obstacles": [], "radius": 0.0}
    space["labels"] = ["east (m)", "north (m)", "height (m)"]
    panel = figures.PathPanel(pd.DataFrame(path_rows(0, nx=3)), space, set(), "")
    panels = figures.trajectories_figure(panel).axes
    assert [axes.get_ylabel() for axes in panels] == space["labels"]
    for index, axes in enumerate(panels):
        times, values = axes.lines[0].get_data()
        np.testing.assert_allclose(times, 0.5 * np.arange(STEPS + 1))
        np.testing.assert_allclose(values, [step["state"][index] for step in path_rows(0, nx=3)])


@pytest.mark.parametrize(
    ("noise", "label"),
    [
        ({}, r"$\sigma_o$"),
        ({"unit": "m"}, r"$\sigma_o$ (m)"),
        ({"unit": "m", "partial": True}, r"$\sigma_o$ of measurements in m"),
        ({"unit": ""}, r"$\sigma_o$"),
    ],
)
def test_the_shading_has_the_unit_of_the_measurements(noise, label):
    scene = SCENE | {"noise": SCENE["noise"] | noise}
    panel = figures.PathPanel(pd.DataFrame(path_rows(0)), scene, set(), "")
    figure = figures.trajectories_figure(panel)
    assert figure.axes[-1].get_ylabel() == label
    assert [figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()] == ["x", "y"]


def test_shading_covers_the_view_and_paths_beyond_are_counted():
    far = path_rows(0) + path_rows(1)
    far[-1]["state"] = np.array([1e9, 0.0, 0.0, 0.0])
    panel = figures.PathPanel(pd.DataFrame(far), SCENE, set(), "")
    figure = figures.trajectories_figure(panel)
    axes = figure.axes[0]
    assert axes.get_xlim()[1] <= SCENE["noise"]["x"][-1]
    assert axes.get_xlim()[0] >= SCENE["noise"]["x"][0]
    assert legend(figure) == ["start", "goal", "2 paths", "1 leaves the picture"]
    both = figures.compare_paths([panel, panel._replace(title="far", failed=2)])
    notes = legend(both)[3:]
    assert notes == [": 1 not or not wholly drawn", "far: 3 not or not wholly drawn"]


def test_a_picture_without_a_map_of_the_noise_has_no_bar():
    scene = {name: value for name, value in SCENE.items() if name != "noise"}
    figure = figures.trajectories_figure(
        figures.PathPanel(pd.DataFrame(path_rows(0)), scene, set(), "")
    )
    assert len(figure.axes) == 1


def test_a_map_with_holes_is_drawn():
    scene = copy.deepcopy(SCENE)
    scene["noise"]["level"][0][1] = math.nan
    panel = figures.PathPanel(pd.DataFrame(path_rows(0)), scene, set(), "")
    figure = figures.trajectories_figure(panel)
    figure.canvas.draw()
    assert figure.axes[0].collections[0].get_clim()[1] == 6.0


def test_where_nothing_can_collide_no_legend_speaks_of_it(tmp_path):
    free = SCENE | {"obstacles": []}
    cell = stored_cell(tmp_path, trial_rows(2), path_rows(0), free)
    figure = figures.figure_1([cell])
    assert not any("collide" in text for text in legend(figure))
    assert figure.axes[0].get_title() == "MPPI-Belief"


def diverged(trial: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Returns row and path of a trial that left the finite numbers."""
    path = path_rows(trial)
    for step in path[2:]:
        step |= {
            "state": np.full(4, np.nan),
            "mean": np.full(4, -np.inf),
            "cov": np.full(16, np.inf),
        }
    return row(trial, status="diverged", cost=math.inf, error="the state left"), path


def test_a_diverged_trial_is_left_out_of_the_picture_and_counted(tmp_path, capsys):
    bad_row, bad_path = diverged(1)
    cell = stored_cell(tmp_path, [row(0), bad_row], path_rows(0) + bad_path, SCENE)
    assert show_overview([cell.cell], tmp_path, 2, outcome(cell)) == 1
    out, err = capsys.readouterr()
    assert f"picture: {tmp_path / cell.id / 'trajectories.png'}" in out
    assert err.splitlines() == [f"{cell.id}: 1 diverged, e.g. trial 1: the state left"]
    figure = figures.trajectories_figure(figures.kept_panel(cell, ""))
    assert legend(figure) == ["start", "goal", "1 path", "1 failed, not drawn"]


def test_trials_that_all_diverged_leave_a_table_and_one_line(tmp_path, capsys):
    bad_row, bad_path = diverged(0)
    cell = stored_cell(tmp_path, [bad_row], bad_path, SCENE)
    assert show_overview([cell.cell], tmp_path, 1, outcome(cell)) == 1
    out, err = capsys.readouterr()
    assert "1 (1 failed)" in out
    assert err.splitlines()[1:] == [f"{cell.id}: no picture, since all kept trials failed"]


def broken(*args: Any, **settings: Any) -> Any:
    raise ZeroDivisionError("a bug of the picture")


def test_a_picture_that_fails_costs_the_overview_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(figures, "trajectories_figure", broken)
    scene = SCENE | {"left_out": {"obstacles": "TypeError: rows"}}
    cell = stored_cell(tmp_path, [row(0)], path_rows(0), scene)
    assert show_overview([cell.cell], tmp_path, 1, outcome(cell)) == 0
    out, err = capsys.readouterr()
    assert "1 trial run" in out
    assert "picture: " not in out
    assert err.splitlines() == [
        f"no picture of {cell.id} (ZeroDivisionError: a bug of the picture)",
        f"{cell.id}: no obstacles in the picture (TypeError: rows)",
    ]


def test_a_picture_of_the_report_that_fails_becomes_a_note(tmp_path, capsys):
    (tmp_path / "fig.png").write_bytes(b"of an earlier report")
    (picture,) = write_picture(tmp_path, "fig", broken, "alt")
    assert picture.file == "fig.png"
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err == "no picture fig (ZeroDivisionError: a bug of the picture)\n"
    assert write_picture(tmp_path, "fig", lambda: None, "alt") == []

    def unwritable() -> Figure:
        figure = Figure()
        figure.text(0.5, 0.5, r"$\nonsense$")
        return figure

    assert len(write_picture(tmp_path, "fig", unwritable, "alt")) == 1
    assert "no picture fig (ValueError" in capsys.readouterr().err


def test_only_errors_are_caught(capsys):
    def interrupted() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        drawn("x", interrupted)
    assert drawn("x", lambda: 3) == 3
    assert capsys.readouterr().err == ""


def test_the_style_of_a_user_changes_no_picture(tmp_path):
    def draw(folder: Path) -> list[bytes]:
        panel = figures.PathPanel(pd.DataFrame(path_rows(0)), SCENE, {0}, "title")
        figures.save_png(figures.trajectories_figure(panel), folder / "a.png")
        rows = [failed_row({}, 5, "error", "oh"), *trial_rows(4, hits=1)]
        cell = stored_cell(folder, rows, path_rows(0), SCENE)
        figures.save_png_and_pdf(figures.figure_1([cell]), folder, "b")
        return [(folder / name).read_bytes() for name in ("a.png", "b.png", "b.pdf")]

    ours = draw(tmp_path / "ours")
    theirs = {
        "axes.facecolor": "red",
        "font.size": 30,
        "lines.linewidth": 9,
        "savefig.bbox": "tight",
        "savefig.transparent": True,
        "hatch.linewidth": 7,
        "path.sketch": (1, 100, 2),
    }
    with mpl.rc_context(theirs):
        assert draw(tmp_path / "theirs") == ours


def test_a_backend_and_a_matplotlibrc_of_a_user_are_not_heeded(tmp_path):
    (tmp_path / "matplotlibrc").write_text("backend: nonsense\nfont.size: many\n")
    code = (
        "from mppi_belief.config.environment import prepare_drawing; prepare_drawing();"
        "import matplotlib as mpl; from mppi_belief.report import figures;"
        "print(mpl.rcParams['backend'], mpl.matplotlib_fname())"
    )
    theirs = {"MPLBACKEND": "module://not_installed.backend", "MATPLOTLIBRC": str(tmp_path)}
    ended = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | theirs,
        capture_output=True,
        text=True,
        check=True,
    )
    assert ended.stdout.split() == ["agg", "/dev/null"]
    assert ended.stderr == ""
