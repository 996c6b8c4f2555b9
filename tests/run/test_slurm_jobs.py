"""Jobs of Slurm, with commands in its place that say what they are told to."""

import os
from pathlib import Path

import pytest

from cli_helpers import python
from mppi_belief.config.executors import SlurmExecutor
from mppi_belief.errors import ConfigError
from mppi_belief.run import slurm
from mppi_belief.run.slurm import SlurmJobs
from mppi_belief.run.slurm_script import job_script
from mppi_belief.run.workers import WorkersGone

QUEUE = """#!/bin/sh
echo "$0 $*" >> calls
case $0 in
  *sbatch) if [ -e refuse ]; then cat refuse >&2; exit 1; fi
           echo >> count; n=$(wc -l < count); echo "$n R" >> queue; echo "$n;cluster" ;;
  *squeue) [ ! -e down ] || exit 1; cat queue ;;
esac
"""


@pytest.fixture
def queue(tmp_path, monkeypatch) -> Path:
    """A folder with a queue that takes all jobs; time passes quickly."""
    for name in ("sbatch", "squeue", "scancel"):
        (tmp_path / name).write_text(QUEUE)
        (tmp_path / name).chmod(0o755)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(slurm, "SHORTEST_INTERVAL", 0.0)
    monkeypatch.setattr(slurm, "LONGEST_INTERVAL", 0.0)
    (tmp_path / "queue").touch()
    return tmp_path


def calls(queue: Path, name: str) -> int:
    lines = (queue / "calls").read_text().splitlines() if (queue / "calls").exists() else []
    return sum(line.split()[0].endswith(name) for line in lines)


def test_as_many_jobs_as_asked_for_and_then_silence(queue):
    jobs = SlurmJobs("#!/bin/sh", "mine", 3, 2)
    jobs.replace_missing([])
    assert calls(queue, "sbatch") == 3
    here = [f"{job}-{position}" for job in (1, 2, 3) for position in (0, 1)]
    jobs.replace_missing(here)
    before = calls(queue, "squeue")
    jobs.replace_missing(here)
    assert (calls(queue, "sbatch"), calls(queue, "squeue")) == (3, before)
    jobs.replace_missing(here[:3])
    assert (calls(queue, "sbatch"), calls(queue, "squeue")) == (3, before + 1)
    jobs.cancel_all()
    assert "scancel --name=mine" in (queue / "calls").read_text()


def test_a_job_that_ends_is_replaced_and_one_that_is_completing_has_ended(queue):
    jobs = SlurmJobs("", "mine", 2)
    jobs.replace_missing([])
    jobs.replace_missing([1, 2])
    (queue / "queue").write_text("1 CG\n2 R\n")
    jobs.replace_missing([2])
    jobs.replace_missing([2])
    assert calls(queue, "sbatch") == 3


def test_a_queue_that_does_not_answer_says_nothing_about_jobs(queue):
    jobs = SlurmJobs("", "mine", 2)
    jobs.replace_missing([])
    (queue / "down").touch()
    jobs.replace_missing([])
    assert calls(queue, "sbatch") == 2


def test_it_is_asked_ever_more_seldom(queue, monkeypatch):
    monkeypatch.setattr(slurm, "SHORTEST_INTERVAL", 1.0)
    monkeypatch.setattr(slurm, "LONGEST_INTERVAL", 30.0)
    now = [100.0]
    monkeypatch.setattr(slurm.time, "monotonic", lambda: now[0])
    jobs = SlurmJobs("", "mine", 1)
    while now[0] < 400:
        jobs.replace_missing([])
        now[0] += 0.5
    assert 10 <= calls(queue, "squeue") <= 15


def test_jobs_that_end_before_a_worker_comes_end_the_run(queue):
    jobs = SlurmJobs("", "mine", 1)
    for _ in range(3):
        jobs.replace_missing([])
        (queue / "queue").write_text("")
    with pytest.raises(WorkersGone, match="3 jobs ended before a worker connected"):
        jobs.replace_missing([])
    assert calls(queue, "sbatch") == 3


