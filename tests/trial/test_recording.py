"""Tests the recording of one trial: its sampled paths and the residuals along it."""

import copy
import json
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm

from cli_helpers import compose
from experiment_helpers import compiled_quickly
from mppi_belief.trial import record, run_trials
from mppi_belief.trial.recording import SHOWN

STEPS = 5
HORIZON = 4
TRIAL = 3
SIZES = ("planner.horizon=4", "problem.steps=5", "record=3")
DT = 0.1


class Recorded(NamedTuple):
    """Holds a recording and its configuration."""

    config: dict[str, Any]
    content: dict[str, Any]

    @property
    def position(self) -> np.ndarray:
        return np.array(self.content["samples"]["position"])

    @property
    def weight(self) -> np.ndarray:
        return np.array(self.content["samples"]["weight"])

    def curve(self, convention: str, name: str) -> np.ndarray:
        return np.array(self.content["matching"][convention][name], dtype=float)


class TrialResult(NamedTuple):
    """Holds what `run_trials` says of a trial."""

    row: dict[str, Any]
    means: np.ndarray  # (STEPS + 1, nx)
    controls: np.ndarray  # (STEPS, nu)
    states: np.ndarray  # (STEPS + 1, nx)
    covs: np.ndarray  # (STEPS + 1, nx nx)


def recorded(*args: str, **groups: Any) -> Recorded:
    """Returns the recording of a trial with these settings."""
    config = compose(*args, *SIZES) | groups
    with compiled_quickly():
        return Recorded(config, record(config))


def trial_result(config: dict[str, Any]) -> TrialResult:
    """Returns the recorded trial as `run_trials` computes it."""
    with compiled_quickly():
        batch = run_trials(config, [TRIAL])
    means = np.stack([step["mean"] for step in batch.paths])
    controls = np.stack([step["control"] for step in batch.paths[:-1]])
    covs = np.stack([step["cov"] for step in batch.paths])
    states = np.stack([step["state"] for step in batch.paths])
    return TrialResult(batch.rows[0], means, controls, states, covs)


@pytest.fixture(scope="module")
def belief() -> Recorded:
    """Returns a recording of MPPI-Belief in the plane, with all of its few paths."""
    return recorded("planner.n_samples=24", "seed=2")


@pytest.fixture(scope="module")
def trial(belief: Recorded) -> TrialResult:
    """Returns the trial of the recording `belief`."""
    return trial_result(belief.config)


@pytest.fixture(scope="module")
def scalar() -> Recorded:
    """Returns a recording of the matched system with more paths than are kept, in float64."""
    return recorded("system=scalar_linear", "planner.n_samples=100", "precision=float64")


@pytest.fixture(scope="module")
def silent() -> Recorded:
    """Returns a recording of a controller without samples and without a temperature.

    It leaves the light with an uncertain velocity.
    """
    prior = ("problem.prior_mean=[4.9,1,0.5,0]", "problem.prior_std=[0.2,0.2,1,1]")
    return recorded(*prior, controller={"_target_": "helpers.Feedback", "gain": 5.0})


def test_a_recording_is_json_and_says_of_which_trial(belief, scalar, silent):
    for recording in (belief, scalar, silent):
        content = recording.content
        assert json.loads(json.dumps(content, allow_nan=False)) == content
        assert content["trial"] == TRIAL


def test_samples_have_a_path_for_every_step_and_sample(belief, scalar):
    assert belief.position.shape == (STEPS, 24, HORIZON, 2)
    assert belief.weight.shape == (STEPS, 24)
    assert SHOWN == 40
    assert scalar.position.shape == (STEPS, SHOWN, HORIZON, 1)
    assert scalar.weight.shape == (STEPS, SHOWN)


def test_weights_are_those_of_the_trial_that_is_run(belief, trial):
    """Uses that all paths are kept: the weights sum to one and give the effective sample size."""
    np.testing.assert_allclose(belief.weight.sum(axis=1), 1, atol=24 * 1e-5)
    ess = 1 / np.sum(belief.weight**2, axis=1)
    assert ess.mean() == pytest.approx(trial.row["ess"], rel=2e-3)
    assert ess.std() > 0.05 * ess.mean()


def test_samples_start_from_the_belief_of_the_trial_that_is_run(belief, trial):
    """Compares with one step of p' = v from the mean: controls reach the velocity only."""
    start = trial.means[:-1, :2] + DT * trial.means[:-1, 2:]
    np.testing.assert_allclose(
        belief.position[:, :, 0], np.broadcast_to(start[:, None], (STEPS, 24, 2)), atol=1e-3
    )


def test_weighted_samples_give_the_control_of_the_trial_that_is_run(belief, trial):
    """Takes the sampled controls as second differences of the paths."""
    start = trial.means[:-1, :2]
    velocity = trial.means[:-1, 2:]
    second = np.einsum("tn,tnd->td", belief.weight, belief.position[:, :, 1])
    controls = (second - start - 2 * DT * velocity) / DT**2
    assert np.ptp(trial.controls, axis=0).min() > 0.5
    np.testing.assert_allclose(controls, trial.controls, atol=0.1)


