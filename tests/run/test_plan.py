"""What makes two cells the same, and which trials are still to run."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cli_helpers import collect, compose
from mppi_belief.config import cell as cell_identity
from mppi_belief.config.cell import Cell
from mppi_belief.run.plan import SMALLEST_CHUNK, chunks
from study_helpers import config, trials_of


def cell_id(*args: str) -> str:
    return Cell(compose(*args)).id


@pytest.fixture(scope="module")
def default_ids() -> dict[str, str]:
    """Ids of the two controllers with nothing changed."""
    return {name: cell_id(f"controller={name}") for name in ("belief", "ce")}


def test_the_id_is_the_controller_and_a_hash_that_stays_the_same():
    """Results on disk are found by it: should it have to change, say so in the changelog."""
    planned = Cell(config(seed=3, light=5.0, centers=[[3.0, -1.0]]))
    assert planned.id == "fake-85f04bf2e5de"
    turned = Cell(dict(reversed(planned.config.items())))
    assert turned.id == planned.id


def test_numbers_of_the_same_value_make_the_same_cell():
    first = config(light=5.0, centers=[[3.0, -1]])
    second = config(light=5, centers=[[3, -1.0]])
    assert Cell(first).id == Cell(second).id != Cell(config(light=5.5, centers=[[3, -1.0]])).id
    assert Cell(config(seen=True)).id != Cell(config(seen=1)).id


def test_a_users_code_is_part_of_the_cell():
    first = config() | {"code": {"mine": "0a"}}
    second = config() | {"code": {"mine": "0b"}}
    assert len({Cell(config()).id, Cell(first).id, Cell(second).id}) == 3


def test_an_algorithm_version_of_its_own_makes_another_cell(monkeypatch):
    before = Cell(config()).id
    monkeypatch.setattr(cell_identity, "ALGORITHM_VERSION", cell_identity.ALGORITHM_VERSION + 1)
    assert Cell(config()).id != before


def test_a_number_that_is_not_finite_has_no_identity():
    with pytest.raises(ValueError):
        _ = Cell(config(light=math.nan)).id


@pytest.mark.parametrize(
    "change",
    [
        "n_trials=3",
        "workers=1",
        "batch=1",
        "batch=null",
        "platform=cpu",
        "results_dir=elsewhere",
        "theta=1",
        "theta=1.0",
        "controller.path_cost.theta=1.0",
        "planner.horizon=30",
        "filter=ekf",
    ],
)
def test_what_does_not_change_a_trial_does_not_change_the_cell(change, default_ids):
    assert cell_id("controller=belief", change) == default_ids["belief"]


@pytest.mark.parametrize(
    "change",
    [
        "theta=2",
        "w_obs=100",
        "seed=1",
        "precision=float64",
        "batch=2",
        "platform=gpu",
        "platform=gpu batch=1",
        "planner.horizon=29",
        "planner.temperature=2",
        "controller/schedule=riccati",
        "system.light=4.5",
        "problem.obstacles.centers=[[3.0,1.0]]",
        "problem.steps=59",
        "problem.prior_std=[0.2,0.2,0.05,0.06]",
        "cost.obstacle_penalty.margin=0.3",
        "filter=particle",
        "system=scalar_linear",
    ],
)
def test_what_changes_a_trial_changes_the_cell(change, default_ids):
    assert cell_id("controller=belief", *change.split()) not in default_ids.values()


def test_a_batch_that_is_not_given_is_the_cell_of_its_size():
    assert (
        cell_id("platform=gpu", "batch=null")
        == cell_id("platform=gpu", "batch=200")
        != cell_id("batch=200")
    )


def test_theta_means_nothing_to_the_certainty_equivalent_controller(default_ids):
    assert cell_id("controller=ce", "theta=2") == default_ids["ce"]
    assert len(set(default_ids.values())) == 2


def test_the_name_of_an_option_is_part_of_the_cell():
    named = config()
    again = config()
    again["names"] = named["names"] | {"controller": "other"}
    assert Cell(named).id != Cell(again).id
    assert Cell(again).id.startswith("other-")


def test_every_cell_of_a_sweep_has_its_own_id():
    ids = [Cell(composed).id for composed in collect("-m", "seed=0,1", "controller=belief,ce")]
    assert len(ids) == len(set(ids)) == 4


@given(
    n_trials=st.integers(1, 5000),
    done=st.sets(st.integers(0, 6000), max_size=200),
    everything_below=st.integers(0, 5000),
    workers=st.integers(1, 300),
    batch=st.integers(1, 300),
)
def test_chunks_are_exactly_the_missing_trials_once_each_in_order(
    n_trials, done, everything_below, workers, batch
):
    done = done | set(range(everything_below))
    planned = list(chunks(Cell(config(batch=batch)), n_trials, done, workers))
    assert trials_of(planned) == [trial for trial in range(n_trials) if trial not in done]
    assert all(chunk.trials for chunk in planned)
    assert all(
        first.trials[-1] // batch < second.trials[0] // batch
        for first, second in itertools.pairwise(planned)
    )


@given(n_trials=st.integers(1, 5000), workers=st.integers(1, 64))
def test_every_worker_gets_a_share_and_no_chunk_is_much_to_lose(n_trials, workers):
    sizes = [len(chunk.trials) for chunk in chunks(Cell(config()), n_trials, (), workers)]
    assert len(sizes) >= min(workers, math.ceil(n_trials / SMALLEST_CHUNK))
    assert max(sizes) <= max(SMALLEST_CHUNK, math.ceil(n_trials / workers / 200))


def test_two_hundred_trials_go_out_in_chunks_of_ten():
    assert [len(chunk.trials) for chunk in chunks(Cell(config()), 200, (), 2)] == [10] * 20
    assert list(chunks(Cell(config()), 200, range(300), 2)) == []


@pytest.mark.parametrize(
    ("batch", "workers", "sizes"),
    [
        (200, 1, [200]),
        (64, 2, [64, 64, 64, 8]),
        (8, 2, [16] * 12 + [8]),
        (8, 25, [8] * 25),
        (1000, 3, [200]),
    ],
)
def test_chunks_are_whole_batches(batch, workers, sizes):
    assert [
        len(chunk.trials) for chunk in chunks(Cell(config(batch=batch)), 200, (), workers)
    ] == sizes
