"""The figures of a report: what is drawn is what the results say."""

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import Circle, Ellipse
from PIL import Image, ImageSequence
from scipy import stats

from mppi_belief.config.cell import Cell
from mppi_belief.report import figures, published
from mppi_belief.report.cell_results import METHOD_NAMES, CellResults
from mppi_belief.report.figures import plane, points, style
from mppi_belief.results.columns import COLUMNS, PATH_COLUMNS
from study_helpers import config, failed_row, row

STEPS = 14
COLLIDED_AT = 4  # of the recorded trials
DT = 0.1
OBSTACLES = [[3.0, 1.0], [3.0, -1.0]]
RADIUS = 0.65
X = np.linspace(-3, 11, 15)
Y = np.linspace(-5, 6, 12)
NOISE = {
    "x": X.tolist(),
    "y": Y.tolist(),
    "level": np.tile(np.abs(X - 5) / math.sqrt(2) + 0.1, (12, 1)).tolist(),
}
SCENE = {
    "dt": DT,
    "start": [1.0, 1.0],
    "goal": [7.0, 0.0],
    "obstacles": OBSTACLES,
    "radius": RADIUS,
    "noise": NOISE,
}
LINE = {"dt": DT, "start": [2.0], "goal": [0.0], "obstacles": [], "radius": 0.0}
MATCHING = {
    "sample": {"optimum": [1.0, None, 0.6], "imposed": [1e4, 50.0, None]},
    "intensity": {"optimum": [0.9, 0.8, 0.7], "imposed": [1e5, 20.0, 30.0]},
}


def cell(method: str = "belief", theta: float = 1.0, w_obs: float = 500.0, **swept: Any) -> Cell:
    configuration = config()
    names = configuration["names"] | {"controller": method}
    return Cell(
        configuration
        | {
            "names": names,
            "swept": swept,
            "controller": {"path_cost": {"theta": theta}},
            "cost": {"w_obs": w_obs},
        }
    )


