"""The cells of a results folder: which there are, which one a person means, what their files weigh."""

import os
import re
import time
from collections.abc import Collection, Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path

from ..errors import ConfigError
from .files import TEMPORARY

_ID = re.compile(r".+-[0-9a-f]{12}")


def cells(root: Path) -> list[Path]:
    """The folders of all cells, by name; raises `ConfigError` where `root` is no folder."""
    if not root.is_dir():
        raise ConfigError(f"results_dir={root}: no such folder")
    return sorted(folder for folder in root.iterdir() if folder.is_dir() and _is_cell(folder))


def _is_cell(folder: Path) -> bool:
    return bool(_ID.fullmatch(folder.name)) or any(folder.glob("part-*.parquet"))


def choose(root: Path, word: str) -> Path:
    """The folder of the cell that a word names: the beginning of its id, or the path of its folder; raises
    `ConfigError` for none and for several."""
    if os.sep in word or word in (os.curdir, os.pardir):
        folder = Path(word).resolve()
        if not (folder.is_dir() and _is_cell(folder)):
            raise ConfigError(f"{word}: not the folder of a cell")
        return folder
    known = [folder.name for folder in cells(root)]
    begun = [name for name in known if name.startswith(word)]
    if word in begun or len(begun) == 1:
        return root / (word if word in begun else begun[0])
    if begun:
        raise ConfigError(f"cell '{word}' is not the only one that begins so: {_some(begun)}")
    within = [name for name in known if word in name]
    if within:
        raise ConfigError(f"no cell begins with '{word}'; did you mean {_some(within)}?")
    near = get_close_matches(word, {name[: len(word)] for name in known}, n=1)
    if near:
        meant = [name for name in known if name.startswith(near[0])]
        raise ConfigError(f"unknown cell '{word}'; did you mean {_some(meant)}?")
    raise ConfigError(f"unknown cell '{word}'; see mppi-belief results results_dir={root}")


def _some(names: Sequence[str], most: int = 6) -> str:
    others = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + others


def files(folder: Path) -> list[Path]:
    """All files of a cell, those that a killed writer has left behind too."""
    return sorted(path for path in folder.iterdir() if path.is_file())


def size(paths: Collection[Path]) -> int:
    """Bytes; a file that is gone has none."""
    return sum(found.st_size for found in _stats(paths))


def age(paths: Collection[Path]) -> float:
    """Seconds since the newest was written; 0 for one from the future, as after a clock was set back."""
    newest = max((found.st_mtime for found in _stats(paths)), default=0.0)
    return max(time.time() - newest, 0.0)


def leftovers(folder: Path, older: float) -> list[Path]:
    """What writers that were killed have left behind, more than `older` seconds ago."""
    return [
        path for path in files(folder) if path.name.startswith(TEMPORARY) and age([path]) > older
    ]


def _stats(paths: Collection[Path]) -> Iterator[os.stat_result]:
    for path in paths:
        try:
            yield path.stat()
        except FileNotFoundError:
            continue
