"""`mppi-belief results`: what is in the results folder, and looking after it."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from ..errors import ConfigError, unknown_key
from ..report.frame_files import write_text_file
from ..results.audit import audit
from ..results.compact import compact
from ..results.contents import read_cell, superseded
from ..results.files import probe
from ..results.folder import cell_folders, choose_cell
from . import usage
from .export import as_csv
from .result_words import Words, read
from .tables import bytes_in_words, description, listing

WRONG = 3


def results(args: Sequence[str]) -> int:
    """`mppi-belief results [show|export|compact|verify] ...`; the exit code."""
    if any(arg in ("-h", "--help") for arg in args):
        print(usage.RESULTS, end="")
        return 0
    told = read(args, "results", flags=["--csv"], valued=["--to"])
    command, *rest = told.words or [""]
    if command not in _COMMANDS:
        raise ConfigError(
            unknown_key(
                command, [*filter(None, _COMMANDS)], "command", "mppi-belief results --help"
            )
        )
    for option in told.options:
        if command != "export":
            raise ConfigError(f"{option} is an option of mppi-belief results export")
    if len(told.options.get("--to", [])) > 1:
        raise ConfigError("--to: one file at a time")
    return _COMMANDS[command](told._replace(words=rest))


def _chosen(told: Words) -> list[Path]:
    """The folders of the cells that are named, each once; of all without a name."""
    return list(dict.fromkeys(choose_cell(told.root, word) for word in told.words)) or cell_folders(
        told.root
    )


def _list(told: Words) -> int:
    found = [read_cell(folder) for folder in cell_folders(told.root)]
    _complain([line for contents in found for line in contents.problems])
    print(listing(found) if found else f"no results in {told.root}")
    return 0


def _show(told: Words) -> int:
    if len(told.words) != 1:
        raise ConfigError("results show: name one cell")
    contents = read_cell(choose_cell(told.root, told.words[0]))
    _complain(contents.problems)
    print(description(contents))
    return 0


def _export(told: Words) -> int:
    found = [read_cell(folder) for folder in _chosen(told)]
    if not told.words:  # those that a report of today would find
        found = [contents for contents in found if superseded(contents) is None]
    _complain([line for contents in found for line in contents.problems])
    text, count = as_csv(found)
    target = told.options.get("--to")
    if target is None:
        print(text, end="")
        return 0
    if not target[0].strip() or Path(target[0]).is_dir():
        raise ConfigError(f"--to {target[0]}: must name a file")
    write_text_file(Path(target[0]), text)
    print(f"{count} rows of {len(found)} cells in {target[0]}")
    return 0


def _compact(told: Words) -> int:
    folders = _chosen(told)
    merged = []
    for folder in folders:
        probe(folder)
        merged.append(compact(folder))
        _complain(merged[-1].problems)
        if merged[-1].files[0] != merged[-1].files[1] or merged[-1].bytes[0] != merged[-1].bytes[1]:
            print(f"{folder.name}: {_change(merged[-1].files, merged[-1].bytes)}")
    before, after = (
        (sum(one.files[at] for one in merged), sum(one.bytes[at] for one in merged))
        for at in (0, 1)
    )
    print(f"{len(folders)} cells: {_change((before[0], after[0]), (before[1], after[1]))}")
    return 0


def _change(files: tuple[int, int], sizes: tuple[int, int]) -> str:
    return f"{files[0]} files, {bytes_in_words(sizes[0])} -> {files[1]} files, {bytes_in_words(sizes[1])}"


def _verify(told: Words) -> int:
    folders = _chosen(told)
    wrong = checked = 0
    for folder in folders:
        contents = read_cell(folder)
        problems = audit(contents)
        for line in problems:
            print(line if line.startswith(str(folder)) else f"{folder}: {line}", flush=True)
        wrong += len(problems)
        checked += (
            len(contents.parts) + len(contents.paths) + len(contents.notes) + len(contents.problems)
        )
    print(f"{len(folders)} cells, {checked} files checked: {_count(wrong)}")
    return WRONG if wrong else 0


def _count(wrong: int) -> str:
    return "all is well" if not wrong else f"{wrong} problem{'s' if wrong > 1 else ''}"


def _complain(lines: Sequence[str]) -> None:
    for line in lines:
        print(line, file=sys.stderr)


_COMMANDS: dict[str, Callable[[Words], int]] = {
    "": _list,
    "show": _show,
    "export": _export,
    "compact": _compact,
    "verify": _verify,
}
SUBCOMMANDS = tuple(filter(None, _COMMANDS))
