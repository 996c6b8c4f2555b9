"""Two structures beside each other: each number under its own column, settings by their keys."""

from typing import Any

import pytest

from mppi_belief.config.cell import Cell
from mppi_belief.report import published
from mppi_belief.report.cell_results import CellResults, Studies
from mppi_belief.report.open_settings import chosen_frame, fitted_frame, setting_text
from mppi_belief.report.sections.structures import structures_section
from mppi_belief.report.sections.table_1_long import long_frame, table_1_long_section
from report_helpers import cell_of, results_of, trial_rows

HITS = {"belief": 2, "ce": 72, "pipf": 51, "ilqg": 68}  # of 200, at the weight of Table I


def measured(method: str, hits: int, cost: float, clearance: float = 0.5, **labels: float):
    rows = trial_rows(200, hits, (cost, 6.0), (clearance, 0.2))
    return results_of(cell_of(method, **labels), rows, departures=("cost.goal",))


def bumps() -> list[CellResults]:
    """Returns a small study of the first calibration: Table I, two theta, two weights."""
    cells = [measured(method, hits, 50.0, w_obs=300.0) for method, hits in HITS.items()]
    cells.append(measured("belief", 26, 53.0, 0.42, theta=0.0, w_obs=300.0))
    cells.append(measured("belief", 1, 58.9, 0.89, theta=5.0, w_obs=300.0))
    cells += [measured("belief", hits, 55.0, w_obs=w) for w, hits in ((100.0, 10), (2500.0, 0))]
    return [*cells, measured("ce", 88, 50.7, w_obs=100.0)]


def today() -> Studies:
    """Returns Table I and sweeps with other numbers."""
    table_1 = [measured(method, 40, 51.0, w_obs=700.0) for method in published.TABLE_1]
    theta = [measured("belief", 46, 51.3, 0.11, theta=0.0, w_obs=700.0)]
    weights = [measured("ce", 46, 50.5, w_obs=100.0)]
    return {"table_1": table_1, "theta_sweep": theta, "w_obs_sweep": weights}


def column(studies: Studies, name: str, folder) -> dict[str, str]:
    numbers = structures_section(studies, folder).tables[0].frame
    return dict(zip(numbers["Number"], numbers[name], strict=True))


def test_each_number_stands_in_the_column_of_its_structure(tmp_path):
    studies = today() | {"table_1_bumps": bumps()}
    old = column(studies, "table_1_bumps", tmp_path)
    new = column(studies, "table_1", tmp_path)
    paper = column(studies, "Paper", tmp_path)
    assert old["CE-MPPI, collisions %"] == "36.0"
    assert new["CE-MPPI, collisions %"] == "20.0"
    assert paper["CE-MPPI, collisions %"] == "23.0"
    assert old["MPPI-Belief, cost"] == "50.0 ± 6.0"
    assert (old["theta 0, clearance m"], new["theta 0, clearance m"]) == ("0.42", "0.11")
    assert (old["theta 5, clearance m"], new["theta 5, clearance m"]) == ("0.89", "-")
    label = "w_obs 100, CE-MPPI, collisions %"
    assert (old[label], new[label], paper[label]) == ("44.0", "23.0", "11 to 33")
    assert paper["w_obs 2500, MPPI-Belief, collisions %"] == "0.0"
    assert "w_obs 10000, CE-MPPI, collisions %" not in paper
    for stem in ("structures", "structure_settings"):
        assert (tmp_path / f"{stem}.md").is_file()


def test_the_first_calibration_is_shown_alone_where_it_is_alone(tmp_path):
    numbers = structures_section({"table_1_bumps": bumps()}, tmp_path).tables[0].frame
    assert list(numbers.columns) == ["Number", "Paper", "table_1_bumps"]


def with_settings(method: str, **groups: Any) -> CellResults:
    """Returns a cell of a method with these groups of settings."""
    cell = cell_of(method)
    return results_of(Cell(cell.config | groups), trial_rows(2))


def test_settings_are_those_of_the_first_cell_that_has_them():
    cost = {"w_obs": 300.0, "obstacle_penalty": {"_target_": "mppi_belief.Hinge", "margin": 0.13}}
    cells = [
        with_settings("pipf", cost=cost, filter={"noise_at": "mean"}, controller={}),
        with_settings(
            "belief",
            cost=cost | {"w_obs": 500.0},
            controller={"path_cost": {"expectation": "at_mean", "at_step_end": False}},
        ),
    ]
    assert setting_text(cells, "filter.noise_at") == "mean"
    assert setting_text(cells, "cost.w_obs") == "500.0"  # MPPI-Belief first
    assert setting_text(cells, "cost.obstacle_penalty._target_") == "Hinge"
    assert setting_text(cells, "cost.nothing.below") == ""
    chosen = chosen_frame(cells)
    values = dict(zip(chosen["Key"], chosen["Value"], strict=True))
    assert values["cost.obstacle_penalty"] == "Hinge"
    assert values["controller.path_cost.at_step_end"] == "False"
    assert set(chosen["Chosen"]) == {published.BY_THE_SWEEPS, published.BY_HAND}
    fitted = fitted_frame(cells)
    assert list(fitted["Key"]) == ["cost.obstacle_penalty.margin", "cost.w_obs"]


def test_no_setting_is_both_chosen_and_fitted():
    assert not published.STRUCTURE.keys() & published.FITTED_SETTINGS.keys()


def test_a_long_table_has_z_beside_each_method(tmp_path):
    rows = trial_rows(2000, 16, (57.5, 6.7))
    cells = [results_of(cell_of(), rows), measured("ce", 40, 50.0)]
    frame = long_frame(cells)
    assert list(frame["Trials"]) == ["2000", "200"]
    z = frame["z of cost, spread, collisions"]
    assert len(z[0].split(", ")) == 3
    assert z[1] == "-"  # its settings are not the paper's
    section = table_1_long_section({"table_1_long": cells}, tmp_path)
    assert section.title == "Table I over 200 to 2000 trials"
    assert frame.equals(section.tables[0].frame)


@pytest.mark.parametrize("method", [*published.TABLE_1])
def test_a_structure_without_a_method_has_a_dash(method, tmp_path):
    cells = [cell for cell in bumps() if cell.method != method]
    numbers = column({"table_1_bumps": cells}, "table_1_bumps", tmp_path)
    assert sum(value == "-" for value in numbers.values()) >= 2
