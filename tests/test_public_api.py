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
from mppi_belief.experiment import run_trials
from mppi_belief.simulate import Metrics

# cost, running cost, terminal cost, clearance (m), final distance (m), mean effective sample size of
# trials 0, 1, 2 in double precision. A change of these numbers is a change of the algorithm: raise
# study.plan.ALGORITHM_VERSION and say so in the changelog.
INF = float("inf")
GOLDEN = {
    ("belief", "light_dark"): [
        [114.292, 44.9754, 69.3168, 0.571245, 5.26496, 4.19371],
        [149.740, 53.3161, 96.4237, 0.879219, 6.20394, 4.28516],
        [117.731, 44.1242, 73.6066, 0.584582, 5.42502, 3.95233],
    ],
    ("algorithm_1", "scalar_linear"): [
        [11.7961, 10.3752, 1.42085, INF, 1.19199, 9.43653],
        [16.0903, 15.4759, 0.614346, INF, 0.783802, 7.04009],
        [8.13579, 7.20270, 0.933096, INF, 0.965969, 16.5663],
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
        "import sys, mppi_belief; print([name for name in ('jax', 'numpy', 'hydra', 'pandas') if name in sys.modules])"
    )
    assert python(code, tmp_path) == "[]"
    assert python("import sys, mppi_belief; mppi_belief.EKF; print('hydra' in sys.modules)", tmp_path) == "False"


def test_no_module_hides_a_public_name():
    before = {name: getattr(mb, name) for name in mb.__all__}
    modules = [module.name for module in pkgutil.walk_packages(mb.__path__, "mppi_belief.")]
    assert len(modules) > 20
    for module in modules:
        importlib.import_module(module)
    assert {name: getattr(mb, name) for name in mb.__all__} == before


def test_the_example_of_the_package_runs(capsys):
    blocks = [textwrap.dedent(block) for block in mb.__doc__.split("\n\n") if block.startswith("    ")]
    names: dict[str, object] = {}
    exec("\n".join(blocks), names)
    assert names["trial"].states.shape == (61, 4)
    assert "cost=" in capsys.readouterr().out
    reference = light_dark_problem()
    assert repr(names["problem"]) == repr(reference)


@pytest.mark.parametrize(("controller", "system"), GOLDEN)
def test_the_numbers_are_those_of_this_version(controller, system):
    small = ["planner.n_samples=32", "planner.horizon=8", "problem.steps=20", "precision=float64", "seed=1"]
    batch = run_trials(compose(f"controller={controller}", f"system={system}", *small), range(3))
    columns = [name for name in Metrics._fields if name != "collided"]
    found = [[row[name] for name in columns] for row in batch.rows]
    np.testing.assert_allclose(found, GOLDEN[controller, system], rtol=1e-3)
