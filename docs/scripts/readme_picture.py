"""Draws the pictures of the README from existing results of Table I: `make picture`."""

from pathlib import Path

from mppi_belief.config.cell import Cell
from mppi_belief.config.compose import collect
from mppi_belief.config.request import Request
from mppi_belief.report import figures
from mppi_belief.report.cell_results import read_cell_results

FOLDER = Path("docs/img")


def main() -> None:
    """Reads the Table I results of both planners; writes trajectories.png and animation.gif."""
    panels = []
    cells = []
    for config in collect(Request(("experiment=table_1", "controller=belief,ce"))):
        results = read_cell_results(Cell(config), Path(config["results_dir"]), config["n_trials"])
        panel = figures.kept_panel(results, results.name)
        if panel is None:
            raise SystemExit("no results: mppi-belief run experiment=table_1 controller=belief,ce")
        rate = 100 * results.collided.mean()
        n_drawn = panel.paths["trial"].nunique()
        title = (
            f"{results.name}: {rate:.1f} % of {len(results.good)} trials collide;\n"
            f"the first {n_drawn} are drawn"
        )
        panels.append(panel._replace(title=title))
        cells.append(results)
    FOLDER.mkdir(parents=True, exist_ok=True)
    figures.save_png(figures.compare_paths(panels), FOLDER / "trajectories.png")
    figures.write_animation(cells, FOLDER / "animation.gif")


if __name__ == "__main__":
    main()
