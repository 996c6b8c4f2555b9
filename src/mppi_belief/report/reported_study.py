"""The studies that a report is asked for: their cells, and how their sections are headed."""

import shlex
from typing import NamedTuple

from ..config.cell import Cell


class ReportedStudy(NamedTuple):
    """Holds a study as the command line asks for it; its results are read elsewhere."""

    name: str  # that of its yaml in experiment/, or `SWEEP`
    cells: list[Cell]
    words: tuple[str, ...]  # of the command `mppi-belief run` that runs its trials
    overrides: tuple[str, ...]  # the settings of the command line among them
    is_own: bool  # whether its settings are others than those of a study that has a section
    stem: str  # of the files of a study of one's own
    title: str  # of a study of one's own
    question: str  # what it asks, in a sentence or two; may be empty

    @property
    def command(self) -> str:
        """Returns the command that runs the trials of the study."""
        return shlex.join(["mppi-belief", "run", *self.words])
