"""Tests that settings of JAX which somebody has changed change no trial."""

from collections.abc import Iterator
from typing import Any

import jax
import pytest

from cli_helpers import SMALL, compose
from mppi_belief.config import targets
from mppi_belief.numerics.jax_settings import PINNED
from mppi_belief.trial import build, check, run_trials

CHANGES: dict[str, Any] = {
    "jax_random_seed_offset": 5,
    "jax_threefry_partitionable": False,
    "jax_default_prng_impl": "rbg",
    "jax_numpy_rank_promotion": "raise",
    "jax_numpy_dtype_promotion": "strict",
    "jax_debug_nans": True,
    "jax_disable_jit": True,
    "jax_transfer_guard": "disallow",
}
MODULE = """
import jax
from mppi_belief import ScalarLinear

jax.config.update("jax_random_seed_offset", 5)
"""


@pytest.fixture(autouse=True)
def restored_settings() -> Iterator[None]:
    """Restores the settings of JAX after a test."""
    before = {name: jax.config.values[name] for name in PINNED}
    yield
    for name, value in before.items():
        jax.config.update(name, value)


def test_a_trial_has_the_numbers_of_its_cell_under_any_setting():
    """The effective sample size of LQG is nan by design, which jax_debug_nans would refuse."""
    config = compose("controller=lqg", *SMALL)
    (expected,) = run_trials(config, [0]).rows
    assert expected["status"] == "ok"
    for name, value in CHANGES.items():
        jax.config.update(name, value)
        check(config)
        jax.config.update(name, value)
        (row,) = run_trials(config, [0]).rows
        assert repr(row) == repr(expected), name


def test_the_streams_are_those_of_jax_as_it_is_delivered():
    config = compose(
        "controller=ce",
        "system=scalar_linear",
        "planner.n_samples=20",
        "planner.horizon=5",
        "problem.steps=5",
    )
    jax.config.update("jax_threefry_partitionable", False)
    costs = [row["cost"] for row in run_trials(config, [0, 1]).rows]
    assert costs == pytest.approx([4.394903, 2.145490], rel=1e-6)


def test_a_module_that_changes_settings_while_it_is_imported_changes_no_trial(tmp_path):
    (tmp_path / "changes_settings.py").write_text(MODULE)
    targets.allow([tmp_path])
    config = compose(*SMALL)
    config["system"] = config["system"] | {"_target_": "changes_settings.ScalarLinear"}
    build(config)
    assert jax.config.jax_random_seed_offset == 0
