"""What every system, cost, filter, controller, sweep and study in conf/ must do; a new yaml is
taken up by itself.

An option that makes sense only together with others says so in a comment line of its yaml, which is
then obeyed here: `# needs: system=scalar_linear filter=particle`.
"""

import pickle
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from cli_helpers import CONF, PLANNER, collect, compose
from experiment_helpers import compiled_quickly
from helpers import float64
from mppi_belief.belief.cost import running_moments
from mppi_belief.config.cell import Cell
from mppi_belief.config.settings import RUNTIME_KEYS
from mppi_belief.problem import ClosedFormCost, Cost, System
from mppi_belief.trial import CellParts, build, check, run_trials

GROUPS = ("system", "cost", "filter", "controller", "sweep", "experiment")
OPTIONS = {group: sorted(path.stem for path in CONF.glob(f"{group}/*.yaml")) for group in GROUPS}
NUMBER = re.compile(r"(?<![\w.$])[-+]?\d[\d_.]*(e[-+]?\d+)?(?![\w.])", re.IGNORECASE)
STEP = 1e-6  # of finite differences, in double precision
PARTS = {
    f"{path.parent.name}={path.stem}": path for path in sorted(CONF.glob("controller/*/*.yaml"))
}  # of a planner


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


def needs(group: str, option: str) -> dict[str, str]:
    """Returns other options that the yaml of an option asks for."""
    match = re.search(
        r"^# needs: (.+)$", (CONF / group / f"{option}.yaml").read_text(), re.MULTILINE
    )
    return dict(pair.split("=") for pair in match[1].split()) if match else {}


def pairs(group: str) -> list[tuple[str, str]]:
    """Returns every option of a group with every system that it is meant for."""
    return [
        (option, system)
        for option in OPTIONS[group]
        for system in OPTIONS["system"]
        if needs(group, option).get("system", system) == system
    ]


@cache
def configured(group: str, option: str, system: str) -> dict[str, Any]:
    """Returns the configuration of a small experiment of an option in a system."""
    chosen = {"system": system} | needs("system", system) | needs(group, option) | {group: option}
    return compose(*(f"{name}={value}" for name, value in chosen.items()), *PLANNER)


@cache
def built(system: str) -> CellParts:
    return build(configured("system", system, system))


def states(experiment: CellParts) -> np.ndarray:
    """Returns a few states (6, nx) around the prior and the goal."""
    rng = np.random.default_rng(1)
    ends = np.stack(
        [np.asarray(experiment.problem.prior_mean), np.asarray(experiment.problem.cost.goal)]
    )
    return rng.permutation(np.repeat(ends, 3, axis=0)) + rng.normal(size=(6, ends.shape[1]))


def differences(function: Any, x: np.ndarray) -> np.ndarray:
    """Returns the Jacobian by central differences."""
    steps = STEP * np.eye(len(x))
    return np.stack(
        [(np.asarray(function(x + h)) - np.asarray(function(x - h))) / (2 * STEP) for h in steps],
        axis=-1,
    )


def test_every_group_has_options():
    assert all(OPTIONS.values())
    assert {path.name for path in CONF.iterdir() if path.is_dir()} >= set(GROUPS)


@pytest.mark.parametrize(
    "path", sorted(CONF.rglob("*.yaml")), ids=lambda path: f"{path.parent.name}/{path.stem}"
)
def test_every_number_says_where_it_comes_from(path):
    text = re.sub(
        r"^( *)\S+: \|\n(?:\1 +.*\n|\n)*", "", path.read_text(), flags=re.MULTILINE
    )  # literal blocks
    for line in text.splitlines():
        value, _, comment = line.partition("#")
        if NUMBER.search(value.partition(":")[2] or value):
            assert comment.strip(), line
    assert path.read_text().startswith("#")


@pytest.mark.parametrize("system", OPTIONS["system"])
def test_a_system_and_its_cost_have_all_functions(system):
    problem = built(system).problem
    assert isinstance(problem.system, System)
    assert isinstance(problem.cost, Cost)
    check(configured("system", system, system))


def test_every_cost_is_brought_by_a_system_or_says_which_it_needs():
    brought = {
        configured("system", system, system)["names"]["cost"] for system in OPTIONS["system"]
    }
    assert brought | {cost for cost in OPTIONS["cost"] if "system" in needs("cost", cost)} == set(
        OPTIONS["cost"]
    )


@pytest.mark.parametrize("system", OPTIONS["system"])
@pytest.mark.parametrize("name", ["f", "c"])
def test_jacobians_of_a_system_match_finite_differences(name, system):
    experiment = built(system)
    function = getattr(experiment.problem.system, name)
    with float64():
        for x in states(experiment):
            np.testing.assert_allclose(
                jax.jacfwd(function)(jnp.asarray(x)), differences(function, x), atol=1e-7, rtol=1e-7
            )


@pytest.mark.parametrize("system", OPTIONS["system"])
@pytest.mark.parametrize("name", ["base", "penalty", "terminal"])
def test_gradients_of_a_cost_match_finite_differences(name, system):
    experiment = built(system)
    owner = experiment.problem if name == "penalty" else experiment.problem.cost
    function = getattr(owner, name)
    with float64():
        for x in states(experiment):
            slope = differences(function, x)
            np.testing.assert_allclose(
                jax.grad(function)(jnp.asarray(x)), slope, atol=1e-5, rtol=1e-6
            )


