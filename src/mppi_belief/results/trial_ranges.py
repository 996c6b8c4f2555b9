"""Sets of trial numbers as ranges [first, last], for metadata and for messages."""

from collections.abc import Collection, Sequence


def ranges(trials: Collection[int]) -> list[list[int]]:
    """Returns trials as [first, last] of every run without a gap, in ascending order."""
    pairs: list[list[int]] = []
    for trial in sorted(trials):
        if pairs and trial == pairs[-1][1] + 1:
            pairs[-1][1] = trial
        else:
            pairs.append([trial, trial])
    return pairs


def ranges_in_words(pairs: Sequence[Sequence[int]], most: int | None = None) -> str:
    """Returns the text of ranges, of the first `most` of them: "0..9, 12 and 3 more"; "none"
    without any.
    """
    texts = [str(first) if first == last else f"{first}..{last}" for first, last in pairs]
    shown = texts[:most]
    rest = len(texts) - len(shown)
    more = f" and {rest} more" if rest else ""
    return ", ".join(shown) + more or "none"
