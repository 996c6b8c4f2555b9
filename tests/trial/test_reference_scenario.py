"""Tests the reference scenario against what an independent program measured (400 trials).

Dynamics, filter, moments, weights and metrics must be right together for these numbers to come out.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binom, fisher_exact

import mppi_belief as mb
from helpers import SIGMAS, light_dark_problem, users_jit

TRIALS = 100
REFERENCE_TRIALS = 400
SAMPLER = mb.NominalSampler(control_std=2.75)


class ReferenceRow(NamedTuple):
    """Holds the published numbers of one method."""

    controller: mb.MPPI
    cost: tuple[float, float]  # mean and standard error
    clearance: tuple[float, float]  # m, mean and standard error
    collisions: int  # trials with one
    final_distance: float  # m, mean


TABLE = {
    "CE-MPPI": ReferenceRow(
        mb.MPPI(path_cost=mb.CertaintyEquivalent(), sampler=SAMPLER),
        (44.8, 0.35),
        (0.108, 0.009),
        102,
        1.01,
    ),
    "MPPI-Belief": ReferenceRow(
        mb.MPPI(path_cost=mb.RiskSensitive(theta=1.0), sampler=SAMPLER),
        (55.9, 0.38),
        (0.734, 0.013),
        2,
        1.01,
    ),
}


@pytest.fixture(scope="module")
def metrics_of_methods() -> dict[str, mb.Metrics]:
    """Returns metrics (TRIALS,) by method, in float32 and compiled as users' programs are."""
    problem = light_dark_problem()

    def metrics(controller: mb.MPPI) -> mb.Metrics:
        def judge(number: jax.Array) -> mb.Metrics:
            return mb.metrics(problem, mb.simulate_trial(problem, mb.EKF(), controller, 0, number))

        run = users_jit(lambda numbers: jax.lax.map(judge, numbers))
        return jax.tree.map(np.asarray, run(jnp.arange(TRIALS)))

    return {name: metrics(row.controller) for name, row in TABLE.items()}


@pytest.mark.parametrize("name", TABLE)
def test_cost_and_clearance_agree_within_standard_errors(name, metrics_of_methods):
    metrics = metrics_of_methods[name]
    for values, (mean, error) in (
        (metrics.cost, TABLE[name].cost),
        (metrics.clearance, TABLE[name].clearance),
    ):
        ours = values.std(ddof=1) / np.sqrt(TRIALS)
        assert abs(values.mean() - mean) < SIGMAS * np.hypot(ours, error), (values.mean(), ours)


@pytest.mark.parametrize("name", TABLE)
def test_final_distances_agree_within_standard_errors(name, metrics_of_methods):
    values = metrics_of_methods[name].final_distance
    # The table gives no standard error of these: it is taken to be ours, for its number of trials.
    error = values.std(ddof=1) * np.sqrt(1 / TRIALS + 1 / REFERENCE_TRIALS)
    rounding = 0.005  # the table has two digits
    assert abs(values.mean() - TABLE[name].final_distance) < SIGMAS * error + rounding


@pytest.mark.parametrize("name", TABLE)
def test_collisions_agree(name, metrics_of_methods):
    """Takes Fisher's exact test on the two counts, at the level of 4.5 standard errors."""
    ours = int(metrics_of_methods[name].collided.sum())
    theirs = TABLE[name].collisions
    counts = [[ours, TRIALS - ours], [theirs, REFERENCE_TRIALS - theirs]]
    assert fisher_exact(counts).pvalue > 7e-6, counts


def test_planning_with_the_belief_is_safer(metrics_of_methods):
    """Compares the same trials: where only one method collides, it is nearly always CE-MPPI."""
    certain, belief = (metrics_of_methods[name].collided for name in TABLE)
    only_certain = np.sum(certain & ~belief)
    only_belief = np.sum(belief & ~certain)
    assert binom.sf(only_certain - 1, only_certain + only_belief, 0.5) < 1e-4
    assert (
        metrics_of_methods["MPPI-Belief"].clearance.mean()
        > metrics_of_methods["CE-MPPI"].clearance.mean() + 0.3
    )


@pytest.mark.parametrize("name", TABLE)
def test_all_trials_are_finite_and_the_weights_not_degenerate(name, metrics_of_methods):
    assert all(np.all(np.isfinite(part)) for part in metrics_of_methods[name])
    assert np.all(metrics_of_methods[name].ess > 1)
    assert np.all(metrics_of_methods[name].ess < 500)