@pytest.mark.parametrize("system", OPTIONS["system"])
def test_noise_and_weights_are_regular(system):
    experiment = built(system)
    R = np.asarray(experiment.problem.cost.R)
    np.testing.assert_array_equal(R, R.T)
    assert np.linalg.eigvalsh(R).min() > 0
    for x in states(experiment):
        assert np.linalg.cond(np.asarray(experiment.problem.system.sigma_o(jnp.asarray(x)))) < 1e6
        assert not jnp.isnan(experiment.problem.clearance(jnp.asarray(x)))


@pytest.mark.parametrize("system", OPTIONS["system"])
def test_moments_of_a_cost_tend_to_the_cost_where_all_is_known(system):
    experiment = built(system)
    problem = experiment.problem
    cost = problem.cost
    if not isinstance(cost, ClosedFormCost):
        return
    with float64():
        certain_moments = jax.jit(
            lambda x: running_moments(problem, x, jnp.zeros((len(x), len(x))))
        )
        for x in map(jnp.asarray, states(experiment)):
            moments = certain_moments(x)
            np.testing.assert_allclose(moments.base, cost.base(x), rtol=1e-9)
            np.testing.assert_allclose(moments.penalty, problem.penalty(x), rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(moments[2:], 0, atol=1e-9)


@pytest.mark.parametrize(
    ("group", "option", "system"),
    [(group, *pair) for group in ("filter", "controller") for pair in pairs(group)],
)
class TestPairs:
    """Tests a filter or a controller in a system that it is meant for."""

    def test_it_builds_pickles_and_passes_the_check(self, group, option, system):
        config = configured(group, option, system)
        assert config["names"][group] == option
        parts = build(config)
        again = pickle.loads(pickle.dumps(parts))
        assert jax.tree.structure(again) == jax.tree.structure(parts)
        for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(parts), strict=True):
            np.testing.assert_array_equal(a, b)
        assert repr(again) == repr(parts)
        check(config)

    def test_a_short_loop_is_finite_and_the_same_key_gives_the_same_bits(
        self, group, option, system
    ):
        config = configured(group, option, system)
        parts = build(config)
        batch = run_trials(config, [0, 1])
        again = run_trials(config, [1])
        for row in batch.rows:
            assert (row["status"], row["error"], row["steps"]) == ("ok", None, 3)
            assert row["cost"] >= 0
            assert row["final_distance"] >= 0
        assert pickle.dumps(again.rows[0]) == pickle.dumps(batch.rows[1])
        assert batch.rows[0]["cost"] != batch.rows[1]["cost"]
        for step in batch.paths:
            assert all(np.all(np.isfinite(step[name])) for name in ("state", "mean", "cov"))
            cov = step["cov"].reshape(len(step["mean"]), -1)
            np.testing.assert_array_equal(cov, cov.T)
            assert np.linalg.eigvalsh(cov).min() >= -1e-6 * np.trace(cov)
        self.judge_sample_size([row["ess"] for row in batch.rows], parts)

    def judge_sample_size(self, sample_sizes: list[float], parts: CellParts) -> None:
        """Asserts sizes between one and the number of paths, or nan for a controller without."""
        if hasattr(parts.controller, "n_samples"):
            paths = parts.controller.n_samples * getattr(parts.filter, "n_particles", 1)
            assert all(1 - 1e-5 <= ess <= paths * (1 + 1e-5) for ess in sample_sizes)
        else:
            assert np.all(np.isnan(sample_sizes))


@pytest.mark.parametrize("part", PARTS)
def test_a_part_of_a_planner_can_be_chosen_by_its_name(part):
    group = part.partition("=")[0]
    controller = "pipf" if group == "combination" else "belief"
    config = compose(f"controller={controller}", f"controller/{part}", *PLANNER)
    chosen = build(config).controller
    target = config["controller"][group]["_target_"]
    assert target == f"mppi_belief.{type(getattr(chosen, group)).__name__}"
    check(config)


@pytest.mark.parametrize("sweep", OPTIONS["sweep"])
def test_a_sweep_composes_cells_that_differ_and_can_run(sweep):
    configs = collect(f"sweep={sweep}", *PLANNER)
    assert len({Cell(config).id for config in configs}) == len(configs)
    assert len(configs) == 1 if sweep == "none" else len(configs) > 1
    for config in configs:
        assert jax.tree.structure(build(config)) == jax.tree.structure(build(configs[0]))


@pytest.mark.parametrize("study", OPTIONS["experiment"])
def test_a_study_composes_cells_that_differ_and_can_be_built(study):
    configs = collect(f"experiment={study}")
    assert len({Cell(config).id for config in configs}) == len(configs)
    assert len(configs) == 1 if study == "none" else len(configs) > 1
    for config in configs:
        parts = build(config)
        assert isinstance(parts.problem.cost, Cost)
        assert callable(parts.controller.act)
    for key in RUNTIME_KEYS:
        assert all(config[key] == configs[0][key] for config in configs)
