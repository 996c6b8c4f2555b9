"""What `make bench-scale` makes of what it sees; nothing is timed."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import document
import rounds
import scale
import study_helpers
from cli_helpers import restored
from mppi_belief.results import table as results
from remote import SubjectError
from scaling import long_run, samples, start_up, sweep, table_1
from scaling.processes import CommandError, Ended
from scaling.sizes import QUICK, Sizes

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "benchmarks"
SOURCE = {
    **{
        "started": "today",
        "commit": "0123456789abcdef",
        "dirty": True,
        "processor": "a",
        "platform": "b",
    },
    **{"versions": {"jax": "1"}, "load": (0.5, 0.25, 0.125)},
}


def stored(numbers):
    """The numbers as they come back from the JSON file."""
    return json.loads(json.dumps(numbers))


def write_part(folder, trials, modified=None):
    """A part file of the runner's own."""
    results.write_rows(folder, [study_helpers.row(trial) for trial in trials], {"config": {}})
    if modified is not None:
        (newest,) = folder.glob(f"part-{trials[0]:06d}-*.parquet")
        os.utime(newest, (modified, modified))


class Planner:
    """A subject whose control steps take 2 ns for each sample and step ahead, and 1 ms more in its
    first round.
    """

    def __init__(self, name, fails=()):
        self.name = name
        self.fails = fails
        self.asked = []
        self.ended = False
        self.process = self
        self.pid = os.getpid()

    def poll(self):
        return None

    def ask(self, do, **values):
        self.asked.append(do)
        if self.name in self.fails:
            raise SubjectError("out of memory")
        if do == "time":
            first = (
                self.asked.count("time") == 3
            )  # after one for the program and one for what else is compiled
            return {
                "seconds": [2e-9 * 30 * int(self.name.partition("-")[2]) + 1e-3 * first]
                * values["calls"]
            }
        return {}

    def end(self):
        self.ended = True


def test_table_1_runs_cold_then_warm_in_turns_each_into_a_folder_of_its_own(monkeypatch, tmp_path):
    ran = []

    def watched(args, folder, look, env):
        words = dict(arg.partition("=")[::2] for arg in args[1:])
        assert (args[0], words["experiment"], words["n_trials"]) == ("run", "table_1", "4")
        ran.append((folder.name, int(words["workers"]), Path(env["XDG_CACHE_HOME"]).name))
        look(0)
        (folder / "results").mkdir(parents=True)
        look(0)
        took = 60.0 / ran[-1][1]
        write_part(folder / "results" / "ce", [0, 1], look.seen_at + 5)
        write_part(folder / "results" / "belief", [0, 1], look.seen_at + took)
        return Ended(0.0, took + 20 * (ran[-1][2] == "cache-2" or "cold" in ran[-1][0]) + 10)

    monkeypatch.setattr(table_1, "watched", watched)
    monkeypatch.setattr(table_1, "machine_efficiency", lambda folder: 0.97)
    numbers = stored(table_1.measure(QUICK._replace(table_rounds=2), tmp_path))
    assert ran == [
        ("cold-1", 1, "cache-1"),
        ("cold-2", 2, "cache-2"),
        *((f"warm-{n}-{k}", n, "cache-1") for k in (0, 1) for n in (1, 2)),
    ]
    shares = {label: row["efficiency"] for label, row in numbers["rows"].items()}
    np.testing.assert_allclose(list(shares.values()), [90 / 120, 70 / 80, 1.0], rtol=1e-3)
    text = table_1.markdown(numbers)
    assert "16 trials, seconds, the median of 2 warm runs" in text
    assert "efficiency of 0.97 here" in text
    assert "| whole command | 70.0 | 40.0 | 0.88 |" in text
    assert "| its trials | 60.0 | 30.0 | 1.00 |" in text
    assert "efficiency of" not in table_1.markdown(numbers | {"machine_efficiency": None})


def test_the_machines_own_efficiency_is_that_of_steps_alone_and_at_once(monkeypatch, tmp_path):
    class Pair(Planner):
        def ask(self, do, **values):
            busy.append(self.name)
            return (
                {"seconds": [2.0, 4.0] if len(busy) % 3 == 0 else [1.0, 2.0]}
                if do == "time"
                else {}
            )

    busy = []
    cpus = []
    monkeypatch.setattr(table_1.os, "sched_getaffinity", lambda pid: {0, 1, 2})
    monkeypatch.setattr(table_1, "workload", lambda: {"steps": 60})
    monkeypatch.setattr(table_1, "TURNS", 3)
    monkeypatch.setattr(
        rounds, "start", lambda python, module, name, cpu, log: cpus.append(cpu) or Pair(name)
    )
    busy.extend(
        ["", ""]
    )  # two questions to each before the turns: of a turn's three the last is the slow one
    assert table_1.machine_efficiency(tmp_path) == 0.5
    assert cpus == [1, 2]
    monkeypatch.setattr(table_1.os, "sched_getaffinity", lambda pid: {0})
    assert table_1.machine_efficiency(tmp_path) is None


