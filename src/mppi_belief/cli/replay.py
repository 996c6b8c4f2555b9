"""`mppi-belief replay CELL TRIAL`: a trial run once more, compared with what was kept of it bit for bit, and drawn.

Nothing that a results folder names is looked for on the disk: code of a user's own comes from --config-dir alone.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..config import environment
from ..config.cell import ALGORITHM_VERSION, IDENTITY, labels
from ..config.targets import allow, fingerprints
from ..errors import ConfigError
from ..results.contents import CellContents, belongs, path_of, read_cell
from ..results.folder import choose_cell
from ..results.provenance import provenance
from ..results.sources import row_of
from . import usage
from .result_words import read
from .tables import commit_label

NOT_REPRODUCED = 3
UNFINISHED = ("crashed", "timeout")  # trials that no process survived or waited for
_VERSIONS = ("python", "jax", "jaxlib", "numpy", "mppi-belief")


class Kept(NamedTuple):
    """A trial as a results folder has it: its row, its path (empty if that was not kept), the run it comes from."""

    folder: Path
    trial: int
    row: dict[str, Any]
    path: list[dict[str, Any]]
    source: dict[str, Any]

    @property
    def config(self) -> dict[str, Any]:
        config = self.source.get("config")
        return config if isinstance(config, dict) else {}


def replay(args: Sequence[str]) -> int:
    """Run, compare, say what differs, draw; the exit code."""
    if any(arg in ("-h", "--help") for arg in args):
        print(usage.REPLAY, end="")
        return 0
    told = read(args, "replay", flags=["--force"], valued=["--config-dir", "-cd"])
    if len(told.words) != 2:
        raise ConfigError("replay: name a cell and a trial; see mppi-belief replay --help")
    kept = _find(read_cell(choose_cell(told.root, told.words[0])), told.words[1])
    if kept.row["status"] in UNFINISHED and "--force" not in told.options:
        raise ConfigError(
            f"trial {kept.trial} {kept.row['status']}: {kept.row['error']}; --force runs it again, in this process"
        )
    variables = environment.prepare(kept.config["platform"])
    now = provenance(["mppi-belief", "replay", *args])
    os.environ.update(variables)
    folders = [name for option in ("--config-dir", "-cd") for name in told.options.get(option, [])]
    allow(folders)
    now["code"] = fingerprints(kept.config, folders)
    return _again(kept, now)


def _find(contents: CellContents, word: str) -> Kept:
    """A trial of a cell; raises `ConfigError` where there is none, or not the configuration to run it with."""
    for line in contents.problems:
        print(line, file=sys.stderr)
    folder = contents.folder
    if not (word.isascii() and word.isdigit()):
        raise ConfigError(f"trial '{word}': must be a whole number, 0 or above")
    found = row_of(contents, int(word))
    if found is None:
        rows = contents.rows["trial"]
        there = (
            f"it has {len(rows)} trials, {rows.min()} to {rows.max()}"
            if len(rows)
            else "it has none"
        )
        raise ConfigError(f"{folder.name} has no trial {word}: {there}")
    kept = Kept(folder, int(word), found[0], path_of(contents, int(word)), found[1])
    missing = [key for key in IDENTITY if key not in kept.config]
    if missing:
        raise ConfigError(
            f"{folder.name} says nothing of '{missing[0]}': it was made by another version of mppi-belief"
        )
    if kept.source.get("algorithm") == ALGORITHM_VERSION and not belongs(kept.config, folder):
        raise ConfigError(
            f"{folder.name}: the configuration of trial {word} is not that of this cell"
        )
    return kept


def _again(kept: Kept, now: dict[str, Any]) -> int:
    """The part that computes."""
    from ..trial import device
    from ..trial.rerun import differences, rerun

    now["device"] = device(kept.config)
    row, source = kept.row, kept.source
    print(
        f"{kept.folder.name}, trial {kept.trial}: {row['status']}, cost {row['cost']!r}, {_run(source)}"
    )
    changes = _changes(source, now)
    if changes:
        print(f"not as it was then: {'; '.join(changes)}")
    batch = rerun(kept.config, kept.trial)
    found = differences(row, batch.rows[0], kept.path, batch.paths, kept.config["precision"])
    for one in found:
        print(_difference(one, kept.config["precision"]))
    compared = f"{len(row)} values of its row, {f'{len(kept.path)} steps of its path' if kept.path else 'no path was kept'}"
    print(f"{'NOT reproduced' if found else 'reproduced bit for bit'}: {compared}")
    sys.stdout.flush()
    _draw(kept, batch)
    return NOT_REPRODUCED if found else 0


def _run(source: dict[str, Any]) -> str:
    return f"of {source.get('started', 'an unknown time')} at {commit_label(source)}"


def _changes(then: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """What is other than when the trial was run, of all that may change its last digits."""
    before, after = then.get("versions") or {}, now["versions"]
    code = (then.get("config") or {}).get("code") or {}
    pairs = [(name, before.get(name), after[name]) for name in _VERSIONS]
    pairs += [(name, then.get(name), now[name]) for name in ("algorithm", "processor", "platform")]
    pairs += [("device", then.get("device"), now["device"])]
    pairs += [("commit", commit_label(then), commit_label(now))] if then.get("commit") else []
    pairs += [(f"code of {name}", code.get(name), value) for name, value in now["code"].items()]
    threads = then.get("threads") or {}
    pairs += [(name, threads.get(name), value) for name, value in now["threads"].items()]
    return [
        f"{name} {one}, now {other}"
        for name, one, other in pairs
        if one is not None and one != other
    ]


def _difference(one: Any, precision: str) -> str:
    where = f" at {one.location}, the first of {one.values}" if one.location else ""
    apart = (
        ""
        if one.ulp is None
        else f"; {'at most ' if one.values > 1 else ''}{one.ulp} ulp of {precision} apart"
    )
    return f"{one.name}{where}: {one.then!r}, now {one.now!r}{apart}"


def _draw(kept: Kept, batch: Any) -> None:
    """A picture of the trial as it ran now, beside the results of its cell; raises OSError."""
    import pandas as pd

    from ..report import figures
    from ..report.positions import position_first
    from ..report.summary import label_text
    from ..trial.recording import sampled_paths
    from ..trial.rerun import finite_steps

    steps, scene = position_first(pd.DataFrame(list(finite_steps(batch.paths))), batch.scene)
    if len(steps) < 2 or scene is None:
        print("no picture: it has no path")
        return
    try:
        samples = sampled_paths(kept.config, kept.trial)
    except Exception as error:  # a system of a user's own may do with less
        print(f"no sampled paths in the picture ({type(error).__name__}: {error})", file=sys.stderr)
        samples = None
    told = labels(kept.config) | {"trial": kept.trial}
    title = ", ".join(
        f"{name} {label_text(value)}" for name, value in told.items() if label_text(value) != "-"
    )
    picture = kept.folder / f"replay-{kept.trial}.png"
    figures.save_png(
        figures.one_trial_figure(
            steps.to_dict("records"),  # type: ignore[arg-type]
            scene,
            samples,
            kept.config["names"]["controller"],
            title,
        ),
        picture,
    )
    print(f"picture: {picture}")
