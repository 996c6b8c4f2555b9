"""Quality per time: which cells the study has, what is said of them, what is drawn."""

import itertools
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Annotation

from cli_helpers import CONF, call, collect
from mppi_belief.config.cell import Cell
from mppi_belief.config.request import Request
from mppi_belief.config.studies import grids
from mppi_belief.report import figures
from mppi_belief.report.cell_results import CellResults
from mppi_belief.report.sections import study_sections
from mppi_belief.report.sections.quality_per_time import (
    ABOVE,
    GOOD_ENOUGH,
    advice,
    collision_range,
    quality_frame,
)
from mppi_belief.report.statistics import paired_rate_difference
from mppi_belief.report.summary import interval_text
from report_helpers import cell_of, failed_trial, results_of, spread_values, trial_rows
from study_helpers import row

N = 20
STUDY = "quality_per_time"
KEYS = {"pipf": "controller.n_samples", "ilqg": "controller.max_iterations"}
SD = 6.0


def cell(method: str, value: int) -> Cell:
    """A method at a value of what it is swept over, as `collect` makes it."""
    key = KEYS.get(method, "planner.n_samples")
    config = cell_of(method, **{key: value}).config
    filter = {"n_particles": 50} if method == "pipf" else {}
    problem = {"dt": 0.1}
    return Cell(
        config
        | {"controller": {key.rpartition(".")[2]: value}, "filter": filter, "problem": problem}
    )


def timed_cell(
    method: str, value: int, cost: float, ms: float | None = None, hits: int = 0
) -> CellResults:
    """A cell whose trials all cost as much above those of another cell as their means are apart."""
    results = results_of(cell(method, value), trial_rows(N, hits, (cost, SD)))
    return (
        results
        if ms is None
        else results._replace(seconds=[1e-3 * ms * part for part in (0.9, 1.0, 1.0, 1.1)])
    )


def belief() -> list[CellResults]:
    """Three numbers of samples, the largest the best by 2 and 10 %."""
    return [
        timed_cell("belief", 50, 55.0, 0.2),
        timed_cell("belief", 500, 51.0, 0.5),
        timed_cell("belief", 5000, 50.0, 4.0),
    ]


def test_a_study_is_its_yaml_and_those_that_begin_with_its_name_and_a_dot(tmp_path):
    assert grids(Request((f"experiment={STUDY}", "n_trials=3"))) == [
        Request((f"experiment={STUDY}{name}", "n_trials=3")) for name in ("", ".ilqg", ".pipf")
    ]
    for overrides in (
        (),
        ("theta=1",),
        ("experiment=table_1",),
        ("experiment=",),
        (f"experiment={STUDY}.pipf",),
    ):
        assert grids(Request(overrides)) == [Request(overrides)]
    (tmp_path / "experiment").mkdir()
    for name in ("mine.more.yaml", "mine_too.yaml"):
        (tmp_path / "experiment" / name).touch()
    own = (str(tmp_path),)
    request = Request(("experiment=mine",), own)
    (tmp_path / "experiment" / "mine.yaml").write_text(
        "hydra:\n  sweeper:\n    params:\n      theta: 0,1\n"
    )
    assert grids(request) == [request, Request(("experiment=mine.more",), own)]
    part = Request(("experiment=mine", "theta=2"), own)  # of the first grid
    assert grids(part) == [part]
    assert len(grids(Request(("experiment=mine", "seed=2"), own))) == 2


def test_the_study_has_table_1_among_its_cells_and_nothing_twice():
    ids = [Cell(config).id for config in collect(f"experiment={STUDY}")]
    assert len(set(ids)) == len(ids)
    assert {Cell(config).id for config in collect("experiment=table_1")} < set(ids)
    assert {name.partition("-")[0] for name in ids} == {"belief", "ce", "pipf", "ilqg"}


def test_a_configuration_is_printed_once(tmp_path, capsys):
    output = call(tmp_path, capsys, "run", f"experiment={STUDY}", "--cfg", "job")
    assert (output.code, output.out.count("\ncontroller:")) == (0, 1)


