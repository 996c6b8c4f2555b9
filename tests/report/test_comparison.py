"""Table I as text, CSV and LaTeX agrees with the files, also with failed and missing trials."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from mppi_belief.report.cell_results import CellResults, paired_rows
from mppi_belief.report.comparison import baseline_pairs, method_differences, multiplicity_text
from mppi_belief.report.elements import bold_lowest_rate, drawn_text, write_page_table
from mppi_belief.report.page import PageTable
from mppi_belief.report.sections.table_1 import table_1_frame, table_1_latex
from mppi_belief.report.statistics import holm_adjusted
from report_helpers import (
    cell_of,
    failed_trial,
    random_trials,
    read_all,
    results_of,
    rows_on_disk,
    store_results,
    trial_rows,
)
from study_helpers import row

METHODS = {"belief": (0.0, 56.0), "ce": (0.3, 50.0), "pipf": (0.2, 47.0), "ilqg": (0.25, 46.0)}
CELLS = {method: cell_of(method) for method in METHODS}
SECONDS = {"belief": 0.018, "ce": 0.013, "pipf": 0.296}  # none of ilqg
TIMES = {"belief": "18.0", "ce": "13.0", "pipf": "296"}  # ms, three significant digits
PAPER = {  # Table I
    "MPPI-Belief": ("56.5 ± 5.2", "0.0", "18"),
    "CE-MPPI": ("50.5 ± 6.2", "23.0", "13"),
    "PIPF": ("47.6 ± 5.5", "18.0", "296"),
    "EKF-iLQG": ("46.1 ± 6.2", "24.5", "148"),
}
NUMBER = r"-?\d+\.\d+"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Stores 200 trials of each method; some failed, some of ce are missing, files are shuffled."""
    path = tmp_path_factory.mktemp("results")
    rng = np.random.default_rng(3)
    for method, (rate, cost) in METHODS.items():
        numbers = rng.permutation(200)[: 170 if method == "ce" else 200]
        rows = random_trials(rng, numbers, rate, cost)
        bad = {"belief": (3, 77), "pipf": (4, 77, 150)}.get(method, ())
        rows = [failed_trial(r["trial"]) if r["trial"] in bad else r for r in rows]
        seconds = SECONDS[method] * np.arange(90, 111) / 100 if method in SECONDS else []
        store_results(path, CELLS[method], rows, list(seconds))
        store_results(
            path, CELLS[method], [row(trial, cost=1e6, collided=True) for trial in range(200, 205)]
        )  # not asked for
    return path


@pytest.fixture(scope="module")
def cells(root: Path) -> list[CellResults]:
    return read_all(root, *CELLS.values())


@pytest.fixture(scope="module")
def disk(root: Path) -> dict[str, pd.DataFrame]:
    """The good rows of the trials asked for, by pandas alone."""
    tables = {method: rows_on_disk(root, cell) for method, cell in CELLS.items()}
    return {method: rows[rows.index < 200] for method, rows in tables.items()}


def numbers_in(text: str) -> list[float]:
    return [float(number) for number in re.findall(NUMBER, text)]


def clopper_pearson(rows: pd.DataFrame) -> tuple[float, float, float]:
    """In %."""
    test = stats.binomtest(int(rows["collided"].sum()), len(rows))
    interval = test.proportion_ci(0.95, method="exact")
    return 100 * test.statistic, 100 * interval.low, 100 * interval.high


def test_the_text_says_what_is_in_the_files(cells, disk):
    frame = table_1_frame(cells)
    assert frame["Method"].tolist() == [*PAPER]
    assert frame["Trials"].tolist() == ["198", "170", "197", "200"]
    for (_, line), (method, rows) in zip(frame.iterrows(), disk.items(), strict=True):
        np.testing.assert_allclose(
            numbers_in(line["Cost"]), (rows["cost"].mean(), rows["cost"].std()), atol=0.0501
        )
        np.testing.assert_allclose(
            numbers_in(line["Collision %"]), clopper_pearson(rows), atol=0.0501
        )
        assert (line["Paper: cost"], line["Paper: collision %"], line["Paper: ms"]) == PAPER[
            line["Method"]
        ]
        # the median of 0.90, 0.91, ..., 1.10 is 1 and their 95 % point is 1.09
        ms = [1e3 * SECONDS[method] * part for part in (1, 1.09)] if method in SECONDS else []
        np.testing.assert_allclose(numbers_in(line["Time ms (p95)"]), ms, atol=0.00501)
    assert frame["Time ms (p95)"].tolist()[-1] == "-"


