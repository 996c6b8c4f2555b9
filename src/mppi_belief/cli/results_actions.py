"""Lists, shows, exports, compacts and verifies the cells of a results folder."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from ..errors import ConfigError, counted
from ..report.frame_files import write_text_file
from ..results.audit import audit
from ..results.compact import compact
from ..results.contents import read_cell, superseded
from ..results.files import probe
from ..results.folder import cell_folders, choose_cell
from . import exit_codes
from .export import as_csv
from .results_request import ResultsRequest
from .tables import bytes_in_words, description, listing


def list_cells(request: ResultsRequest) -> int:
    """Prints a line for each cell; returns the exit code."""
    cells = [read_cell(folder) for folder in cell_folders(request.root)]
    _report_problems([line for contents in cells for line in contents.problems])
    print(listing(cells) if cells else f"no results in {request.root}")
    return exit_codes.DONE


def show_cell(request: ResultsRequest) -> int:
    """Prints all that is known of one cell; returns the exit code."""
    if len(request.words) != 1:
        raise ConfigError("results show: name one cell")
    contents = read_cell(choose_cell(request.root, request.words[0]))
    _report_problems(contents.problems)
    print(description(contents))
    return exit_codes.DONE


def export_cells(request: ResultsRequest) -> int:
    """Prints the rows of cells as CSV, or writes them to a file; returns the exit code."""
    try:
        cells = [read_cell(folder) for folder in _chosen_folders(request)]
    except ConfigError as error:
        hint = "" if request.options.to else "; a file to write into is given with --to FILE"
        raise ConfigError(f"{error}{hint}") from None
    if not request.words:  # all cells: those that a report of today reads
        cells = [contents for contents in cells if superseded(contents) is None]
    _report_problems([line for contents in cells for line in contents.problems])
    text, count = as_csv(cells)
    if not request.options.to:
        print(text, end="")
        return exit_codes.DONE
    (target,) = request.options.to
    if not target.strip() or Path(target).is_dir():
        raise ConfigError(f"--to {target}: must name a file")
    write_text_file(Path(target), text)
    print(f"{counted(count, 'row')} of {counted(len(cells), 'cell')} in {target}")
    return exit_codes.DONE


def compact_cells(request: ResultsRequest) -> int:
    """Merges the small files of cells and prints what that changes; returns the exit code."""
    folders = _chosen_folders(request)
    files_before = 0
    files_after = 0
    bytes_before = 0
    bytes_after = 0
    for folder in folders:
        probe(folder)
        merged = compact(folder)
        _report_problems(merged.problems)
        if merged.files[0] != merged.files[1] or merged.bytes[0] != merged.bytes[1]:
            print(f"{folder.name}: {_change(merged.files, merged.bytes)}")
        files_before += merged.files[0]
        files_after += merged.files[1]
        bytes_before += merged.bytes[0]
        bytes_after += merged.bytes[1]
    change = _change((files_before, files_after), (bytes_before, bytes_after))
    print(f"{counted(len(folders), 'cell')}: {change}")
    return exit_codes.DONE


def verify_cells(request: ResultsRequest) -> int:
    """Checks every file of cells and prints what is wrong; returns the exit code."""
    folders = _chosen_folders(request)
    n_problems = 0
    n_files = 0
    for folder in folders:
        contents = read_cell(folder)
        problems = audit(contents)
        for line in problems:
            print(line if line.startswith(str(folder)) else f"{folder}: {line}", flush=True)
        n_problems += len(problems)
        n_files += len(contents.parts) + len(contents.paths)
        n_files += len(contents.notes) + len(contents.problems)
    verdict = counted(n_problems, "problem") if n_problems else "all is well"
    checked = f"{counted(len(folders), 'cell')}, {counted(n_files, 'file')} checked"
    print(f"{checked}: {verdict}")
    return exit_codes.INCOMPLETE if n_problems else exit_codes.DONE


def _chosen_folders(request: ResultsRequest) -> list[Path]:
    """Returns the folders of the cells that are named, each once; of all cells without a name."""
    named = dict.fromkeys(choose_cell(request.root, word) for word in request.words)
    return list(named) or cell_folders(request.root)


def _change(files: tuple[int, int], sizes: tuple[int, int]) -> str:
    """Returns numbers and sizes of files before and after."""
    before = f"{counted(files[0], 'file')}, {bytes_in_words(sizes[0])}"
    after = f"{counted(files[1], 'file')}, {bytes_in_words(sizes[1])}"
    return f"{before} -> {after}"


def _report_problems(lines: Sequence[str]) -> None:
    for line in lines:
        print(line, file=sys.stderr)


ACTIONS: dict[str, Callable[[ResultsRequest], int]] = {
    "show": show_cell,
    "export": export_cells,
    "compact": compact_cells,
    "verify": verify_cells,
}
