"""Tests what type checkers see of the public names: every example passes, every mistake is found.

The programs are those of the documents and the notebook, as they stand and with the names imported
from their submodules, and `type_mistakes.py`. Each checker runs once over all of them.
"""

import ast
import importlib
import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import NamedTuple

import pytest
from hatchling.builders.wheel import WheelBuilder
from mypy import api

import mppi_belief as mb
from documents import DOCUMENTS, ROOT, code_blocks

MISTAKES = ROOT / "tests" / "type_mistakes.py"
BOAT = ROOT / "examples" / "boat"
# An error of mypy as it prints it, with its code at the end of the line.
MYPY_ERROR = re.compile(r"^(?P<file>[^:]+):(?P<line>\d+): error: .*\[(?P<code>[\w-]+)\]$")


class TypeCheckerError(NamedTuple):
    """Holds an error that a type checker reports."""

    file: str
    line: int  # from 1
    code: str


def programs() -> dict[str, str]:
    """Returns the source of every program by the name of its file."""
    sources = {}
    for document in DOCUMENTS:
        blocks = [block.code for block in code_blocks(document)]
        if blocks:
            # An excerpt that imports its neighbours stands for a module of the package.
            text = "\n".join(blocks).replace("from ..", "from mppi_belief.")
            sources[f"page_{document.stem.lower()}.py"] = text
    cells = json.loads((ROOT / "examples" / "boat.ipynb").read_text())["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    sources["notebook.py"] = "\n".join(code)
    sources |= {
        f"submodules_{name}": from_submodules(source)
        for name, source in sources.items()
        if "import mppi_belief as mb" in source
    }
    return sources | {MISTAKES.name: MISTAKES.read_text()}


def from_submodules(source: str) -> str:
    """Returns a program that imports each public name from the module that defines it."""
    used = set(re.findall(r"\bmb\.(\w+)", source)) - {"__version__"}
    modules = modules_of_public_names()
    imports = [f"from mppi_belief.{modules[name]} import {name}" for name in sorted(used)]
    shortened = re.sub(r"\bmb\.(?!__version__)(\w+)", r"\1", source)
    return shortened.replace(
        "import mppi_belief as mb", "; ".join(["import mppi_belief as mb", *imports])
    )


def modules_of_public_names() -> dict[str, str]:
    """Returns the module of each public name, as the package's imports for type checkers say."""
    modules = {}
    for node in ast.walk(ast.parse(Path(str(mb.__file__)).read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == 1:
            modules |= {alias.name: str(node.module) for alias in node.names}
    return modules


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a folder with the programs."""
    folder = tmp_path_factory.mktemp("programs")
    for name, source in programs().items():
        (folder / name).write_text(source)
    return folder


@pytest.fixture(scope="module")
def mypy_errors(folder: Path) -> list[TypeCheckerError]:
    """Returns the errors of `mypy --strict`, whose cache is that of `make types`."""
    options = ["--config-file", str(ROOT / "pyproject.toml"), "--no-error-summary"]
    files = [str(folder / name) for name in programs()]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)  # the configuration's paths are relative
        patch.setenv("MYPYPATH", str(BOAT))
        output, problems, _ = api.run([*options, *files])
    assert problems == ""
    errors = []
    for line in output.splitlines():
        match = MYPY_ERROR.match(line)
        if match:
            name = Path(match["file"]).name
            errors.append(TypeCheckerError(name, int(match["line"]), match["code"]))
    return errors


@pytest.fixture(scope="module")
def pyright_errors(folder: Path) -> list[TypeCheckerError]:
    """Returns the errors of pyright in its standard mode."""
    options = {"extraPaths": [str(ROOT / "src"), str(BOAT)], "reportUnusedExpression": False}
    (folder / "pyrightconfig.json").write_text(json.dumps(options))
    command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--outputjson"]
    environment = os.environ | {"PYRIGHT_PYTHON_IGNORE_WARNINGS": "1"}
    run = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    reports = json.loads(run.stdout)["generalDiagnostics"]
    errors = []
    for report in reports:
        line = report["range"]["start"]["line"] + 1
        errors.append(TypeCheckerError(Path(report["file"]).name, line, report["rule"]))
    return errors


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_the_examples_pass(checker, request):
    errors = request.getfixturevalue(f"{checker}_errors")
    assert [error for error in errors if error.file != MISTAKES.name] == []


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_every_mistake_is_found(checker, request):
    errors = request.getfixturevalue(f"{checker}_errors")
    reported = {error.line: error.code for error in errors if error.file == MISTAKES.name}
    expected = {}
    for number, line in enumerate(MISTAKES.read_text().splitlines(), start=1):
        comment = re.search(rf"#.* {checker}: ([\w-]+)", line)
        if comment:
            expected[number] = comment[1]
    assert len(expected) > 40
    assert reported == expected


def test_type_checkers_are_told_the_same_names():
    """Reads the imports of `__init__.py` that are never executed."""
    modules = modules_of_public_names()
    assert set(modules) == set(mb.__all__) - {"__version__"}
    for name, module in modules.items():
        assert getattr(importlib.import_module(f"mppi_belief.{module}"), name) is getattr(mb, name)


def test_a_wheel_says_that_the_package_has_types(tmp_path):
    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    assert "mppi_belief/py.typed" in zipfile.ZipFile(wheel).namelist()
