"""From rows to a table and a picture: what is averaged, how sure it is, what is left out."""

import itertools
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from scipy import stats

from helpers import SIGMAS
from mppi_belief.cli.overview import show_overview
from mppi_belief.config.cell import Cell
from mppi_belief.report import figures
from mppi_belief.report.cell_results import read_cell_results
from mppi_belief.report.elements import cell_lines, write_page_table
from mppi_belief.report.statistics import Estimate, mean_interval, proportion_interval
from mppi_belief.report.summary import BUSY_NOTE, aligned_text, summary_text
from mppi_belief.results import files
from mppi_belief.results import table as results
from study_helpers import config, failed_row, row


@pytest.mark.parametrize("level", [0.5, 0.95, 0.99])
def test_the_mean_has_students_interval(level, rng):
    values = rng.normal(3, 2, size=12)
    low, high = stats.t.interval(level, 11, loc=values.mean(), scale=stats.sem(values))
    np.testing.assert_allclose(mean_interval(values, level), (values.mean(), low, high), rtol=1e-12)


def test_the_mean_interval_covers_as_often_as_it_says(rng):
    n = 4000
    intervals = np.array([mean_interval(sample) for sample in rng.normal(1, 3, size=(n, 5))])
    covered = np.mean((intervals[:, 1] <= 1) & (intervals[:, 2] >= 1))
    assert abs(covered - 0.95) < SIGMAS * math.sqrt(0.95 * 0.05 / n)


@pytest.mark.parametrize(
    ("values", "value"),
    [([], math.nan), ([2.5], 2.5), ([1.0, math.nan], math.nan), ([1.0, math.inf], math.inf)],
)
def test_a_mean_of_too_few_or_of_infinite_values_has_no_interval(values, value):
    np.testing.assert_equal(tuple(mean_interval(np.array(values))), (value, math.nan, math.nan))


def test_equal_values_have_an_interval_of_no_width():
    assert mean_interval(np.full(9, 2.0)) == Estimate(2.0, 2.0, 2.0)


@pytest.mark.parametrize(
    ("successes", "trials"), [(0, 200), (1, 200), (51, 200), (199, 200), (200, 200), (0, 1), (1, 1)]
)
def test_a_proportion_has_the_interval_of_clopper_and_pearson(successes, trials):
    low = stats.beta.ppf(0.025, successes, trials - successes + 1) if successes else 0.0
    high = stats.beta.ppf(0.975, successes + 1, trials - successes) if successes < trials else 1.0
    expected = (successes / trials, low, high)
    np.testing.assert_allclose(
        proportion_interval(successes, trials), expected, rtol=1e-8, atol=1e-15
    )


def test_none_of_two_hundred_and_none_of_none():
    value, low, high = proportion_interval(0, 200)
    assert (value, low, round(100 * high, 2)) == (0, 0, 1.83)
    assert np.all(np.isnan(proportion_interval(0, 0)))


@pytest.mark.parametrize("p", [0.003, 0.05, 0.3, 0.5, 0.98])
def test_the_proportion_interval_covers_at_least_as_often_as_it_says(p):
    intervals = [proportion_interval(k, 40) for k in range(41)]
    covering = [k for k, (_, low, high) in enumerate(intervals) if low <= p <= high]
    assert stats.binom.pmf(covering, 40, p).sum() >= 0.95


def rows(n: int = 20, **changes: Any) -> pd.DataFrame:
    return pd.DataFrame(
        [row(trial, collided=trial < 3, clearance=0.1 * trial, **changes) for trial in range(n)]
    )


def test_a_line_says_what_its_trials_show():
    line = summary_text(
        rows(), {"controller": "belief", "theta": 0.5, "w_obs": math.nan}, [1e-3] * 99 + [1.0]
    )
    value, low, high = mean_interval(np.arange(20) + 3.0)
    assert line["cost [95 %]"] == f"{value:.2f} [{low:.2f}, {high:.2f}]"
    assert line["collided % [95 %]"] == "15.0 [3.2, 37.9]"
    assert line["clearance m [95 %]"].startswith("0.950 [")
    assert line["sd"] == f"{np.std(np.arange(20), ddof=1):.2f}"
    assert (line["controller"], line["theta"], line["w_obs"]) == ("belief", "0.5", "-")
    assert (line["trials"], line["ESS"], line["ms/step (p95)"]) == ("20", "8.0", "1.00 (1.00)")


