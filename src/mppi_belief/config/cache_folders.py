"""Finds where compiled programs and Matplotlib's list of fonts are cached between commands.

A container may run as a user without a home directory, or with one that cannot be written to. The
cache then lies in the folder for temporary files, if nobody else can write to it there.
"""

import os
import tempfile
from pathlib import Path

NAME = "mppi-belief"
PROGRAMS = "xla"  # the folder in ours of compiled programs
VARIABLE = "JAX_COMPILATION_CACHE_DIR"  # where JAX reads and writes compiled programs
OWNER_ONLY = 0o700


def program_folder() -> Path | None:
    """Returns the folder of compiled programs: `JAX_COMPILATION_CACHE_DIR`, or xla in the user's
    cache directory; None where there is none.
    """
    given = os.environ.get(VARIABLE)
    if given:
        return Path(given)
    folder = user_cache_folder()
    return folder / PROGRAMS if folder else None


def has_writable_home() -> bool:
    """Says whether this user has a home directory and may write to it."""
    try:
        return os.access(Path.home(), os.W_OK)
    except RuntimeError:  # neither HOME nor an entry in /etc/passwd
        return False


def user_cache_folder() -> Path | None:
    """Returns the folder mppi-belief in the user's cache directory, which is made where it is
    missing; None where there is none that can be written to.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        parent = Path(base) if base else Path.home() / ".cache"
        return _writable(parent / NAME)
    except (OSError, RuntimeError):  # RuntimeError: no home directory
        return None


def temporary_cache_folder() -> Path | None:
    """Returns a folder of this user alone among the temporary files; None where there is none.

    Compiled programs are executed, so a folder to which others could write is not used.
    """
    try:
        folder = Path(tempfile.gettempdir()) / f"{NAME}-{os.getuid()}"
        folder.mkdir(mode=OWNER_ONLY, exist_ok=True)
        status = folder.lstat()
        private = status.st_uid == os.getuid() and status.st_mode & 0o077 == 0
        return _writable(folder) if private and not folder.is_symlink() else None
    except OSError:
        return None


def _writable(folder: Path) -> Path:
    """Makes a folder and returns it; raises OSError where it cannot be made or written to."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        return folder
