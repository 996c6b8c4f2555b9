"""The sentences of docs/results.md that contain measured numbers, from the results of studies.

results_page.py puts them into the page; `SENTENCES` says which studies each of them needs.
"""

import textwrap
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Any, NamedTuple

import pandas as pd

from mppi_belief.report import published
from mppi_belief.report.agreement import FITTED, HELD_OUT, ComparedNumber, compare_numbers
from mppi_belief.report.cell_results import CellResults, Studies, by_method
from mppi_belief.report.claims import judged_claims
from mppi_belief.report.comparison import cost_difference
from mppi_belief.report.elements import collision_text
from mppi_belief.report.frame_files import as_markdown
from mppi_belief.report.page import Section
from mppi_belief.report.sections.published_problems import problem_frame
from mppi_belief.report.sections.reproduction import multiplicity_verdict, verdict
from mppi_belief.report.summary import interval_text, summarise_trials
from mppi_belief.report.targets import MET, evaluate_targets
from mppi_belief.report.wording import count_range, listed

WIDTH = 118  # characters of a line of the page
NO_BREAK = "\N{NO-BREAK SPACE}"
COMMIT_LENGTH = 7  # characters of a commit's name
PROBLEM_COLUMNS = (
    "furthest x m",
    "belief sd at the end m",
    "final distance m [95 %]",
    "cost [95 %]",
)


class PageSources(NamedTuple):
    """Holds what the page is made of."""

    studies: Studies  # those that have results
    sections: list[Section]  # of the report of these studies


def paragraph(*sentences: str) -> str:
    """Returns sentences as the lines of one paragraph."""
    return _wrapped(" ".join(sentences))


def items(sentences: Sequence[str]) -> str:
    """Returns sentences as a list."""
    return "\n".join(_wrapped(f"- {sentence}", "  ") for sentence in sentences)


