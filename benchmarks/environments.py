"""Installs an environment per peer: `.venv-bench/NAME` with the extra `bench-NAME` of
pyproject.toml.

The versions are those of `constraints/NAME.txt`. An environment is made once, and again when either
file changes.
"""

import glob
import hashlib
import os
import subprocess
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
VENVS = ROOT / ".venv-bench"
PYTHONS = {
    "faran": ("3.13",),
    "jax_mppi": ("3.13", "3.12"),
}  # others run on the Python that runs this
TIMEOUT = 1800  # s, for one installation


class CannotInstallError(Exception):
    """Says in one line why an environment is missing."""


def python(name: str) -> Path:
    """Returns the interpreter of environment `name`, installing it first if necessary; raises
    `CannotInstallError`.
    """
    venv = VENVS / name
    interpreter = venv / "bin" / "python"
    stamp = venv / ".installed"
    wanted = requirements(name)
    constraints = HERE / "constraints" / f"{name}.txt"
    digest = hashlib.sha256("\n".join([*wanted, constraints.read_text()]).encode()).hexdigest()
    if stamp.is_file() and stamp.read_text() == digest:
        return interpreter
    print(
        f"installing {' '.join(wanted)} into {venv.relative_to(ROOT)}", file=sys.stderr, flush=True
    )
    _run([find_python(name), "-m", "venv", "--clear", str(venv)])
    pip = [str(interpreter), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    _run([*pip, "-c", str(constraints), *wanted])
    stamp.write_text(digest)
    return interpreter


def requirements(name: str) -> list[str]:
    """Returns the requirements of environment `name`, an extra of pyproject.toml."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    return list(extras[f"bench-{name.replace('_', '-')}"])


def find_python(name: str) -> str:
    """Returns an interpreter of a version that the peer supports; raises `CannotInstallError`."""
    versions = PYTHONS.get(name, (f"{sys.version_info[0]}.{sys.version_info[1]}",))
    pyenv = os.environ.get("PYENV_ROOT", str(Path.home() / ".pyenv"))
    for wanted in versions:
        for candidate in (
            sys.executable,
            f"python{wanted}",
            *glob.glob(f"{pyenv}/versions/{wanted}*/bin/python"),
        ):
            if _version(candidate) == wanted:
                return candidate
    raise CannotInstallError(f"needs Python {' or '.join(versions)}, which was not found")


def _version(candidate: str) -> str:
    """Returns the version of an interpreter as major.minor; an empty text if it does not start."""
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    try:
        return subprocess.run(
            [candidate, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def _run(command: list[str]) -> None:
    """Runs an installation command; raises `CannotInstallError` if it fails or takes too long."""
    try:
        installation = subprocess.run(
            command, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        raise CannotInstallError(f"installation took more than {TIMEOUT} s") from None
    if installation.returncode:
        messages = [
            line for line in installation.stderr.splitlines() if line.startswith("ERROR")
        ] or installation.stderr.splitlines()
        raise CannotInstallError(f"not installed: {messages[-1].strip() if messages else command}")
