"""Draw what the README shows, from results that are there: `make picture`."""

from pathlib import Path

from mppi_belief.cli.overview import overview_panel
from mppi_belief.config.cell import Cell
from mppi_belief.config.compose import collect
from mppi_belief.config.request import Request
from mppi_belief.report import figures
from mppi_belief.report.cell_results import read_cell_results

FOLDER = Path("docs/img")


def main() -> None:
    """Reads the Table I results of both planners; writes trajectories.png and animation.gif."""
    runs = []
    cells = []
    for config in collect(Request(("experiment=table_1", "controller=belief,ce"))):
        results = read_cell_results(Cell(config), Path(config["results_dir"]), config["n_trials"])
        run = overview_panel(results)
        if run is None:
            raise SystemExit("no results: mppi-belief run experiment=table_1 controller=belief,ce")
        rate = 100 * results.collided.mean()
        title = f"{results.name}: {rate:.1f} % of {len(results.good)} trials collide"
        runs.append(run._replace(title=title))
        cells.append(results)
    FOLDER.mkdir(parents=True, exist_ok=True)
    figures.save_png(figures.compare_paths(runs), FOLDER / "trajectories.png")
    figures.write_animation(cells, FOLDER / "animation.gif")


if __name__ == "__main__":
    main()