def test_cost_of_a_sample_step_and_one_that_fails(monkeypatch, tmp_path):
    started = {}
    monkeypatch.setattr(samples, "workload", lambda: {"steps": 60, "horizon": 30})

    def start(python, module, name, cpu, log):
        assert (module, log.parent) == ("scaled", tmp_path)
        return started.setdefault(name, Planner(name, fails=("belief-2000",)))

    monkeypatch.setattr(rounds, "start", start)
    numbers = stored(samples.measure(QUICK._replace(sample_rounds=3), tmp_path))
    assert list(started) == ["ce-500", "ce-2000", "belief-500", "belief-2000"]
    assert all(subject.ended for subject in started.values())
    assert started["ce-500"].asked.count("time") == 1 + 1 + 3
    rows = numbers["ce"]["rows"]
    np.testing.assert_allclose([row["ns"] for row in rows], 2)
    np.testing.assert_allclose([row["median_ms"] for row in rows], [0.03, 0.12])
    np.testing.assert_allclose([row["fastest_round_ms"] for row in rows], [0.03, 0.12])
    assert numbers["ce"]["spread"] == pytest.approx(1)
    assert rows[0]["peak_mb"] > 10
    assert numbers["belief"]["rows"][1] == {"n": 2000, "error": "out of memory"}
    text = samples.markdown(numbers)
    assert "to the cheapest: 1.00 (CE-MPPI), 1.00 (MPPI-Belief)" in text
    assert "on the samples, in ms: 0.00 (CE-MPPI), 0.00 (MPPI-Belief)" in text
    assert f"| 2 000 | 0.120 | 2.0 | {rows[1]['peak_mb']:.0f} | out of memory |" in text
    assert samples.spread([2.0, 1.0, 1.5]) == 2
    assert samples.fixed_ms([{"n": 10, "median_ms": 7.0}, {"n": 100, "median_ms": 20.0}]) == 5
    no_numbers = {"rows": [], "spread": samples.spread([]), "fixed_ms": samples.fixed_ms([])}
    assert "unknown (CE-MPPI)" in samples.markdown(
        {"horizon": 30, "ce": no_numbers, "belief": no_numbers}
    )


def test_a_process_that_had_to_compile_is_started_again(monkeypatch, tmp_path):
    started = []
    program_counts = iter(range(100))
    monkeypatch.setattr(samples, "workload", lambda: {"steps": 60, "horizon": 30})
    monkeypatch.setattr(
        rounds, "start", lambda *args: started.append(Planner(args[2])) or started[-1]
    )
    monkeypatch.setattr(samples, "programs", lambda cache: next(program_counts))
    samples.measure(QUICK, tmp_path)
    assert [subject.name for subject in started[4:]] == [subject.name for subject in started[:4]]
    assert all(subject.ended for subject in started)
    assert all(subject.asked == ["prepare", "time"] for subject in started[:4])


def test_the_subject_has_its_number_of_samples():
    with restored():
        from subjects import scaled

        controller = scaled.make("belief-123", {}, "float64")
    assert controller.config["controller"]["n_samples"] == 123
    assert (controller.config["names"]["controller"], controller.config["precision"]) == (
        "belief",
        "float64",
    )


