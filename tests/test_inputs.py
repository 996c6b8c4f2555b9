"""Whatever is typed or written into a yaml: one line and exit code 2, or a configuration that can be run."""

import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from cli_helpers import CONF, SMALL, Said, call, compose, files_in
from experiment_helpers import compiled_quickly
from mppi_belief import cli
from mppi_belief.report import write
from mppi_belief.study import runner

LINE = r"mppi-belief: [^\n]{1,700}\n"
SLOW = 10  # s, in which a refusal takes milliseconds


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


@pytest.fixture
def ask(tmp_path, capsys, monkeypatch) -> Callable[..., Said]:
    """The command in a folder of its own, all of it but the trials, the certificates and the report."""
    return asking(tmp_path, capsys, monkeypatch)


def asking(folder: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Said]:
    def run_study(cells: list, n_trials: int, root: Path, workers: int, task: Any, *rest: Any) -> None:
        for cell in cells:
            assert cell.id
            task.check(cell.config)

    monkeypatch.setattr(runner, "run_study", run_study)
    monkeypatch.setattr(cli, "_tell", lambda *args: 0)
    monkeypatch.setattr(cli, "_certify", lambda *args: 0)
    monkeypatch.setattr(cli, "_what_holds", lambda *args: 0)
    monkeypatch.setattr(write, "report", lambda *args: True)
    return lambda *args: call(folder, capsys, *args)


def is_fine(said: Said) -> bool:
    """Done, or refused in one line."""
    return (said.code, said.err) == (0, "") or (said.code == 2 and re.fullmatch(LINE, said.err) is not None)


def keys(node: Any, path: str = "") -> Iterator[str]:
    """Every key below a node, dotted."""
    for key, value in node.items():
        yield f"{path}{key}"
        if isinstance(value, dict):
            yield from keys(value, f"{path}{key}.")


GROUPS = ("system", "controller", "filter", "sweep", "experiment", "cost")
OPTIONS = {group: sorted(path.stem for path in (CONF / group).glob("*.yaml")) for group in GROUPS}
WORLDS = [f"{group}={option}" for group in ("system", "controller") for option in OPTIONS[group]]
OWN = {"names", "swept", "code"}
KEYS = sorted(
    {key for world in WORLDS for key in keys(compose(world)) if key.split(".")[0] not in OWN}
    | {"foo", "theta.x", "planner..horizon", "controller[0]", "names", "swept", "code", "folders", ""}
    | {"hydra.run.dir", "hydra.job.chdir", "hydra.sweep.dir", "hydra.launcher", "hydra.mode", "hydra.output_subdir"}
    | {"hydra.verbose", "hydra/job_logging", "hydra/launcher", "hydra.callbacks.x._target_", "hydra.searchpath"}
    | {"hydra.sweeper.params", "hydra.sweeper._target_", "hydra", "hydra.job.env_set.X", "controller@hydra.callbacks"}
    | {"controller@foo", "system@_global_", *GROUPS}
)
VALUES = [
    *("nan", "inf", "-inf", "1e400", "-1", "0", "1", "1.5", "1e-50", "1e30", "1e300", "9" * 400, "1_0", "0x10", "１"),
    *("", "''", '""', " ", "null", "true", "[]", "{}", "[[]]", "[1,[2]]", "{a: 1}", "{1: 2}", "[nan]", "[1e39]", "[a]"),
    *("ω", "日本", "a b", "a\tb", "a,b", "1,2", "'a,b'", "a=b", "a:b", "\\", "[", "}", "(", "!!int 3", "x" * 3000),
    *("${theta}", "${seed}", "${nowhere}", "${", "${.x}", "${oc.env:HOME}", "${oc.env:NOT_THERE}", "${oc.decode:'[1'}"),
    *("${oc.create:{a:1}}", "${now:%Y}", "${hydra:runtime.cwd}", "${unknown:1}", "${system}", "${controller}", "???"),
    *("range(0,3)", "range(0,0)", "range(0,1,0)", "range(0,1e18)", "shuffle(range(0,1e18))", "interval(0,1)"),
    *("choice(1,2)", "glob(*)", "glob(zz)", "sort(2,1)", "float(1)", "int(x)", "str(1)", "json_str(x)", "tag(a,1)"),
    *("os.system", "antigravity.X", "mppi_belief", "mppi_belief.EKF", "mppi_belief.Problem", "mppi_belief.cli.main"),
    *("../system/light_dark", "/etc/passwd", "light_dark/", ".", "gpu", "float64", "sample", "belief", "pipf"),
]
WORD = st.builds(
    lambda sign, key, equals, value: f"{sign}{key}{equals}{value}",
    st.sampled_from(["", "", "", "", "+", "++", "~", "-"]),
    st.sampled_from(KEYS),
    st.sampled_from(["=", "=", "=", "=", "", ":"]),
    st.sampled_from(VALUES) | st.text(max_size=8) | st.floats(width=16).map(str) | st.integers(-3, 300).map(str),
)
FLAG = st.sampled_from(["-m", "--help", "--cfg", "--cfg=job", "--info", "--", "-", "--config-dir=/dev/null", "-cn=x"])


def composed_and_checked(said: Said) -> bool:
    return is_fine(said)


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("empty")


@settings(
    max_examples=150, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(command=st.sampled_from(["run"] * 6 + ["verify", "report"]), words=st.lists(WORD | FLAG, min_size=1, max_size=2))
def test_any_line_is_refused_in_one_line_or_can_be_run(command, words, room, capsys, monkeypatch):
    before, began = set(sys.modules), time.monotonic()
    said = asking(room, capsys, monkeypatch)(command, *words)
    assert is_fine(said), (words, said)
    assert files_in(room) == []
    assert time.monotonic() - began < SLOW
    assert "antigravity" not in set(sys.modules) - before
