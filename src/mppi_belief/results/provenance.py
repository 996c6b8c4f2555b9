"""Says where a number comes from: command, commit, versions, machine."""

import functools
import platform
import socket
import subprocess
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..config.cell import ALGORITHM_VERSION
from ..config.environment import numeric_settings, threads

_PACKAGES = (
    "mppi-belief",
    "jax",
    "jaxlib",
    "numpy",
    "scipy",
    "pandas",
    "pyarrow",
    "hydra-core",
    "omegaconf",
)


def provenance(command: list[str]) -> dict[str, Any]:
    """Returns what is the same for all files of one run; `command` is that which was given."""
    return {
        "command": command,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "algorithm": ALGORITHM_VERSION,
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in _PACKAGES},
        },
        **machine(),
        "threads": threads(),
        **_commit(Path(__file__).resolve().parents[3]),
    }


def _commit(root: Path) -> dict[str, Any]:
    """Returns commit and dirty flag of the checkout that this package runs from; None when it is
    installed elsewhere.
    """
    if not (root / "pyproject.toml").is_file():
        return {"commit": None, "dirty": None}
    try:
        head = _git(root, "rev-parse", "HEAD")
        return {
            "commit": head,
            "dirty": bool(_git(root, "status", "--porcelain", "--untracked-files=no")),
        }
    except (OSError, subprocess.CalledProcessError):
        return {"commit": None, "dirty": None}


def _git(root: Path, *args: str) -> str:
    completed = subprocess.run(
        ["git", "-C", str(root), *args], capture_output=True, text=True, check=True
    )
    return completed.stdout.strip()


def machine() -> dict[str, Any]:
    """Returns host, platform and processor, and the `settings` of this process on which the digits
    of a number depend, as they may on the processor.
    """
    return {
        "host": socket.gethostname(),
        "platform": platform.platform(),
        "processor": processor(),
        "settings": numeric_settings(),
    }


@functools.cache
def processor() -> str:
    """Returns the model name of the processor."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()
