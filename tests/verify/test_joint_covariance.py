"""A covariance for every path: the certificate holds, and fails where it should."""

from collections.abc import Iterator
from dataclasses import replace

import jax
import numpy as np
import pytest

from certificate_helpers import assert_holds
from helpers import float64
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify.certificates import joint_covariance as joint
from mppi_belief.verify.estimates import rms
from mppi_belief.verify.scenarios import lit_line, lit_line_paths

pytestmark = pytest.mark.long

KEY = jax.random.key(3)


@pytest.fixture(scope="module")
def certificate() -> Iterator[Certificate]:
    with float64():
        yield joint.certify()


def test_the_certificate_holds(certificate):
    assert_holds(certificate)


@pytest.fixture(scope="module")
def setting() -> Iterator[tuple[lit_line.Problem, list]]:
    with float64():
        problem = lit_line.lit_problem(4)
        yield problem, lit_line.backward_recursion(problem)


def verdicts(problem: lit_line.Problem, values: list) -> list[bool]:
    return [
        check.holds for check in joint.belief_checks(problem, values, joint.JOINT_STARTS[1], KEY)
    ]


def test_a_wrong_filter_or_temperature_shows(setting, monkeypatch):
    problem, values = setting
    with float64():
        assert verdicts(problem, values) == [True, True, True]
        monkeypatch.setattr(lit_line, "sensor_noise", lambda system, mean: np.full_like(mean, 4.0))
        assert not verdicts(problem, lit_line.backward_recursion(problem))[0]
        monkeypatch.undo()
        for module in (joint, lit_line, lit_line_paths):
            monkeypatch.setattr(module, "LIT_TEMPERATURE", 1.1 * module.LIT_TEMPERATURE)
        assert not verdicts(problem, values)[1]


def test_a_value_of_another_equation_leaves_a_residual(setting, monkeypatch):
    problem, values = setting
    with float64():
        right = lit_line.joint_bellman_residual(problem, values)
        monkeypatch.setattr(lit_line, "LIT_LINE", replace(lit_line.LIT_LINE, process_noise=0.9))
        wrong = lit_line.joint_bellman_residual(problem, values)
    assert rms(wrong) > 2 * rms(right)
