"""Measures of how readable the code is: each one is a function from a checkout to its findings.

A finding names a file, a line and what is wrong there. `style_report.py` counts and prints them.
Only the standard library is used, so that any checkout can be measured by any Python from 3.11 on.
"""

import ast
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from style_checkout import Finding, Module

PACKAGE = "mppi_belief"
LINE_LENGTH = 100  # characters
MODULE_LENGTH = 200  # lines
FUNCTION_LENGTH = 40  # lines

# Words that hide what a name holds, and private words for terms that the field has.
PRIVATE_WORDS = frozenset(
    [
        "told",
        "found",
        "said",
        "kept",
        "made",
        "seen",
        "ahead",
        "off",
        "one",
        "other",
        "at",
        "nothing",
        "whole",
        "place",
        "left",
        "slopes",
        "bends",
        "feed",
        "retreat",
        "follow",
        "still",
        "absorb",
    ]
)
# Methods of the standard library and of JAX whose names begin with an underscore but are public.
PUBLIC_UNDERSCORES = frozenset(["_replace", "_asdict", "_fields", "_make", "_field_defaults"])
# First words of a docstring that opens with a clause instead of a verb.
CLAUSE_OPENERS = frozenset(["what", "whether", "where", "how", "of", "which", "whoever"])
# Verbs that a docstring may open with, in the imperative; the third person is derived from them.
VERBS = frozenset((Path(__file__).parent / "docstring_verbs.txt").read_text().split())

Function = ast.FunctionDef | ast.AsyncFunctionDef
Documented = Function | ast.ClassDef


def root_modules(root: Path) -> list[Finding]:
    """Finds the modules that lie at the root of the package, `__init__.py` not among them."""
    folder = root / "src" / PACKAGE
    paths = sorted(path for path in folder.glob("*.py") if path.name != "__init__.py")
    return [Finding(path.relative_to(root), 1, "module at the root") for path in paths]


def import_rule_names(root: Path) -> list[Finding]:
    """Finds the names of rooms and modules that the layers contract of pyproject.toml lists."""
    project = tomllib.loads((root / "pyproject.toml").read_text())
    contracts = project["tool"]["importlinter"]["contracts"]
    (rule,) = [contract for contract in contracts if contract.get("containers") == [PACKAGE]]
    layers = rule["layers"]
    names = " ".join(layers).replace("|", " ").split()
    return [
        Finding(Path("pyproject.toml"), 1, f"name in the import rule: {name}") for name in names
    ]


def _top_level_names(module: Module) -> Iterator[tuple[str, int]]:
    """Yields name and line of every class, function and constant at the top level of a module."""
    for node in module.tree.body:
        if isinstance(node, Function | ast.ClassDef):
            yield node.name, node.lineno
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                if isinstance(target, ast.Name):
                    yield target.id, node.lineno


def shared_names(source: list[Module]) -> list[Finding]:
    """Finds top-level names that two or more modules define; one finding per name."""
    places: dict[str, list[tuple[Module, int]]] = defaultdict(list)
    for module in source:
        for name, line in _top_level_names(module):
            if not any(module is known for known, _ in places[name]):
                places[name].append((module, line))
    findings = []
    for name, definitions in sorted(places.items()):
        if len(definitions) > 1 and not name.startswith("__"):
            module, line = definitions[0]
            elsewhere = ", ".join(str(known.path) for known, _ in definitions[1:])
            findings.append(module.finding(line, f"`{name}` is also defined in {elsewhere}"))
    return findings


def _is_swap(targets: ast.Tuple, values: ast.Tuple) -> bool:
    """Tells whether an assignment only exchanges or rotates the values of its targets."""
    return sorted(map(ast.unparse, targets.elts)) == sorted(map(ast.unparse, values.elts))


def tuple_assignments(source: list[Module]) -> list[Finding]:
    """Finds assignments of a tuple to a tuple; a swap, or one call on the right, is allowed."""
    findings = []
    for module in source:
        for node in module.nodes:
            if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple):
                continue
            for target in node.targets:
                if isinstance(target, ast.Tuple) and not _is_swap(target, node.value):
                    text = f"tuple assigned to a tuple: {ast.unparse(target)} = ..."
                    findings.append(module.finding(node.lineno, text))
    return findings


def long_lines(source: list[Module]) -> list[Finding]:
    """Finds lines of more than 100 characters."""
    return [
        module.finding(number, f"line of {len(line)} characters")
        for module in source
        for number, line in enumerate(module.lines, 1)
        if len(line) > LINE_LENGTH
    ]


def _docstrings(source: list[Module]) -> Iterator[tuple[Module, Documented, str]]:
    """Yields module, node and text of the docstrings of all functions and classes."""
    for module in source:
        for node in module.nodes:
            if isinstance(node, Documented):
                text = ast.get_docstring(node)
                if text and text.split():
                    yield module, node, text


