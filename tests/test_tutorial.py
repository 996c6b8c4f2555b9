"""Tests the tutorial and the notebook: their files are those of examples/, their commands work."""

import base64
import json
import re
import shlex
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from cli_helpers import Said, call

ROOT = Path(__file__).parents[1]
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text()
QUICK = ("planner.n_samples=16", "planner.horizon=3", "problem.steps=3", "n_trials=2", "workers=1")
COMMANDS = re.findall(r"^    mppi-belief (.+)$", TUTORIAL, re.MULTILINE)


@pytest.mark.parametrize("name", ["boat.py", "system/boat.yaml", "experiment/crossing.yaml"])
def test_its_files_are_those_of_the_example(name):
    quoted = re.findall(r"^```\w+\n(.*?)^```$", TUTORIAL, re.MULTILINE | re.DOTALL)
    assert (ROOT / "examples" / "boat" / name).read_text() in quoted


def test_its_commands_run_one_after_the_other(tmp_path, capsys):
    assert len(COMMANDS) == 6
    for line in COMMANDS:
        answer = run_smaller(line, tmp_path, capsys)
        assert answer.code == 0, (line, answer.err)
    assert "boat" in (tmp_path / "outputs" / "report" / "index.html").read_text()


def run_smaller(line: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> Said:
    """Runs a command of the tutorial with few samples and trials."""
    command, *words = shlex.split(line.replace("examples/boat", str(ROOT / "examples" / "boat")))
    return call(folder, capsys, command, *words, *(QUICK[:3] if command == "verify" else QUICK))


def test_the_notebook_runs_from_its_folder(monkeypatch, capsys):
    monkeypatch.chdir(ROOT / "examples")
    monkeypatch.setattr(plt, "show", lambda: None)
    notebook = json.loads(Path("boat.ipynb").read_text())
    monkeypatch.setattr(sys, "path", [*sys.path])
    names: dict[str, object] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["MPPI-Belief", "CE-MPPI"]
    plt.close("all")


def test_the_notebook_is_stored_with_outputs_that_are_small():
    path = ROOT / "examples" / "boat.ipynb"
    codes = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in codes] == [*range(1, len(codes) + 1)]
    outputs = [output for cell in codes for output in cell["outputs"]]
    printed, drawn = outputs
    assert [line.split()[0] for line in printed["text"]] == ["MPPI-Belief", "CE-MPPI"]
    assert base64.b64decode(drawn["data"]["image/png"]).startswith(b"\x89PNG")
    assert path.stat().st_size < 100_000, "run docs/scripts/run_notebook.py"
