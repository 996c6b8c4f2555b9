"""The rule for names of folders, in which a tilde stands for a home folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class FolderName:
    """Accepts the name of a folder, which need not exist, and None where it is optional."""

    optional: bool = False  # whether None is allowed

    def check(self, value: Any) -> str | None:
        """Returns the name with the home folder in place of `~` or `~user` at its beginning.

        Raises ValueError for what cannot name a folder, and for a home folder that is not known.
        """
        if value is None and self.optional:
            return None
        if not isinstance(value, str) or not value.strip() or "\0" in value:
            raise ValueError(f"must name a folder, got {value!r}")
        return home_expanded(value)


def home_expanded(path: str) -> str:
    """Returns a path with the home folder in place of `~` or `~user` at its beginning.

    Raises ValueError for a home folder that is not known.
    """
    if not path.startswith("~"):
        return path
    try:
        return str(Path(path).expanduser())
    except RuntimeError:
        user = path.partition("/")[0]
        raise ValueError(
            f"is {path}, but the home folder {user} is not known; "
            f"a folder of that name is given as ./{path}"
        ) from None
