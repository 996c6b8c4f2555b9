"""Writes files as a whole or not at all, and small JSON files with a hash of their content."""

import hashlib
import json
import os
import tempfile
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Prefix of the name of a file while it is written; a writer that is killed leaves such a file.
TEMPORARY = ".tmp-"
_DIGEST = "digest"


def probe(root: Path) -> None:
    """Makes the folder `root`; raises OSError if it cannot be made or written to."""
    root.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=root):
        pass


def write_whole(target: Path, fill: Callable[[Path], Any]) -> None:
    """Lets `fill` write a temporary file, syncs it, and renames it to `target`.

    A reader sees all of the file or nothing, also after a power cut. Raises OSError.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f"{TEMPORARY}{uuid.uuid4().hex[:12]}-{target.name}")
    try:
        fill(temporary)
        _sync(temporary)
        temporary.replace(target)
        _sync(target.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def digest(content: Any) -> str:
    """Returns a hash of JSON content: equal if and only if every value is, numbers bit for bit."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def write_json(folder: Path, name: str, content: dict[str, Any]) -> None:
    """Writes `folder/name.json` with a hash of its content; raises OSError."""
    text = json.dumps({**content, _DIGEST: digest(content)})
    write_whole(folder / f"{name}.json", lambda path: path.write_text(text, encoding="utf-8"))


def read_json(folder: Path, name: str) -> dict[str, Any] | None:
    """Returns the content of `folder/name.json`; None if it is missing, torn, or changed since it
    was written.
    """
    try:
        content = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        written = content.pop(_DIGEST, None)
        return content if written in (None, digest(content)) else None
    except (OSError, ValueError, AttributeError, TypeError):
        return None