def test_every_file_of_the_study_is_documented():
    text = (CONF.parent / "experiments" / f"{STUDY}.md").read_text()
    assert all(grid.overrides[0] in text for grid in grids(Request((f"experiment={STUDY}",))))


def test_a_line_says_time_samples_and_what_they_buy_above_the_best():
    small, medium, best = belief()
    pipf = timed_cell("pipf", 20, 52.0)
    ilqg = results_of(cell("ilqg", 1), [*trial_rows(4), failed_trial(9)])
    table = quality_frame([[small, medium, best], [pipf], [ilqg]])
    assert table["method"].tolist() == ["MPPI-Belief"] * 3 + ["PIPF", "EKF-iLQG"]
    assert table["setting"].tolist() == [
        *(f"planner.n_samples={n}" for n in (50, 500, 5000)),
        "-",
        "-",
    ]
    assert table["samples"].tolist() == ["50", "500", "5000", "1000", "-"]
    assert table["ms/step (p95)"].tolist()[2:] == ["4.00 (4.34)", "-", "-"]
    assert table[ABOVE].tolist() == ["5.00 [5.00, 5.00]", "1.00 [1.00, 1.00]", "-", "-", "-"]
    assert table["trials"].tolist() == ["20", "20", "20", "20", "5 (1 failed)"]


def test_costs_are_compared_on_the_trials_that_both_have():
    item = results_of(cell("belief", 50), [row(t, cost=60.0 + t) for t in range(1, 9)])
    two = results_of(
        cell("belief", 500), [failed_trial(3), *(row(t, cost=50.0 + t) for t in range(9) if t != 3)]
    )
    (text, _) = quality_frame([[item, two]])[ABOVE]
    assert text == "10.00 [10.00, 10.00]"


def described(given: CellResults, value: int) -> str:
    key = KEYS.get(given.method, "planner.n_samples")
    cost = f"{given.good['cost'].mean():.1f}"
    return rf"`{re.escape(key)}={value}` \(cost {cost} \[[^]]+\], [\d.]+ ms per step\)"


def test_the_quickest_that_is_good_enough_is_named_beside_the_best():
    cells = belief()
    sentence = advice(cells)
    assert re.search(
        rf"good enough is {described(cells[1], 500)}, 1\.00 \[1\.00, 1\.00\] above", sentence
    )
    assert re.search(rf"the best, {described(cells[2], 5000)}$", sentence)
    assert advice(cells[1:] + cells[:1]) == sentence


@pytest.mark.parametrize(
    ("share", "enough"), [(GOOD_ENOUGH - 1e-3, True), (GOOD_ENOUGH + 1e-3, False)]
)
def test_good_enough_is_a_part_of_the_least_cost(share, enough):
    cells = [timed_cell("ce", 50, 50.0 * (1 + share), 0.2), timed_cell("ce", 500, 50.0, 0.4)]
    assert (
        "quickest setting that is good enough is `planner.n_samples=50`" in advice(cells)
    ) is enough
    assert (
        "no setting quicker than the best is shown to be good enough: `planner.n_samples=500`"
        in advice(cells)
    ) is not enough


def test_what_may_cost_more_is_not_good_enough_though_its_mean_is():
    sure = [timed_cell("ce", 50, 51.0, 0.2), timed_cell("ce", 500, 50.0, 0.4)]
    noise = np.random.default_rng(0).permutation(spread_values(N, 51.0, SD))
    unsure = results_of(sure[0].cell, [row(t, cost=float(value)) for t, value in enumerate(noise)])
    assert "good enough is `planner.n_samples=50`" in advice(sure)
    assert "no setting quicker" in advice([unsure._replace(seconds=sure[0].seconds), sure[1]])


def test_time_decides_and_not_the_number():
    cells = [
        timed_cell("ilqg", 1, 50.5, 0.9),
        timed_cell("ilqg", 2, 50.2, 0.3),
        timed_cell("ilqg", 50, 50.0, 0.5),
    ]
    assert "good enough is `controller.max_iterations=2`" in advice(cells)
    untimed = [item._replace(seconds=[]) for item in cells]
    assert re.search(
        r"the best is `controller\.max_iterations=50` .*, and not all settings were timed$",
        advice(untimed),
    )
    half = advice([*untimed[:1], *cells[1:]])
    assert "quickest" not in half
    assert "not all settings were timed" in half