def test_jobs_that_had_a_worker_may_end_as_often_as_they_like(queue):
    jobs = SlurmJobs("", "mine", 3)
    for number in range(1, 10, 3):
        jobs.replace_missing([])
        jobs.replace_missing([number, number + 1, number + 2])
        (queue / "queue").write_text("")
        jobs.replace_missing([])  # all at once, as when their walltime is over
    assert calls(queue, "sbatch") == 12


@pytest.mark.parametrize(
    ("message", "raised", "line"),
    [
        (
            "sbatch: error: Batch job submission failed: Invalid partition",
            ConfigError,
            "job: Batch job .* partition$",
        ),
        (
            "sbatch: unrecognized option\nTry help",
            ConfigError,
            "refuses the job: sbatch: unrecognized option$",
        ),
        ("", ConfigError, "does not say why"),
        (
            "sbatch: error: Unable to contact slurm controller",
            WorkersGone,
            "Slurm does not answer: Unable",
        ),
    ],
)
def test_a_refusal_is_one_line(message, raised, line, queue):
    (queue / "refuse").write_text(message)
    with pytest.raises(raised, match=line):
        SlurmJobs("", "mine", 2).replace_missing([])


def test_a_refusal_of_some_jobs_leaves_the_others_at_work(queue):
    jobs = SlurmJobs("", "mine", 3)
    (queue / "sbatch").write_text(
        QUEUE.replace('echo "$n;', '[ "$n" -lt 2 ] || touch refuse; echo "$n;')
    )
    jobs.replace_missing([])
    assert calls(queue, "sbatch") == 3
    jobs.replace_missing([1, 2])
    (queue / "queue").write_text("")
    with pytest.raises(WorkersGone, match="takes no more jobs"):
        jobs.replace_missing([])


def test_no_slurm_is_said(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(ConfigError, match="there is no sbatch on this machine"):
        SlurmJobs("", "mine", 1).replace_missing([])


def test_the_script_asks_for_what_was_set():
    settings = SlurmExecutor(
        partition="long", memory="1.5GB", walltime="2-00:00:00", directives=["--nice", "--qos=low"]
    )
    lines = job_script(settings, 2, "mine", "tcp://here:1").splitlines()
    assert {"#SBATCH -p long", "#SBATCH -t 2-00:00:00", "#SBATCH --nice", "#SBATCH --qos=low"} <= {
        *lines
    }
    assert {
        "#SBATCH --cpus-per-task=2",
        "#SBATCH --mem=3G",
        "#SBATCH --output=/dev/null",
        "#SBATCH -J mine",
    } <= {*lines}
    (worker,) = [line for line in lines if "dask_worker" in line]
    assert (
        "tcp://here:1 --name $SLURM_JOB_ID --nthreads 1 --memory-limit 1.40GiB --nworkers 2 --nanny"
        in worker
    )


def test_the_answer_to_a_signal_stays_ours(tmp_path):
    """Importing dask_jobqueue sets another one."""
    code = """
import signal
from mppi_belief.config.executors import SlurmExecutor
from mppi_belief.run.slurm_script import job_script
before = signal.getsignal(signal.SIGINT)
job_script(SlurmExecutor(), 1, "mine", "tcp://here:1")
print(signal.getsignal(signal.SIGINT) is before, signal.pthread_sigmask(signal.SIG_BLOCK, []))
"""
    assert python(code, tmp_path) == "True set()"


def test_logs_are_kept_where_asked(tmp_path):
    lines = job_script(SlurmExecutor(logs=str(tmp_path)), 1, "mine", "tcp://here:1").splitlines()
    assert f"#SBATCH -o {tmp_path}/mine-%J.out" in lines
    assert not any("/dev/null" in line for line in lines)
