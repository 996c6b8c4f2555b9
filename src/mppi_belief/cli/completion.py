"""Tab completion in bash: the script that is evaluated, and the words that it asks for.

The options of a command come from its parser, keys and options of groups
from the configuration that the words before the cursor compose.
"""

import os
from collections.abc import Mapping, Sequence
from typing import Any

from omegaconf import OmegaConf

from ..config.compose import first_job
from ..config.conf_files import groups
from ..config.request import Request
from ..errors import ConfigError
from . import exit_codes

SCRIPT = r"""
_mppi_belief_completion()
{
    local line
    COMPREPLY=()
    while IFS= read -r line; do
        COMPREPLY+=("$line")
    done < <(COMP_LINE="$COMP_LINE" COMP_POINT="$COMP_POINT" "${COMP_LINE%% *}" -sc query=bash)
}
COMP_WORDBREAKS=${COMP_WORDBREAKS//=}
complete -o nospace -o default -F _mppi_belief_completion mppi-belief
""".lstrip()


def answer_completion(args: Sequence[str], commands: Mapping[str, Any]) -> int:
    """Carries out `mppi-belief -sc install=bash` or `query=bash`; returns the exit code.

    `commands` has the module of each command, as `main.COMMANDS` has.
    """
    if "install=bash" in args:
        print(SCRIPT, end="")
    elif "query=bash" in args:
        line = os.environ.get("COMP_LINE", "")
        point = int(os.environ.get("COMP_POINT") or len(line))
        for word in candidates(line[:point], commands):
            print(word)
    else:
        raise ConfigError("-sc: must be followed by install=bash or query=bash")
    return exit_codes.DONE


def candidates(line: str, commands: Mapping[str, Any]) -> list[str]:
    """Returns what the last word of a line may become; after a space, that is a new word."""
    words = line.split()[1:]
    if not words or line.endswith(" "):
        words.append("")
    *before, last = words
    if not before:
        first_words = (*commands, "--help", "--version")
        return [word for word in first_words if word.startswith(last)]
    command, *before = before
    if command not in commands:
        return []
    module = commands[command]
    if last.startswith("-"):
        return [option for option in module.parser().options if option.startswith(last)]
    return list(module.complete(before, last))


def complete_setting(request: Request, last: str) -> list[str]:
    """Returns what a word KEY=VALUE that is begun may become, in the configuration of a request."""
    options = groups(request.config_dirs)
    signs = last[: len(last) - len(last.lstrip("+~"))]
    word = last.removeprefix(signs)
    key, equals, value = word.partition("=")
    if equals:
        done, comma, begun = value.rpartition(",")  # of several options, the last is completed
        matching = [option for option in options.get(key, []) if option.startswith(begun)]
        return [f"{signs}{key}={done}{comma}{option}" for option in matching]
    return [f"{signs}{name}" for name in _matching_keys(request, list(options), word)]


def _matching_keys(request: Request, group_names: Sequence[str], begun: str) -> list[str]:
    """Returns the keys and groups that begin so: `theta=`, `planner.`, `controller.` and
    `controller=`.
    """
    parent = begun.rpartition(".")[0]
    config = _composed(request)
    node: Any = config
    for part in filter(None, parent.split(".")):
        node = node.get(part) if isinstance(node, dict) else None
    names = {f"{group}=" for group in group_names if ("/" in group) == ("/" in begun)}
    for key, value in (node if isinstance(node, dict) else {}).items():
        path = f"{parent}.{key}" if parent else str(key)
        names.add(f"{path}." if isinstance(value, dict) else f"{path}=")
    return sorted(name for name in names if name.startswith(begun))


def _composed(request: Request) -> dict[str, Any]:
    """Returns the configuration of a request, or the default one if it cannot be composed."""
    try:
        config = first_job(request).config
    except ConfigError:
        config = first_job(Request()).config
    composed: Any = OmegaConf.to_container(config, resolve=False)
    return dict(composed)
