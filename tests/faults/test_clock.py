"""The clock is set back while a study runs: what is measured goes by another, which only ever goes
on.

The machine's own clock is not touched: in every process of the command Python's `time.time` gives,
each time it is asked, a moment an hour before the last.
"""

import os

import pytest

from faults_helpers import Run
from mppi_belief.results import table as results

BACKWARDS = """
import time

told = [time.time()]

def earlier():
    told[0] -= 3600
    return told[0]

time.time, time.time_ns = earlier, lambda: int(earlier() * 1e9)
"""


@pytest.mark.long
def test_a_clock_that_jumps_back_changes_nothing(tmp_path, undisturbed):
    (tmp_path / "sitecustomize.py").write_text(BACKWARDS)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    run = Run(tmp_path)
    ended = run.again("trial_timeout=60", env=os.environ | {"PYTHONPATH": path})
    assert (ended.code, ended.err) == (0, ""), ended.err
    assert run.hashes() == undisturbed.hashes
    for file in run.parts():
        (source,) = results.read_table(file)[0]["sources"]
        assert 0 <= source["elapsed"] < 1000
