"""The numbers of conf/ that are read without Hydra are those that Hydra composes."""

import pytest

from cli_helpers import CONF, compose
from mppi_belief.config.reference import reference, reference_settings

FILES = [
    path
    for group in ("system", "cost", "filter", "controller")
    for path in CONF.glob(f"{group}/*.yaml")
]
NEEDED = {"station": ["system=steered"], "quadratic": ["system=scalar_linear"]}


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_file_is_read_as_it_is_composed(path):
    group = path.parent.name
    option = path.stem
    values = reference(group, option)
    composed = compose(*NEEDED.get(option, []), f"{group}={option}")
    if group in values:
        assert values == {key: composed[key] for key in values}
    else:
        assert values == composed[group]


def test_the_top_level_is_that_of_the_main_file():
    settings = reference_settings()
    composed = compose()
    assert settings["planner"] == composed["planner"]
    assert (settings["theta"], settings["w_obs"]) == (composed["theta"], composed["w_obs"])
    assert "hydra" not in settings


def test_a_file_that_is_not_there_raises():
    with pytest.raises(FileNotFoundError):
        reference("cost", "nothing")
