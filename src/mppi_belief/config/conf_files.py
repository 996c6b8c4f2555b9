"""The folder conf/ of this package: where it lies and what its files hold, read without Hydra."""

from collections.abc import Sequence
from pathlib import Path

import yaml

from ..errors import ConfigError


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


def check_aliases(folder: Path) -> None:
    """Raises `ConfigError` for a yaml file of a folder's groups in which an alias contains itself.

    OmegaConf would unfold such a node until the memory is full. A file that is no yaml is left to
    the reader of the file.
    """
    for path in sorted(folder.glob("*/**/*.yaml")):
        text = path.read_bytes()
        if b"&" not in text or b"*" not in text:
            continue
        try:
            alias = _alias_of_itself(text)
        except yaml.YAMLError:
            continue
        if alias is not None:
            raise ConfigError(f"{path}: *{alias} contains itself")


def _alias_of_itself(text: bytes) -> str | None:
    """Returns the name of an anchor that an alias within its own node repeats, if there is one."""
    open_anchors: list[str | None] = []
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            open_anchors.append(event.anchor)
        elif isinstance(event, yaml.CollectionEndEvent):
            open_anchors.pop()
        elif isinstance(event, yaml.AliasEvent) and event.anchor in open_anchors:
            return str(event.anchor)
    return None