def _wrapped(text: str, indent: str = "") -> str:
    """Breaks a text into lines, no percent sign away from its number."""
    lines = textwrap.fill(
        text.replace(" %", f"{NO_BREAK}%"),
        WIDTH,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines.replace(NO_BREAK, " ")


def origin(sources: PageSources) -> str:
    """Says when, where and with what the trials were run."""
    cells = [cell for study in sources.studies.values() for cell in study]
    runs = [source for cell in cells for source in cell.sources]
    versions = [run.get("versions") or {} for run in runs]
    days = _different(_day(run["started"]) for run in runs if run.get("started"))
    commits = _different(str(run.get("commit"))[:COMMIT_LENGTH] for run in runs)
    python = listed(_different(version.get("python") for version in versions))
    jax = listed(_different(version.get("jax") for version in versions))
    trials = count_range(cell.wanted for cell in sources.studies["table_1"])
    return paragraph(
        f"The trials were run on {listed(days)} at {_noun(commits, 'commit')} {listed(commits)}, "
        f"on {listed(_different(run.get('processor') for run in runs))}, with Python {python} and "
        f"JAX {jax}, in {listed(_different(cell.config['precision'] for cell in cells))}, with "
        f"seed {listed(_different(cell.config['seed'] for cell in cells))}. Each cell has {trials} "
        "trials, as in the paper, unless its table says otherwise; all cells of a study meet the "
        "same noise."
    )


def _day(text: str) -> str:
    """Returns the day of a time in ISO format: 30 November 2026."""
    moment = datetime.fromisoformat(text)
    return f"{moment.day} {moment:%B %Y}"


def _different(values: Any) -> list[str]:
    """Returns the distinct values as text, in order; without None."""
    return list(dict.fromkeys(str(value) for value in sorted(values, key=str) if value is not None))


def _noun(values: Sequence[str], noun: str) -> str:
    return noun if len(values) == 1 else f"{noun}s"


def summary(sources: PageSources) -> str:
    """Says how Table I came out, and how many numbers and targets are met."""
    methods = by_method(sources.studies["table_1"])
    belief = methods["belief"][0]
    baselines = [methods[method][0] for method in published.BASELINES]
    rates = [100 * float(cell.collided.mean()) for cell in baselines]
    long_belief = by_method(sources.studies["table_1_long"])["belief"][0]
    above = interval_text(cost_difference(belief, methods["ce"][0]), 1)
    numbers = _compared(sources)
    targets = evaluate_targets(sources.studies)
    met = sum(target.verdict == MET for target in targets)
    return paragraph(
        f"MPPI-Belief collides in {collision_text(belief)} of {len(belief.good)} trials and in "
        f"{collision_text(long_belief)} of {len(long_belief.good)}, the baselines in "
        f"{min(rates):.1f} to {max(rates):.1f} % of {len(belief.good)}. It costs {above} more than "
        "CE-MPPI.",
        verdict(numbers, FITTED),
        verdict(numbers, HELD_OUT),
        f"{met} of the {len(targets)} targets {'is' if met == 1 else 'are'} met.",
    )


def agreement(sources: PageSources) -> str:
    """Says how many numbers agree, and what so many comparisons mean."""
    numbers = _compared(sources)
    sentences = [verdict(numbers, FITTED), verdict(numbers, HELD_OUT)]
    return paragraph(*sentences, multiplicity_verdict(numbers))


def claims(sources: PageSources) -> str:
    """Judges the paper's conclusions, an item each."""
    return items(judged_claims(sources.studies["table_1"], sources.studies["w_obs_sweep"]))


def _compared(sources: PageSources) -> list[ComparedNumber]:
    names = ("table_1", "theta_sweep", "w_obs_sweep")
    return compare_numbers(*(sources.studies[name] for name in names))


def weights(sources: PageSources) -> str:
    """Returns collisions and cost of each method over the obstacle weight as a table."""
    lines = []
    for cells in by_method(sources.studies["w_obs_sweep"]).values():
        line = {"Collisions % (cost)": cells[0].name}
        for cell in sorted(cells, key=lambda cell: float(cell.labels["w_obs"])):
            ours = summarise_trials(cell.rows, None)
            text = f"{100 * ours.collided.value:.1f} ({ours.cost.value:.1f})"
            line[f"{cell.labels['w_obs']:g}"] = text
        lines.append(line)
    return as_markdown(pd.DataFrame(lines).fillna("-"))


def neutral(sources: PageSources) -> str:
    """Compares theta = 0 with both expectations, CE-MPPI and the paper's row."""
    cells = [cell for cell in sources.studies["expectation"] if cell.labels["theta"] == 0]
    certain = by_method(sources.studies["table_1"])["ce"][0]
    paper = published.PAPER_THETA[0.0]
    parts = [
        f"{_three_numbers(cell)} with "
        f"`controller.path_cost.expectation={cell.labels[published.EXPECTATION_KEY]}`"
        for cell in cells
    ]
    return paragraph(
        f"At theta = 0 collisions, clearance and cost are {'; '.join(parts)}. CE-MPPI has "
        f"{_three_numbers(certain)}, the paper's row {100 * paper.collision_rate[0]:.1f} %, "
        f"{paper.clearance:.2f} m and {paper.cost}."
    )


def _three_numbers(cell: CellResults) -> str:
    """Returns collision rate, clearance and cost of a cell."""
    ours = summarise_trials(cell.rows, None)
    rate = 100 * ours.collided.value
    return f"{rate:.1f} %, {ours.clearance.value:.2f} m and {ours.cost.value:.1f}"


def times(sources: PageSources) -> str:
    """Returns the medians of a control step beside the paper's times."""
    parts = []
    for method, row in published.TABLE_1.items():
        cell = by_method(sources.studies["table_1"])[method][0]
        ours = summarise_trials(cell.rows, cell.seconds).time
        parts.append(f"{ours:.2f} ms for {cell.name} (the paper: {row.time:g})")
    sweep = [summarise_trials(cell.rows, cell.seconds) for cell in sources.studies["theta_sweep"]]
    step = [summary.time for summary in sweep]
    return paragraph(
        f"The medians of Table I above are {listed(parts)}. The rows of the theta sweep, which "
        f"take the step of MPPI-Belief, have {min(step):.2f} to {max(step):.2f} ms."
    )


def matching_residual(sources: PageSources) -> str:
    """Returns what the report says of the residual of (15) along the recorded trial."""
    return _section_text(sources, "The matching residual")


def diffusion_text(sources: PageSources) -> str:
    """Returns what the report says of Algorithm 1 as printed."""
    return _section_text(sources, "Matched diffusion or Algorithm 1 as printed")


def quality(sources: PageSources) -> str:
    """Returns what the report says of the quickest settings."""
    return _section_text(sources, "Quality per time: which setting to choose")


def _section_text(sources: PageSources, title: str) -> str:
    """Returns the paragraphs of a section of the report; "" where there is no such section."""
    texts = [section.text for section in sources.sections if section.title == title]
    return "\n\n".join(paragraph(text) for text in (texts[0] if texts else []))


def problems(sources: PageSources) -> str:
    """Returns the methods on both published problems as one table."""
    frames = []
    for study, authors in (("platt_2010", "Platt"), ("van_den_berg_2012", "van den Berg")):
        frame = problem_frame(sources.studies[study])
        frame.insert(0, "Problem", f"{authors} et al.")
        frames.append(frame[["Problem", "method", *PROBLEM_COLUMNS]])
    return as_markdown(pd.concat(frames))


# The studies that each block needs, and the function that writes it.
SENTENCES: dict[str, tuple[tuple[str, ...], Callable[[PageSources], str]]] = {
    "origin": (("table_1",), origin),
    "summary": (("table_1", "table_1_long", "theta_sweep", "w_obs_sweep"), summary),
    "agreement": (("table_1", "theta_sweep", "w_obs_sweep"), agreement),
    "claims": (("table_1", "w_obs_sweep"), claims),
    "weights": (("w_obs_sweep",), weights),
    "neutral": (("table_1", "expectation"), neutral),
    "times": (("table_1", "theta_sweep"), times),
    "matching_residual": (("table_1",), matching_residual),
    "diffusion_text": (("diffusion",), diffusion_text),
    "quality": (("quality_per_time",), quality),
    "problems": (("platt_2010", "van_den_berg_2012"), problems),
}
