"""A gate that decides how many trials of a real command may begin, so that tests wait for events
and not for time.
"""

import os
from pathlib import Path

GATED = str(Path(__file__).resolve().parent / "gated")  # a --config-dir with gated controllers
EVERYTHING = 10**9


class Gate:
    """Admits a number of trials of the commands that run in its environment; further ones wait in
    their workers.

    `folder` must be new for each command. Workers are those of `tests/gated/gated.py`.
    """

    def __init__(self, folder: Path, admitted: int) -> None:
        folder.mkdir(parents=True)
        self.folder = folder
        self.admit(admitted)

    @property
    def environment(self) -> dict[str, str]:
        """Returns the environment of a command whose trials this gate holds."""
        return os.environ | {"MPPI_BELIEF_TEST_GATE": str(self.folder)}

    def admit(self, count: int) -> None:
        """Lets so many trials begin in all."""
        temporary = self.folder / "admitted.new"
        temporary.write_text(str(count))
        temporary.replace(self.folder / "admitted")

    def open(self) -> None:
        """Lets all trials begin."""
        self.admit(EVERYTHING)

    def waiting(self) -> list[int]:
        """Returns the ids of the processes that wait, in the order in which they came."""
        tickets = self.folder / "tickets"
        if not tickets.exists():
            return []
        pids = tickets.read_text().split()
        return [int(pid) for pid in pids[int((self.folder / "admitted").read_text()) :]]
