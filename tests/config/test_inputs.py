"""Whatever is typed or written into a yaml: one line and exit code 2, or a configuration that can
be run.
"""

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cli_helpers import CONF, SMALL, Said, call, compose, files_in
from experiment_helpers import compiled_quickly
from mppi_belief.cli import run, verify
from mppi_belief.report import build
from mppi_belief.run import runner

LINE = r"mppi-belief: [^\n]{1,700}\n"


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


@pytest.fixture
def ask(tmp_path, capsys, monkeypatch) -> Callable[..., Said]:
    """The command in a folder of its own, all of it but the trials, the certificates and the
    report.
    """
    return asking(tmp_path, capsys, monkeypatch)


def asking(folder: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Said]:
    def run_study(cells: list, order: Any, root: Path, task: Any, *rest: Any) -> None:
        for cell in cells:
            assert cell.id
            task.check(cell.config)

    monkeypatch.setattr(runner, "run_study", run_study)
    monkeypatch.setattr(run, "show_outcome", lambda *args: 0)
    monkeypatch.setattr(verify, "verify_paper", lambda *args: 0)
    monkeypatch.setattr(verify, "verify_system", lambda *args: 0)
    monkeypatch.setattr(build, "report_studies", lambda *args, **how: True)
    return lambda *args: call(folder, capsys, *args)


def is_fine(ended: Said) -> bool:
    """Done, or refused in one line."""
    return (ended.code, ended.err) == (0, "") or (
        ended.code == 2 and re.fullmatch(LINE, ended.err) is not None
    )


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
    | {
        "foo",
        "theta.x",
        "planner..horizon",
        "controller[0]",
        "names",
        "swept",
        "code",
        "folders",
        "",
    }
    | {
        "hydra.run.dir",
        "hydra.job.chdir",
        "hydra.sweep.dir",
        "hydra.launcher",
        "hydra.mode",
        "hydra.output_subdir",
    }
    | {
        "hydra.verbose",
        "hydra/job_logging",
        "hydra/launcher",
        "hydra.callbacks.x._target_",
        "hydra.searchpath",
    }
    | {
        "hydra.sweeper.params",
        "hydra.sweeper._target_",
        "hydra",
        "hydra.job.env_set.X",
        "controller@hydra.callbacks",
    }
    | {"controller@foo", "system@_global_", *GROUPS}
)
VALUES = [
    *(
        "nan",
        "inf",
        "-inf",
        "1e400",
        "-1",
        "0",
        "1",
        "1.5",
        "1e-50",
        "1e30",
        "1e300",
        "9" * 400,
        "1_0",
        "0x10",
        "１",
    ),
    *(
        "",
        "''",
        '""',
        " ",
        "null",
        "true",
        "[]",
        "{}",
        "[[]]",
        "[1,[2]]",
        "{a: 1}",
        "{1: 2}",
        "[nan]",
        "[1e39]",
        "[a]",
    ),
    *(
        "ω",
        "日本",
        "a b",
        "a\tb",
        "a,b",
        "1,2",
        "'a,b'",
        "a=b",
        "a:b",
        "\\",
        "[",
        "}",
        "(",
        "!!int 3",
        "x" * 3000,
    ),
    *(
        "${theta}",
        "${seed}",
        "${nowhere}",
        "${",
        "${.x}",
        "${oc.env:HOME}",
        "${oc.env:NOT_THERE}",
        "${oc.decode:'[1'}",
    ),
    *(
        "${oc.create:{a:1}}",
        "${now:%Y}",
        "${hydra:runtime.cwd}",
        "${unknown:1}",
        "${system}",
        "${controller}",
        "???",
    ),
    *(
        "range(0,3)",
        "range(0,0)",
        "range(0,1,0)",
        "range(0,1e18)",
        "shuffle(range(0,1e18))",
        "interval(0,1)",
    ),
    *(
        "choice(1,2)",
        "glob(*)",
        "glob(zz)",
        "sort(2,1)",
        "float(1)",
        "int(x)",
        "str(1)",
        "json_str(x)",
        "tag(a,1)",
    ),
    *(
        "os.system",
        "antigravity.X",
        "mppi_belief",
        "mppi_belief.EKF",
        "mppi_belief.Problem",
        "mppi_belief.cli.main",
    ),
    *(
        "../system/light_dark",
        "/etc/passwd",
        "light_dark/",
        ".",
        "gpu",
        "float64",
        "sample",
        "belief",
        "pipf",
    ),
]
WORD = st.builds(
    lambda sign, key, equals, value: f"{sign}{key}{equals}{value}",
    st.sampled_from(["", "", "", "", "+", "++", "~", "-"]),
    st.sampled_from(KEYS),
    st.sampled_from(["=", "=", "=", "=", "", ":"]),
    st.sampled_from(VALUES)
    | st.text(max_size=8)
    | st.floats(width=16).map(str)
    | st.integers(-3, 300).map(str),
)
FLAG = st.sampled_from(
    ["-m", "--help", "--cfg", "--cfg=job", "--", "-", "--config-dir=/dev/null", "-cn=x", "--run"]
)
COMMANDS = [["run"]] * 6 + [["verify"], ["report", "experiment=diffusion"]]


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("empty")


