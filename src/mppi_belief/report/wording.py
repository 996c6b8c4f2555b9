"""Words numbers and lists for sentences: ranges, "a, b and c"."""

from collections.abc import Iterable, Sequence


def count_range(numbers: Iterable[int]) -> str:
    """Returns the one value of some numbers, or "LOWEST to HIGHEST"; "0" of none."""
    distinct = sorted(set(numbers)) or [0]
    return str(distinct[0]) if len(distinct) == 1 else f"{distinct[0]} to {distinct[-1]}"


def listed(words: Sequence[str]) -> str:
    """Returns words as a list of a sentence: "a", "a and b", "a, b and c"."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"
