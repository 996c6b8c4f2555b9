"""Reads the import graph of the package from its source, module by module and room by room.

A room is a folder or a module at the root of the package; a floor is a line of the import rule in
pyproject.toml. Imports inside functions count, imports for type checkers only count too.
"""

import ast
import tomllib
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "mppi_belief"
SOURCE = ROOT / "src" / PACKAGE

Graph = dict[str, set[str]]  # importer -> imported


def floors() -> list[list[str]]:
    """Returns the rooms of every floor from the top down, as the import rule lists them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    (contract,) = [
        contract
        for contract in project["tool"]["importlinter"]["contracts"]
        if contract.get("containers") == [PACKAGE]
    ]
    return [layer.replace("|", " ").split() for layer in contract["layers"]]


def module_names() -> dict[str, Path]:
    """Returns the file of every module by its name without `mppi_belief.`.

    The name of the package itself is an empty text.
    """
    names = {}
    for path in sorted(SOURCE.rglob("*.py")):
        parts = list(path.relative_to(SOURCE).with_suffix("").parts)
        if parts[-1] == "__init__":
            parts.pop()
        names[".".join(parts)] = path
    return names


def module_imports() -> Graph:
    """Returns for every module the modules of the package that it imports."""
    names = module_names()
    graph: Graph = {}
    for module, path in names.items():
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        imported = set()
        for node in ast.walk(ast.parse(path.read_text())):
            for target in _targets(node, package):
                while target not in names:  # a name of a module, not a module
                    target = target.rpartition(".")[0]
                imported.add(target)
        graph[module] = imported - {module}
    return graph


def _targets(node: ast.AST, package: str) -> list[str]:
    """Returns what an import statement in `package` names, without `mppi_belief.`; else nothing."""
    if isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
        return [name.removeprefix(PACKAGE + ".") for name in names if name.startswith(PACKAGE)]
    if not isinstance(node, ast.ImportFrom):
        return []
    base = node.module or ""
    if node.level == 0:
        if base != PACKAGE and not base.startswith(PACKAGE + "."):
            return []
        base = base.removeprefix(PACKAGE).removeprefix(".")
    else:
        parts = package.split(".") if package else []
        parents = parts[: len(parts) - node.level + 1]
        base = ".".join([*parents, *filter(None, [base])])
    return [f"{base}.{alias.name}".strip(".") for alias in node.names]


def room_imports() -> Graph:
    """Returns for every room the other rooms that it imports."""
    graph: Graph = defaultdict(set)
    for module, imported in module_imports().items():
        room = module.partition(".")[0]
        rooms = {name.partition(".")[0] for name in imported}
        graph[room] |= rooms - {room, ""}
    return {room: graph[room] for floor in floors() for room in floor}


def reachable(graph: Graph, start: str) -> set[str]:
    """Returns everything that `start` imports, directly or through others, itself not included."""
    known: set[str] = set()
    open_ends = [start]
    while open_ends:
        for name in graph.get(open_ends.pop(), set()) - known:
            known.add(name)
            open_ends.append(name)
    return known - {start}


def without_shortcuts(graph: Graph) -> Graph:
    """Returns the graph without the imports that a longer way makes superfluous."""
    reduced = {}
    for room, imported in graph.items():
        through = {name for step in imported for name in reachable(graph, step)}
        reduced[room] = imported - through
    return reduced
