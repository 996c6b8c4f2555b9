"""The job array of docs/cluster.md, taken from its text, on a real Slurm."""

import os
import re
import subprocess
from pathlib import Path

import pytest

from cli_helpers import COMMAND
from mppi_belief.results import table as results
from slurm_helpers import STUDY, jobs, no_jobs, parts, rows, run
from study_helpers import limited, poll

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "cluster.md").read_text()
TRIALS = 60


@pytest.fixture
def array(tmp_path) -> Path:
    """The script of the document, of a size that this machine has."""
    (script,) = re.findall(r"<!-- array -->\n```bash\n(.*?)```", TEXT, re.S)
    for before, after in (
        ("1-20", "1-2"),
        ("SHARDS=20", "SHARDS=2"),
        ("cpus-per-task=5", "cpus-per-task=1"),
        ("10G", "1G"),
        ("04:00:00", "00:05:00"),
    ):
        assert before in script
        script = script.replace(before, after)
    (tmp_path / "array.sh").write_text(script)
    return tmp_path


def submit(folder: Path, *options: str) -> None:
    """`sbatch OPTIONS array.sh` with the study, whose command is found on the PATH."""
    env = os.environ | {"PATH": f"{Path(COMMAND).parent}{os.pathsep}{os.environ['PATH']}"}
    study = [*STUDY[1:], f"n_trials={TRIALS}", "results_dir=results"]
    command = ["sbatch", *options, "array.sh", *study]
    subprocess.run(command, cwd=folder, env=env, check=True, capture_output=True, timeout=30)


def test_parts_of_a_job_array_merge_by_lying_in_one_folder(array):
    with limited(500):
        submit(array)
        poll(lambda: parts(array), 100)
        subprocess.run(["scancel", jobs()[0]], check=True, timeout=30)  # one of them, in its middle
        no_jobs(120)
        submit(array, "--array=2")  # a part of the array; then all of it
        no_jobs(200)
        submit(array)
        no_jobs(200)
        rows_of_shards = rows(array)
        assert rows_of_shards["trial"].tolist() == [*range(TRIALS)]
        ended = run(array, n_trials=TRIALS)
        assert (ended.code, rows(array).equals(rows_of_shards)) == (0, True), ended.err
        here = array / "here"
        here.mkdir()
        run(here, n_trials=TRIALS)
        assert results.result_hash(rows(here)) == results.result_hash(rows_of_shards)
    assert [
        path.read_text() for path in array.glob("*.err") if "Traceback" in path.read_text()
    ] == []
