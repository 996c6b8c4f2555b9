"""The command line: bad input in one line and nothing on disk, what it prints, what it composes."""

import errno
import json
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import PIPE

import pytest
from omegaconf import OmegaConf

import mppi_belief
from cli_helpers import (
    CONF,
    SMALL,
    TIMEOUT,
    Said,
    call,
    collect,
    command,
    files_in,
    python,
    restored,
)
from mppi_belief.cli import exit_codes
from mppi_belief.cli.main import COMMANDS
from mppi_belief.config.compose import collect as collect_request
from mppi_belief.config.request import Request
from mppi_belief.config.settings import Planner, Settings
from mppi_belief.results import files

BAD = [
    "run theta=abc",
    "run theta=-1",
    "run theta=nan",
    "run controler=belief",
    "run controller=beleif",
    "run n_trials=0",
    "run w_obs=-5",
    "run workers=0",
    "run +foo=1",
    "run -m theta=1,-1",
    "run -m workers=1,2",
    "run -m platform=cpu,gpu",
    "run platform=tpu",
    "run batch=0",
    "run batch=1.5",
    "verify platform=gpu",
    "run --unknown",
    "run +controller.foo=1",
    "run controller.horizon=0",
    "run controller/sampler=backwards",
    "run problem.dt=-0.1",
    "run system.light=here",
    "run cost=quadratic",
    "run cost.goal=[1]",
    "run controller._target_=os.system",
    "run controller._target_=nowhere.Controller",
    "run ~cost.goal",
    "run ~system._target_",
    "run controller=pipf filter=ekf",
    "theta=1",
    "rum theta=1",
    "--theta",
    "''",
    "-sc",
]


@pytest.fixture
def mppi_belief_command(tmp_path, capsys) -> Callable[..., Said]:
    """The command, in this process and an empty folder."""
    return lambda *args, **env: call(tmp_path, capsys, *args, **env)


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_line_and_exit_code_2_and_leaves_no_trace(
    line, mppi_belief_command, tmp_path
):
    ended = mppi_belief_command(*shlex.split(line))
    assert (ended.code, ended.out) == (2, "")
    assert re.fullmatch(r"mppi-belief: \S.*\n", ended.err)
    assert files_in(tmp_path) == []


@pytest.mark.parametrize("args", [["run", "theta=nan"], ["theta=1"]], ids=" ".join)
def test_bad_input_to_the_real_command(args, tmp_path):
    ended = command(tmp_path, *args)
    assert (ended.code, ended.out) == (2, "")
    assert re.fullmatch(r"mppi-belief: \S.*\n", ended.err)
    assert files_in(tmp_path) == []


def test_a_results_dir_that_cannot_be_made_or_written_is_exit_code_74(
    mppi_belief_command, tmp_path
):
    taken = tmp_path / "taken"
    taken.write_text("a file")
    for target in ("/dev/null/x", str(taken)):
        ended = mppi_belief_command("run", f"results_dir={target}", *SMALL)
        assert (ended.code, ended.out) == (74, "")
        assert re.fullmatch(rf"mppi-belief: cannot write results: .*{target}.*\n", ended.err)
    assert files_in(tmp_path) == ["taken"]


def test_a_full_disk_is_exit_code_74_and_said_in_words(mppi_belief_command, monkeypatch):
    def full(root: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files, "probe", full)
    ended = mppi_belief_command("run", *SMALL)
    assert ended.code == 74
    assert re.fullmatch(
        r"mppi-belief: cannot write results: No space left on device\S*\n", ended.err
    )


def test_a_forgotten_run_is_suggested(mppi_belief_command):
    assert (
        "did you mean `mppi-belief run theta=1 seed=2`?"
        in mppi_belief_command("theta=1", "seed=2").err
    )
    assert (
        "did you mean `mppi-belief run -m theta=1,2`?" in mppi_belief_command("-m", "theta=1,2").err
    )
    assert "see mppi-belief --help" in mppi_belief_command("simulate").err


