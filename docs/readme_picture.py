"""Draw the picture at the top of the README from results that are there: `make picture`."""

from pathlib import Path

from mppi_belief.cli import collect
from mppi_belief.report import figures
from mppi_belief.report.overview import shown
from mppi_belief.study import results
from mppi_belief.study.plan import Cell

TITLES = {"belief": "MPPI-Belief", "ce": "CE-MPPI"}


def main() -> None:
    """Read the default results of both planners and write docs/img/trajectories.png."""
    runs = []
    for name, title in TITLES.items():
        cell = Cell(collect([f"controller={name}"])[0])
        folder = Path(cell.config["results_dir"]) / cell.id
        rows = results.read_rows(folder)
        run = shown(folder, cell, rows)
        if run is None:
            raise SystemExit(f"no results for {name}: mppi-belief run -m controller=belief,ce")
        runs.append(run._replace(title=f"{title}: {100 * rows['collided'].mean():.1f} % of {len(rows)} trials collide"))
    target = Path("docs/img/trajectories.png")
    target.parent.mkdir(parents=True, exist_ok=True)
    figures.save(figures.compare(runs), target)


if __name__ == "__main__":
    main()
