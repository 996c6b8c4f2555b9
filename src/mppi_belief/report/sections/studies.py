"""What each study shows: its tables and figures, and sentences made from its numbers."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from .. import figures, published
from ..cell_results import CellResults, by_method
from ..comparison import as_latex, method_differences, table_1
from ..elements import cell_lines, collision_text, cost_text, write_picture, write_table
from ..frame_files import write_text_file
from ..page import Picture, Section
from ..summary import summarise_trials
from . import published_problems, reproduction
from .controlled_sensing import sensing
from .information import information
from .nonlinearity import consistency
from .proposals import proposals
from .quality_per_time import quality
from .two_lanes import two_lanes

Studies = dict[str, list[CellResults]]


def sections(studies: Studies, folder: Path) -> list[Section]:
    """Every section of the report, for the studies that have results."""
    some = {
        name: founds for name, founds in studies.items() if any(len(found.good) for found in founds)
    }
    known = BUILDERS | BEYOND
    made = [builder(some[name], folder) for name, builder in known.items() if name in some]
    others = [_general(name, founds, folder) for name, founds in some.items() if name not in known]
    return [*made, *_reproduction(some, folder), *others]


def _table_1(founds: list[CellResults], folder: Path) -> Section:
    pairs = method_differences(founds)
    write_text_file(folder / "table_1.tex", as_latex(founds))
    rates = [float(one.collided.mean()) if len(one.good) else float("inf") for one in founds]
    first = write_table(
        folder, "table_1", "Table I. Cost: mean ± standard deviation", table_1(founds), founds
    )
    tables = [
        first._replace(
            bold=[(rates.index(min(rates)), list(first.frame.columns).index("Collision %"))]
        )
    ]
    if len(pairs):
        tables.append(
            write_table(
                folder,
                "table_1_differences",
                "MPPI-Belief against each method, trial by trial",
                pairs,
            )
        )
    alt = (
        "Fig. 1: 50 trials of each method in the plane, the noise of the position sensor as shading"
    )
    pictures = write_picture(folder, "figure_1", figures.figure_1(founds), alt)
    if figures.write_animation(founds, folder / "animation.gif"):
        alt = "One trial of MPPI-Belief next to CE-MPPI: true path, belief ellipse, sampled paths"
        pictures.append(Picture("animation.gif", alt))
    text = [
        f"{one.name} costs {cost_text(one)} and collides in {collision_text(one)} of its trials."
        for one in founds
    ]
    what = "Costs are those of the true state, obstacle penalties left out. Times are of the machine named below."
    return Section("Table I and Fig. 1: the four methods", [" ".join(text), what], tables, pictures)


def _matching(founds: list[CellResults], folder: Path) -> list[Section]:
    """The residual along the recorded trial of MPPI-Belief."""
    recorded = [one for one in by_method(founds).get("belief", []) if one.recording and one.scene]
    if not recorded or recorded[0].recording is None:
        return []
    least = {
        name: min((value for value in curves["optimum"] if value is not None), default=float("nan"))
        for name, curves in recorded[0].recording["matching"].items()
    }
    text = " and ".join(f"{value:.2f} (sigma_o as {name})" for name, value in least.items())
    alt = "Matching residual over time along one trial of MPPI-Belief: at its optimum, and as imposed by the planner"
    return [
        Section(
            "The matching residual",
            [
                "Controls reach the velocity only, so only its block of the diffusion can be matched (Proposition 3): "
                f"whatever the weight, the residual of (15) along a trial of MPPI-Belief is never below {text}. "
                f"The paper prints {published.RESIDUAL}; the steady state in the light, sigma_o as intensity, has 0.80."
            ],
            [],
            write_picture(folder, "matching", figures.residual_figure(recorded[0]), alt),
        )
    ]


def _weights(founds: list[CellResults], folder: Path) -> Section:
    text = []
    for cells in by_method(founds).values():
        rates = [
            100 * summarise_trials(one.rows, None).collided.value for one in cells if len(one.good)
        ]
        if rates:
            text.append(f"{cells[0].name} in {min(rates):.1f} to {max(rates):.1f} %")
    low, high = (100 * end for end in published.BASELINE_RANGE)
    alt = (
        "Fig. 2: (a) collision rate and (b) base cost over the obstacle weight, with 95 % intervals"
    )
    return Section(
        "Fig. 2: the obstacle weight",
        [
            f"Over all weights, collisions happen to {', to '.join(text)} of the trials.",
            f"Held out of the calibration. In the paper the baselines stay within {low:g} to {high:g} %.",
        ],
        [write_table(folder, "w_obs_sweep", "Every weight and method", cell_lines(founds), founds)],
        write_picture(folder, "figure_2", figures.figure_2(founds), alt),
    )


def _theta(founds: list[CellResults], folder: Path) -> Section:
    text = [
        f"{collision_text(one)} at theta = {one.labels['theta']:g}"
        for one in founds
        if len(one.good)
    ]
    alt = (
        "Collision rate, clearance and cost over theta, with 95 % intervals and the paper's values"
    )
    return Section(
        "The theta sweep",
        [f"Collisions by risk aversion: {', '.join(text)}.", "Held out of the calibration."],
        [
            write_table(
                folder, "theta_sweep", "MPPI-Belief by risk aversion", cell_lines(founds), founds
            )
        ],
        write_picture(folder, "theta_sweep", figures.theta_figure(founds), alt),
    )


def _expectation(founds: list[CellResults], folder: Path) -> Section:
    neutral = [one for one in founds if one.labels["theta"] == 0 and len(one.good)]
    how = {"exact": "expected exactly", "at_mean": "taken at the mean"}
    text = [
        f"{collision_text(one)} with the penalty {how[one.labels['controller.path_cost.expectation']]}"
        for one in neutral
    ]
    return Section(
        "What theta = 0 means",
        [
            "With the exact expectation of the obstacle penalty a planner without risk aversion already sees the "
            "covariance; with the penalty's value at the mean it is CE-MPPI, path by path, and the variance is all "
            f"that theta brings in. Collisions at theta = 0: {', '.join(text)}; the paper: "
            f"{100 * published.THETA[0.0].collision_rate[0]:g} %."
        ],
        [
            write_table(
                folder,
                "expectation",
                "MPPI-Belief by expectation and risk aversion",
                cell_lines(founds),
                founds,
            )
        ],
    )


def _diffusion(founds: list[CellResults], folder: Path) -> Section:
    tables = [
        write_table(
            folder,
            "diffusion",
            "Two systems, three controllers, theta = 0",
            cell_lines(founds),
            founds,
        )
    ]
    for name in dict.fromkeys(one.cell.config["names"]["system"] for one in founds):
        cells = [one for one in founds if one.cell.config["names"]["system"] == name]
        if len(pairs := method_differences(cells, "lqg")):
            tables.append(
                write_table(
                    folder, f"diffusion_{name}", f"LQG against each, trial by trial: {name}", pairs
                )
            )
    return Section(
        "Matched diffusion or Algorithm 1 as printed",
        [
            "On the scalar system matching holds exactly, and LQG is the optimum: what Algorithm 1 as printed and the "
            "planner about a warm-started nominal cost above it is the price of sampling and of their horizon. On the "
            "light-dark system the innovation hardly moves the velocity in the dark, so that Algorithm 1 as printed "
            "hardly steers there; LQG does not see the obstacles.",
        ],
        tables,
    )


def _samples(founds: list[CellResults], folder: Path) -> Section:
    usual = [
        one
        for one in founds
        if one.labels.get("planner.horizon") == published.HORIZON and len(one.good)
    ]
    text = [
        f"N = {one.labels['planner.n_samples']}: {collision_text(one)}, cost {cost_text(one)}"
        for one in usual
    ]
    alt = "Effective sample size, collision rate, cost and time by number of samples and horizon"
    return Section(
        "Horizon and number of samples",
        [f"Collisions and cost at the paper's horizon: {'; '.join(text)}."],
        [
            write_table(
                folder,
                "horizon_and_samples",
                "MPPI-Belief by horizon and samples",
                cell_lines(founds),
                founds,
            )
        ],
        write_picture(folder, "horizon_and_samples", figures.ess_figure(founds), alt),
    )


BUILDERS: dict[str, Callable[[list[CellResults], Path], Section]] = {
    "table_1": _table_1,
    "w_obs_sweep": _weights,
    "theta_sweep": _theta,
    "expectation": _expectation,
    "diffusion": _diffusion,
    "horizon_and_samples": _samples,
    "quality_per_time": quality,
}  # of the paper: what a report is of unless it is asked for others
BEYOND: dict[str, Callable[[list[CellResults], Path], Section]] = {
    "information": information,
    "proposals": proposals,
    "controlled_sensing": sensing,
    "nonlinearity": consistency,
    "two_lanes": two_lanes,
    **published_problems.BUILDERS,
}


def _general(name: str, founds: list[CellResults], folder: Path) -> Section:
    """A study that the report knows nothing of: its table."""
    return Section(
        name,
        [],
        [write_table(folder, name.replace("/", "_"), "All cells", cell_lines(founds), founds)],
    )


def _reproduction(studies: Studies, folder: Path) -> list[Section]:
    """The matching residual, and how well the published numbers are met, fitted and held-out apart."""
    first, weights = studies.get("table_1", []), studies.get("w_obs_sweep", [])
    compared = reproduction.compare(first, studies.get("theta_sweep", []), weights)
    if not compared:
        return _matching(first, folder)
    kinds = (reproduction.FITTED, reproduction.HELD_OUT)
    tables = [
        write_table(
            folder,
            f"reproduction_{kind.replace(' ', '_')}",
            f"{kind.capitalize().replace(' ', '-')} numbers, z in standard errors",
            frame,
        )
        for kind in kinds
        if len(frame := reproduction.as_frame(compared, kind))
    ]
    if len(values := _open_values(first)):
        tables.append(
            write_table(folder, "calibrated", "What the paper leaves open, as calibrated", values)
        )
    text = (
        "The paper leaves about ten numbers open. They were fitted to the costs, spreads and collision rates of "
        "Table I and to nothing else; both sweeps are predictions. z is the difference in standard errors; both sides "
        "are Monte Carlo estimates. Four choices were made by hand before the fit, by whether the paper's picture "
        "appears: sigma_o is the deviation of a sample, the variance of Remark 4 is that of the obstacle penalty, a "
        "step is charged at its end, and the particle filter takes the measurement noise at the particles' mean."
    )
    said = [
        *(reproduction.verdict(compared, kind) for kind in kinds),
        *reproduction.claims(first, weights),
    ]
    return [
        *_matching(first, folder),
        Section("How well the published numbers are met", [text, *said], tables),
    ]


def _open_values(founds: list[CellResults]) -> pd.DataFrame:
    """The calibrated settings of Table I's MPPI-Belief."""
    rows = []
    for one in by_method(founds).get("belief", [])[:1]:
        for key, meaning in published.OPEN.items():
            group, _, name = key.partition(".")
            rows.append(
                {"Key": key, "What": meaning, "Value": str(one.cell.config[group].get(name, "-"))}
            )
    return pd.DataFrame(rows)