@settings(
    max_examples=50,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(command=st.sampled_from(COMMANDS), words=st.lists(WORD | FLAG, min_size=1, max_size=2))
def test_any_line_is_refused_in_one_line_or_can_be_run(command, words, room, capsys, monkeypatch):
    before = set(sys.modules)
    ended = asking(room, capsys, monkeypatch)(*command, *words)
    assert is_fine(ended), (words, ended)
    assert files_in(room) == []
    assert "antigravity" not in set(sys.modules) - before


NONSENSE = [
    "theta=true",
    "theta=1e39",
    "problem.dt=1e-50",
    "problem.prior_mean=[]",
    "problem.prior_std=[1e30,0,0,0]",
    "system.noise_floor=1e-30 system.noise_slope=0",
    "system.noise_slope=1e38",
    "problem.obstacles.radius=" + "9" * 400,
    "cost={a: 1}",
    "controller._target_=antigravity.X",
    "controller._target_=os.system",
    "controller._target_=mppi_belief..MPPI",
    "controller._target_=mppi_belief.LightDark",
    "system._target_=mppi_belief.EKF",
    "problem._target_=mppi_belief.EKF",
    "~problem._target_",
    "controller=../controller/ce",
    "-m seed=range(0,0)",
    "-m seed=range(0,1e18)",
    "-m seed=shuffle(range(0,1e18))",
    "-m seed=range(0,1000) w_obs=range(0,1000)",
    "-m theta=interval(0,1)",
    "theta=${theta}",
    "theta=${oc.env:NOT_THERE}",
    "hydra.run.dir=here",
    "hydra.job.chdir=true",
    "hydra.output_subdir=here",
    "hydra.callbacks.x._target_=antigravity.X",
    "hydra/job_logging=default",
    "+controller@hydra.callbacks.x=belief",
    "--experimental-rerun=x.pickle",
    "--config-path=/tmp",
    "--config-name=schema",
    "--config-dir=/dev/null",
    "--config-dir",
    "--package=theta",
    "theta=1\n",
    "\udcff=1",
    "theta=\udcff",
    "",
    "--",
    "theta=" + "[" * 2000,
    "x" * 100_000,
]


@pytest.mark.parametrize(
    "line", NONSENSE, ids=lambda line: line[:40].encode("unicode_escape").decode()
)
def test_nonsense_is_refused(line, ask, tmp_path):
    words = line.split(" ")
    ended = ask("run", *words, *(() if "system" in line or "problem" in line else SMALL))
    assert (ended.code, ended.out) == (2, "")
    assert re.fullmatch(LINE, ended.err)
    assert files_in(tmp_path) == []


GOOD = "_target_: mppi_belief.LQG\nhorizon: 0\n"
YAML = {
    "an alias in itself": (b"a: &a [*a]\n", r"\*a contains itself"),
    "an alias of nothing": (b"a: *b\n", r"bad\.yaml:1: .*undefined alias"),
    "a deep list": (b"a: " + b"[" * 9000, r"nested too deeply"),
    "binary": (bytes(range(128, 256)), r"must be UTF-8"),
    "a tab": (b"gain:\n\t1\n", r"bad\.yaml:2: .*\\t"),
    "a key twice": (b"gain: 1\ngain: 2\n", r"bad\.yaml:\d: found duplicate key gain"),
    "a Python tag": (
        b"a: !!python/object/apply:os.system [x]\n",
        r"bad\.yaml:1: could not determine a constructor",
    ),
    "a path tag": (
        b"_target_: mppi_belief.LQG\nhorizon: !!python/object/apply:pathlib.Path [x]\n",
        r"bad\.yaml:2: could not determine a constructor",
    ),
    "bytes": (
        b"_target_: mppi_belief.LQG\nhorizon: !!binary aGk=\n",
        r"horizon must be a number",
    ),
    "keys of numbers": (b"_target_: mppi_belief.LQG\n1: 2\n", r"controller/bad\.yaml: Key .*1"),
    "a list": (b"[1, 2]\n", r"bad\.yaml: must hold lines KEY: VALUE, holds \[1, 2\]"),
    "a word": (b"hello\n", r"bad\.yaml: must hold lines KEY: VALUE, holds 'hello'"),
    "nothing": (b"", r"controller has no _target_"),
    "two documents": (b"a: 1\n---\nb: 1\n", r"bad\.yaml:\d: but found another document"),
    "other code": (
        b"_target_: os.system\n",
        r"must name a class of mppi_belief or of a module in a --config-dir folder",
    ),
    "other code inside": (
        b"_target_: mppi_belief.LQG\nhorizon:\n  _target_: os.system\n",
        r"horizon\._target_=os",
    ),
    "itself": (b"defaults:\n  - bad\n", r"contains itself"),
    "what is not there": (b"defaults:\n  - /controller: gone\n", r"gone"),
}


@pytest.mark.parametrize("what", YAML)
def test_a_bad_yaml_is_refused_by_name(what, ask, tmp_path):
    content, reason = YAML[what]
    own = tmp_path / "own" / "controller"
    own.mkdir(parents=True)
    (own / "bad.yaml").write_bytes(content)
    ended = ask("run", "--config-dir=own", "controller=bad", *SMALL)
    assert ended.code == 2, ended
    assert re.fullmatch(LINE, ended.err), ended.err
    assert re.search(reason, ended.err), ended.err
    assert files_in(tmp_path) == ["own"]


HYDRAS_OWN = {
    "a callback": "# @package hydra.callbacks\nx:\n  _target_: antigravity.X\n",
    "a folder": "# @package _global_\nhydra:\n  job:\n    chdir: true\n  run:\n    dir: here\n",
    "a launcher": "# @package hydra.launcher\n_target_: antigravity.X\n",
}


@pytest.mark.parametrize("what", HYDRAS_OWN)
def test_settings_of_hydra_in_a_yaml_have_no_effect(what, ask, tmp_path):
    own = tmp_path / "own" / "experiment"
    own.mkdir(parents=True)
    (own / "mine.yaml").write_text(HYDRAS_OWN[what])
    assert ask("run", "--config-dir=own", "experiment=mine", *SMALL) == (0, "", "")
    assert files_in(tmp_path) == ["own"]
    assert "antigravity" not in sys.modules


def test_a_byte_order_mark_before_the_package_is_refused(ask, tmp_path):
    (tmp_path / "own" / "experiment").mkdir(parents=True)
    (tmp_path / "own" / "experiment" / "mine.yaml").write_bytes(
        b"\xef\xbb\xbf# @package _global_\ntheta: 2\n"
    )
    ended = ask("run", "--config-dir=own", "experiment=mine")
    assert ended.code == 2
    assert re.fullmatch(LINE, ended.err)


def test_a_configuration_that_makes_sense_is_accepted(ask, tmp_path):
    own = tmp_path / "own" / "controller"
    own.mkdir(parents=True)
    (own / "good.yaml").write_text(GOOD)
    assert ask("run", "--config-dir=own", "controller=good", *SMALL) == (0, "", "")
    assert ask("run", *SMALL, "theta=0.5", "results_dir=${oc.env:HOME}/x") == (0, "", "")
    assert files_in(tmp_path) == ["own"]


@pytest.mark.parametrize(
    "words",
    [
        ["run\n"],
        ["\udcff"],
        ["x" * 100_000],
        ["--", "run"],
        [""],
        ["verify", "\udcff"],
        ["report", "--", "x"],
    ],
)
def test_odd_commands_are_refused(words, ask):
    ended = ask(*words)
    assert ended.code == 2
    assert re.fullmatch(LINE, ended.err)
