"""Defines the fixtures that all tests share."""

import gc
import itertools
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import pytest

import mppi_belief as mb
from helpers import Scalar, float64, light_dark_problem, quick_jit
from mppi_belief.config import targets
from mppi_belief.run import slow_starts

ENDED = itertools.count(1)  # tests of this process
# XLA's older and simpler kernels, all in one piece: they compile in a half to a quarter of the time
# of those of users, to the same numbers but for rounding (jaxlib 0.10.2 has these flags; XLA ends a
# process that names one it has not)
SIMPLE = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"


def compile_simply() -> None:
    """Lets XLA compile simply in this process, which reads its flags now.

    The commands that tests start compile as users do, and so do programs of `helpers.users_jit`.
    """
    given = os.environ.get("XLA_FLAGS")
    os.environ["XLA_FLAGS"] = f"{SIMPLE} {given or ''}"
    jax.devices()
    if given is None:
        del os.environ["XLA_FLAGS"]
    else:
        os.environ["XLA_FLAGS"] = given


compile_simply()


@pytest.fixture(autouse=True, scope="session")
def own_parts() -> None:
    """Allows configurations to name the classes of the tests' own modules."""
    targets.allow([Path(__file__).parent])


@pytest.fixture(autouse=True, scope="session")
def no_slow_starts() -> None:
    """Keeps lines about slow starts, which depend on the machine's speed, out of what tests read;
    commands in processes of their own still write them.
    """
    slow_starts.PATIENCE = threading.TIMEOUT_MAX


@pytest.fixture(autouse=True)
def room_for_programs() -> Iterator[None]:
    """Clears compiled programs before their memory maps run out.

    Every compiled program maps some pages, and a process may have 65 530 maps: LLVM aborts when it
    gets none.
    """
    yield
    maps = Path("/proc/self/maps")
    if next(ENDED) % 20 == 0 and maps.exists() and maps.read_bytes().count(b"\n") > 45_000:
        jax.clear_caches()
        gc.collect()


@pytest.fixture
def x64() -> Iterator[None]:
    """Switches to double precision for one test."""
    with float64():
        yield


@pytest.fixture
def quick_x64(x64, monkeypatch) -> None:
    """Switches to double precision and spends little time on compiling."""
    monkeypatch.setattr(jax, "jit", quick_jit)


@pytest.fixture
def light_dark() -> mb.Problem:
    """Returns the problem of the reference scenario."""
    return light_dark_problem()


@pytest.fixture
def scalar() -> Scalar:
    """Returns the exactly matched scalar system."""
    return Scalar()


@pytest.fixture
def rng() -> np.random.Generator:
    """Returns a fixed stream of random numbers for the inputs of one test."""
    return np.random.default_rng(0)