def test_failed_trials_are_counted_and_in_no_average():
    bad = [failed_row({}, 90, "error", "oh"), failed_row({}, 91, "crashed", "gone")]
    diverged = row(92, status="diverged", cost=math.inf, collided=True, clearance=-9.0)
    mixed = pd.concat([rows(), pd.DataFrame([*bad, diverged])], ignore_index=True)
    clean = summary_text(rows(), {}, None)
    line = summary_text(mixed, {}, None)
    assert line.pop("trials") == "23 (3 failed)"
    clean.pop("trials")
    assert line == clean
    assert "ms/step (p95)" not in line


def test_a_line_of_failures_only_or_of_one_trial_can_be_written():
    failures = summary_text(
        pd.DataFrame([failed_row({}, trial, "error", "oh") for trial in range(2)]), {}, None
    )
    assert (failures["trials"], failures["cost [95 %]"], failures["collided % [95 %]"]) == (
        "2 (2 failed)",
        "-",
        "-",
    )
    single = summary_text(rows(1), {}, [])
    assert (single["cost [95 %]"], single["sd"]) == ("3.00", "-")
    far = summary_text(rows().assign(clearance=math.inf), {}, None)
    assert far["clearance m [95 %]"] == "-"


def test_a_table_has_a_header_and_a_row_for_every_line():
    text = aligned_text(
        [{"controller": "belief", "theta": "1"}, {"controller": "ce", "trials": "5"}]
    )
    assert [line.split() for line in text.splitlines()] == [
        ["controller", "theta", "trials"],
        ["belief", "1", "-"],
        ["ce", "-", "5"],
    ]


def paths(trials: int, nx: int) -> list[dict[str, Any]]:
    arrays = {"mean": np.zeros(nx), "cov": np.eye(nx).ravel(), "control": np.zeros(1)}
    return [
        {"trial": trial, "step": k, "state": np.full(nx, trial + 0.1 * k), **arrays}
        for trial, k in itertools.product(range(trials), range(4))
    ]


def plane(obstacles: list[list[float]]) -> dict[str, Any]:
    noise = {"x": [-9.0, 5.0, 15.0], "y": [-9.0, 15.0], "level": [[0.3, 0.1, 0.2]] * 2}
    return {
        "dt": 0.1,
        "start": [1, 1],
        "goal": [7, 0],
        "obstacles": obstacles,
        "radius": 0.65,
        "noise": noise,
    }


def settings() -> dict[str, Any]:
    """Returns Matplotlib's settings without the backend, which it chooses on first use."""
    return {name: value for name, value in mpl.rcParams.items() if name != "backend"}


LINE = {"dt": 0.1, "start": [2.0], "goal": [0.0], "obstacles": [], "radius": 0.0}


@pytest.mark.parametrize(
    ("scene", "nx"),
    [(plane([[3, 1], [3, -1]]), 4), (plane([]), 2), (LINE, 1)],
    ids=["plane", "plane without obstacles", "line"],
)
def test_pictures_of_the_plane_and_of_a_line_over_time(scene, nx, tmp_path):
    table = pd.DataFrame(paths(3, nx))
    before = settings()
    figure = figures.trajectories_figure(figures.PathPanel(table, scene, {1}, "a title"))
    assert figure.axes[0].get_title() == "a title"
    figures.save_png(figure, tmp_path / "picture.png")
    image = imread(tmp_path / "picture.png")
    assert image.shape[1] == 1440
    assert 600 < image.shape[0] < 1100
    assert 0.01 < np.mean(image[..., :3].min(axis=-1) < 0.9) < 0.9
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    assert settings() == before


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_picture_shows_every_path_and_says_which_collide():
    panel = figures.PathPanel(pd.DataFrame(paths(3, 4)), plane([[3, 1]]), {1}, "")
    figure = figures.trajectories_figure(panel)
    axes = figure.axes[0]
    true_paths = [line for line in axes.lines if len(line.get_xdata()) == 4]
    assert [line.get_color() for line in true_paths] == [figures.BLUE, figures.ORANGE, figures.BLUE]
    np.testing.assert_allclose(
        true_paths[2].get_xydata(), np.repeat(2 + 0.1 * np.arange(4)[:, None], 2, axis=1)
    )
    assert legend(figure) == ["start", "goal", "2 paths", "1 that collides"]
    low, high = axes.get_xlim()
    bottom, top = axes.get_ylim()
    assert low < 1 < 7 < high
    assert bottom < 0 < 2.3 < top
    free = panel._replace(scene=plane([]), collided=set())
    assert legend(figures.trajectories_figure(free)) == ["start", "goal", "3 paths"]


