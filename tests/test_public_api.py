"""Tests what `import mppi_belief` gives, and that its numbers are those of this version."""

import importlib
import inspect
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import pytest

import mppi_belief as mb
from cli_helpers import compose, python
from experiment_helpers import compiled_quickly
from mppi_belief.trial import build, run_trials
from mppi_belief.trial_metrics import Metrics

ROOT = Path(__file__).resolve().parents[1]

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
    value = getattr(mb, name)
    assert name in dir(mb)
    if name != "__version__":
        text = inspect.getdoc(value)
        assert text
        assert not text.startswith(f"{name}(")  # what a dataclass or a named tuple writes by itself
        assert len(text) > 20


def test_every_public_name_has_an_example():
    """Looks the names up in docs/api.md, whose Python is executed by `test_docs.py`."""
    page = (ROOT / "docs" / "api.md").read_text()
    blocks = "".join(re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL))
    assert set(re.findall(r"\bmb\.(\w+)", blocks)) == set(mb.__all__)


def test_configurations_name_classes_by_their_public_names():
    """Allows one spelling of `_target_` for the package's own classes: mppi_belief.Name."""
    for path in (ROOT / "conf").rglob("*.yaml"):
        for target in re.findall(r"_target_: (mppi_belief\S*)", path.read_text()):
            package, _, name = target.partition(".")
            assert (package, name in mb.__all__) == ("mppi_belief", True), f"{path}: {target}"


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
    assert "\n\n".join(block.strip("\n") for block in blocks) in (ROOT / "README.md").read_text()
    configured = build(compose("controller=belief"))
    example = (names["problem"], names["planner"])
    default = (configured.problem, configured.controller)
    assert jax.tree.structure(example) == jax.tree.structure(default)
    for value, expected in zip(jax.tree.leaves(example), jax.tree.leaves(default), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-6)


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
    numbers = [[row[name] for name in columns] for row in batch.rows]
    np.testing.assert_allclose(numbers, GOLDEN[setting], rtol=1e-3)
