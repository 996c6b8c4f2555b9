"""The page on the architecture is true: its picture, its paths, and its walks on the import
graph.
"""

import re
from pathlib import Path

import pytest

import architecture_picture
import import_graph

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text()
MOST_WRAPPERS = 3  # of a row between the worker and the table


def walk(name: str) -> list[str]:
    """Returns the steps of a walk, the numbered lines after its marker."""
    _, _, rest = PAGE.partition(f"<!-- walk: {name} -->\n")
    steps, _, _ = rest.partition("\n<!-- end -->")
    return re.findall(r"^\d+\. (.*(?:\n   .*)*)", steps, re.MULTILINE)


def modules_of(name: str) -> list[str]:
    """Returns the module of each step of a walk, the first in backticks, as `belief.cost`."""
    paths = [re.search(r"`([\w/]+)\.py`", step) for step in walk(name)]
    return [path[1].replace("/", ".").removesuffix(".__init__") for path in paths if path]


def test_the_picture_shows_the_import_graph():
    drawn = architecture_picture.PICTURE.read_text()
    assert drawn == architecture_picture.picture(), "run docs/scripts/architecture_picture.py"


def test_every_room_has_a_note_and_a_place_in_the_picture():
    rooms = {room for floor in import_graph.floors() for room in floor}
    assert rooms == set(architecture_picture.NOTES) == set(architecture_picture.PLACES)


def test_every_import_leads_to_a_lower_floor():
    level = {
        room: height
        for height, floor in enumerate(reversed(import_graph.floors()))
        for room in floor
    }
    for room, imported in import_graph.room_imports().items():
        for lower in imported:
            assert level[lower] < level[room], (room, lower)


def test_the_page_names_every_room():
    for floor in import_graph.floors():
        for room in floor:
            assert re.search(rf"`{room}(/|\.py)`", PAGE) or room == "__main__", room


def test_paths_on_the_page_exist():
    paths = re.findall(r"`((?:src|conf|tests|docs|experiments)/[\w/.]+)`", PAGE)
    assert len(paths) > 20
    for path in paths:
        assert "NAME" in path or (ROOT / path).exists(), path


@pytest.mark.parametrize("name", ["run", "theta", "row"])
def test_each_step_of_a_walk_meets_an_earlier_one(name):
    """Checks that each step imports an earlier step, or is imported by one."""
    modules = modules_of(name)
    assert len(modules) == len(walk(name)) >= 4
    graph = import_graph.module_imports()
    for position, module in enumerate(modules):
        assert module in graph, module
        earlier = modules[:position]
        meets = any(_are_neighbours(graph, module, before) for before in earlier)
        assert meets or not earlier, f"{module} meets none of {earlier}"


def _are_neighbours(graph: import_graph.Graph, before: str, after: str) -> bool:
    """Tells whether one of two modules imports the other, itself or through its package."""
    return after in _imported(graph, before) or before in _imported(graph, after)


def _imported(graph: import_graph.Graph, module: str) -> set[str]:
    """Returns what a module imports; of a package also what its `__init__.py` imports."""
    direct = graph[module]
    packages = {name for name in direct if import_graph.module_names()[name].name == "__init__.py"}
    return direct.union(*(graph[name] for name in packages))


def test_a_row_is_wrapped_at_most_three_times():
    steps = walk("row")
    wrappers = [wrapper for step in steps for wrapper in re.findall(r"in an? `(\w+)`", step)]
    assert 1 <= len(wrappers) <= MOST_WRAPPERS
    source = "\n".join(path.read_text() for path in import_graph.SOURCE.rglob("*.py"))
    for wrapper in wrappers:
        assert f"class {wrapper}" in source, wrapper


def test_no_two_test_modules_have_the_same_name():
    """pytest imports them by their bare names and refuses the second."""
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(set(names)) == sorted(names)
