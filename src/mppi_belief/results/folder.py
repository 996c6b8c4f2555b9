"""Finds the cells of a results folder: which there are, which one a person means, what their files
weigh.
"""

import os
import re
import shlex
import time
from collections.abc import Collection, Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path

from ..config.folders import home_expanded
from ..errors import ConfigError
from .files import TEMPORARY

_CELL_ID = re.compile(r".+-[0-9a-f]{12}")


def cell_folders(root: Path) -> list[Path]:
    """Returns the folders of all cells, by name; raises `ConfigError` where `root` is no folder."""
    if not root.is_dir():
        raise ConfigError(f"results_dir={root}: no such folder")
    return sorted(folder for folder in root.iterdir() if folder.is_dir() and _is_cell(folder))


def _is_cell(folder: Path) -> bool:
    return bool(_CELL_ID.fullmatch(folder.name)) or any(folder.glob("part-*.parquet"))


def choose_cell(root: Path, word: str) -> Path:
    """Returns the folder of the cell that a word names: the beginning of its id, or the path of its
    folder.

    Raises `ConfigError` for none and for several.
    """
    if os.sep in word or word in (os.curdir, os.pardir):
        folder = _path(word).resolve()
        if not (folder.is_dir() and _is_cell(folder)):
            raise ConfigError(f"{word}: not the folder of a cell")
        return folder
    names = [folder.name for folder in cell_folders(root)]
    matches = [name for name in names if name.startswith(word)]
    if word in matches:
        return root / word
    if len(matches) == 1:
        return root / matches[0]
    if matches:
        raise ConfigError(
            f"several cells begin with '{word}': {_listed(matches)}; name one of them in full, "
            f"{_listing_command(root)} shows their settings"
        )
    raise ConfigError(_unknown_cell(root, word, names))


def _path(word: str) -> Path:
    """Returns the path that a word names, with the home folder for `~`. Raises `ConfigError`."""
    try:
        return Path(home_expanded(word))
    except ValueError as error:
        raise ConfigError(f"the folder of the cell {error}") from None


def _unknown_cell(root: Path, word: str, names: Sequence[str]) -> str:
    """Returns the message for a word that begins no cell's id, with the ids that were probably
    meant.
    """
    containing = [name for name in names if word in name]
    if containing:
        return f"no cell begins with '{word}'; did you mean {_listed(containing)}?"
    near = get_close_matches(word, {name[: len(word)] for name in names}, n=1)
    if near:
        similar = [name for name in names if name.startswith(near[0])]
        return f"unknown cell '{word}'; did you mean {_listed(similar)}?"
    return f"unknown cell '{word}'; see {_listing_command(root)}"


def _listing_command(root: Path) -> str:
    """Returns the command that lists the cells of a folder, to be copied into a shell."""
    return shlex.join(["mppi-belief", "results", f"results_dir={root}"])


def _listed(names: Sequence[str], most: int = 6) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def cell_files(folder: Path) -> list[Path]:
    """Returns all files of a cell, including those that a killed writer has left behind."""
    return sorted(path for path in folder.iterdir() if path.is_file())


def total_size(paths: Collection[Path]) -> int:
    """Returns the size in bytes; a file that is gone has none."""
    return sum(stat.st_size for stat in _stats(paths))


def seconds_since_write(paths: Collection[Path]) -> float:
    """Returns the seconds since the newest file was written; 0 for one from the future, as after a
    clock was set back.
    """
    newest = max((stat.st_mtime for stat in _stats(paths)), default=0.0)
    return max(time.time() - newest, 0.0)


def leftovers(folder: Path, older: float) -> list[Path]:
    """Returns the files that killed writers have left behind more than `older` seconds ago."""
    temporary = [path for path in cell_files(folder) if path.name.startswith(TEMPORARY)]
    return [path for path in temporary if seconds_since_write([path]) > older]


def _stats(paths: Collection[Path]) -> Iterator[os.stat_result]:
    for path in paths:
        try:
            yield path.stat()
        except FileNotFoundError:
            continue
