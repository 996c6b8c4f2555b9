"""Beyond the paper: how many sampled paths a step needs, by the policy they are sampled from."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from .. import figures
from ..cell_results import CellResults, paired_rows
from ..elements import cell_lines, write_picture, write_table
from ..figures.sampling_efficiency import KEY
from ..page import Section
from ..statistics import Estimate, paired_mean_difference
from ..summary import interval_text, label_text, summarise_trials


def proposals(founds: list[CellResults], folder: Path) -> Section:
    """The table of all cells with effective samples a millisecond, and cost against time."""
    frame = cell_lines(founds)
    frame.insert(1, "system", [_scenario(one)[0] for one in founds])
    frame.insert(list(frame.columns).index("ESS") + 1, "ESS/ms", [_rate(one) for one in founds])
    alt = "Cost and effective sample size against milliseconds per step, a line a planner and proposal"
    usual = [one for one in founds if _scenario(one) == _scenario(founds[0])]
    return Section(
        "Beyond the paper: where paths are sampled",
        [
            "The paper samples controls about a nominal that is the same for all paths. The Laplace proposal samples "
            "them from the optimal feedback policy of the problem expanded about that nominal, and corrects the "
            "weights for it; one path in five stays about the nominal. For many samples both give the same control.",
            " ".join([*_gains(founds), *_fewest(usual)]),
        ],
        [
            write_table(
                folder, "proposals", "Every planner, proposal and number of samples", frame, founds
            )
        ],
        write_picture(folder, "proposals", figures.proposals_figure(usual), alt),
    )


def twins(founds: Sequence[CellResults]) -> Iterator[tuple[CellResults, CellResults]]:
    """The cells that differ in nothing but the proposal: nominal, Laplace."""
    told = [
        (one, {name: label_text(value) for name, value in one.labels.items() if name != KEY})
        for one in founds
    ]
    for one, labels in told:
        if one.labels.get(KEY) == "nominal":
            yield from (
                (one, other)
                for other, also in told
                if other.labels.get(KEY) == "laplace" and also == labels
            )


def saved(
    founds: Sequence[CellResults], method: str
) -> tuple[CellResults, CellResults, Estimate] | None:
    """The nominal with most samples, the fewest from the Laplace proposal that cost less for certain, and by how much;
    None where there are none."""
    there = [one for one in founds if one.method == method and len(one.good) > 1]
    nominal = [one for one in there if one.labels.get(KEY) == "nominal"]
    if not nominal:
        return None
    most = max(nominal, key=lambda one: one.samples or 0)
    for one in sorted(there, key=lambda one: one.samples or 0):
        if one.labels.get(KEY) == "laplace":
            first, second = paired_rows(one, most)
            less = paired_mean_difference(second["cost"].to_numpy(), first["cost"].to_numpy())
            if less.low >= 0:
                return most, one, less
    return None


def _scenario(found: CellResults) -> tuple[str, str]:
    return str(found.cell.config["names"]["system"]), label_text(found.labels["w_obs"])


def _gains(founds: Sequence[CellResults]) -> list[str]:
    """What the proposal does to the effective sample size, over all pairs of cells."""
    sizes = [
        (summarise_trials(one.rows, None).ess, summarise_trials(other.rows, None).ess)
        for one, other in twins(founds)
    ]
    ratios = [guided / before for before, guided in sizes if before > 0 and math.isfinite(guided)]
    if not ratios:
        return []
    return [
        f"The effective sample size is {min(ratios):.2g} to {max(ratios):.2g} times that about the nominal."
    ]


def _fewest(founds: Sequence[CellResults]) -> list[str]:
    """For each method how few samples do what the nominal does with most."""
    text = []
    for method in dict.fromkeys(one.method for one in founds):
        if found := saved(founds, method):
            most, one, less = found
            text.append(
                f"{one.name} with {one.samples} samples of it costs {interval_text(less, 2)} less than with {most.samples} "
                f"about the nominal{_times(one, most)}."
            )
    return text


def _times(one: CellResults, most: CellResults) -> str:
    quick, slow = (summarise_trials(found.rows, found.seconds).time for found in (one, most))
    return (
        f", in {quick:.2f} ms a step for {slow:.2f}"
        if math.isfinite(quick) and math.isfinite(slow)
        else ""
    )


def _rate(found: CellResults) -> str:
    told = summarise_trials(found.rows, found.seconds)
    return (
        f"{told.ess / told.time:.0f}"
        if math.isfinite(told.ess) and math.isfinite(told.time)
        else "-"
    )
