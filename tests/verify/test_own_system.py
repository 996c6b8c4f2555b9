"""What of the paper holds for a system of one's own: each condition, met and broken."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from cli_helpers import call
from experiment_helpers import compiled_quickly
from helpers import Feedback, Scalar, light_dark_problem
from mppi_belief.errors import ConfigError
from mppi_belief.results.certificate import Certificate
from mppi_belief.verify.own_system import what_holds

C, NOISE, F, G, COV, INCLUDED, LEAST, EQUAL, MATCHED, ONE, CLASSICAL, EXPANSION = range(12)


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


@mb.struct
class Nonlinear:
    """Implements a scalar system; x^2 is added to its functions with these weights."""

    f2: float = mb.number(default=0.0)
    G2: float = mb.number(default=0.0)
    c1: float = mb.number(default=1.0)
    c2: float = mb.number(default=0.0)
    sigma0: float = mb.number(default=0.5)
    sigma2: float = mb.number(default=0.0)

    @property
    def H(self) -> Array:
        return jnp.array([[0.5]])

    def f(self, x: Array) -> Array:
        return -0.2 * x + self.f2 * x**2

    def G(self, x: Array) -> Array:
        return jnp.reshape(1 + self.G2 * x**2, (1, 1))

    def c(self, x: Array) -> Array:
        return self.c1 * x + self.c2 * x**2

    def sigma_o(self, x: Array) -> Array:
        return jnp.reshape(self.sigma0 + self.sigma2 * x**2, (1, 1))


@mb.struct
class Risky:
    """Implements feedback with a risk-sensitive path cost."""

    gain: float = mb.number()
    path_cost: mb.RiskSensitive

    def init(self, problem: mb.Problem) -> Array:
        return Feedback(self.gain).init(problem)

    def act(self, problem: mb.Problem, belief: mb.Belief, plan: Array, key: Array) -> tuple:
        return Feedback(self.gain).act(problem, belief, plan, key)


def conditions_of(problem: mb.Problem, temperature: float = 0.6, theta: float = 0.5) -> Certificate:
    return what_holds(
        problem,
        mb.EKF(),
        Risky(0.5, mb.RiskSensitive(theta)),
        temperature,
        seed=0,
        name="mine",
        settings="system=mine",
    )


def broken(certificate: Certificate) -> set[int]:
    return {index for index, check in enumerate(certificate.checks) if not check.holds}


def nonlinear_problem(**weights: float) -> mb.Problem:
    return replace(Scalar().problem(steps=5), system=Nonlinear(**weights))


def test_everything_holds_for_the_matched_scalar_system():
    certificate = conditions_of(Scalar().problem())
    assert broken(certificate) <= {CLASSICAL}  # the process noise is not the innovation's
    assert "is exactly Gaussian" in certificate.text
    assert "(15) holds" in certificate.text
    assert "system=mine" in certificate.statement


def test_another_temperature_breaks_the_matching_alone():
    certificate = conditions_of(Scalar().problem(), temperature=1.2)
    assert broken(certificate) <= {MATCHED, CLASSICAL}
    assert certificate.checks[MATCHED].value == pytest.approx(1.0)  # |D - 2 D| / |D|
    assert "with one other R" in certificate.text


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ({}, set()),
        ({"c2": 0.3}, {C, COV}),
        ({"sigma2": 0.3}, {NOISE, COV}),
        ({"f2": 0.3}, {F, COV}),
        ({"G2": 0.3}, {G, COV}),
    ],
)
def test_each_function_that_is_bent_is_seen(weights, expected):
    certificate = conditions_of(nonlinear_problem(**weights))
    assert broken(certificate) & {C, NOISE, F, G, COV} == expected
    assert ("is exactly Gaussian" in certificate.text) == (not weights)


def planar(A: list, B: list, sensors: Sequence[float] = (0.5,)) -> mb.Problem:
    """Return a problem with two states, of which the first or both are measured."""
    system = mb.Linear(A, B, np.eye(len(sensors), 2), 0.3 * np.eye(2), list(sensors))
    R = np.ones(np.shape(B)[1])
    return mb.Problem(
        system,
        mb.GoalObstacleCost([0.0, 0], [1.0, 1], [1.0, 1], R),
        [1.0, 1],
        [0.4, 0.4],
        0.1,
        5,
        noise_convention="intensity",
    )


def test_a_diffusion_out_of_reach_of_the_controls():
    certificate = conditions_of(planar([[0.0, 1], [0, 0]], [[0.0, 0], [0, 1]]))
    assert {INCLUDED, MATCHED} <= broken(certificate)
    assert "out of reach" in certificate.text


def test_a_diffusion_of_less_rank_than_the_controls():
    certificate = conditions_of(planar([[0.0, 0], [0, 0]], [[1.0, 0], [0, 1]]))
    assert broken(certificate) - {CLASSICAL} == {EQUAL, MATCHED, ONE}
    assert "no R > 0" in certificate.text
    assert "D = 0" not in certificate.text


def test_a_diffusion_of_full_rank_but_very_uneven():
    problem = planar([[0.0, 0], [0, 0]], [[1.0, 0], [0, 1]], sensors=[1e-3, 1e3])
    assert EQUAL not in broken(conditions_of(problem))


def test_matching_that_would_need_an_r_that_changes():
    certificate = conditions_of(replace(Scalar().problem(steps=5), prior_std=np.array([1.5])))
    assert broken(certificate) - {CLASSICAL} == {MATCHED, ONE}
    assert "changes with time" in certificate.text


def test_no_diffusion_at_all_is_not_matched():
    certificate = conditions_of(
        replace(nonlinear_problem(), system=replace(nonlinear_problem().system, c1=0.0))
    )
    assert {EQUAL, MATCHED, ONE} <= broken(certificate)
    assert not {C, INCLUDED} & broken(certificate)
    assert "D = 0 at 5 steps" in certificate.text


def test_a_state_that_is_known_at_first():
    certificate = conditions_of(replace(Scalar().problem(steps=5), prior_std=np.zeros(1)))
    assert {EQUAL, MATCHED} <= broken(certificate)
    assert not {C, NOISE, F, G, COV} & broken(certificate)
    assert "D = 0 at 1 step" in certificate.text


def test_a_trial_that_diverges_is_one_line():
    with pytest.raises(ConfigError, match="diverges"):
        conditions_of(nonlinear_problem(f2=1e200))


def test_a_singular_sensor_is_one_line():
    with pytest.raises(ConfigError, match="is sigma_o singular"):
        conditions_of(
            replace(nonlinear_problem(), system=replace(nonlinear_problem().system, sigma0=0.0))
        )


def test_a_controller_without_risk_has_no_expansion_to_check():
    certificate = what_holds(
        Scalar().problem(),
        mb.EKF(),
        Feedback(0.5),
        0.6,
        seed=0,
        name="mine",
        settings="system=mine",
    )
    assert len(certificate.checks) == EXPANSION


def test_the_expansion_fails_at_a_large_theta():
    problem = light_dark_problem(prior_mean=[3, 1.7, 0, 0], steps=2)
    assert EXPANSION in broken(conditions_of(problem, theta=1.0))
    assert EXPANSION not in broken(conditions_of(problem, theta=1e-4))


def test_the_light_dark_system_is_affine_with_noise_that_is_not_constant():
    certificate = conditions_of(light_dark_problem(steps=4), temperature=1.0)
    assert {NOISE, COV, INCLUDED, MATCHED} <= broken(certificate)
    assert not {C, F, G} & broken(certificate)
    assert 0 < certificate.checks[LEAST].value <= certificate.checks[INCLUDED].value <= 1


def test_the_command_says_and_writes_it(tmp_path, capsys):
    result = call(
        tmp_path, capsys, "verify", "system=scalar_linear", "controller=lqg", "problem.steps=4"
    )
    assert result.code == 0, result.err
    assert "What holds for system=scalar_linear, controller=lqg, problem.steps=4" in result.out
    assert "exact for the mean's equation (12)" in result.out
    assert (tmp_path / "outputs" / "verify" / "systems" / "scalar_linear-lqg.md").is_file()


def test_a_system_that_cannot_be_built_is_one_line(tmp_path, capsys):
    result = call(
        tmp_path,
        capsys,
        "verify",
        "system=scalar_linear",
        "system.sensor_noise=-1",
        "controller=lqg",
    )
    assert result.code == 2
    assert result.err.startswith("mppi-belief: system.sensor_noise must be")