def test_growth_counts_from_the_first_trials_to_the_last(tmp_path):
    def look(seconds, trials, parent, worker):
        mb = {"parent": parent} | ({} if worker is None else {"worker 1": worker})
        return long_run.Look(seconds, trials, trials // 50, mb)

    looks = [
        look(0, 0, 90, None),
        look(1, 50, 100, 300),
        look(2, 100, 110, 310),
        look(3, 200, 115, 350),
    ]
    looks += [
        look(3.5, 200, 115, 350),
        look(6, 250, 114, 340),
        look(7, 300, 113, 320),
        look(9, 300, 190, None),
    ]
    numbers = stored(long_run.judged(looks, QUICK))
    assert numbers["memory"] == {
        "parent": {"first_mb": 110, "last_mb": 114, "growth_mb": 5},
        "worker 1": {"first_mb": 310, "last_mb": 340, "growth_mb": 40},
    }
    assert (numbers["parts"], numbers["parent_peak_mb"]) == (6, 190)
    assert (numbers["first_part_s"], numbers["last_part_s"], numbers["longest_wait_s"]) == (1, 7, 3)
    text = long_run.markdown({"trials": 300, "settled": 100, "seconds": 9.0, **numbers})
    assert "6 part files from second 1.0 to 7.0, at most 3.0 s apart" in text
    assert "| worker 1 | 310 | 340 | 40.0 |" in text
    assert long_run.judged(looks[:2], QUICK)["memory"] == {}


def test_a_part_files_name_tells_its_trials(tmp_path):
    for trials in ([3], [10, 11, 12], [*range(999_990, 1_000_015)]):
        write_part(tmp_path, trials)
    names = sorted(path.name for path in tmp_path.glob("part-*"))
    assert sorted(map(long_run.trials_in, names)) == [1, 3, 25]


def test_a_sweeps_phases_by_the_times_of_its_files_and_its_programs(monkeypatch, tmp_path):
    def run(args, folder, env):
        words = dict(arg.partition("=")[::2] for arg in args[2:])
        cells = [
            f"{theta}-{w_obs}"
            for theta in words["theta"].split(",")
            for w_obs in words["w_obs"].split(",")
        ]
        assert len(set(cells)) == len(cells)
        for k, cell in enumerate(cells):
            write_part(folder / "results" / cell, [0, 1], 1000 + 4 + k)
            timing = folder / "results" / cell / "timing.json"
            timing.touch()
            os.utime(timing, (1000 + 3 + len(cells) + 2 * (k + 1),) * 2)
        Path(env["XDG_CACHE_HOME"]).mkdir(exist_ok=True)
        for k in range(3 if len(cells) == 2 else programs):
            (Path(env["XDG_CACHE_HOME"]) / f"jit_{k}-cache").touch()
            (Path(env["XDG_CACHE_HOME"]) / f"jit_{k}-atime").touch()
        return Ended(1000.0, 3 + 3 * len(cells) + 0.5 * len(cells))

    monkeypatch.setattr(sweep, "run", run)
    for programs, sentence in (
        (3, "for 2 cells, 3, are all that the others need"),
        (5, "not all: 6 cells needed 5"),
    ):
        numbers = stored(sweep.measure(QUICK, tmp_path / str(programs)))
        np.testing.assert_allclose(
            list(numbers["ms_per_cell"].values()), [0, 1000, 2000, 500, 3500]
        )
        text = sweep.markdown(numbers)
        assert sentence in text
        assert "| the Time column | 2000 |" in text


def test_start_up_takes_turns_and_medians(monkeypatch, tmp_path):
    ran = []

    def run(args, folder, env):
        ran.append(" ".join(args))
        return Ended(0.0, float(len(ran)))

    monkeypatch.setattr(start_up, "run", run)
    numbers = stored(start_up.measure(Sizes(starts=3), tmp_path))
    assert len(ran) == 1 + 4 * 3
    assert ran[1:5] != ran[5:9]
    assert len({line for line in ran if "fresh" in line}) == 3
    assert numbers["median"] == {
        "--help": 6,
        "run --help": 7,
        "run, 2 trials": 8,
        "run, all done": 9,
    }
    assert "| run, 2 trials | 8.00 |" in start_up.markdown(numbers)


class Part:
    """A part of the benchmark that fails or tells its size."""

    def __init__(self, fails=False):
        self.fails = fails

    def measure(self, sizes, folder):
        assert folder.is_dir()
        if self.fails:
            raise CommandError("run: code 2: no such key")
        return {"starts": sizes.starts}

    def markdown(self, numbers):
        return f"{numbers['starts']} starts"


@pytest.fixture
def parts(monkeypatch, tmp_path):
    monkeypatch.setattr(scale, "PARTS", {"one": Part(), "two": Part(fails=True)})
    monkeypatch.setattr(scale, "OUTPUT", tmp_path / "bench")
    monkeypatch.setattr(scale, "provenance", lambda command: SOURCE)
    return tmp_path / "bench"


def test_a_part_that_fails_is_told_and_the_others_are_kept(parts, capsys):
    for words, code in ((["two"], 1), (["one"], 1), ([], 1)):
        with pytest.raises(SystemExit) as ended:
            scale.main(words)
        assert ended.value.code == code
        assert "Not measured: two (run: code 2: no such key)" in capsys.readouterr().out
    report = json.loads((parts / "scale.json").read_text())
    assert report["one"]["numbers"] == {"starts": 5}
    text = (parts / "scale.md").read_text()
    assert "5 starts" in text
    assert "- `one`: today, commit 0123456789ab (changed), a, b, jax 1, load average before" in text
    assert [path.name for path in parts.iterdir() if path.is_dir()] == []


def test_a_quick_look_writes_nothing_and_an_unknown_part_is_told(parts, capsys):
    with pytest.raises(SystemExit) as ended:
        scale.main(["one", "--quick"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("1 starts")
    assert not (parts / "scale.json").exists()
    with pytest.raises(SystemExit):
        scale.main(["three"])
    assert "three: not one of one, two" in capsys.readouterr().err


def test_the_document_has_a_place_for_the_numbers():
    text = document.PAGES["scale"].read_text()
    assert "\n\n| 1 |\n\n" in document.between(text, "scale", "| 1 |")