def judged(n: int, hits: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    numbers = {"cost": (50, 5), "clearance": (0.5, 0.1), "ess": (20, 3)}
    return [
        row(
            k,
            collided=k < hits,
            **{name: rng.normal(mean, sd) for name, (mean, sd) in numbers.items()},
        )
        for k in range(n)
    ]


def steps(trial: int, nx: int = 4) -> list[dict[str, Any]]:
    """Returns a path past the obstacles (trial 0: through one) and a turning, growing belief."""
    path = []
    for k in range(STEPS + 1):
        part = k / STEPS
        angle = 0.3 * k
        state = np.array([1 + 6 * part, 1 - part + 0.2 * trial, 0.1, 0.2])[:nx]
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        cov = np.eye(4)
        cov[:2, :2] = turn @ np.diag([0.04 + 0.02 * k, 0.01]) @ turn.T
        parts = {
            "state": state,
            "mean": state + 0.1,
            "cov": cov[:nx, :nx].ravel(),
            "control": np.zeros(2),
        }
        path.append({"trial": trial, "step": k, **parts})
    return path


def recording(trial: int = 0, samples: bool = True) -> dict[str, Any]:
    rng = np.random.default_rng(7)
    positions = np.cumsum(rng.normal(0.3, 0.2, size=(STEPS, 8, 5, 2)), axis=2) + 1
    weights = rng.dirichlet(np.ones(8), size=STEPS)
    sampled = {"position": positions.tolist(), "weight": weights.tolist()}
    return {
        "trial": trial,
        "collided_at": COLLIDED_AT,
        "samples": sampled if samples else None,
        "matching": MATCHING,
    }


def cell_with(
    configured: Cell | None = None,
    n: int = 20,
    hits: int = 3,
    with_paths: int = 0,
    scene: dict[str, Any] | None = SCENE,
    seconds: Sequence[float] = (),
    record: dict[str, Any] | None = None,
    bad: Sequence[dict[str, Any]] = (),
    seed: int = 0,
    departures: tuple[str, ...] | None = (),
) -> CellResults:
    """Returns a cell with n good trials, `with_paths` of them with paths, and some bad ones."""
    rows = pd.DataFrame(
        [*judged(n, hits, np.random.default_rng(seed)), *bad], columns=list(COLUMNS)
    )
    nx = 4 if scene is None else 2 * len(scene["start"])
    path_rows = itertools.chain.from_iterable(steps(trial, nx) for trial in range(with_paths))
    paths = pd.DataFrame(list(path_rows), columns=PATH_COLUMNS)
    return CellResults(
        configured or cell(),
        n + len(bad),
        rows,
        paths,
        scene if with_paths else None,
        list(seconds),
        record,
        [],
        departures=departures,
    )


BAD = (
    failed_row({}, 90, "error", "oh"),
    row(91, status="diverged", cost=math.inf, collided=True, clearance=-9.0),
)


def drawn_series(axes: Axes) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Returns by label the points (n, 2) and the lower and upper ends of their bars."""
    series = {}
    for bars in axes.containers:
        assert isinstance(bars, ErrorbarContainer)
        line, _, (segments,) = bars.lines
        ends = [np.reshape(segment, (-1, 2))[:, 1] for segment in segments.get_segments()]
        low, high = (
            np.array([end if len(end) == 2 else [np.nan, np.nan] for end in ends]).reshape(-1, 2).T
        )
        series[bars.get_label()] = (line.get_xydata(), low, high)
    return series


def rate(hits: int, n: int) -> tuple[float, float, float]:
    low = stats.beta.ppf(0.025, hits, n - hits + 1) if hits else 0.0
    high = stats.beta.ppf(0.975, hits + 1, n - hits) if hits < n else 1.0
    return 100 * hits / n, 100 * low, 100 * high


def mean(values: pd.Series) -> tuple[float, float, float]:
    return (
        values.mean(),
        *stats.t.interval(0.95, len(values) - 1, loc=values.mean(), scale=stats.sem(values)),
    )


def agree(
    line: tuple[np.ndarray, np.ndarray, np.ndarray], expected: Sequence[tuple[float, float, float]]
) -> None:
    np.testing.assert_allclose(
        np.stack([line[0][:, 1], line[1], line[2]], axis=1), expected, rtol=1e-6, atol=1e-9
    )


def colours(axes: Axes) -> dict[str, str]:
    return {bars.get_label(): to_hex(bars.lines[0].get_color()) for bars in axes.containers}


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.fixture(autouse=True)
def settings_stay() -> Iterator[None]:
    before = {name: value for name, value in mpl.rcParams.items() if name != "backend"}
    yield
    assert {name: value for name, value in mpl.rcParams.items() if name != "backend"} == before


def test_every_method_has_its_own_colour_marker_and_line():
    assert set(style.METHOD_LOOKS) == set(METHOD_NAMES)
    looks = [*style.METHOD_LOOKS.values(), figures.method_look("mine")]
    assert (
        len({look.colour for look in looks}) == len({look.marker for look in looks}) == len(looks)
    )
    assert len({str(look.line) for look in style.METHOD_LOOKS.values()}) == len(style.METHOD_LOOKS)
    assert style.ORANGE not in {look.colour for look in looks}
    assert sorted(["mine", "ilqg", "ce", "pipf", "belief"], key=style.method_order) == [
        *[*style.METHOD_LOOKS][:4],
        "mine",
    ]


def test_text_is_legible_in_a_column():
    figure = figures.figure_2([cell_with()])
    sizes = {text.get_fontsize() for text in figure.findobj(mpl.text.Text) if text.get_text()}
    assert figure.get_figwidth() == 3.5
    assert min(sizes) >= 7


def many(methods: int) -> list[CellResults]:
    return [
        cell_with(cell(method), with_paths=1, hits=0) for method in [*style.METHOD_LOOKS][:methods]
    ]


@pytest.mark.parametrize(
    ("draw", "methods"),
    [
        (figures.figure_1, 1),
        (figures.figure_1, 3),
        (figures.figure_1, 4),
        (figures.figure_2, 4),
        (figures.theta_figure, 4),
    ],
)
def test_no_text_is_cut_off_or_written_over_another(draw, methods):
    figure = draw(many(methods))
    FigureCanvasAgg(figure).draw()
    shown = [axes for axes in figure.axes if axes.get_visible()]
    words = [text for axes in shown for text in (axes.title, axes.xaxis.label, axes.yaxis.label)]
    written = [
        text
        for text in [*words, *figure.legends[0].get_texts()]
        if text.get_text() and text.get_visible()
    ]
    boxes = [text.get_window_extent() for text in written]
    assert len(boxes) > 6
    for box in boxes:
        assert 0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert 0 <= box.y0 < box.y1 <= figure.bbox.y1
    assert not any(first.overlaps(second) for first, second in itertools.combinations(boxes, 2))


def test_the_same_results_are_the_same_bytes(tmp_path):
    for folder in ("one", "two"):
        figure = figures.figure_1([cell_with(with_paths=2)])
        assert figures.save_png_and_pdf(figure, tmp_path / folder, "fig") == ["fig.png", "fig.pdf"]
    for name in ("fig.png", "fig.pdf"):
        first, second = ((tmp_path / folder / name).read_bytes() for folder in ("one", "two"))
        assert first == second
        assert b"Date" not in first
    assert imread(tmp_path / "one/fig.png").shape[1] == 700
    assert (tmp_path / "one/fig.pdf").read_bytes().startswith(b"%PDF")
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == ["fig.pdf", "fig.png"]


def test_a_picture_that_cannot_be_written_leaves_the_one_before(tmp_path):
    (tmp_path / "fig.png").write_bytes(b"before")
    figure = Figure()
    figure.text(0.5, 0.5, r"$\nonsense$")
    with pytest.raises(ValueError):
        figures.save_png_and_pdf(figure, tmp_path, "fig")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"before"]


def panels(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.get_title() and axes.get_visible()]


def trial_lines(axes: Axes) -> list[Any]:
    return [line for line in axes.lines if len(line.get_xdata()) == STEPS + 1]


def ellipses(axes: Axes) -> list[Ellipse]:
    return [
        patch
        for patch in axes.patches
        if isinstance(patch, Ellipse) and not isinstance(patch, Circle)
    ]


def test_figure_1_has_a_panel_a_method_in_order_with_the_rate_of_all_good_trials():
    cells = [
        cell_with(cell("ilqg"), n=40, hits=9, with_paths=3, bad=BAD),
        cell_with(n=40, hits=1, with_paths=3),
        cell_with(cell("mine"), with_paths=1),
    ]
    figure = figures.figure_1(cells)
    titles = ["MPPI-Belief, 2.5 % collide", "EKF-iLQG, 22.5 % collide", "mine, 15.0 % collide"]
    assert [axes.get_title() for axes in panels(figure)] == titles
    assert len({(axes.get_xlim(), axes.get_ylim()) for axes in panels(figure)}) == 1
    assert legend(figure)[:4] == ["start", "goal", "a trial", "a trial that collides"]


def test_paths_are_those_of_the_trials_and_those_that_collide_are_set_apart():
    axes = panels(figures.figure_1([cell_with(cell("pipf"), hits=2, with_paths=3)]))[0]
    lines = trial_lines(axes)
    assert [to_hex(line.get_color()).upper() for line in lines] == [
        style.ORANGE,
        style.ORANGE,
        style.method_look("pipf").colour,
    ]
    for trial, line in enumerate(lines):
        np.testing.assert_allclose(line.get_xydata(), [step["state"][:2] for step in steps(trial)])
    centers = [patch.center for patch in axes.patches if isinstance(patch, Circle)]
    np.testing.assert_allclose(centers, OBSTACLES)
    low, high = axes.get_xlim()
    assert low < 1 - 0.2 < 7 + 0.2 < high


@pytest.mark.parametrize(
    ("record", "trial"), [(None, 0), (1, 1), (7, 0)], ids=["not recorded", "recorded", "lost"]
)
def test_ellipses_are_two_standard_deviations_of_one_trial(record, trial):
    given = cell_with(with_paths=3, record=None if record is None else recording(record))
    axes = panels(figures.figure_1([given]))[0]
    chosen = steps(trial)[::6]
    assert len(ellipses(axes)) == len(chosen) == 3
    for shape, step in zip(ellipses(axes), chosen, strict=True):
        cov = step["cov"].reshape(4, 4)[:2, :2]
        np.testing.assert_allclose(shape.center, step["mean"][:2])
        sizes = 4 * np.sqrt(np.linalg.eigvalsh(cov))
        np.testing.assert_allclose(sorted([shape.width, shape.height]), sizes, rtol=1e-9)
        edge = (shape.get_patch_transform().transform(shape.get_path().vertices) - shape.center) / 2
        np.testing.assert_allclose(
            np.sum(edge * np.linalg.solve(cov, edge.T).T, axis=1).min(), 1, rtol=1e-3
        )
    widths = [line.get_linewidth() for line in trial_lines(axes)]
    assert np.argmax(widths) == trial
    assert sorted(widths)[1] < max(widths)


def test_shading_is_sigma_o_with_one_bar():
    figure = figures.figure_1([cell_with(with_paths=1), cell_with(cell("ce"), with_paths=2)])
    meshes = [axes.collections[0] for axes in panels(figure)]
    assert [mesh.get_clim() for mesh in meshes] == [meshes[0].get_clim()] * 2
    low, high = panels(figure)[0].get_xlim()
    inside = [level for x, level in zip(X, NOISE["level"][0], strict=True) if low <= x <= high]
    assert meshes[0].get_clim() == (0, max(inside))
    np.testing.assert_allclose(meshes[0].get_array(), NOISE["level"])
    assert len(figure.axes) == 3


def test_failed_trials_lines_and_cells_without_paths_are_left_out():
    diverged = cell_with(n=2, hits=0, with_paths=3, bad=[row(2, status="diverged", cost=math.inf)])
    wild = diverged.paths["trial"] == 2
    diverged.paths.loc[wild, "state"] = pd.Series(
        [np.full(4, np.inf)] * wild.sum(), index=diverged.paths.index[wild]
    )
    line = cell_with(cell("lqg"), with_paths=2, scene=LINE)
    bare = cell_with(cell("ce"))
    figure = figures.figure_1([line, diverged, bare])
    assert [axes.get_title() for axes in panels(figure)] == ["MPPI-Belief, 0.0 % collide"]
    assert len(trial_lines(panels(figure)[0])) == 2
    assert figures.figure_1([line, bare]) is None
    assert figures.figure_1([]) is None
    assert figures.figure_1([cell_with(n=0, with_paths=1)]) is None


def test_a_belief_that_is_not_finite_has_no_ellipse():
    given = cell_with(with_paths=1)
    given.paths.at[6, "cov"] = np.full(16, np.nan)
    assert len(ellipses(panels(figures.figure_1([given]))[0])) == 2


SETTINGS = tuple(itertools.product(("ilqg", "belief"), (100.0, 1000.0, 10000.0)))


def weights(n: int = 12) -> list[CellResults]:
    return [
        cell_with(cell(method, w_obs=w), n=n, hits=k, bad=BAD, seed=k)
        for k, (method, w) in enumerate(SETTINGS)
    ]


def test_figure_2_shows_rates_costs_and_their_intervals():
    given = weights()
    rates, costs = figures.figure_2(given[::-1]).axes
    assert [*drawn_series(rates)] == [*drawn_series(costs)] == ["MPPI-Belief", "EKF-iLQG"]
    agree(drawn_series(rates)["EKF-iLQG"], [rate(k, 12) for k in range(3)])
    agree(drawn_series(rates)["MPPI-Belief"], [rate(k, 12) for k in range(3, 6)])
    agree(drawn_series(costs)["EKF-iLQG"], [mean(cell.rows["cost"][:12]) for cell in given[:3]])
    agree(drawn_series(costs)["MPPI-Belief"], [mean(cell.rows["cost"][:12]) for cell in given[3:]])


def test_points_stand_beside_each_other_at_their_weight():
    axes = figures.figure_2(weights()).axes[0]
    x = np.array([line[0][:, 0] for line in drawn_series(axes).values()])
    np.testing.assert_allclose(np.sqrt(x[0] * x[1]), [100, 1000, 10000])
    assert np.all(x[1] / x[0] > 1.03)
    assert np.all(x[1] / x[0] < 1.2)
    assert axes.get_xscale() == "log"


def test_what_the_paper_says_is_marked():
    figure = figures.figure_2(weights())
    band = figure.axes[0].collections[0].get_datalim(figure.axes[0].transData)
    np.testing.assert_allclose([band.x0, band.x1, band.y0, band.y1], [1e2, 1e4, 11, 33])
    hollow = [line for line in figure.axes[0].lines if line.get_markerfacecolor() == "none"]
    assert [(*line.get_xydata()[0], line.get_marker()) for line in hollow] == [
        (500, 1, "v"),
        (2500, 0, "s"),
    ]
    assert legend(figure) == ["MPPI-Belief", "EKF-iLQG", "paper"]


@pytest.mark.parametrize("n", [1, 3])
def test_few_trials(n):
    _, costs = figures.figure_2([cell_with(n=n, hits=0)]).axes
    points, low, _ = drawn_series(costs)["MPPI-Belief"]
    assert len(points) == 1
    assert np.isfinite(low).all() == (n > 1)


def test_cells_without_trials_or_weight_are_left_out():
    given = [
        cell_with(),
        cell_with(cell("ce"), n=0, hits=0, bad=BAD),
        cell_with(cell("lqg", w_obs=math.nan)),
        cell_with(cell(w_obs=0.0)),
    ]
    assert len(drawn_series(figures.figure_2(given).axes[0])["MPPI-Belief"][0]) == 1
    assert legend(figures.figure_2(given)) == ["MPPI-Belief", "paper"]
    assert figures.figure_2(given[1:]) is None
    assert figures.figure_2([]) is None


def test_the_theta_figure_shows_rates_clearances_and_costs_beside_the_papers():
    given = [
        cell_with(cell(theta=theta), hits=k, seed=k) for k, theta in enumerate([2.0, 0.0, 1.0])
    ]
    figure = figures.theta_figure(given)
    order = [given[1], given[2], given[0]]
    lines = [drawn_series(axes)["MPPI-Belief"] for axes in figure.axes]
    assert len(lines) == 3
    assert all(line[0][:, 0].tolist() == [0, 1, 2] for line in lines)
    agree(lines[0], [rate(k, 20) for k in (1, 2, 0)])
    agree(lines[1], [mean(cell.rows["clearance"]) for cell in order])
    agree(lines[2], [mean(cell.rows["cost"]) for cell in order])
    hollow = [
        line.get_xydata().tolist()
        for axes in figure.axes
        for line in axes.lines
        if line.get_mfc() == "none"
    ]
    assert hollow[0] == [[0, 23], [0.5, 2.5], [1, 0], [2, 1], [5, 1]]
    assert hollow[1:] == [[[0, 0.11], [0.5, 0.8], [1, 0.82]], [[0, 51.3], [1, 56.6]]]
    assert legend(figure) == ["MPPI-Belief", "paper"]


def test_no_theta_no_figure():
    assert (
        figures.theta_figure([cell_with(cell("ce", theta=math.nan)), cell_with(n=0, hits=0)])
        is None
    )


def test_no_obstacles_no_clearance():
    given = cell_with()
    given.rows["clearance"] = math.inf
    assert drawn_series(figures.theta_figure([given]).axes[1])["MPPI-Belief"][0].size == 0


def test_a_method_has_its_colour_in_every_figure():
    given = [cell_with(cell(method), with_paths=2, hits=0) for method in ("belief", "ce", "mine")]
    expected = {cell.name: to_hex(style.method_look(cell.method).colour) for cell in given}
    for figure in (figures.figure_2(given), figures.theta_figure(given)):
        assert colours(figure.axes[0]) == expected
    paths = {
        axes.get_title().split(",")[0]: trial_lines(axes)[0].get_color()
        for axes in panels(figures.figure_1(given))
    }
    assert {name: to_hex(colour) for name, colour in paths.items()} == expected


def test_residuals_over_time_with_the_papers_value():
    figure = figures.residual_figure(cell_with(with_paths=1, record=recording()))
    best, imposed = figure.axes
    for axes, which in ((best, "optimum"), (imposed, "imposed")):
        for line, reading in zip(axes.lines, ("sample", "intensity"), strict=False):
            np.testing.assert_allclose(line.get_xdata(), [0, DT, 2 * DT])
            np.testing.assert_array_equal(
                line.get_ydata(), np.array(MATCHING[reading][which], dtype=float)
            )
    assert best.lines[2].get_ydata() == [published.RESIDUAL] * 2
    assert (best.get_yscale(), imposed.get_yscale()) == ("linear", "log")
    assert best.get_ylim()[0] == 0
    assert best.get_ylim()[1] >= 1
    assert legend(figure)[-1] == "paper: 0.79"


def test_the_papers_values_are_not_drawn_beside_other_settings():
    boats = [cell_with(cell(theta=theta), departures=None) for theta in (0.0, 1.0)]
    other_goal = [cell_with(cell(), departures=("cost.goal",))]
    for given in (boats, other_goal):
        for figure in (figures.figure_2(given), figures.theta_figure(given)):
            assert "paper" not in legend(figure)
            for axes in figure.axes:
                assert not [line for line in axes.lines if line.get_markerfacecolor() == "none"]
    recorded = cell_with(with_paths=1, record=recording(), departures=("system.light",))
    assert not [text for text in legend(figures.residual_figure(recorded)) if "paper" in text]


def test_a_controller_without_temperature_and_a_line_have_one_panel():
    alone = {name: {"optimum": curve["optimum"]} for name, curve in MATCHING.items()}
    given = cell_with(
        with_paths=1, scene=LINE, record={"trial": 0, "samples": None, "matching": alone}
    )
    assert len(figures.residual_figure(given).axes) == 1


@pytest.mark.parametrize(
    "given",
    [
        cell_with(),
        cell_with(with_paths=1),
        cell_with(record=recording()),
        cell_with(with_paths=1, record={"trial": 0, "matching": {}}),
    ],
)
def test_no_residual_no_figure(given):
    assert figures.residual_figure(given) is None


def sampled(horizon: int, samples: int, **more: Any) -> CellResults:
    swept = {"planner.horizon": horizon, "planner.n_samples": samples}
    return cell_with(cell(**swept), seed=horizon + samples, **more)


def test_samples_and_horizon_a_line_a_horizon_in_four_panels():
    times = 1e-3 * np.random.default_rng(1).permutation(np.arange(1, 101))
    given = [
        sampled(h, n, hits=h // 10, seconds=times * h)
        for h, n in itertools.product((30, 15), (500, 50, 150))
    ]
    figure = figures.ess_figure([*given, cell_with()])
    ess, rates, costs, time = (drawn_series(axes)["$H = 15$"] for axes in figure.axes)
    order = [given[4], given[5], given[3]]
    agree(ess, [mean(cell.rows["ess"]) for cell in order])
    agree(costs, [mean(cell.rows["cost"]) for cell in order])
    agree(rates, [rate(1, 20)] * 3)
    np.testing.assert_allclose(time[0][:, 1], 15 * 50.5)
    np.testing.assert_allclose(ess[0][:, 0], [50, 150, 500], rtol=0.1)
    assert legend(figure) == ["$H = 15$", "$H = 30$"]
    assert figure.axes[0].get_xscale() == "log"


def test_without_times_or_weights_their_panels_stay_empty():
    given = sampled(30, 500)
    given.rows["ess"] = math.nan
    sizes = [
        drawn_series(axes)["$H = 30$"][0].shape[0] for axes in figures.ess_figure([given]).axes
    ]
    assert sizes == [0, 1, 1, 0]
    assert figures.ess_figure([cell_with(), sampled(30, 50, n=0, hits=0)]) is None


def test_the_interval_of_a_median_covers_as_often_as_it_says():
    n = 60
    repeats = 1000
    draws = np.random.default_rng(3).exponential(size=(repeats, n))
    given = cell_with()
    intervals = np.array([points.step_time(given._replace(seconds=draw)) for draw in draws]) / 1e3
    np.testing.assert_allclose(intervals[:, 0], np.median(draws, axis=1))
    covered = np.mean((intervals[:, 1] <= math.log(2)) & (intervals[:, 2] >= math.log(2)))
    assert 0.95 - 4 * math.sqrt(0.05 * 0.95 / repeats) < covered < 0.985
    assert math.isnan(points.step_time(cell_with(seconds=[1e-3])).low)


def frames(path: Path) -> tuple[list[np.ndarray], list[int]]:
    with Image.open(path) as image:
        frames = [
            (np.asarray(frame.convert("RGB")), frame.info["duration"])
            for frame in ImageSequence.Iterator(image)
        ]
        assert image.info["loop"] == 0
    return [picture for picture, _ in frames], [duration for _, duration in frames]


def close(picture: np.ndarray, colour: str) -> int:
    """How many pixels have a colour, nearly."""
    return int(
        np.sum(np.abs(picture - 255 * np.array(mpl.colors.to_rgb(colour))).max(axis=-1) < 12)
    )


def test_an_animation_has_a_frame_a_step_that_goes_on_and_says_when_it_collides(tmp_path):
    target = tmp_path / "trial.gif"
    assert figures.write_animation(
        [
            cell_with(cell("ce"), with_paths=1, record=recording()),
            cell_with(with_paths=1, record=recording()),
        ],
        target,
    )
    pictures, durations = frames(target)
    assert len(pictures) == STEPS + 1
    assert durations == [100] * STEPS + [1500]
    assert pictures[0].shape[1] == 900
    assert all(np.any(frame != following) for frame, following in itertools.pairwise(pictures))
    path = [close(picture, style.method_look("ce").colour) for picture in pictures]
    assert path[-1] > 2 * path[0]
    red = [close(picture, style.ORANGE) > 50 for picture in pictures]
    assert red == [k >= COLLIDED_AT for k in range(STEPS + 1)]
    assert [path.name for path in tmp_path.iterdir()] == ["trial.gif"]
    assert target.stat().st_size < 2.5e6


def test_long_trials_are_thinned(tmp_path, monkeypatch):
    monkeypatch.setattr("mppi_belief.report.figures.animation.FRAMES", 4)
    assert figures.write_animation(
        [cell_with(with_paths=1, record=recording())], tmp_path / "trial.gif"
    )
    assert len(frames(tmp_path / "trial.gif")[0]) == 5


@pytest.mark.parametrize(
    "given",
    [
        cell_with(with_paths=1),
        cell_with(record=recording()),
        cell_with(with_paths=1, record=recording(samples=False)),
        cell_with(with_paths=1, record=recording(5)),
        cell_with(with_paths=1, scene=LINE, record=recording()),
        cell_with(n=0, hits=0, with_paths=1, record=recording()),
    ],
    ids=["no recording", "no paths", "no samples", "another trial", "a line", "a failed trial"],
)
def test_nothing_recorded_no_animation(given, tmp_path):
    assert figures.write_animation([given], tmp_path / "trial.gif") is False
    assert figures.write_animation([], tmp_path / "trial.gif") is False
    assert list(tmp_path.iterdir()) == []


def test_an_ellipse_has_the_axes_of_its_covariance():
    (width, height), angle = plane.ellipse_shape(np.diag([1.0, 4.0]))
    np.testing.assert_allclose((width, height, abs(angle)), (8, 4, 90))
