"""Exit codes of all commands, with the meanings that help texts and docs/reliability.md print."""

from collections.abc import Sequence
from typing import NamedTuple

DONE = 0
CERTIFICATE_FAILS = 1
BAD_INPUT = 2
INCOMPLETE = 3
CANNOT_WRITE = 74  # EX_IOERR of sysexits.h
NO_WORKERS = 75  # EX_TEMPFAIL of sysexits.h
SIGNALLED = 128  # plus the number of the signal
READER_GONE = 141  # 128 + SIGPIPE


class Meaning(NamedTuple):
    """Says what an exit code of a command means."""

    code: str  # as printed: "3", or "130, 143"
    command: str  # "run", or "every command"
    meaning: str


MEANINGS = (
    Meaning(f"{DONE}", "every command", "done"),
    Meaning(
        f"{DONE}", "verify", "all certificates hold, or the question about a system is answered"
    ),
    Meaning(f"{DONE}", "replay", "the trial was reproduced bit for bit"),
    Meaning(f"{CERTIFICATE_FAILS}", "verify", "a certificate fails or cannot be computed"),
    Meaning(f"{BAD_INPUT}", "every command", "the input is wrong; nothing was run"),
    Meaning(f"{INCOMPLETE}", "run", "done, but some trials failed"),
    Meaning(f"{INCOMPLETE}", "report", "written, but trials or certificates are missing"),
    Meaning(f"{INCOMPLETE}", "results", "`results verify` has found something wrong"),
    Meaning(f"{INCOMPLETE}", "replay", "the trial was not reproduced"),
    Meaning(f"{CANNOT_WRITE}", "every command", "results, or the output, cannot be written"),
    Meaning(
        f"{NO_WORKERS}",
        "run",
        "no worker can run trials: processes die while they start, or the cluster is gone",
    ),
    Meaning("130, 143", "run", "stopped by Ctrl-C, by SIGTERM; the same command goes on"),
    Meaning("130, 143", "every command", "stopped by Ctrl-C, by SIGTERM"),
)


def meanings_of(command: str) -> list[Meaning]:
    """Returns the exit codes of one command; its own meaning of a code replaces the common one."""
    own = [entry for entry in MEANINGS if entry.command == command]
    codes = {entry.code for entry in own}
    common = [
        entry for entry in MEANINGS if entry.command == "every command" and entry.code not in codes
    ]
    return sorted([*own, *common], key=lambda entry: int(entry.code.partition(",")[0]))


def help_text(command: str) -> str:
    """Returns the paragraph on exit codes of a command's help."""
    return "\n".join(["Exit codes:", *_columns(meanings_of(command))])


def markdown() -> str:
    """Returns the table of exit codes of docs/reliability.md."""
    lines = ["| code | command | meaning |", "|---|---|---|"]
    lines += [f"| {entry.code} | {entry.command} | {entry.meaning} |" for entry in MEANINGS]
    return "\n".join(lines)


def _columns(entries: Sequence[Meaning]) -> list[str]:
    return [f"  {entry.code:8}  {entry.meaning}" for entry in entries]
