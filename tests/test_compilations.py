"""Programs are compiled for a structure, never for its numbers: JAX reports its compilations."""

from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
import pytest

from cli_helpers import PLANNER, compose
from compilation_helpers import COMPILED, TRACED, collect_events
from experiment_helpers import compiled_quickly
from mppi_belief.trial import check, run_trials, time_steps

GROUPS = ("system", "cost", "problem", "filter", "controller")


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


def moved(node: Any) -> Any:
    """Returns a configuration with every number but integers moved by a hundredth."""
    if isinstance(node, dict):
        return {key: moved(value) for key, value in node.items()}
    if isinstance(node, list):
        return [moved(value) for value in node]
    return 1.01 * node + 0.001 if isinstance(node, float) else node


def row_of(config: dict[str, Any]) -> dict[str, Any]:
    """Returns the row of a trial of a cell, run as a worker does."""
    (row,) = run_trials(config, [0]).rows
    assert (row["status"], row["error"]) == ("ok", None)
    return row


def another(config: dict[str, Any]) -> dict[str, Any]:
    """Returns a cell that shares no number with this one but its sizes."""
    changed = (
        config | {group: moved(config[group]) for group in GROUPS} | {"seed": config["seed"] + 1}
    )
    assert changed["problem"]["obstacles"]["centers"] != config["problem"]["obstacles"]["centers"]
    return changed


def test_each_compilation_is_noted_once():
    function = jax.jit(lambda x: 3 * x)
    with collect_events(COMPILED) as compiled, collect_events(TRACED) as traced:
        for value in (1.0, 2.0, 3.0):
            function(value)
        assert len(compiled) == len(traced) == 1
        function(np.int32(1))
    assert len(compiled) == len(traced) == 2
    function(np.int8(1))
    assert len(compiled) == 2  # nobody listens any more


def test_no_number_of_a_cell_compiles_anything_anew():
    config = compose(*PLANNER)
    check(config)
    first = row_of(config)
    time_steps(config, 2)
    changed = another(config)
    with collect_events(COMPILED) as compiled:
        check(changed)
        with collect_events(TRACED) as traced:
            assert row_of(changed)["ess"] != first["ess"]
            time_steps(changed, 2)
    assert (compiled, traced) == ([], [])


def test_no_word_of_a_sweep_over_numbers_compiles_anything_anew():
    row_of(compose(*PLANNER))
    changes = [
        ("cost.goal=[6,0,0,0]",),
        ("theta=3", "w_obs=0"),
        ("w_obs=2500", "seed=5"),
        ("planner.temperature=2",),
        ("planner.control_std=1",),
        ("problem.dt=1", "problem.prior_std=[1,1,0,0]"),
        ("problem.obstacles.centers=[[2,0],[4,1]]", "system.light=4"),
    ]
    with collect_events(COMPILED) as compiled, collect_events(TRACED) as traced:
        sample_sizes = {row_of(compose(*PLANNER, *change))["ess"] for change in changes}
    assert (compiled, traced) == ([], [])
    assert len(sample_sizes) == len(changes)


@pytest.mark.parametrize(
    "structure",
    [
        ("controller=ce",),
        ("controller=pipf", "filter.n_particles=4"),
        ("controller=ilqg", "controller.max_iterations=2"),
    ],
    ids=" ".join,
)
def test_another_structure_is_compiled_and_then_no_number_of_it(structure):
    row_of(compose(*PLANNER))
    config = compose(*PLANNER, *structure, "planner.horizon=7")  # which no other test has compiled
    with collect_events(COMPILED) as compiled:
        row_of(config)
    assert compiled
    with collect_events(COMPILED) as compiled, collect_events(TRACED) as traced:
        row_of(another(config))
    assert (compiled, traced) == ([], [])
