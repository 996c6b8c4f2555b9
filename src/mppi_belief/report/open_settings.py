"""Shows the settings that the paper leaves open: the chosen structure and the fitted numbers."""

from collections.abc import Sequence
from typing import Any

import pandas as pd

from . import published
from .cell_results import CellResults

TARGET = "_target_"  # the key of a class in a configuration


def chosen_frame(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns the structure of some cells as text: a line per key of `published.STRUCTURE`."""
    return pd.DataFrame(
        [
            {"Key": shown_key(key), "Meaning": meaning, "Value": value, "Chosen": chosen}
            for key, (meaning, chosen) in published.STRUCTURE.items()
            if (value := setting_text(cells, key))
        ]
    )


def fitted_frame(cells: Sequence[CellResults]) -> pd.DataFrame:
    """Returns the fitted numbers of some cells as text."""
    return pd.DataFrame(
        [
            {"Key": key, "Meaning": meaning, "Value": value}
            for key, meaning in published.FITTED_SETTINGS.items()
            if (value := setting_text(cells, key))
        ]
    )


def setting_text(cells: Sequence[CellResults], key: str) -> str:
    """Returns the value of a dotted key in the first cell that has it, "" where none has it.

    A class is shown by its name alone. MPPI-Belief comes before the other methods.
    """
    for cell in sorted(cells, key=lambda cell: cell.method != "belief"):
        value: Any = cell.config
        for name in key.split("."):
            value = value.get(name) if isinstance(value, dict) else None
        if value is not None:
            return str(value).rpartition(".")[2] if key.endswith(TARGET) else str(value)
    return ""


def shown_key(key: str) -> str:
    """Returns a key as it is set on the command line; a class is chosen by its group."""
    return key.removesuffix(f".{TARGET}")
