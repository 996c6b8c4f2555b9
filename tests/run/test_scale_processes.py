"""Commands watched from outside: their end, their folder, their workers, their memory."""

import subprocess
import sys
from pathlib import Path

import pytest

import study_helpers
from scaling import processes
from scaling.processes import CommandError


@pytest.fixture
def interpreter(monkeypatch):
    """Python in place of the command."""
    monkeypatch.setattr(processes, "COMMAND", sys.executable)


def test_a_command_is_watched_to_its_end(interpreter, tmp_path):
    """It ends when it has been looked at twice."""
    pids = []

    def look(pid):
        pids.append(pid)
        if len(pids) == 2:
            (tmp_path / "seen").touch()

    waits = (
        "import pathlib, time\n"
        "while not pathlib.Path('seen').exists():\n    time.sleep(0.01)\n"
        "time.sleep(0.2)\n"
    )
    ended = processes.watched(["-c", waits], tmp_path, look, every=0.01)
    assert len(pids) > 1
    assert len(set(pids)) == 1
    assert ended.seconds >= 0.2
    assert processes.resident_mb(pids[0]) is None


def test_a_command_gets_its_folder_and_its_environment(interpreter, tmp_path):
    code = "import os; open('said.txt', 'w').write(os.environ['XDG_CACHE_HOME'])"
    processes.run(["-c", code], tmp_path / "new", {"XDG_CACHE_HOME": "there"})
    assert (tmp_path / "new" / "said.txt").read_text() == "there"


def test_a_command_that_fails_is_one_line_and_one_that_hangs_is_ended(
    interpreter, monkeypatch, tmp_path
):
    with pytest.raises(CommandError, match=r"code 3: no luck$"):
        processes.run(
            ["-c", "import sys; print('no\\nno luck', file=sys.stderr); sys.exit(3)"], tmp_path
        )
    monkeypatch.setattr(processes, "TIMEOUT", 0.3)
    pids = []
    with pytest.raises(CommandError, match=r"not done in 0\.3 s"):
        processes.watched(["-c", "import time; time.sleep(3600)"], tmp_path, pids.append)
    assert not study_helpers.is_alive(pids[0])


def test_the_workers_of_a_command_are_found(interpreter, tmp_path):
    (tmp_path / "pool.py").write_text(
        "import multiprocessing, pathlib, time\n"
        "def work():\n    pathlib.Path('works').touch()\n    time.sleep(60)\n"
        "if __name__ == '__main__':\n"
        "    worker = multiprocessing.get_context('spawn').Process(target=work, daemon=True)\n"
        "    worker.start()\n    pathlib.Path('told').write_text(str(worker.pid))\n"
        "    while not pathlib.Path('seen').exists():\n        time.sleep(0.01)\n"
    )
    pids = []

    def look(pid):
        if (tmp_path / "works").exists():
            pids.append(processes.workers_of(pid))
            (tmp_path / "seen").touch()

    processes.watched(["pool.py"], tmp_path, look)
    assert pids[0] == [int((tmp_path / "told").read_text())]  # not the tracker of resources


GROWING = """
import os, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from scaling import processes
held = processes.resident_mb(os.getpid())
block = np.ones(50_000_000 // 8)
now = processes.resident_mb(os.getpid())
print(now - held, processes.peak_mb(os.getpid()) - now, block[0])
"""


def test_memory_is_that_of_the_process():
    """Measures a new process: in a used one an array may lie where something else was."""
    benchmarks = str(Path(processes.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", GROWING, benchmarks], capture_output=True, text=True, check=True
    )
    grown, above, _ = map(float, done.stdout.split())
    assert grown == pytest.approx(50, abs=10)
    assert above >= -1
