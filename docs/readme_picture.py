"""Draw what the README shows, from results that are there: `make picture`."""

from pathlib import Path

from mppi_belief.cli.main import collect
from mppi_belief.cli.overview import as_run
from mppi_belief.config.cell import Cell
from mppi_belief.report import figures
from mppi_belief.report.cell_results import read_cell_results

FOLDER = Path("docs/img")


def main() -> None:
    """Read the Table I results of both planners, write trajectories.png and animation.gif."""
    runs, founds = [], []
    for config in collect(["experiment=table_1", "controller=belief,ce"]):
        found = read_cell_results(Cell(config), Path(config["results_dir"]), config["n_trials"])
        run = as_run(found)
        if run is None:
            raise SystemExit("no results: mppi-belief run experiment=table_1 controller=belief,ce")
        rate = 100 * found.collided.mean()
        runs.append(
            run._replace(title=f"{found.name}: {rate:.1f} % of {len(found.good)} trials collide")
        )
        founds.append(found)
    FOLDER.mkdir(parents=True, exist_ok=True)
    figures.save_png(figures.compare_paths(runs), FOLDER / "trajectories.png")
    figures.write_animation(founds, FOLDER / "animation.gif")


if __name__ == "__main__":
    main()
