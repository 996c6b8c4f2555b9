"""The certificate of a covariance for every path: that it holds, and that it fails where the package would be wrong."""

from collections.abc import Iterator
from dataclasses import replace

import jax
import numpy as np
import pytest

from certificate_helpers import assert_holds
from helpers import float64
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify.certificates import joint_covariance as joint

pytestmark = pytest.mark.long

KEY = jax.random.key(3)


@pytest.fixture(scope="module")
def certificate() -> Iterator[Certificate]:
    with float64():
        yield joint.certify()


def test_the_certificate_holds(certificate):
    assert_holds(certificate)


@pytest.fixture(scope="module")
def setting() -> Iterator[tuple[joint.Problem, list]]:
    with float64():
        problem = joint.problem_of(4)
        yield problem, joint.recursion(problem)


def verdicts(problem: joint.Problem, values: list) -> list[bool]:
    return [check.holds for check in joint._at(problem, values, joint.STARTS[1], KEY)]


def test_a_wrong_filter_or_temperature_shows(setting, monkeypatch):
    problem, values = setting
    with float64():
        assert verdicts(problem, values) == [True, True, True]
        monkeypatch.setattr(joint, "sensor", lambda system, mean: np.full_like(mean, 4.0))
        assert not verdicts(problem, joint.recursion(problem))[0]
        monkeypatch.undo()
        monkeypatch.setattr(joint, "TEMPERATURE", 1.1 * joint.TEMPERATURE)
        assert not verdicts(problem, values)[1]


def test_a_value_of_another_equation_leaves_a_residual(setting, monkeypatch):
    problem, values = setting
    with float64():
        right = joint.residual(problem, values)
        monkeypatch.setattr(joint, "LIT", replace(joint.LIT, process_noise=0.9))
        wrong = joint.residual(problem, values)
    assert joint.rms(wrong) > 2 * joint.rms(right)