def clause_docstrings(source: list[Module]) -> list[Finding]:
    """Finds docstrings of functions that open with a clause: What, Whether, Where, How, Of, ..."""
    return [
        _docstring_finding(module, node, text)
        for module, node, text in _docstrings(source)
        if isinstance(node, Function) and _first_word(text) in CLAUSE_OPENERS
    ]


def verbless_docstrings(source: list[Module]) -> list[Finding]:
    """Finds docstrings of functions and classes whose first word is not a known verb."""
    return [
        _docstring_finding(module, node, text)
        for module, node, text in _docstrings(source)
        if not is_verb(_first_word(text))
    ]


def is_verb(word: str) -> bool:
    """Tells whether a word is one of `VERBS`, in the imperative or in the third person."""
    stems = [word]
    if word.endswith("s"):
        stems.append(word[:-1])
    if word.endswith("es"):
        stems.append(word[:-2])
    if word.endswith("ies"):
        stems.append(word[:-3] + "y")
    return any(stem in VERBS for stem in stems)


def _first_word(text: str) -> str:
    """Returns the first word of a docstring in lower case, without punctuation."""
    return text.split()[0].strip(",:;.").lower()


def _docstring_finding(module: Module, node: Documented, text: str) -> Finding:
    """Returns the finding of a docstring: the name of its function or class and its opening."""
    opening = text.splitlines()[0][:60]
    return module.finding(node.lineno, f"docstring of {node.name}: {opening}")


def private_words(source: list[Module]) -> list[Finding]:
    """Finds variables, parameters, fields and functions that are named by a private word."""
    findings = []
    for module in source:
        operands = _operands(module)
        for node in module.nodes:
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                name = node.id
            elif isinstance(node, ast.arg) and node not in operands:
                name = node.arg
            elif isinstance(node, Function):
                name = node.name
            else:
                continue
            if name in PRIVATE_WORDS:
                findings.append(module.finding(node.lineno, f"private word as a name: {name}"))
    return sorted(findings)


def _operands(module: Module) -> list[ast.arg]:
    """Returns the parameters of special methods such as `__eq__`, for which `other` is usual."""
    operands = []
    for _, node in _functions([module]):
        if node.name.startswith("__"):
            operands += node.args.args
    return operands


def reached_privates(tests: list[Module]) -> list[Finding]:
    """Finds private attributes of the package's modules and objects that tests reach into."""
    findings = []
    for module in tests:
        for node in module.nodes:
            names = []
            if isinstance(node, ast.Attribute) and not _is_own(node.value):
                names = [node.attr]
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
                names = [alias.name for alias in node.names]
            for name in names:
                hidden = re.fullmatch(r"_[^_].*[^_]|_[^_]", name)
                if hidden and name not in PUBLIC_UNDERSCORES:
                    findings.append(module.finding(node.lineno, f"private attribute: {name}"))
    return sorted(findings)


def _is_own(value: ast.expr) -> bool:
    """Tells whether an attribute belongs to `self`, `cls`, or a module outside the package."""
    return isinstance(value, ast.Name) and value.id in ("self", "cls", "os", "sys")


def long_functions(source: list[Module]) -> list[Finding]:
    """Finds functions of more than 40 lines, in order of file and line."""
    return [
        module.finding(node.lineno, f"{node.name}: {_length(node)} lines")
        for module, node in _functions(source)
        if _length(node) > FUNCTION_LENGTH
    ]


def function_lengths(source: list[Module]) -> list[int]:
    """Returns the lengths in lines of all functions, the longest first."""
    return sorted((_length(node) for _, node in _functions(source)), reverse=True)


def _functions(source: list[Module]) -> Iterator[tuple[Module, Function]]:
    """Yields every function with its module."""
    for module in source:
        for node in module.nodes:
            if isinstance(node, Function):
                yield module, node


def _length(node: Function) -> int:
    """Returns the number of lines of a function, its docstring included, its decorators not."""
    return (node.end_lineno or node.lineno) - node.lineno + 1


def long_modules(source: list[Module]) -> list[Finding]:
    """Finds modules of more than 200 lines, the longest first."""
    large = [module for module in source if len(module.lines) > MODULE_LENGTH]
    large.sort(key=lambda module: -len(module.lines))
    return [module.finding(1, f"module of {len(module.lines)} lines") for module in large]


def comment_lines(source: list[Module]) -> int:
    """Returns the number of lines that hold nothing but a comment."""
    return sum(line.lstrip().startswith("#") for module in source for line in module.lines)


def code_lines(source: list[Module]) -> int:
    """Returns the number of lines that are not blank."""
    return sum(bool(line.strip()) for module in source for line in module.lines)
