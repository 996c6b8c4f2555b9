"""Tests that variables of the environment change no number, and that a command does without a home
directory.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest

from cli_helpers import SMALL, call, files_in, restored
from mppi_belief.config import cache_folders, environment
from mppi_belief.errors import ConfigError

FOLDERS = ("XDG_CACHE_HOME", "JAX_COMPILATION_CACHE_DIR", "MPLCONFIGDIR")


@pytest.fixture(autouse=True)
def own_environment() -> Iterator[None]:
    """Removes what a test sets, and restores what it removes."""
    with restored():
        os.environ.pop("XLA_FLAGS", None)
        yield


@pytest.fixture
def homeless(monkeypatch, tmp_path) -> Path:
    """Takes the home directory away, as in a container; returns the folder of temporary files."""

    def home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in FOLDERS:
        os.environ.pop(name, None)
    monkeypatch.setattr(Path, "home", home)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def test_variables_that_may_change_a_trial_are_removed_with_one_note(capsys):
    os.environ |= {
        "JAX_DEBUG_NANS": "1",
        "JAX_RANDOM_SEED_OFFSET": "5",
        "JAX_OF_NEXT_YEAR": "on",
        "NVIDIA_TF32_OVERRIDE": "1",
        "JAX_LOG_COMPILES": "1",
        "JAX_ENABLE_X64": "1",
    }
    environment.prepare()
    assert capsys.readouterr().err == (
        "mppi-belief: JAX_DEBUG_NANS=1, JAX_OF_NEXT_YEAR=on, JAX_RANDOM_SEED_OFFSET=5, "
        "NVIDIA_TF32_OVERRIDE=1: not used; may change the numbers of a trial or fail it\n"
    )
    remaining = {name for name in os.environ if name.startswith(("JAX_", "NVIDIA_TF32"))}
    assert {"JAX_LOG_COMPILES", "JAX_ENABLE_X64"} < remaining <= environment.HARMLESS
    environment.prepare()
    assert capsys.readouterr().err == ""


def test_harmless_variables_are_settings_that_jax_has():
    assert {name.lower() for name in environment.HARMLESS} <= {*jax.config.values}


@pytest.mark.parametrize(
    "flag",
    [
        "--xla_cpu_enable_fast_math=true",
        "--xla_there_is_no_such_flag=1",
        "--xla_cpu_prefer_vector_width=256",
        "flags.txt",  # XLA reads flags from a file of this name
    ],
)
def test_flags_of_xla_that_may_change_a_trial_are_refused(flag, tmp_path, capsys):
    flags = f"--xla_dump_to=here {flag}"
    answer = call(tmp_path, capsys, "run", *SMALL, "n_trials=1", XLA_FLAGS=flags)
    assert (answer.code, answer.out, files_in(tmp_path)) == (2, "", [])
    assert answer.err.startswith(f"mppi-belief: XLA_FLAGS: {flag} may change the numbers ")
    assert len(answer.err.splitlines()) == 1


def test_harmless_flags_of_xla_stay_beside_our_own():
    os.environ["XLA_FLAGS"] = "--xla_dump_to=here"
    environment.prepare()
    flags = os.environ["XLA_FLAGS"].split()
    assert flags[0] == "--xla_dump_to=here"
    assert "--xla_cpu_multi_thread_eigen=false" in flags
    assert environment.numeric_settings()["XLA_FLAGS"] == os.environ["XLA_FLAGS"]
    environment.prepare()
    assert os.environ["XLA_FLAGS"].split() == flags
    os.environ["XLA_FLAGS"] += " --xla_gpu_deterministic_ops=false"
    with pytest.raises(ConfigError, match="--xla_gpu_deterministic_ops=false may change"):
        environment.prepare("gpu")


def test_without_a_home_directory_programs_are_kept_among_temporary_files(homeless, capsys):
    environment.prepare()
    own = homeless / f"mppi-belief-{os.getuid()}"
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(own / "xla")
    assert os.environ["MPLCONFIGDIR"] == str(own / "matplotlib")
    assert own.stat().st_mode & 0o777 == 0o700
    assert capsys.readouterr().err == (
        "mppi-belief: no cache directory of this user can be written to; "
        f"compiled programs are kept in {own / 'xla'}\n"
    )


def test_a_cache_that_is_given_is_used_without_a_home_directory(homeless, capsys):
    os.environ["JAX_COMPILATION_CACHE_DIR"] = "mine"
    environment.prepare()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == "mine"
    del os.environ["JAX_COMPILATION_CACHE_DIR"]
    os.environ["XDG_CACHE_HOME"] = str(homeless / "cache")
    environment.prepare()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(homeless / "cache/mppi-belief/xla")
    assert capsys.readouterr().err == ""


def test_a_folder_to_which_others_can_write_keeps_no_programs(homeless, capsys):
    shared = homeless / f"mppi-belief-{os.getuid()}"
    shared.mkdir()
    shared.chmod(0o777)
    environment.prepare()
    assert "JAX_COMPILATION_CACHE_DIR" not in os.environ
    assert "compiled anew by every worker" in capsys.readouterr().err
    assert "JAX_COMPILATION_CACHE_DIR" not in environment.in_force()
    assert cache_folders.program_folder() is None
