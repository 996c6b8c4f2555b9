"""The folder conf/ of this package: where it lies and what its files hold, read without Hydra."""

from pathlib import Path


def conf_dir() -> Path:
    """Returns conf/ of the checkout that this file belongs to, or the copy installed beside the package."""
    checkout = Path(__file__).resolve().parents[3]
    if (checkout / "pyproject.toml").is_file() and (checkout / "conf").is_dir():
        return checkout / "conf"
    return Path(__file__).resolve().parents[1] / "conf"