def test_help_and_version(mppi_belief_command):
    for args in ([], ["--help"], ["-h"]):
        ended = mppi_belief_command(*args)
        assert (ended.code, ended.err) == (0, "")
        assert "mppi-belief run --help" in ended.out
    assert mppi_belief_command("--version") == (0, f"mppi-belief {mppi_belief.__version__}\n", "")


def test_help_of_run_names_every_group_option_and_key(mppi_belief_command, tmp_path):
    ended = mppi_belief_command("run", "--help")
    assert (ended.code, ended.err) == (0, "")
    groups = [entry for entry in CONF.iterdir() if entry.is_dir()]
    assert len(groups) >= 5
    for group in groups:
        (line,) = re.findall(rf"^{group.name}: .*$", ended.out, re.MULTILINE)
        assert sorted(re.findall(r"[\w.]+", line)[1:]) == sorted(
            path.stem for path in group.glob("*.yaml")
        )
    for key in (*Settings.__dataclass_fields__, *Planner.__dataclass_fields__):
        assert re.search(rf"^\s*{key}:", ended.out, re.MULTILINE), key
    assert not re.search(r"^hydra:|\?\?\?|schema", ended.out, re.MULTILINE)
    assert files_in(tmp_path) == []


def test_help_and_complaints_do_not_wait_for_what_is_slow_to_load(tmp_path):
    for args in (["--help"], ["run", "--help"], ["run", "theta=-1"]):
        code = f"import sys; sys.argv = {['mppi-belief', *args]}\n"
        code += "from mppi_belief.cli.main import main; main()\n"
        modules = ("hydra", "jax", "matplotlib", "numpy", "pandas", "pyarrow")
        slow = f"[name for name in {modules} if name in sys.modules]"
        loaded = python(f"{code}print('loaded', {slow})", tmp_path)
        assert loaded.splitlines()[-1] == f"loaded {['hydra'] if 'run' in args else []}"


def test_cfg_job_prints_the_configuration_and_runs_nothing(mppi_belief_command, tmp_path):
    ended = mppi_belief_command("run", "theta=2.5", "controller=ce", "--cfg", "job", "--resolve")
    assert (ended.code, ended.err) == (0, "")
    printed = OmegaConf.create(ended.out)
    assert set(printed) == set(Settings.__dataclass_fields__)
    assert (printed.theta, printed.controller.path_cost._target_, printed.n_trials) == (
        2.5,
        "mppi_belief.CertaintyEquivalent",
        200,
    )
    assert files_in(tmp_path) == []


def test_numbers_at_the_top_reach_the_groups():
    (config,) = collect(
        "theta=2", "w_obs=100", "planner.horizon=7", "planner.n_samples=9", "planner.temperature=3"
    )
    assert (config["controller"]["path_cost"]["theta"], config["cost"]["w_obs"]) == (2.0, 100.0)
    assert [config["controller"][key] for key in ("horizon", "n_samples", "temperature")] == [
        7,
        9,
        3.0,
    ]
    names = {
        "system": "light_dark",
        "cost": "goal_obstacles",
        "filter": "ekf",
        "controller": "belief",
    }
    assert config["names"] == names


def test_a_system_brings_its_cost_and_its_time_grid():
    (config,) = collect("system=scalar_linear")
    assert config["names"]["cost"] == "quadratic"
    assert len(config["problem"]["prior_mean"]) == len(config["cost"]["goal"]) == 1
    assert config["controller"]["sampler"]["control_std"] is None


def test_sweeps_need_no_m_and_multiply():
    configs = collect("sweep=theta", "seed=3")
    assert [config["theta"] for config in configs] == [
        config["controller"]["path_cost"]["theta"] for config in configs
    ]
    assert [config["theta"] for config in configs] == [0, 0.5, 1, 2, 5]
    assert {config["seed"] for config in configs} == {3}
    configs = collect("sweep=w_obs", "controller=belief,ce")
    weights = [100, 250, 500, 1000, 2500, 5000, 10000]
    pairs = sorted((config["names"]["controller"], config["w_obs"]) for config in configs)
    assert pairs == [(name, weight) for name in ("belief", "ce") for weight in weights]
    assert len(collect("theta=1", "-m", "seed=0,1")) == 2


