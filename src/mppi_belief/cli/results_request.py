"""What commands that look into a results folder share: plain words, options and results_dir=DIR."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ..config.reference import reference_folder
from ..errors import ConfigError, unknown_key
from .parser import CommandParser

SETTING = re.compile(r"\w+=.*", re.DOTALL)
ONLY_SETTING = "results_dir"


class ResultsRequest(NamedTuple):
    """Holds what a command line asks of a results folder."""

    words: list[str]  # in their order, without results_dir=DIR
    options: argparse.Namespace  # those of the command's parser
    root: Path  # the results folder


def read_request(parser: CommandParser, args: Sequence[str]) -> ResultsRequest:
    """Returns what the words of a command ask for. Raises `ConfigError`."""
    options = parser.read(args)
    words: list[str] = []
    root = None
    for word in options.words:
        name, _, value = word.partition("=")
        if not SETTING.fullmatch(word):
            words.append(word)
        elif name == ONLY_SETTING:
            root = value
        else:
            see = f"mppi-belief {parser.name} --help"
            raise ConfigError(unknown_key(name, [ONLY_SETTING], see=see))
    return ResultsRequest(words, options, reference_folder(ONLY_SETTING, root))


def matching_cells(root: Path, beginning: str) -> list[str]:
    """Returns the names of the cells in a results folder that begin so, for tab completion."""
    from ..results.folder import cell_folders

    try:
        names = [folder.name for folder in cell_folders(root)]
    except (ConfigError, OSError):
        return []
    return [name for name in names if name.startswith(beginning) and re.fullmatch(r"[\w.-]+", name)]
