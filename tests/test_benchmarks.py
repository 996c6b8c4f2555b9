"""The benchmark's protocol, its table, and that its work is the configuration's; nothing is
timed.
"""

import io
import json
import os
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import beyond
import compare
import contestants
import control_step
import document
import environments
import plant
import remote
import rounds
import subject
import table
import workload as work
from cli_helpers import collect, restored
from mppi_belief.trial import build

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "benchmarks"


@pytest.fixture(scope="module")
def workload():
    with restored():
        return work.workload()


class Chaser(plant.Planner):
    """Drives to the goal by feedback."""

    settings = "by hand"

    def reset(self):
        self.calls = 0

    def observe(self, x):
        return x

    def act(self, state):
        self.calls += 1
        goal = self.workload["goal"]
        return [2 * (goal[i] - state[i]) - 3 * state[2 + i] for i in range(2)]

    def control(self, result):
        return result


def make(name, workload, dtype):
    return Chaser(workload, dtype)


class Process:
    """Represents a contestant without a process; as in `remote.Remote`, replies are JSON."""

    def __init__(self, make, fails_at=""):
        self.make = make
        self.fails_at = fails_at
        self.ended = False
        self.asked = []

    def ask(self, do, **values):
        self.asked.append(do)
        if do == self.fails_at:
            raise remote.SubjectError("it broke")
        if do == "prepare":
            self.made = {}
        return json.loads(
            json.dumps(subject.answer(self.make, "chaser", {"do": do, **values}, self.made))
        )

    def end(self):
        self.ended = True


def test_the_work_is_what_the_configuration_says(workload):
    (config,) = collect("experiment=table_1_bumps", "controller=ce")
    problem, _, controller = build(config)
    assert (workload["dt"], workload["steps"], workload["start"]) == (
        problem.dt,
        problem.steps,
        [0.9, 1.9, 0, 0],
    )
    names = ("n_samples", "horizon", "temperature")
    assert [workload[name] for name in names] == [getattr(controller, name) for name in names]
    assert workload["control_std"] == controller.sampler.control_std
    x = np.array([2.0, 0.5, 1.0, -0.5])
    u = np.array([0.3, -0.2])
    goal = np.array(workload["goal"])
    width = workload["bump_width"]
    quadratic = {
        key: 0.5 * np.sum(workload[key] * (x - goal) ** 2)
        for key in ("running_weight", "terminal_weight")
    }
    apart = np.sum((x[:2] - np.array(workload["centers"])) ** 2, axis=1)
    np.testing.assert_allclose(problem.cost.base(x), quadratic["running_weight"], rtol=1e-6)
    np.testing.assert_allclose(problem.cost.terminal(x), quadratic["terminal_weight"], rtol=1e-6)
    bumps = workload["w_obs"] * np.sum(np.exp(-0.5 * apart / width**2))
    np.testing.assert_allclose(problem.penalty(x), bumps, rtol=1e-6)
    np.testing.assert_allclose(problem.cost.R, np.diag(workload["control_weight"]), rtol=1e-6)
    moved = x + (problem.system.f(x) + problem.system.G(x) @ u) * problem.dt
    np.testing.assert_allclose(plant.plant_step(workload, x.tolist(), u.tolist()), moved, rtol=1e-6)
    clearance = plant.judge(workload, [x.tolist()])["clearance"]
    np.testing.assert_allclose(clearance, problem.clearance(x), rtol=1e-6)
    path = np.array([x, [3.2, 0.4, 0.0, 0.0], [3.2, 0.4, 0.0, 0.0], [7.5, -0.4, 0.0, 0.0]])
    clearance = plant.judge(workload, path.tolist())["clearance"]
    np.testing.assert_allclose(clearance, np.min(problem.path_clearance(path)), rtol=1e-6)


def test_a_subject_answers_line_by_line_and_survives_its_errors(workload):
    requests = [
        {"do": "time", "calls": 2},  # before it is prepared
        {"do": "prepare", "workload": workload, "dtype": "float64"},
        {"do": "time", "calls": 3},
        {"do": "closed_loop"},
        {"do": "dance"},
        {"do": "quit"},
        {"do": "closed_loop"},  # never read
    ]
    replies = io.StringIO()
    subject.serve(make, "chaser", io.StringIO("\n".join(map(json.dumps, requests))), replies)
    unready, prepared, timed, judged, unknown, after_quit = map(
        json.loads, replies.getvalue().splitlines()
    )
    assert "KeyError" in unready["error"]
    assert prepared == {"versions": {}, "settings": "by hand"}
    assert len(timed["seconds"]) == 3
    assert min(timed["seconds"]) > 0
    assert judged["nearest"] <= judged["final_distance"] < 0.1
    assert "dance" in unknown["error"]
    assert after_quit == {}


