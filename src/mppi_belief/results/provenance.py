"""Where a number comes from: command, commit, versions, machine."""

import functools
import platform
import socket
import subprocess
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..config.cell import ALGORITHM_VERSION
from ..config.environment import threads

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
    """What is the same for all files of one run."""
    return {
        "command": command,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "algorithm": ALGORITHM_VERSION,
        "versions": {
            "python": platform.python_version(),
            **{name: version(name) for name in _PACKAGES},
        },
        **where(),
        "threads": threads(),
        **_commit(Path(__file__).resolve().parents[3]),
    }


def _commit(root: Path) -> dict[str, Any]:
    """Commit and dirty flag of the checkout this package runs from; None when it is installed elsewhere."""
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
    done = subprocess.run(
        ["git", "-C", str(root), *args], capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@functools.cache
def where() -> dict[str, str]:
    """The host and its processor: the last digits of a number may depend on the latter."""
    return {"host": socket.gethostname(), "platform": platform.platform(), "processor": processor()}


def processor() -> str:
    """The model name of the processor."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()