def test_swept_settings_are_labels_and_what_does_not_change_a_trial_is_not():
    changes = ["theta=2", "controller.horizon=7", "cost.goal=[1,2,0,0]", "controller=ce"]
    (config,) = collect(*changes, "n_trials=5", "workers=1", "results_dir=elsewhere")
    labels = {
        "theta": 2.0,
        "controller.horizon": 7,
        "cost.goal": "[1, 2, 0, 0]",
        "controller": "ce",
    }
    assert config["swept"] == labels


def test_one_call_leaves_nothing_behind_for_the_next(mppi_belief_command):
    with restored():
        first = collect_request(Request(("controller=ce",)))
        assert mppi_belief_command("run", "theta=abc").code == 2
        assert mppi_belief_command("run", "--help").code == 0
        assert len(collect_request(Request(("theta=0,1",), multirun=True))) == 2
        assert collect_request(Request(("controller=ce",))) == first


def test_a_users_yaml_is_found_by_config_dir_from_anywhere(tmp_path):
    (tmp_path / "controller").mkdir()
    (tmp_path / "controller" / "mine.yaml").write_text("_target_: mine.Mine\ngain: ${theta}\n")
    (tmp_path / "mine.py").write_text("")
    for args in (
        [f"--config-dir={tmp_path}"],
        ["--config-dir", str(tmp_path)],
        ["-cd", str(tmp_path)],
    ):
        (config,) = collect(*args, "controller=mine", "theta=3")
        assert config["controller"] == {"_target_": "mine.Mine", "gain": 3.0}
        assert config["names"]["controller"] == "mine"


USERS_CONTROLLER = """
import jax.numpy as jnp
import mppi_belief as mb
from typing import NamedTuple

class Info(NamedTuple):
    ess: object

@mb.struct
class Proportional:
    gain: float = mb.number(default=1.0, ge=0)

    def init(self, problem):
        return jnp.zeros(())

    def act(self, problem, belief, plan, key):
        return -self.gain * belief.mean, plan, Info(jnp.ones(()))
"""


def test_a_users_own_controller_runs_from_a_yaml_and_a_module_beside_it(tmp_path):
    own = tmp_path / "own"
    away = tmp_path / "away"
    (own / "controller").mkdir(parents=True)
    away.mkdir()
    (own / "proportional.py").write_text(USERS_CONTROLLER)
    (own / "controller" / "proportional.yaml").write_text(
        "_target_: proportional.Proportional\ngain: 0.5\n"
    )
    args = [
        "run",
        "--config-dir",
        "../own",
        "controller=proportional",
        "n_trials=3",
        "workers=1",
        *SMALL,
    ]
    # As the kernel of a notebook sets it for all that it starts, with a module that is not there.
    ended = command(away, *args, MPLBACKEND="module://not_installed.backend_inline")
    assert (ended.code, ended.err) == (0, "")
    assert "3 trials run, 0 already done" in ended.out
    assert re.search(r"^\s*proportional\b", ended.out, re.MULTILINE)
    assert (files_in(away), files_in(away / "outputs")) == (["outputs"], ["results"])
    (cell,) = (away / "outputs" / "results").iterdir()
    assert cell.name.startswith("proportional-")
    assert len(json.loads((cell / "timing.json").read_text())["seconds"]) == 200
    assert (cell / "trajectories.png").stat().st_size > 5000


COMPLETIONS = {
    "mppi-belief ": ["run", "report", "verify", "results", "replay", "--help", "--version"],
    "mppi-belief r": ["run", "report", "results", "replay"],
    "mppi-belief report exp": ["experiment="],
    "mppi-belief x": [],
    "mppi-belief verify cole_hopf fey": ["feynman_kac"],
    "mppi-belief verify cole_hopf the": ["theta="],
    "mppi-belief run contr": ["controller.", "controller="],
    "mppi-belief run the": ["theta="],
    "mppi-belief run -m seed=1,2 controller=belief work": ["workers="],
    "mppi-belief run controller=belief controller.horiz": ["controller.horizon="],
}


