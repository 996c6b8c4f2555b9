"""What an undisturbed run gives is found out once."""

import pytest

from faults_helpers import Run, Undisturbed
from study_helpers import limited


@pytest.fixture(autouse=True)
def in_time(request) -> object:
    """A test that hangs fails."""
    with limited(900 if request.node.get_closest_marker("long") else 200):
        yield


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory) -> Undisturbed:
    """The study in one run of two workers."""
    run = Run(tmp_path_factory.mktemp("undisturbed"))
    ended = run.again()
    assert ended.code == 0, ended.err
    return Undisturbed(run.root, run.hashes(), ended.out)


@pytest.fixture(scope="session")
def seconds(undisturbed, tmp_path_factory) -> float:
    """Measures how long the study takes when all programs are compiled."""
    return Run(tmp_path_factory.mktemp("measured")).again().seconds
