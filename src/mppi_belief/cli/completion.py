"""Tab completion: the command words are ours, what follows `run` and `verify` is Hydra's."""

import os
from collections.abc import Sequence

from ..config.compose import compose

COMMANDS = ("run", "report", "verify", "results", "replay")
FIRST_WORDS = (*COMMANDS, "--help", "--version")


def complete(args: Sequence[str]) -> int:
    """Shell completion is Hydra's; the command word is ours and taken out of the line it sees."""
    line = os.environ.get("COMP_LINE", "")
    words = line.split()
    if any(arg.startswith("query=") for arg in args):
        if len(words) < 2 or (
            len(words) == 2 and words[1] not in COMMANDS and not line.endswith(" ")
        ):
            print(
                " ".join(
                    word for word in FIRST_WORDS if len(words) < 2 or word.startswith(words[1])
                )
            )
            return 0
        if words[1] in ("results", "replay"):
            from .result_words import complete as complete_words

            print(*complete_words(words[1:], begun=not line.endswith(" ")), sep="\n")
            return 0
        if words[1] == "verify":
            line = _complete_certificates(line, words)
        os.environ["COMP_LINE"] = line.replace(f" {words[1]}", "", 1)
    compose(args, lambda config: None)
    return 0


def _complete_certificates(line: str, words: Sequence[str]) -> str:
    """Print the certificates that the last word begins; the line without those that are there, for Hydra."""
    from ..results.certificate import CERTIFICATE_NAMES

    begun = "" if line.endswith(" ") else words[-1]
    print(
        *(name for name in CERTIFICATE_NAMES if name.startswith(begun) and name not in words),
        sep="\n",
    )
    for name in {*CERTIFICATE_NAMES}.intersection(words):
        line = line.replace(f" {name}", "")
    return line
