"""Says what a `_target_` may name: classes of this package and of modules in allowed folders.

The place of a module's file decides whether it may be named, before anything of it is imported. A
user's code is part of what a trial is, so it has a fingerprint: a hash of its files.
"""

import hashlib
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module, invalidate_caches
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any

from ..errors import ConfigError
from .own_code import source_line

PACKAGE = __name__.partition(".")[0]
ALLOWED_TARGETS = f"must name a class of {PACKAGE} or of a module in a --config-dir folder"
ALLOWED_FOLDERS: list[str] = []


def allow(folders: Sequence[str | Path]) -> None:
    """Allows a `_target_` to name modules of these folders, which go to the front of the module
    search path.
    """
    paths = [str(Path(folder).resolve()) for folder in folders]
    sys.path[:] = [*paths, *(path for path in sys.path if path not in paths)]
    ALLOWED_FOLDERS.extend(path for path in paths if path not in ALLOWED_FOLDERS)


def locate(name: Any, path: str) -> Any:
    """Returns what the `_target_` of the node at `path` names. Raises `ConfigError`; imports only
    what is allowed.
    """
    module, attribute = _module_and_class(name, path)
    top = module.partition(".")[0]
    if top != PACKAGE:
        _find_module(top, ALLOWED_FOLDERS, f"{path}._target_={name}")
    try:
        return getattr(import_module(module), attribute)
    except (Exception, SystemExit) as error:  # a module may do anything while it is imported
        text = f"{path}._target_={name}: {type(error).__name__}: {error}"
        raise ConfigError(with_source_line(text, error)) from error


def with_source_line(text: str, error: BaseException) -> str:
    """Returns the text with the line of the user's own code in which an exception was raised, if
    there is one: "text (mine.py, line 12)".
    """
    line = source_line(error, ALLOWED_FOLDERS)
    return f"{text} ({line})" if line and line not in text else text


def fingerprints(config: dict[str, Any], folders: Sequence[str | Path]) -> dict[str, str]:
    """Returns a fingerprint for each module outside this package that a configuration names.

    It is the first 12 hexadecimal digits of the SHA-256 of the module's file; of a package, of all
    its Python files. Raises `ConfigError` for a module that is not in `folders`.
    """
    paths = [str(Path(folder).resolve()) for folder in folders]
    digests = {}
    for path, name in _targets(config, ""):
        top = _module_and_class(name, path)[0].partition(".")[0]
        if top != PACKAGE and top not in digests:
            setting = f"{path}._target_={name}"
            try:
                digests[top] = _fingerprint(_find_module(top, paths, setting))
            except OSError as error:
                raise ConfigError(f"{setting}: {error.filename}: {error.strerror}") from error
    return dict(sorted(digests.items()))


def _targets(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yields every `_target_` of a configuration with the path of its node."""
    if isinstance(node, dict):
        if "_target_" in node:
            yield path, node["_target_"]
        for key, value in node.items():
            yield from _targets(value, f"{path}.{key}" if path else str(key))
    elif isinstance(node, list):
        for value in node:
            yield from _targets(value, path)


def _module_and_class(name: Any, path: str) -> tuple[str, str]:
    """Returns the module and the class of a name like `mine.Mine`. Raises `ConfigError`."""
    words = name.split(".") if isinstance(name, str) else []
    if len(words) < 2 or not all(word.isidentifier() for word in words):
        raise ConfigError(f"{path}._target_={name}: {ALLOWED_TARGETS}")
    return ".".join(words[:-1]), words[-1]


def _find_module(top: str, folders: Sequence[str], setting: str) -> ModuleSpec:
    """Returns where a top-level module lies in one of the folders, without importing it. Raises
    `ConfigError`.
    """
    invalidate_caches()  # the folder may have changed within the clock's resolution
    spec = PathFinder.find_spec(top, list(folders)) if folders else None
    if spec is None:
        raise ConfigError(f"{setting}: {ALLOWED_TARGETS}")
    loaded = getattr(sys.modules.get(top), "__spec__", None)
    if top in sys.stdlib_module_names or (loaded and loaded.origin != spec.origin):
        raise ConfigError(
            f"{setting}: {top} is another module's name already; give yours a name of its own"
        )
    return spec


def _fingerprint(spec: ModuleSpec) -> str:
    """Returns the fingerprint of the file of a module, or of all Python files of a package."""
    content = hashlib.sha256()
    if spec.submodule_search_locations is None:
        content.update(Path(str(spec.origin)).read_bytes())
    for folder in map(Path, spec.submodule_search_locations or ()):
        for file in sorted(folder.rglob("*.py")):
            content.update(f"{file.relative_to(folder)}\0".encode() + file.read_bytes())
    return content.hexdigest()[:12]
