"""A person's yaml, read through OmegaConf once it is known to be of a reasonable size.

An alias stands for all that it names, so a few lines can describe more than any memory holds: what a file expands to
is counted before anything is built from it.
"""

import io
from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf

from ..errors import ConfigError

MOST_BYTES, MOST_VALUES, DEEPEST = 100_000, 10_000, 50  # of a file; ours have 2000, 100 and 5


def read_yaml(path: Path) -> tuple[str, Any]:
    """The text of a file and the OmegaConf container it describes; raises `ConfigError`."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ConfigError(f"{path}: more than {MOST_BYTES} bytes are no configuration")
        text = path.read_text(encoding="utf-8-sig")
        problem = _too_much(text)
        if problem:
            raise ConfigError(f"{path}: {problem}")
        return text, OmegaConf.load(io.StringIO(text))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: must be UTF-8 text") from error
    except yaml.MarkedYAMLError as error:
        line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ConfigError(f"{path}{line}: {error.problem}") from error
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(
            f"{path}: {str(error).partition(chr(10))[0] or type(error).__name__}"
        ) from error


def _too_much(text: str) -> str | None:
    """What is wrong with the size of a yaml text, if anything; an alias counts as all that it stands for."""
    sizes: dict[str, int] = {}  # of what each anchor names, once it has ended
    counts, anchors = [0], [""]  # of the nodes that are open
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        anchor = getattr(event, "anchor", None) or ""
        if isinstance(event, yaml.CollectionStartEvent):
            counts.append(1)
            anchors.append(anchor)
        elif isinstance(event, yaml.CollectionEndEvent):
            size, name = counts.pop(), anchors.pop()
            sizes[name] = size
            counts[-1] += size
        elif isinstance(event, yaml.AliasEvent):
            if anchor in anchors:
                return f"*{anchor} contains itself"
            counts[-1] += sizes.get(anchor, 1)
        elif isinstance(event, yaml.ScalarEvent):
            counts[-1] += 1
            sizes[anchor] = 1
        if len(counts) > DEEPEST:
            return f"nested more than {DEEPEST} deep"
        if sum(counts) > MOST_VALUES:
            return f"more than {MOST_VALUES} values are no configuration"
    return None
