"""Fixtures shared by all tests."""

from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import pytest

import mppi_belief as mb
from helpers import Scalar, float64, light_dark_problem, quick_jit
from mppi_belief import targets


@pytest.fixture(autouse=True, scope="session")
def own_parts() -> None:
    """Configurations may name the classes of the tests' own modules."""
    targets.allow([Path(__file__).parent])


@pytest.fixture
def x64() -> Iterator[None]:
    """Double precision for one test."""
    with float64():
        yield


@pytest.fixture
def quick_x64(x64, monkeypatch) -> None:
    """Double precision, and little spent on compiling."""
    monkeypatch.setattr(jax, "jit", quick_jit)


@pytest.fixture
def light_dark() -> mb.Problem:
    """The numbers of the reference scenario."""
    return light_dark_problem()


@pytest.fixture
def scalar() -> Scalar:
    """The exactly matched scalar system."""
    return Scalar()


@pytest.fixture
def rng() -> np.random.Generator:
    """A fixed stream for the inputs of one test."""
    return np.random.default_rng(0)
