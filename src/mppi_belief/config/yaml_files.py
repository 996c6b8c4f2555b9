"""Reads the yaml files of configurations: the one reader, for Hydra as well as for messages.

A plain scalar means what the same word means on the command line:

    12, +3, 1_000                  whole numbers; 017, 0o17, 0x10 and 1:30 are texts
    1.5, .5, 1., 1e3, inf, nan     floats
    true, False                    truth values; yes and on are texts
    null, ~ and no value           null
    everything else                a text

A setting that is a text (`text_keys.py`) takes any scalar as it is written. YAML 1.1 would read 017
as 15, 10:00:00 as 36000, and 1234e567 as infinity.
"""

import re
from pathlib import Path
from typing import Any, ClassVar

import yaml

from ..errors import ConfigError
from .text_keys import CHOICES, LISTS_OF_TEXTS, OPTIONAL_TEXTS, TEXTS

WHOLE = r"(?:0|[1-9](?:_?[0-9])*)"  # INT_UNSIGNED of Hydra's grammar
DIGITS = r"[0-9](?:_?[0-9])*"
WITH_POINT = rf"(?:{WHOLE}\.|{WHOLE}?\.{DIGITS})"
FLOAT = rf"[+-]?(?:{WITH_POINT}|(?:{WHOLE}|{WITH_POINT})e[+-]?{DIGITS}|inf|nan)"
PLAIN_SCALARS = {
    "null": r"null|~|",
    "bool": r"true|false",
    "int": rf"[+-]?{WHOLE}",
    "float": FLOAT,
    "merge": r"<<",
}
TAG = "tag:yaml.org,2002:"
NO_TEXT = [f"{TAG}{kind}" for kind in PLAIN_SCALARS]

AS_WRITTEN = TEXTS | CHOICES | LISTS_OF_TEXTS
DEFAULTS = "defaults"  # the key of a file whose scalars are names of groups and options
SWEPT = "hydra.sweeper.params"  # its values are in the notation of the command line


class _Loader(yaml.SafeLoader):
    """Builds plain values; refuses a key that occurs twice and an alias that contains itself."""

    yaml_implicit_resolvers: ClassVar[dict[Any, Any]] = {}

    def __init__(self, stream: Any) -> None:
        super().__init__(stream)
        self._open_anchors: list[str | None] = []

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Composes a node; OmegaConf would unfold one that contains itself until memory is full."""
        event: Any = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            if event.anchor in self._open_anchors:
                reason = f"*{event.anchor} contains itself"
                raise yaml.composer.ComposerError(None, None, reason, event.start_mark)
            return super().compose_node(parent, index)
        self._open_anchors.append(event.anchor)
        node = super().compose_node(parent, index)
        self._open_anchors.pop()
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Returns a mapping as a dict."""
        names = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != f"{TAG}merge":
                if key.value in names:
                    reason = f"found duplicate key {key.value}"
                    raise yaml.constructor.ConstructorError(None, None, reason, key.start_mark)
                names.add(key.value)
        return super().construct_mapping(node, deep=deep)


for _tag, _pattern in PLAIN_SCALARS.items():
    _Loader.add_implicit_resolver(
        f"{TAG}{_tag}", re.compile(rf"(?:{_pattern})\Z", re.IGNORECASE), None
    )


def read_yaml(path: Path, package: str = "") -> dict[str, Any]:
    """Returns the content of a yaml file as plain values; an empty dict for an empty file.

    `package` is the dotted key below which its keys are those of the configuration: `executor`, or
    "" for a file that sets keys of the top level. Raises `yaml.YAMLError` with file and line,
    `UnicodeDecodeError`, OSError, and `ConfigError` for a file that holds no mapping.
    """
    with path.open(encoding="utf-8") as stream:
        loader = _Loader(stream)
        try:
            node: Any = loader.get_single_node()
            if node is None:
                return {}
            content: Any = loader.construct_document(_as_written(node, package, top=True))
        finally:
            loader.dispose()
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: must hold lines KEY: VALUE, holds {content!r}")
    return content


def _as_written(node: Any, path: str, *, top: bool = False) -> Any:
    """Returns the node of the key `path` with the scalars of texts as they are written.

    Nodes are replaced, not changed, since an alias may share them with another key.
    """
    if not (top or _takes_texts(path) or _has_texts_below(path)):
        return node
    if isinstance(node, yaml.ScalarNode):
        return _text_node(node, path)
    if isinstance(node, yaml.SequenceNode) and (path in LISTS_OF_TEXTS or path == DEFAULTS):
        items = [_as_written(item, path) for item in node.value]
        return yaml.SequenceNode(node.tag, items, node.start_mark, node.end_mark)
    if isinstance(node, yaml.MappingNode):
        pairs = []
        for key, value in node.value:
            inner = f"{path}.{key.value}" if path else str(key.value)
            if path == DEFAULTS or (top and key.value == DEFAULTS):
                inner = DEFAULTS
            pairs.append((key, _as_written(value, inner)))
        return yaml.MappingNode(node.tag, pairs, node.start_mark, node.end_mark)
    return node


def _takes_texts(path: str) -> bool:
    """Returns whether the scalars of a key are texts."""
    return path in AS_WRITTEN or path == DEFAULTS or path.startswith(f"{SWEPT}.")


def _has_texts_below(path: str) -> bool:
    """Returns whether a key is a mapping in which another key takes texts."""
    return any(key.startswith(f"{path}.") for key in (*AS_WRITTEN, f"{SWEPT}."))


def _text_node(node: yaml.ScalarNode, path: str) -> yaml.ScalarNode:
    """Returns a scalar as a text, where its key takes texts; null stays null where it may be."""
    if not _takes_texts(path) or node.tag not in NO_TEXT:
        return node
    if node.tag == f"{TAG}null" and (path in OPTIONAL_TEXTS or path == DEFAULTS):
        return node
    return yaml.ScalarNode(f"{TAG}str", node.value, node.start_mark, node.end_mark)
