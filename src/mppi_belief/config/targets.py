"""What a `_target_` may name: classes of this package, and of modules in folders that were allowed.

Whether a module may be named is decided by where its file lies, before anything of it is imported. A user's code
counts in what a trial is, so it has a fingerprint, taken of its files and not of what they do.
"""

import hashlib
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module, invalidate_caches
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any

from ..errors import ConfigError

PACKAGE = __name__.partition(".")[0]
RULE = f"must name a class of {PACKAGE} or of a module in a --config-dir folder"
ALLOWED_FOLDERS: list[str] = []


def allow(folders: Sequence[str | Path]) -> None:
    """From now on a `_target_` may name what lies in these folders; they go to the front of the module search path."""
    places = [str(Path(folder).resolve()) for folder in folders]
    sys.path[:] = [*places, *(place for place in sys.path if place not in places)]
    ALLOWED_FOLDERS.extend(place for place in places if place not in ALLOWED_FOLDERS)


def locate(name: Any, path: str) -> Any:
    """What the `_target_` of the node at `path` names; raises `ConfigError`, without importing where it may not."""
    module, attribute = _parts(name, path)
    top = module.partition(".")[0]
    if top != PACKAGE:
        _find(top, ALLOWED_FOLDERS, f"{path}._target_={name}")
    try:
        return getattr(import_module(module), attribute)
    except (Exception, SystemExit) as error:  # a module may do anything while it is imported
        raise ConfigError(f"{path}._target_={name}: {type(error).__name__}: {error}") from error


def fingerprints(config: dict[str, Any], folders: Sequence[str | Path]) -> dict[str, str]:
    """{module: first 12 hexadecimal digits of the SHA-256 of its file} for all modules that a configuration names
    outside this package; of a package all its modules count. Raises `ConfigError` for one that is not in `folders`."""
    places = [str(Path(folder).resolve()) for folder in folders]
    found = {}
    for path, name in _targets(config, ""):
        top = _parts(name, path)[0].partition(".")[0]
        if top != PACKAGE and top not in found:
            what = f"{path}._target_={name}"
            try:
                found[top] = _fingerprint(_find(top, places, what))
            except OSError as error:
                raise ConfigError(f"{what}: {error.filename}: {error.strerror}") from error
    return dict(sorted(found.items()))


def _targets(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Every `_target_` of a configuration with the path of the node it belongs to."""
    if isinstance(node, dict):
        if "_target_" in node:
            yield path, node["_target_"]
        for key, value in node.items():
            yield from _targets(value, f"{path}.{key}" if path else str(key))
    elif isinstance(node, list):
        for value in node:
            yield from _targets(value, path)


def _parts(name: Any, path: str) -> tuple[str, str]:
    """Module and class of a name like `mine.Mine`."""
    words = name.split(".") if isinstance(name, str) else []
    if len(words) < 2 or not all(word.isidentifier() for word in words):
        raise ConfigError(f"{path}._target_={name}: {RULE}")
    return ".".join(words[:-1]), words[-1]


def _find(top: str, folders: Sequence[str], what: str) -> ModuleSpec:
    """Where a top-level module lies in one of the folders; nothing is imported."""
    invalidate_caches()  # the folder may have changed within the clock's resolution
    spec = PathFinder.find_spec(top, list(folders)) if folders else None
    if spec is None:
        raise ConfigError(f"{what}: {RULE}")
    loaded = getattr(sys.modules.get(top), "__spec__", None)
    if top in sys.stdlib_module_names or (loaded and loaded.origin != spec.origin):
        raise ConfigError(
            f"{what}: {top} is another module's name already; give yours a name of its own"
        )
    return spec


def _fingerprint(spec: ModuleSpec) -> str:
    """Of the file of a module, or of all the modules of a package."""
    content = hashlib.sha256()
    if spec.submodule_search_locations is None:
        content.update(Path(str(spec.origin)).read_bytes())
    for place in map(Path, spec.submodule_search_locations or ()):
        for file in sorted(place.rglob("*.py")):
            content.update(f"{file.relative_to(place)}\0".encode() + file.read_bytes())
    return content.hexdigest()[:12]
