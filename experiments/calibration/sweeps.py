"""Runs both sweeps of the paper for one candidate, to choose between structures.

    python experiments/calibration/sweeps.py --from 51 --trials 200

Numbers are fitted to Table I alone (search.py, refine.py). The structure may be chosen with a look
at the sweeps; this prints them. The trials are those of the search, not those of the studies.
"""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any, NamedTuple

import scenario
from mppi_belief.config import environment
from mppi_belief.report import published


class Point(NamedTuple):
    """Names one cell of a sweep."""

    method: str
    key: str  # "theta" or "w_obs"
    value: float


def points() -> Iterator[Point]:
    """Yields the cells of both sweeps."""
    for theta in published.PAPER_THETA:
        yield Point("belief", "theta", theta)
    for method in ("belief", *published.BASELINES):
        for w_obs in published.FIG_2_WEIGHTS:
            yield Point(method, "w_obs", w_obs)


def measure_point(
    candidate: scenario.Candidate, trials: int, point: Point
) -> tuple[Point, scenario.Measured]:
    """Returns what the trials of one cell of a sweep measure."""
    base = scenario.base_configs()[point.method]
    config = scenario.configure(base, candidate)
    node: dict[str, Any] = config["cost"]
    if point.key == "theta":
        node = config["controller"]["path_cost"]
    node[point.key] = point.value
    return point, scenario.measure(scenario.run(config, range(trials)))


def main() -> None:
    """Prints a line per cell: collisions, clearance, cost and spread."""
    parser = scenario.candidate_parser(__doc__)
    parser.add_argument("--trials", type=int, default=200)
    args = parser.parse_args()
    environment.prepare()
    candidate = scenario.logged_candidate(args.log, args.number)
    measure = partial(measure_point, candidate, args.trials)
    context = get_context("spawn")
    with ProcessPoolExecutor(args.processes, context, environment.prepare) as pool:
        for point, measured in pool.map(measure, points()):
            print(
                f"{point.method:8}{point.key:6}{point.value:>8g}"
                f"  {100 * measured.collision_rate:5.1f} %  {measured.clearance:5.2f} m"
                f"  {measured.cost:6.1f} ± {measured.spread:.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
