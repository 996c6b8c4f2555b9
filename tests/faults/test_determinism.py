"""Rows are the same bits for any number of workers, any chunks, order, resume point, part of the
study, or executor.
"""

import pytest

from faults_helpers import N_TRIALS, SMALL, Run
from gate_helpers import GATED

SHARDS = 3


@pytest.mark.long
@pytest.mark.parametrize(
    "more",
    [
        ("workers=1",),
        ("workers=5",),
        ("workers=2", "executor=dask"),
        ("workers=2", "trial_timeout=null"),
    ],
)
def test_whoever_computes_and_however_many(more, tmp_path, undisturbed):
    """The number of workers changes the chunks, too."""
    run = Run(tmp_path)
    ended = run.again(*more)
    assert (ended.code, ended.err) == (0, ""), ended.err
    assert run.hashes() == undisturbed.hashes


@pytest.mark.long
def test_another_order_and_other_resume_points(tmp_path, undisturbed):
    """Cells the other way round, first the first 7 trials, then 22, then all."""
    reversed_study = ("--config-dir", GATED, "controller=gated_ce,gated_belief", "seed=1,0")
    run = Run(tmp_path, "-m", *reversed_study, *SMALL)
    for n_trials in (7, 22, N_TRIALS):
        assert run.again(f"n_trials={n_trials}").code == 0
        assert len(run.done()) == 4 * n_trials
    assert run.hashes() == undisturbed.hashes


@pytest.mark.long
def test_trials_that_are_lost_anywhere_are_the_same_the_second_time(tmp_path, undisturbed):
    """Every other file of a study that is done is taken away."""
    run = Run(tmp_path)
    assert run.again("workers=1").code == 0
    for path in sorted(run.parts())[::2]:
        path.unlink()
    lost = 4 * N_TRIALS - len(run.done())
    ended = run.again()
    assert lost > 0
    assert f"{lost} trials run, {4 * N_TRIALS - lost} already done" in ended.out
    assert run.hashes() == undisturbed.hashes


@pytest.mark.long
def test_the_parts_of_a_study_make_the_whole_wherever_they_were_computed(tmp_path, undisturbed):
    """Each in a folder of its own, then put together as files."""
    merged = Run(tmp_path)
    trials_of_shards: set[tuple[str, int]] = set()
    for part in range(1, SHARDS + 1):
        folder = tmp_path / str(part)
        folder.mkdir()
        run = Run(folder)
        assert run.again(f"shard={part}/{SHARDS}").code == 0
        assert run.done()
        assert not trials_of_shards & run.done()
        trials_of_shards |= run.done()
        for path in run.parts():
            there = merged.root / path.parent.name / path.name
            there.parent.mkdir(parents=True, exist_ok=True)
            there.write_bytes(path.read_bytes())
    assert merged.hashes() == undisturbed.hashes