def test_a_setting_that_fails_more_often_is_not_recommended_for_its_survivors():
    good = [timed_cell("ce", 50, 52.0, 0.2), timed_cell("ce", 500, 50.0, 0.4)]
    lucky = results_of(
        cell("ce", 5), [row(0, cost=1.0), *(failed_trial(t) for t in range(1, N))]
    )._replace(seconds=[1e-4] * 9)
    assert advice([lucky, *good]) == advice(good)


def test_the_best_may_be_the_quickest():
    cells = [timed_cell("ce", 50, 50.0, 0.2), timed_cell("ce", 500, 50.1, 0.4)]
    assert advice(cells).startswith(
        "CE-MPPI: no setting quicker than the best is shown to be good enough: "
        "`planner.n_samples=50`"
    )


def test_cells_without_trials_are_in_no_comparison(tmp_path):
    empty = results_of(cell("belief", 5), [])
    bad = results_of(cell("belief", 7), [failed_trial(0), failed_trial(1)])
    cells = [empty, *belief(), bad]
    assert advice(cells) == advice(
        [item._replace(seconds=[]) if item in (empty, bad) else item for item in cells]
    )
    assert "good enough is `planner.n_samples=500`" in advice(cells)
    assert quality_frame([cells])[ABOVE].tolist() == [
        "-",
        "5.00 [5.00, 5.00]",
        "1.00 [1.00, 1.00]",
        "-",
        "-",
    ]
    assert quality_frame([[empty, bad]])["trials"].tolist() == ["0", "2 (2 failed)"]
    assert study_sections({STUDY: [empty, bad]}, tmp_path) == []


def test_collisions_are_compared_trial_by_trial_from_the_quickest_setting_to_the_slowest():
    slow, quick, between = (
        timed_cell("ce", n, 50.0, ms, hits)
        for n, ms, hits in ((1, 3.0, 2), (2, 0.5, 12), (3, 1.0, 6))
    )
    sentence = collision_range([slow, quick, between])
    change, _ = paired_rate_difference(np.arange(N) < 2, np.arange(N) < 12)
    assert re.fullmatch(r"Collisions: 10\.0 to 60\.0 %; from .* by (.*) points", sentence)[
        1
    ] == interval_text(change.times(100), 1)
    assert change.value == -0.5
    assert (
        collision_range([quick, results_of(cell("ce", 5), [failed_trial(0)])])
        == "Collisions: 60.0 [36.1, 80.9] %"
    )


def everything() -> list[CellResults]:
    ilqg = [timed_cell("ilqg", 1, 47.0, 0.4, hits=7), timed_cell("ilqg", 50, 45.0, 0.6, hits=6)]
    pipf = [timed_cell("pipf", 20, 55.0, 1.0, hits=4), timed_cell("pipf", 200, 51.0, 6.0, hits=4)]
    ce = [timed_cell("ce", 50, 52.0, 0.1, hits=7), timed_cell("ce", 5000, 45.5, 3.0, hits=6)]
    return [*belief(), *ce, *ilqg, *pipf]


def test_the_section_has_a_sentence_a_method_a_table_and_a_figure(tmp_path):
    (section,) = study_sections({STUDY: everything()}, tmp_path)
    lead, *output = section.text
    assert "lasts 100 ms" in lead
    assert f"{6.0 * 1.085:.1f} ms" in lead
    names = ["MPPI-Belief", "CE-MPPI", "PIPF", "EKF-iLQG"]
    assert [text.partition(":")[0] for text in output] == names
    assert list(dict.fromkeys(section.tables[0].frame["method"])) == names
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{STUDY}.{kind}" for kind in ("md", "csv", "png", "pdf")
    }
    header, *rows = (tmp_path / f"{STUDY}.csv").read_text().splitlines()
    assert {"planner.n_samples", "time", "cost_low", "collided_high"} <= set(header.split(","))
    assert [line.split(",")[0] for line in rows] == ["belief"] * 3 + ["ce"] * 2 + ["pipf"] * 2 + [
        "ilqg"
    ] * 2


