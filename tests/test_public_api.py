"""What `import mppi_belief` gives, and the numbers it gives."""

import importlib
import inspect
import pkgutil
import textwrap
from collections.abc import Iterator

import numpy as np
import pytest

import mppi_belief as mb
from cli_helpers import compose, python
from experiment_helpers import compiled_quickly
from helpers import light_dark_problem
from mppi_belief.trial import run_trials
from mppi_belief.trial_metrics import Metrics

# cost, running cost, terminal cost, clearance (m), final distance (m), mean effective sample size
# of trials 0, 1, 2 in double precision. A change of these numbers is a change of the algorithm:
# raise config.cell.ALGORITHM_VERSION and say so in the changelog.
INF = float("inf")
GOLDEN = {
    ("controller=belief", "experiment=reference_scenario"): [
        [104.402, 41.2186, 63.1832, 0.420686, 5.02651, 4.14625],
        [138.386, 48.5775, 89.8082, 0.780737, 5.98662, 4.29820],
        [118.459, 44.0324, 74.4268, 0.629600, 5.45514, 3.95140],
    ],
    ("controller=algorithm_1", "system=scalar_linear"): [
        [10.6367, 9.38445, 1.25229, INF, 1.11906, 10.0617],
        [6.77209, 6.73491, 0.0371818, INF, 0.192826, 11.9416],
        [8.51390, 7.52319, 0.990711, INF, 0.995345, 16.2448],
    ],
}


@pytest.fixture(autouse=True, scope="module")
def quick() -> Iterator[None]:
    with compiled_quickly():
        yield


@pytest.mark.parametrize("name", mb.__all__)
def test_every_public_name_is_there_and_documented(name):
    found = getattr(mb, name)
    assert name in dir(mb)
    if name != "__version__":
        text = inspect.getdoc(found)
        assert text
        assert not text.startswith(f"{name}(")  # what a dataclass or a named tuple writes by itself
        assert len(text) > 20


def test_other_names_are_refused_as_modules_do():
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = mb.nothing


def test_importing_the_package_loads_neither_jax_nor_hydra(tmp_path):
    code = (
        "import sys, mppi_belief\n"
        "print([name for name in ('jax', 'numpy', 'hydra', 'pandas') if name in sys.modules])"
    )
    assert python(code, tmp_path) == "[]"
    assert (
        python("import sys, mppi_belief; mppi_belief.EKF; print('hydra' in sys.modules)", tmp_path)
        == "False"
    )


def test_no_module_hides_a_public_name():
    before = {name: getattr(mb, name) for name in mb.__all__}
    modules = [module.name for module in pkgutil.walk_packages(mb.__path__, "mppi_belief.")]
    assert len(modules) > 20
    for module in modules:
        importlib.import_module(module)
    assert {name: getattr(mb, name) for name in mb.__all__} == before


def test_the_example_of_the_package_runs(capsys):
    blocks = [
        textwrap.dedent(block) for block in mb.__doc__.split("\n\n") if block.startswith("    ")
    ]
    names: dict[str, object] = {}
    exec("\n".join(blocks), names)
    assert names["trial"].states.shape == (61, 4)
    assert "cost=" in capsys.readouterr().out
    reference = light_dark_problem()
    assert repr(names["problem"]) == repr(reference)


@pytest.mark.parametrize("setting", GOLDEN)
def test_the_numbers_are_those_of_this_version(setting):
    small = [
        "planner.n_samples=32",
        "planner.horizon=8",
        "problem.steps=20",
        "precision=float64",
        "seed=1",
    ]
    batch = run_trials(compose(*setting, *small), range(3))
    columns = [name for name in Metrics._fields if name != "collided"]
    found = [[row[name] for name in columns] for row in batch.rows]
    np.testing.assert_allclose(found, GOLDEN[setting], rtol=1e-3)
