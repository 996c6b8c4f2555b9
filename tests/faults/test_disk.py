"""A disk that is full, limited or read-only: exit code 74, one line, no half file, and the same
command goes on.
"""

import os
import resource
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ctypes import CDLL
from pathlib import Path

import pytest

from cli_helpers import started
from faults_helpers import N_TRIALS, Ended, Run, gone_after, when

PR_CAPBSET_DROP = 24  # linux/prctl.h
CAP_DAC_OVERRIDE = 1  # linux/capability.h


def refused(ended: Ended, run: Run, where: str = "results") -> None:
    """It says in one line that it cannot write, and leaves no half file."""
    assert ended.code == 74, ended.err
    assert "Traceback" not in ended.err
    assert ended.err.splitlines()[-1].startswith("mppi-belief: cannot write results: ")
    assert run.left_over() == []


def completes(run: Run, hashes: dict[str, str]) -> None:
    ended = run.again()
    assert ended.code == 0, ended.err
    assert run.hashes() == hashes


def small_files() -> None:
    """In a child: no file may grow beyond this, as on a disk that is full (EFBIG instead of
    ENOSPC).
    """
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))


def obey_permissions() -> None:
    """In a child: permission bits hold for root, too."""
    if os.geteuid() == 0 and CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0) != 0:
        raise OSError("root without CAP_SETPCAP")


@contextmanager
def mounted(folder: Path, size: str) -> Iterator[Callable[[str], None] | None]:
    """A small disk of its own at `folder`, and how to mount it anew; None where that is not
    allowed.
    """
    folder.mkdir(parents=True)

    def mount(options: str) -> bool:
        words = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
        return subprocess.run(words, capture_output=True, check=False).returncode == 0

    if not mount(f"size={size}"):
        yield None
        return
    try:
        yield (
            lambda options: (
                subprocess.run(["mount", "-o", f"remount,{options}", str(folder)], check=True)
                and None
            )
        )
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.mark.long
def test_a_file_that_cannot_grow(tmp_path, undisturbed):
    run = Run(tmp_path)
    refused(run.again(preexec_fn=small_files), run)
    assert len(run.done()) < 4 * N_TRIALS
    completes(run, undisturbed.hashes)


@pytest.mark.long
def test_a_small_disk_that_is_full_and_then_larger(tmp_path, undisturbed):
    """Uses files that cannot grow where no disk may be mounted."""
    run = Run(tmp_path)
    with mounted(run.root, "300k") as mount_anew:
        refused(run.again() if mount_anew else run.again(preexec_fn=small_files), run)
        trials_before = run.done()
        assert len(trials_before) < 4 * N_TRIALS
        if mount_anew:
            mount_anew("size=100m")
        completes(run, undisturbed.hashes)


@pytest.mark.long
def test_a_disk_that_becomes_read_only_while_it_computes(tmp_path, undisturbed):
    """Uses a folder without write permission where no disk may be mounted."""
    run = Run(tmp_path)
    with mounted(run.root, "100m") as mount_anew:
        gate = run.gate(40)
        with run.begun(gate=gate, preexec_fn=obey_permissions) as process:
            when(run.parts, process)
            if mount_anew:
                mount_anew("ro")
            else:
                forbid(run, 0o555)
            gate.open()
            code = process.wait(120)
            assert gone_after(process.pid) == []
        refused(Ended(code, "", run.err, 0.0), run)
        assert run.done()
        mount_anew("rw") if mount_anew else forbid(run, 0o755)
        completes(run, undisturbed.hashes)


def forbid(run: Run, mode: int) -> None:
    for folder in (run.root, *run.root.iterdir()):
        folder.chmod(mode)


def test_a_folder_without_permission_is_told_before_any_trial(tmp_path):
    run = Run(tmp_path)
    run.root.mkdir(parents=True)
    run.root.chmod(0o555)
    ended = run.again(preexec_fn=obey_permissions)
    run.root.chmod(0o755)
    refused(ended, run)
    assert "Permission denied" in ended.err
    assert "trial" not in ended.err
    assert list(run.root.iterdir()) == []


@pytest.mark.parametrize(
    "words", ["--help", "--version", pytest.param("run", marks=pytest.mark.long)]
)
def test_an_output_that_cannot_be_written_is_not_taken_for_success(words, tmp_path, request):
    """The exit code must say that nobody has seen the table; the results are there."""
    run = Run(tmp_path)
    study = ["run", *run.study] if words == "run" else [words]
    with Path("/dev/full").open("w") as full, started(tmp_path, *study, stdout=full) as process:
        assert process.wait(300) == 74
    assert run.err.splitlines() == ["mppi-belief: cannot write results: No space left on device"]
    if words == "run":
        assert run.hashes() == request.getfixturevalue("undisturbed").hashes
