"""Sets how much each part runs: all of it, or a little of everything to see that it works."""

from typing import NamedTuple


class Sizes(NamedTuple):
    """Holds numbers of repeats, trials, cells and samples; medians are over the repeats."""

    table_trials: int = 200  # per method; Table I has four
    table_rounds: int = 2  # warm, each with one worker and with two
    samples: tuple[int, ...] = (500, 1000, 2000, 5000, 10_000, 30_000, 100_000)
    sample_rounds: int = 5
    long_trials: int = 10_000
    long_settled: int = 1000  # growth is counted after so many trials
    sweep_cells: tuple[int, int] = (4, 40)
    sweep_rounds: int = 1
    starts: int = 5
    chunks: int = 300
    chunk_rounds: int = 5
    rows_per_file: tuple[int, ...] = (10, 100, 1000, 10_000, 100_000)
    row_files: int = 200  # at most; what a million rows take is computed from them


QUICK = Sizes(
    table_trials=4,
    table_rounds=1,
    samples=(500, 2000),
    sample_rounds=1,
    long_trials=300,
    long_settled=100,
    sweep_cells=(2, 6),
    sweep_rounds=1,
    starts=1,
    chunks=8,
    chunk_rounds=1,
    rows_per_file=(10, 100),
    row_files=3,
)