def test_the_csv_has_the_numbers_in_full(cells, disk, tmp_path):
    write_page_table(tmp_path, "table_1", "Table I", table_1_frame(cells), cells)
    written = pd.read_csv(tmp_path / "table_1.csv")
    assert written["controller"].tolist() == [*METHODS]
    for (_, line), rows in zip(written.iterrows(), disk.values(), strict=True):
        n = len(rows)
        cost = rows["cost"]
        assert (line["trials"] - line["failed"], line["collisions"]) == (n, rows["collided"].sum())
        np.testing.assert_allclose(
            (line["cost"], line["sd"]), (cost.mean(), cost.std()), rtol=1e-12
        )
        for name in ("cost", "clearance"):
            low, high = stats.t.interval(
                0.95, n - 1, loc=rows[name].mean(), scale=stats.sem(rows[name])
            )
            np.testing.assert_allclose(
                line[[f"{name}_low", f"{name}_high"]].astype(float), (low, high), rtol=1e-9
            )
        rates = line[["collided", "collided_low", "collided_high"]].astype(float)
        np.testing.assert_allclose(100 * rates, clopper_pearson(rows), rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(line["clearance"], rows["clearance"].mean(), rtol=1e-12)
        assert line["ess"] == 8
    np.testing.assert_allclose(written["time"], [18, 13, 296, np.nan], rtol=1e-12)
    np.testing.assert_allclose(written["time_p95"], 1.09 * written["time"], rtol=1e-12)


def test_markdown_has_a_cell_for_every_column(cells, tmp_path):
    write_page_table(tmp_path, "table_1", "Table I", table_1_frame(cells), cells)
    head, rule, *lines = (tmp_path / "table_1.md").read_text().splitlines()
    assert [cell.strip() for cell in head.strip("|").split("|")] == [*table_1_frame(cells).columns]
    assert set(rule) == set("| -")
    texts = [[text.strip() for text in line.strip("|").split("|")] for line in lines]
    assert texts == table_1_frame(cells).to_numpy().tolist()


def body_of(latex: str) -> list[list[str]]:
    """Returns the texts of the rows below \\midrule."""
    body = latex.partition("\\midrule\n")[2].partition("\\bottomrule")[0]
    return [
        [cell.strip() for cell in line.removesuffix(r"\\").split(" & ")]
        for line in body.splitlines()
        if not line.startswith(r"\addlinespace")
    ]


def test_latex_says_what_is_in_the_files(cells, disk):
    body = body_of(table_1_latex(cells))
    lines = body[::2]
    assert [texts[0] for texts in lines] == [*PAPER]
    pairs = zip(lines, body[1::2], disk.items(), strict=True)
    for texts, published, (method, rows) in pairs:
        assert texts[1:3] == ["here", str(len(rows))]
        np.testing.assert_allclose(
            numbers_in(texts[3]), (rows["cost"].mean(), rows["cost"].std()), atol=0.0501
        )
        np.testing.assert_allclose(numbers_in(texts[4]), clopper_pearson(rows), atol=0.0501)
        assert texts[5] == (
            f"{1e3 * SECONDS[method]:#.3g}".rstrip(".") if method in SECONDS else "--"
        )
        cost, rate, ms = PAPER[texts[0]]
        cost = f"${cost.replace('±', chr(92) + 'pm')}$"
        assert published == ["", "paper", "200", cost, rate, ms]


def assert_sound(latex: str) -> None:
    """Checks that braces, environments and mathematics are closed; rows fill the columns."""
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", latex):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0
    opened: list[str] = []
    for kind, name in re.findall(r"\\(begin|end)\{(\w+)\}", latex):
        if kind == "begin":
            opened.append(name)
        else:
            assert opened.pop() == name
    assert opened == []
    rules = re.findall(r"\\(toprule|cmidrule|midrule|bottomrule|hline)", latex)
    assert rules == ["toprule", "midrule", "bottomrule"]
    columns = len(re.search(r"\\begin\{tabular\}\{@\{\}([lcr]+)@\{\}\}", latex)[1])
    rows = [line for line in latex.splitlines() if line.endswith(r"\\")]
    assert len(rows) >= 2
    for line in rows:
        spans = [int(span) for span in re.findall(r"\\multicolumn\{(\d+)\}", line)]
        assert len(re.findall(r"(?<!\\)&", line)) + 1 + sum(spans) - len(spans) == columns
        assert len(re.findall(r"(?<!\\)\$", line)) % 2 == 0
        outside = re.sub(r"\$[^$]*\$", "", line)
        assert not re.search(r"(?<!\\)[_^#%]", outside), line
        assert outside.isascii()


def test_latex_is_sound(cells):
    assert_sound(table_1_latex(cells))
    assert_sound(table_1_latex(read_all(Path("nowhere"), cell_of("ce"))))


def test_latex_is_sound_for_a_method_of_a_users_own(tmp_path):
    cell = cell_of("my_controller")
    store_results(tmp_path, cell, trial_rows(5))
    assert_sound(table_1_latex(read_all(tmp_path, cell)))


def test_methods_are_compared_over_the_good_trials_that_both_have(cells, disk):
    frame = method_differences(cells)
    assert frame["Difference"].tolist() == [
        f"MPPI-Belief - {name}" for name in ("CE-MPPI", "PIPF", "EKF-iLQG")
    ]
    p_values = []
    for (_, line), method in zip(frame.iterrows(), ("ce", "pipf", "ilqg"), strict=True):
        both = disk["belief"].merge(
            disk[method], left_index=True, right_index=True, suffixes=("_1", "_2")
        )
        assert line["Pairs"] == str(len(both))
        cost = both["cost_1"] - both["cost_2"]
        value, low, high = numbers_in(line["Cost [95 %]"])
        assert value == pytest.approx(cost.mean(), abs=0.00501)
        # The bootstrap interval of nearly normal differences is nearly the normal one, to 5 %.
        half = 1.96 * cost.sem()
        np.testing.assert_allclose(
            (low, high), (cost.mean() - half, cost.mean() + half), atol=0.1 * half
        )
        hits = both["collided_1"].astype(int) - both["collided_2"].astype(int)
        value, low, high = numbers_in(line["Collisions, points [95 %]"])
        assert value == pytest.approx(100 * hits.mean(), abs=0.0501)
        p = stats.binomtest(int((hits > 0).sum()), int((hits != 0).sum())).pvalue
        p_values.append(p)
        assert p < 1e-6
        assert high < 0
    adjusted = [float(text) for text in frame["McNemar p (Holm)"]]
    np.testing.assert_allclose(adjusted, holm_adjusted(p_values), rtol=0.06)
    caption = multiplicity_text(frame)
    assert caption.endswith("McNemar's exact p is adjusted by Holm's method for 3 tests")


def test_pairs_are_made_by_trial_and_not_by_place(tmp_path):
    first = cell_of("belief")
    second = cell_of("ce")
    costs = dict(enumerate([60.0, 50.0, 41.0, 33.0, 26.0, 20.0]))
    store_results(tmp_path, first, [row(trial, cost=cost) for trial, cost in costs.items()])
    rows = [row(trial, cost=cost - trial) for trial, cost in costs.items() if trial != 1]
    store_results(tmp_path, second, [*rows[::-1], failed_trial(1)])
    cells = read_all(tmp_path, first, second)
    first_rows, second_rows = paired_rows(*cells)
    assert first_rows.index.tolist() == second_rows.index.tolist() == [0, 2, 3, 4, 5]
    assert (first_rows["cost"] - second_rows["cost"]).tolist() == [0, 2, 3, 4, 5]
    (line,) = method_differences(cells).to_dict("records")
    assert line["Pairs"] == "5"
    assert line["Cost [95 %]"].startswith("2.80 [")
    assert line["McNemar p (Holm)"] == "1"


def test_without_common_trials_or_without_a_reference_nothing_is_claimed(tmp_path):
    first = cell_of("belief")
    second = cell_of("ce")
    store_results(tmp_path, first, [row(trial) for trial in range(5)])
    store_results(tmp_path, second, [row(trial) for trial in range(5, 9)])
    cells = read_all(tmp_path, first, second)
    (line,) = method_differences(cells).to_dict("records")
    assert [*line.values()][1:] == ["0", "-", "-", "-"]
    assert method_differences(cells[1:]).empty
    assert method_differences(cells[:1]).empty


def test_a_table_of_nothing_and_of_failures_can_be_written(tmp_path):
    empty = cell_of("belief")
    broken = cell_of("ce")
    store_results(tmp_path, broken, [failed_trial(0), failed_trial(1)])
    cells = read_all(tmp_path, empty, broken)
    frame = table_1_frame(cells)
    assert frame["Trials"].tolist() == ["0", "0"]
    assert set(frame[["Cost", "Collision %", "Time ms (p95)"]].to_numpy().ravel()) == {"-"}
    ours = body_of(table_1_latex(cells))[::2]
    assert [texts[2:] for texts in ours] == [["0", "--", "--", "--"]] * 2
    write_page_table(tmp_path, "table_1", "Table I", frame, cells)
    assert pd.read_csv(tmp_path / "table_1.csv")["failed"].tolist() == [0, 2]


def method_cells(*settings: tuple[str, float, float, int]) -> list[CellResults]:
    """Cells of these methods, thetas, weights and seeds."""
    return [
        results_of(cell_of(method, theta, w_obs, seed), trial_rows(5))
        for method, theta, w_obs, seed in settings
    ]


def pair_titles(cells: list[CellResults]) -> list[str]:
    return [pair.title for pair in baseline_pairs(cells)]


def test_a_cell_is_compared_with_the_same_settings_of_the_first_method():
    nan = float("nan")
    cells = method_cells(
        ("belief", 1.0, 100.0, 0),
        ("belief", 1.0, 500.0, 0),
        ("ce", nan, 100.0, 0),
        ("ce", nan, 500.0, 0),
    )
    assert pair_titles(cells) == [
        "MPPI-Belief (w_obs 500) - MPPI-Belief (w_obs 100)",
        "CE-MPPI (w_obs 100) - MPPI-Belief (w_obs 100)",
        "CE-MPPI (w_obs 500) - MPPI-Belief (w_obs 500)",
    ]
    first, *_ = baseline_pairs(cells)
    assert (first.first, first.second) == (cells[1], cells[0])


def test_cells_of_two_seeds_or_systems_meet_other_noise_and_are_not_paired():
    seeds = method_cells(
        ("belief", 1.0, 100.0, 0), ("belief", 1.0, 100.0, 1), ("ce", 0.0, 100.0, 1)
    )
    assert len(baseline_pairs(seeds)) == 1
    assert baseline_pairs(seeds)[0].second is seeds[1]
    (cell,) = method_cells(("ce", 0.0, 100.0, 0))
    config = cell.config | {"names": cell.config["names"] | {"system": "boat"}}
    boat = cell._replace(cell=cell.cell._replace(config=config))
    assert baseline_pairs([cell, boat]) == []


def test_a_rate_is_bold_only_where_no_interval_overlaps(cells):
    table = PageTable("t", "Table I", table_1_frame(cells))
    bold = bold_lowest_rate(table, cells, "Collision %")
    assert bold.bold == [(0, list(table.frame.columns).index("Collision %"))]
    assert "below the intervals of all others" in bold.caption
    few = [results_of(cell.cell, cell.good.head(12).to_dict("records")) for cell in cells]
    assert [int(cell.collided.sum()) for cell in few].count(0) == 1  # the lowest, by chance
    assert bold_lowest_rate(table, few, "Collision %") == table


def test_captions_count_what_is_drawn(tmp_path):
    (cell,) = method_cells(("belief", 1.0, 100.0, 0))
    path_rows = pd.DataFrame({"trial": [0, 0, 3, 7], "step": [0, 1, 0, 0]})  # 7 is no good trial
    pictured = cell._replace(paths=path_rows)
    assert drawn_text([pictured]) == "2 of 5 trials are drawn"
    assert drawn_text([pictured, cell]) == "2 of 5 trials are drawn"  # the other has no panel
    assert drawn_text([pictured, pictured]) == "2 of 5 trials of each panel are drawn"
    single = cell._replace(paths=path_rows.head(2))
    assert drawn_text([single]) == "1 of 5 trials is drawn"
    assert drawn_text([single, pictured]) == "1 to 2 of 5 trials of each panel are drawn"


@pytest.mark.parametrize("departures", [None, ("problem.steps",)])
def test_table_1_of_other_settings_has_no_number_of_the_paper(departures, cells):
    others = [cell._replace(departures=departures) for cell in cells]
    frame = table_1_frame(others)
    papers = [column for column in frame if column.startswith("Paper")]
    assert set(frame[papers].to_numpy().ravel()) == {"-"}
    assert "paper" not in table_1_latex(others)
    assert "56.5" not in table_1_latex(others)