def test_without_times_the_advice_names_none(tmp_path):
    (section,) = study_sections(
        {STUDY: [item._replace(seconds=[]) for item in everything()]}, tmp_path
    )
    assert not any(re.search(r"\bms\b", text) for text in section.text)
    assert (tmp_path / f"{STUDY}.png").stat().st_size > 5000


def points(axes: Any) -> list[np.ndarray]:
    """The points (n, 2) of every line."""
    return [np.asarray(bars.lines[0].get_xydata()) for bars in axes.containers]


def named(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.texts if isinstance(text, Annotation)]


def test_the_figure_shows_cost_and_collisions_against_time_and_samples():
    figure = figures.quality_figure(everything()[::-1])
    (time, paths), (rates, _) = np.reshape(figure.axes, (2, 2))
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    ours = "MPPI-Belief: n_samples"
    assert legend == [ours, "CE-MPPI: n_samples", "PIPF: n_samples", "EKF-iLQG: max_iterations"]
    np.testing.assert_allclose(points(time)[0], [(4.0, 50.0), (0.5, 51.0), (0.2, 55.0)])
    np.testing.assert_allclose(points(rates)[2], [(6.0, 20.0), (1.0, 20.0)])
    np.testing.assert_allclose(points(paths)[2][:, 0], [10000, 1000], rtol=0.1)
    np.testing.assert_allclose(points(paths)[2][:, 1], [51.0, 55.0])
    assert points(paths)[3].size == 0
    assert (
        named(time) == named(rates) == ["5000", "500", "50", "5000", "50", "200", "20", "50", "1"]
    )
    assert named(paths) == []
    assert [axes.get_xscale() for axes in figure.axes] == ["log"] * 4


def test_no_label_leaves_the_figure_or_runs_into_another():
    figure = figures.quality_figure(everything())
    FigureCanvasAgg(figure).draw()
    axis_pairs = [(axes.xaxis, axes.yaxis) for axes in figure.axes]
    ticks = []
    words = []
    for axis in itertools.chain.from_iterable(axis_pairs):
        low, high = sorted(axis.get_view_interval())
        ticks += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        words.append(axis.label)
    texts: Sequence[Any] = [*ticks, *words, *figure.legends[0].get_texts()]
    boxes = [text.get_window_extent() for text in texts if text.get_text() and text.get_visible()]
    assert len(boxes) > 12
    assert not any(first.overlaps(second) for first, second in itertools.combinations(boxes, 2))
    inside = [text for axes in figure.axes for text in axes.texts if text.get_visible()]
    labels = [text.get_window_extent() for text in inside]
    assert len(labels) >= 16
    assert not any(first.overlaps(second) for first, second in itertools.combinations(labels, 2))
    for box in [*boxes, *labels]:
        assert 0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert 0 <= box.y0 < box.y1 <= figure.bbox.y1


def test_cells_without_trials_or_times_are_left_out_of_the_figure():
    small, medium, best = belief()
    figure = figures.quality_figure(
        [small, medium._replace(seconds=[]), best, results_of(cell("ce", 5), [failed_trial(0)])]
    )
    assert [len(axes.containers) for axes in figure.axes] == [1] * 4
    assert points(figure.axes[0])[0][:, 0].tolist() == pytest.approx([0.2, 4.0])
    assert named(figure.axes[0]) == ["50", "5000"]
    assert points(figure.axes[1])[0].shape == (3, 2)
    assert figures.quality_figure([results_of(cell("ce", 5), [failed_trial(0)])]) is None
    assert figures.quality_figure([]) is None


def test_one_setting_has_no_name():
    figure = figures.quality_figure([timed_cell("ce", 500, 50.0, 0.4)])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["CE-MPPI"]
    assert set(named(figure.axes[0])) <= {""}
    assert (
        advice([timed_cell("ce", 500, 50.0, 0.4)])
        == "CE-MPPI: cost 50.0 [47.2, 52.8], 0.40 ms per step"
    )


def test_the_paths_of_a_step_are_counted():
    assert [timed_cell(method, 20, 50.0).samples for method in ("belief", "pipf", "ilqg")] == [
        20,
        1000,
        None,
    ]