def test_the_heaviest_quarter_comes_first(belief, scalar):
    for recording, count in ((belief, 24), (scalar, SHOWN)):
        heavy = recording.weight[:, : count // 4]
        others = recording.weight[:, count // 4 :]
        assert np.all(np.diff(heavy, axis=1) <= 0)
        assert np.all(heavy[:, -1] >= others.max(axis=1))
    # The others of a hundred come as they were drawn and not by weight, to represent all of them.
    assert not np.all(np.diff(others, axis=1) <= 0)
    rest = 1 - heavy.sum(axis=1)
    assert np.all(others.sum(axis=1) < rest)
    assert np.all(others.sum(axis=1) > rest / 8)


@pytest.mark.parametrize("convention", ["sample", "intensity"])
def test_the_residual_lies_between_zero_and_one_and_never_above_the_imposed_one(convention, belief):
    optimum = belief.curve(convention, "optimum")
    imposed = belief.curve(convention, "imposed")
    assert optimum.shape == imposed.shape == (STEPS,)
    assert np.all((optimum >= 0) & (optimum <= 1))
    assert np.all(optimum <= imposed)
    # In the dark: controls reach the velocity, about which measurements say little.
    assert np.all(optimum > 0.5)


def test_a_single_state_is_always_matched_and_by_the_imposed_weight_where_the_theory_says(scalar):
    """Uses that scalar_linear.yaml starts at the steady state of (8b) with R of (15)."""
    for convention in ("sample", "intensity"):
        np.testing.assert_allclose(scalar.curve(convention, "optimum"), 0, atol=1e-5)
    np.testing.assert_allclose(scalar.curve("intensity", "imposed"), 0, atol=1e-5)
    assert np.all(scalar.curve("sample", "imposed") > 0.1)


@pytest.mark.parametrize("step", [0, 3, None], ids=["at the start", "between", "never"])
def test_the_first_collision_is_that_of_the_path_between_its_states(step, silent):
    """Puts a small disc on the path of a controller that does not see obstacles."""
    config = copy.deepcopy(silent.config)
    states = trial_result(config).states
    discs = np.full((2, 2), 99.0)
    if step is not None:
        discs[0] = states[max(step - 1, 0) : step + 1, :2].mean(axis=0)
    obstacles = config["problem"]["obstacles"]
    config["problem"]["obstacles"] = obstacles | {"centers": discs.tolist(), "radius": 1e-5}
    with compiled_quickly():
        assert record(config)["collided_at"] == step
        assert run_trials(config, [TRIAL]).rows[0]["collided"] is (step is not None)


def test_a_controller_without_samples_has_a_residual_but_no_paths(silent):
    assert silent.content["samples"] is None
    assert set(silent.content["matching"]) == {"sample", "intensity"}
    for curves in silent.content["matching"].values():
        assert set(curves) == {"optimum"}
        assert len(curves["optimum"]) == STEPS


@pytest.mark.parametrize("convention", ["sample", "intensity"])
def test_the_residual_is_that_of_the_recursions_along_the_trials_own_means(convention, silent):
    """Derives D again: the filter's D = K S K' / dt, and (8b), (9) by matrix exponentials."""
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.zeros((2, 4))]])
    G = np.vstack([np.zeros((2, 2)), np.eye(2)])
    C = np.hstack([np.eye(2), np.zeros((2, 2))])
    F = np.eye(4) + DT * A
    Q = 0.3**2 * G @ G.T
    problem = silent.config["problem"]
    mean = np.array(problem["prior_mean"])
    cov = np.diag(np.array(problem["prior_std"]) ** 2)
    expected = []
    trial = trial_result(silent.config)
    for u, next_mean in zip(trial.controls, trial.means[1:], strict=True):
        after = F @ mean + DT * G @ u
        if convention == "sample":
            cov = F @ cov @ F.T + DT * Q
            K = cov @ C.T @ np.linalg.inv(C @ cov @ C.T + noise(after))
            D = K @ C @ cov / DT
            cov = cov - K @ C @ cov
        else:
            information = C.T @ np.linalg.inv(noise(mean)) @ C
            D = cov @ information @ cov
            flow = expm(DT * np.block([[-A.T, information], [Q, A]])) @ np.vstack([np.eye(4), cov])
            cov = flow[4:] @ np.linalg.inv(flow[:4])
        mean = next_mean
        expected.append(np.sqrt(1 - np.sum(D[2:, 2:] ** 2) / np.sum(D**2)))
    assert np.ptp(expected) > 0.1
    np.testing.assert_allclose(silent.curve(convention, "optimum"), expected, atol=1e-3)


def noise(x: np.ndarray) -> np.ndarray:
    """Returns the measurement covariance (2, 2) of the light-dark system."""
    return (abs(x[0] - 5) / np.sqrt(2) + 0.1) ** 2 * np.eye(2)


def test_theorem_1_has_its_residual_at_every_step(belief):
    """Compares with zero for an affine sensor, and with the closed form for a pendulum's."""
    affine = belief.content["tangent"]
    assert (affine["states"], affine["measurements"]) == (4, 2)
    assert affine["part"] == [0.0] * STEPS

    pendulum = recorded("system=pendulum", "system.curvature=2", "precision=float64")
    trial = trial_result(pendulum.config)
    curved = pendulum.content["tangent"]
    assert (curved["states"], curved["measurements"]) == (2, 1)
    anchor = pendulum.config["system"]["anchor"]
    dt = pendulum.config["problem"]["dt"]
    for k, part in enumerate(curved["part"]):
        # Mean and variance of the angle one step ahead, before the measurement.
        a, r = trial.means[k]
        cov = trial.covs[k].reshape(2, 2)
        variance = cov[0, 0] + 2 * dt * cov[0, 1] + dt**2 * cov[1, 1]
        m = anchor + 2 * (a + dt * r - anchor)
        v = 4 * variance
        derivative = np.cos(m) * np.exp(-v / 2)
        total = -np.expm1(-v) * (1 + np.exp(-v) * np.cos(2 * m)) / 2
        assert part == pytest.approx(1 - derivative**2 * v / total, abs=2e-5)
        assert part > 0.01
