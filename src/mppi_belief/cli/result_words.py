"""What stands on the command line of a tool: words, options and results_dir=DIR."""

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from omegaconf import OmegaConf

from ..config.conf_files import conf_dir
from ..errors import ConfigError, unknown_key
from ..results.folder import cell_folders

_ALL = ("--csv", "--force", "--to", "--config-dir", "-cd")
_SETTING = re.compile(r"\w+=.*", re.DOTALL)


class Words(NamedTuple):
    """Plain words in their order, the values of each option (empty for one that takes none), the results folder."""

    words: list[str]
    options: dict[str, list[str]]
    root: Path


def read(
    args: Sequence[str], command: str, flags: Collection[str] = (), valued: Collection[str] = ()
) -> Words:
    """Sort the arguments of a command that takes these options, without and with a value; raises `ConfigError`."""
    words, left = list[str](), list(args)
    options: dict[str, list[str]] = {}
    root = str(OmegaConf.select(OmegaConf.load(conf_dir() / "config.yaml"), "results_dir"))
    while left:
        arg = left.pop(0)
        name, equals, value = arg.partition("=")
        if arg in flags:
            options.setdefault(arg, [])
        elif name in valued and (equals or left):
            options.setdefault(name, []).append(value if equals else left.pop(0))
        elif name in valued:
            raise ConfigError(f"{name}: needs a value")
        elif arg.startswith("-"):
            raise ConfigError(
                unknown_key(
                    arg, [*flags, *valued], what="option", see=f"mppi-belief {command} --help"
                )
            )
        elif name == "results_dir" and equals:
            root = value
        elif _SETTING.fullmatch(arg):
            raise ConfigError(
                unknown_key(name, ["results_dir"], see=f"mppi-belief {command} --help")
            )
        else:
            words.append(arg)
    if not root.strip():
        raise ConfigError("results_dir: must name a folder")
    return Words(words, options, Path(root))


def complete(words: Sequence[str], begun: bool) -> list[str]:
    """What may stand at the end of a line: `words` from the command on, the last of them `begun` or not."""
    *before, last = words if begun else [*words, ""]
    command, *rest = before or [last]
    given = [word for word in rest if not _SETTING.fullmatch(word) and not word.startswith("-")]
    subcommands = (
        ["show", "export", "compact", "verify"] if command == "results" and not given else []
    )
    options = ["results_dir="]
    if subcommands:
        return [word for word in [*subcommands, *options] if word.startswith(last)]
    try:
        names = [folder.name for folder in cell_folders(read(rest, command, _ALL, _ALL).root)]
    except (ConfigError, OSError):
        names = []
    return [word for word in [*names, *options] if word.startswith(last)]