def test_pictures_can_be_compared_on_one_scale():
    runs = [
        figures.PathPanel(pd.DataFrame(paths(n, 4)), plane([[3, 1]]), set(), f"{n} trials")
        for n in (1, 2, 12)
    ]
    figure = figures.compare_paths(runs)
    assert legend(figure) == ["start", "goal", "a trial"]
    assert (
        legend(figures.compare_paths([*runs, runs[0]._replace(collided={0})]))[3]
        == "a trial that collides"
    )
    panels = figure.axes[:4]
    assert [axes.get_title() for axes in panels if axes.get_visible()] == [
        "1 trials",
        "2 trials",
        "12 trials",
    ]
    assert len({axes.get_xlim() for axes in panels[:3]}) == 1
    assert panels[0].get_xlim()[1] > 11.3


def stored(root: Path, *table: dict[str, Any], **cell: Any) -> Cell:
    """Stores a cell with results."""
    stored_cell = Cell(config(**cell))
    folder = root / stored_cell.id
    results.write_rows(folder, table, {})
    results.write_paths(folder, paths(2, 1))
    files.write_json(folder, "scene", LINE)
    files.write_json(folder, "timing", {"seconds": [1e-3]})
    return stored_cell


def outcome(ran: dict[str, int], stored: int = 0) -> Any:
    return SimpleNamespace(ran=ran, done_before=dict.fromkeys(ran, stored))


def test_the_overview_prints_a_table_draws_and_counts_failures(tmp_path, capsys):
    good = stored(tmp_path, *(row(trial) for trial in range(4)))
    bad = stored(
        tmp_path,
        row(0),
        failed_row({}, 1, "error", "oh dear"),
        failed_row({}, 9, "crashed", "late"),
        seed=1,
    )
    assert show_overview([good, bad], tmp_path, 4, outcome({good.id: 4, bad.id: 0}, 2)) == 1
    out, err = capsys.readouterr()
    header, first, second, counts, pictures, again = out.splitlines()
    assert header.split()[:5] == ["controller", "theta", "w_obs", "seed", "trials"]
    assert (first.split()[3:5], second.split()[3:7]) == (["0", "4"], ["1", "2", "(1", "failed)"])
    assert counts == f"4 trials run, 4 already done; results in {tmp_path}"
    command = f"mppi-belief replay {bad.id} 1 results_dir={tmp_path}"
    assert err == f"{bad.id}: 1 error, e.g. trial 1: oh dear; `{command}` shows it\n"
    assert figures.TRAJECTORIES_PNG in pictures
    assert again == f"one trial again: mppi-belief replay {good.id} 0 results_dir={tmp_path}"
    assert all(
        (tmp_path / cell.id / figures.TRAJECTORIES_PNG).stat().st_size > 5000
        for cell in (good, bad)
    )


def test_a_picture_is_drawn_again_only_when_trials_came(tmp_path, capsys):
    cell = stored(tmp_path, row(0), row(1))
    picture = tmp_path / cell.id / figures.TRAJECTORIES_PNG
    show_overview([cell], tmp_path, 2, outcome({cell.id: 0}))
    picture.write_bytes(b"mine")
    show_overview([cell], tmp_path, 2, outcome({cell.id: 0}))
    assert picture.read_bytes() == b"mine"
    show_overview([cell], tmp_path, 2, outcome({cell.id: 2}))
    assert picture.read_bytes() != b"mine"
    assert str(picture) in capsys.readouterr().out


def test_times_of_a_busy_machine_are_marked_and_explained(tmp_path, capsys):
    cell = stored(tmp_path, row(0), row(1))
    timing = {"seconds": [2e-3], "cpu_share": 0.5, "load": 1.0}
    files.write_json(tmp_path / cell.id, "timing", timing)
    show_overview([cell], tmp_path, 2, outcome({cell.id: 0}))
    out = capsys.readouterr().out
    assert "2.00 (2.00)*" in out
    assert BUSY_NOTE in out.splitlines()

    # On the page: the mark in the table, its meaning in the caption.
    results_of_cell = read_cell_results(cell, tmp_path, 2)
    frame = cell_lines([results_of_cell])
    table = write_page_table(tmp_path, "table", "All cells", frame, [results_of_cell])
    assert table.frame["ms/step (p95)"].tolist() == ["2.00 (2.00)*"]
    assert table.caption == f"All cells. {BUSY_NOTE}"
    files.write_json(tmp_path / cell.id, "timing", timing | {"cpu_share": 1.0})
    calm = read_cell_results(cell, tmp_path, 2)
    assert write_page_table(tmp_path, "table", "All cells", frame, [calm]).caption == "All cells"


def test_an_overview_of_nothing_is_possible(tmp_path, capsys):
    cell = Cell(config())
    assert show_overview([cell], tmp_path, 5, outcome({cell.id: 0})) == 0
    assert capsys.readouterr().out == f"0 trials run, 0 already done; results in {tmp_path}\n"