@pytest.mark.parametrize("line", COMPLETIONS)
def test_completion_of_a_word(line, mppi_belief_command):
    ended = mppi_belief_command("-sc", "query=bash", COMP_LINE=line, COMP_POINT=str(len(line)))
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.split() == COMPLETIONS[line]


@pytest.mark.parametrize("before", ["", "theta=1 ", "-m theta=0,1 w_obs=100 "])
def test_completion_of_an_option_lists_the_group(before, mppi_belief_command):
    line = f"mppi-belief run {before}controller="
    ended = mppi_belief_command("-sc", "query=bash", COMP_LINE=line, COMP_POINT=str(len(line)))
    assert ended.out.split() == sorted(
        f"controller={path.stem}" for path in CONF.glob("controller/*.yaml")
    )


def test_the_script_for_bash_completes(tmp_path):
    folder = Path(sys.executable).parent
    script = f"""
        PATH={folder}:$PATH
        eval "$(mppi-belief -sc install=bash)"
        COMP_LINE="mppi-belief run contr" COMP_POINT=21 COMP_CWORD=2
        _mppi_belief_completion
        echo "${{COMPREPLY[@]}}"
    """
    assert python(
        f"import subprocess; subprocess.run(['bash', '-c', {script!r}], check=True)", tmp_path
    ) == ("controller. controller=")


SWALLOWS = """
import sys, time
from mppi_belief.run.signals import ended_by_signals
def careless():
    while True:
        try:
            print("in its hands", flush=True)
            time.sleep(60)
        except BaseException:
            pass
ended_by_signals(careless, lambda: print("stopped", file=sys.stderr), grace=0.5)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_takes_the_signal_for_its_own_ends_all_the_same(number):
    with subprocess.Popen(
        [sys.executable, "-c", SWALLOWS], stdout=PIPE, stderr=PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "in its hands\n"
        process.send_signal(number)
        _, ended = process.communicate(timeout=TIMEOUT)
    assert (process.returncode, ended) == (128 + number, "stopped\n")


def test_the_docs_have_the_exit_codes_of_the_commands():
    assert exit_codes.markdown() in (CONF.parent / "docs" / "reliability.md").read_text()


@pytest.mark.parametrize("command_name", COMMANDS)
def test_the_help_of_a_command_names_its_options_and_exit_codes(command_name, mppi_belief_command):
    ended = mppi_belief_command(command_name, "--help")
    assert (ended.code, ended.err) == (0, "")
    assert ended.out.startswith(f"usage: mppi-belief {command_name} ")
    assert all(option in ended.out for option in COMMANDS[command_name].parser().options)
    for entry in exit_codes.meanings_of(command_name):
        assert re.search(rf"^  {entry.code} +{re.escape(entry.meaning)}$", ended.out, re.MULTILINE)


def test_a_sweep_starts_from_the_first_of_its_values():
    """A key that only the swept options of a group have is known."""
    configs = collect("-m", "controller=ilqg", "controller.max_iterations=1,2")
    assert [config["controller"]["max_iterations"] for config in configs] == [1, 2]
    configs = collect("-m", "controller=pipf,ilqg", "seed=1")
    assert [config["names"]["controller"] for config in configs] == ["pipf", "ilqg"]


def test_info_names_the_file_of_each_group(mppi_belief_command, tmp_path):
    (tmp_path / "mine" / "controller").mkdir(parents=True)
    mine = tmp_path / "mine" / "controller" / "mine.yaml"
    mine.write_text("_target_: mppi_belief.LQG\nhorizon: 3\n")
    args = ["--config-dir", "mine", "controller=mine", "--info", "defaults"]
    ended = mppi_belief_command("run", *args)
    assert (ended.code, ended.err) == (0, "")
    lines = [line.split() for line in ended.out.splitlines()]
    assert ["controller", "mine", "mine/controller/mine.yaml"] in lines
    assert ["system", "light_dark", str(CONF / "system" / "light_dark.yaml")] in lines
