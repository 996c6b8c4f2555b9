"""The clock is set back while a study runs: what is measured goes by another, which only ever goes on.

The machine's own clock is not touched: every process of the command is told, each time it asks Python for the time
of day, one that is an hour before the last. Nothing else here asks the system for it.
"""

import os
import re

import pandas as pd
import pytest

from faults_helpers import Run
from mppi_belief.study import results

BACKWARDS = """
import datetime, time

told = [time.time()]

def earlier():
    told[0] -= 3600
    return told[0]

class Backwards(datetime.datetime):
    @classmethod
    def now(cls, tz=None):
        return cls.fromtimestamp(earlier(), tz)

time.time, time.time_ns = earlier, lambda: int(earlier() * 1e9)
datetime.datetime = Backwards
"""


@pytest.mark.long
def test_a_clock_that_jumps_back_changes_nothing(tmp_path, undisturbed):
    (tmp_path / "sitecustomize.py").write_text(BACKWARDS)
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    run = Run(tmp_path)
    said = run.again("trial_timeout=60", env=os.environ | {"PYTHONPATH": path})
    assert (said.code, said.err) == (0, ""), said.err
    assert run.hashes() == undisturbed.hashes
    for file in run.parts():
        (source,) = results.read_table(file)[0]["sources"]
        assert source["elapsed"] >= 0
        assert re.match(r"(19|20)\d\d-", source["started"])
        assert pd.Timestamp(source["started"]) < pd.Timestamp.now("UTC") - pd.Timedelta(minutes=50)