def test_timing_drives_trial_after_trial(workload):
    chaser = Chaser(workload | {"steps": 4}, "float64")
    assert (
        len(chaser.time(4)) == 4
    )  # nine calls with the warm-up: two trials and one step of the third
    assert chaser.calls == 1
    assert plant.WARM_UP == 5


def test_turns_are_interleaved_and_one_that_fails_is_out(workload):
    subjects = {"a": Process(make), "b": Process(make, fails_at="closed_loop"), "c": Process(make)}
    turns = []
    for name, contestant in subjects.items():
        ask = contestant.ask
        contestant.ask = lambda do, name=name, ask=ask, **values: (
            turns.append((name, do)) or ask(do, **values)
        )
    results = rounds.measure(subjects, workload, "float64", rounds=2, calls=3)
    rounds.end(list(subjects.values()))
    assert results["b"]["error"] == "it broke"
    assert results["b"]["rounds"] == []
    assert "time" not in subjects["b"].asked
    assert [len(seconds) for seconds in results["a"]["rounds"]] == [3, 3]
    # The second round runs backwards.
    assert turns[-4:] == [("a", "time"), ("c", "time"), ("c", "time"), ("a", "time")]
    assert all(contestant.ended for contestant in subjects.values())


def test_a_process_that_dies_is_reported(tmp_path):
    for code, expected in {
        "import sys; sys.exit(7)": "ended with code 7",
        'input(); print(\'{"error": "no luck"}\', flush=True); input()': "no luck",
    }.items():
        process = remote.Remote([sys.executable, "-c", code], tmp_path / "log.txt")
        with pytest.raises(remote.SubjectError, match=expected):
            process.ask("prepare")
        process.end()
        assert process.process.poll() is not None


def test_a_process_that_does_not_answer_is_ended(tmp_path):
    process = remote.Remote([sys.executable, "-c", "input(); input()"], tmp_path / "log.txt")
    with pytest.raises(remote.SubjectError, match=r"no reply to .time. in 0\.1 s"):
        process.ask("time", timeout=0.1)
    assert process.process.wait(10)
    process.end()


def test_a_real_process_answers_though_its_library_is_missing(tmp_path, workload):
    process = rounds.start(
        sys.executable, "jax_mppi_peer", "jax_mppi", rounds.one_cpu(), tmp_path / "log.txt"
    )
    results = rounds.measure({"jax_mppi": process}, workload, "float32", rounds=1, calls=1)
    rounds.end([process])
    assert "No module named 'jax_mppi'" in results["jax_mppi"]["error"]


def report(**rows):
    seconds = {name: [[ms / 1e3] * 10] * 2 for name, ms in rows.items() if not isinstance(ms, str)}
    measured = {
        name: {"rounds": s, "nearest": 0.2, "versions": {"p": "1"}, "settings": "s"}
        for name, s in seconds.items()
    }
    failed = {name: {"rounds": [], "error": ms} for name, ms in rows.items() if isinstance(ms, str)}
    return {
        "rows": {
            "float32": {name: table.summary(result) for name, result in (measured | failed).items()}
        },
        **{"started": "today", "commit": "abc", "dirty": True, "processor": "a", "platform": "b"},
        **{"load": (0.1, 0.2, 0.3), "rounds": 2, "calls": 10},
    }


def test_the_table_has_ratios_to_ours_multiples_of_floors_and_failures():
    text = table.markdown(report(ce=0.3, floor_ce=0.2, jax_mppi=0.6, torchrl="no wheel"))
    assert "| CE-MPPI | 0.300 | 0.300 | 1.00 | 1.50 | 0.20 | yes |" in text
    assert "| jax_mppi | 0.600 | 0.600 | 2.00 |  | 0.20 | yes |" in text
    assert "| TorchRL MPPIPlanner | failed |  |  |  |  |  |" in text
    assert "- TorchRL MPPIPlanner (float32): no wheel" in text
    assert text.index("jax_mppi") < text.index("TorchRL")
    assert "commit abc (changed)" in text
    assert "| 0.600 | 0.600 |  |" in table.markdown(report(jax_mppi=0.6))  # no ratio without ours


@pytest.mark.parametrize("part", list(document.PAGES))
def test_the_documents_numbers_are_replaced(part):
    page = document.PAGES[part].read_text()
    once = document.between(page, part, "| first |")
    assert "\n\n| first |\n\n" in once
    assert document.between(once, part, "| new |") == once.replace("| first |", "| new |")
    assert once.count(document.END) == page.count(document.END)


