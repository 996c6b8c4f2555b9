"""The folder conf/ of this package: where it lies and which files it has."""

from collections.abc import Sequence
from pathlib import Path


def conf_dir() -> Path:
    """Returns conf/ of the checkout that this file belongs to, or the copy installed beside the
    package.
    """
    checkout = Path(__file__).resolve().parents[3]
    if (checkout / "pyproject.toml").is_file() and (checkout / "conf").is_dir():
        return checkout / "conf"
    return Path(__file__).resolve().parents[1] / "conf"


def groups(folders: Sequence[str] = ()) -> dict[str, list[str]]:
    """Returns the options of every group of conf/ and of more folders, sorted; a nested group is
    `controller/sampler`.
    """
    options: dict[str, set[str]] = {}
    for folder in (conf_dir(), *map(Path, folders)):
        for path in folder.glob("*/**/*.yaml"):
            group = path.parent.relative_to(folder).as_posix()
            options.setdefault(group, set()).add(path.stem)
    return {group: sorted(options[group]) for group in sorted(options)}


def file_of(group: str, option: str, folders: Sequence[str] = ()) -> Path | None:
    """Returns the file of an option of a group: that of conf/, or else the first of the folders
    that has one.
    """
    for folder in (conf_dir(), *map(Path, folders)):
        path = folder / group / f"{option}.yaml"
        if path.is_file():
            return path
    return None