def test_a_document_without_the_part_is_left_alone():
    with pytest.raises(SystemExit, match="measured: other"):
        document.between("text", "other", "| 1 |")


def test_a_part_without_an_end_is_not_written():
    with pytest.raises(SystemExit, match="does not end"):
        document.between("<!-- measured: a -->\n<!-- measured: b -->\n<!-- end -->", "a", "| 1 |")


def test_ratios_against_a_commit_come_with_their_interval():
    here = [[0.9 * base] * 5 for base in (1.0, 2.0, 1.5)]
    there = [[base] * 5 for base in (1.0, 2.0, 1.5)]
    np.testing.assert_allclose(compare.ratio_interval(here, there), 0.9)
    there[0] = [0.9] * 5
    middle, low, high = compare.ratio_interval(here, there)
    np.testing.assert_allclose((middle, low, high), (0.9, 0.9, 1.0))
    assert "commit: gone" in compare.line(
        "ce", "float32", {"rounds": here}, {"rounds": [], "error": "gone"}
    )


def test_contestants_are_chosen_by_name_kind_or_environment():
    assert [contestant.name for contestant in contestants.choose(["ilqg", "torch"])] == [
        "ilqg",
        *(
            contestant.name
            for contestant in contestants.CONTESTANTS
            if contestant.environment == "torch"
        ),
    ]
    assert contestants.choose([]) == list(contestants.CONTESTANTS)
    with pytest.raises(SystemExit, match="nonsense"):
        contestants.choose(["nonsense"])


def test_every_contestant_has_an_adapter_an_environment_and_a_floor():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    names = {contestant.name for contestant in contestants.CONTESTANTS}
    for contestant in contestants.CONTESTANTS:
        assert (FOLDER / "subjects" / f"{contestant.module}.py").is_file()
        assert contestant.floor is None or contestant.floor in names
        if contestant.environment:
            assert environments.requirements(contestant.environment)
            assert (FOLDER / "constraints" / f"{contestant.environment}.txt").is_file()
    used = {
        f"bench-{(contestant.environment or '').replace('_', '-')}"
        for contestant in contestants.CONTESTANTS
        if contestant.environment
    }
    assert used == {name for name in extras if name.startswith("bench-")}


def test_what_cannot_be_installed_is_said_in_one_line(monkeypatch):
    monkeypatch.setattr(environments, "PYTHONS", {"faran": ("2.0",)})
    monkeypatch.setattr(environments, "VENVS", ROOT / ".venv-bench-none")
    faran = contestants.choose(["faran_jax"])
    pythons, reasons = control_step.interpreters(faran)
    assert pythons == {None: Path(sys.executable)}
    assert reasons == {"faran": "needs Python 2.0, which was not found"}
    report = {"workload": {}, "rounds": 1, "calls": 1}
    assert control_step.measure_precision(faran, pythons, reasons, report, "float32") == {
        "faran_jax": {"error": reasons["faran"]}
    }


def test_peers_run_with_one_thread_and_this_process_is_left_alone():
    before = dict(os.environ)
    threads = control_step.threads_of_peers()
    assert (
        threads["OMP_NUM_THREADS"] == "1"
        or before.get("OMP_NUM_THREADS") == threads["OMP_NUM_THREADS"]
    )
    assert "xla_cpu_multi_thread_eigen" in threads["XLA_FLAGS"]
    assert dict(os.environ) == before


def test_what_goes_beyond_the_paper_stands_beside_what_it_replaces():
    names = [row.name for row in beyond.ROWS]
    assert len(set(names)) == len(names)
    assert {row.beside for row in beyond.ROWS} <= set(names)
    origin = {
        "started": "now",
        "commit": "",
        "dirty": True,
        "processor": "p",
        "platform": "q",
        "load": [1.0],
        "rounds": 3,
    }
    text = beyond.markdown(
        {**origin, "milliseconds": {name: 0.5 + (name == "UKF, beacons") for name in names}}
    )
    assert "| EKF, beacons | update | 0.500 |  |" in text
    assert "| UKF, beacons | update | 1.500 | 3.00 EKF, beacons |" in text
    assert (
        "now, commit unknown (changed); p, q; load average before 1.00; 3 rounds of 60 calls"
        in text
    )


def test_a_row_calls_what_it_names_at_every_step_of_a_trial(monkeypatch):
    monkeypatch.setattr(beyond, "STEPS", 3)
    small = ("system=scalar_linear", "controller=lqg", "theta=0")
    with restored():
        for what in ("step", "update"):
            call = beyond.subject(beyond.Row("small", what, small, "small"))
            for k in range(3):
                call(k)
            with pytest.raises(IndexError):
                call(3)
