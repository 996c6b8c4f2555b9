"""Tests that trials are computed on the platform that was asked for, or not at all."""

import logging
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import jax
import pytest

from cli_helpers import SMALL, call, compose, files_in, restored
from mppi_belief.config import environment
from mppi_belief.errors import ConfigError
from mppi_belief.run import runner, start_workers
from mppi_belief.run.local import LocalWorkers
from mppi_belief.run.task import StudyOrder, TrialFunctions
from mppi_belief.run.worker import WorkerSetup
from mppi_belief.trial import check, device, record, run_trials, time_steps
from mppi_belief.trial.device import BACKEND_LOGGER, computing


@pytest.fixture(autouse=True)
def untouched() -> Iterator[None]:
    """Removes what chooses a platform, and restores it afterwards."""
    with restored():
        for name in ("JAX_PLATFORMS", "XLA_FLAGS", "XLA_PYTHON_CLIENT_PREALLOCATE"):
            os.environ.pop(name, None)
        yield


def pretend(monkeypatch: pytest.MonkeyPatch, platform: str, kind: str) -> None:
    """Makes JAX name another device."""
    monkeypatch.setattr(
        jax, "devices", lambda: [SimpleNamespace(platform=platform, device_kind=kind)]
    )


def test_workers_of_a_gpu_get_it_and_who_starts_them_does_not():
    variables = environment.prepare("gpu")
    assert os.environ["JAX_PLATFORMS"] == "cpu"
    assert variables["JAX_PLATFORMS"] == "cuda"
    assert variables["XLA_PYTHON_CLIENT_PREALLOCATE"] == "false"
    flags = variables["XLA_FLAGS"].split()
    own = os.environ["XLA_FLAGS"].split()
    assert set(flags) - set(own) == {"--xla_gpu_deterministic_ops=true"}
    assert set(own) < set(flags)


def test_workers_of_a_cpu_need_nothing_besides():
    assert environment.prepare("cpu") == {}
    assert os.environ["JAX_PLATFORMS"] == "cpu"
    os.environ["JAX_PLATFORMS"] = ""  # the first there is: a GPU, should there be one
    assert environment.prepare() == {}
    assert os.environ["JAX_PLATFORMS"] == "cpu"


def test_what_the_user_has_set_stays():
    os.environ |= {"JAX_PLATFORMS": "rocm", "XLA_PYTHON_CLIENT_PREALLOCATE": "true"}
    variables = environment.prepare("gpu")
    assert (variables["JAX_PLATFORMS"], variables["XLA_PYTHON_CLIENT_PREALLOCATE"]) == (
        "rocm",
        "true",
    )
    os.environ["JAX_PLATFORMS"] = "cuda"
    environment.prepare("cpu")
    assert os.environ["JAX_PLATFORMS"] == "cuda"


@pytest.mark.parametrize(
    ("args", "workers", "batch", "platforms"),
    [
        (["platform=gpu", "workers=3"], 1, 200, "cuda"),
        (["workers=3"], 3, 1, None),
        (["batch=7"], 2, 7, None),
    ],
)
def test_the_switch_reaches_the_study(
    args, workers, batch, platforms, tmp_path, capsys, monkeypatch
):
    given: dict[str, Any] = {}

    def run_study(
        cells: Any,
        order: StudyOrder,
        root: Any,
        task: TrialFunctions,
        workers: LocalWorkers,
        command: Any,
    ) -> None:
        given.update(cells=cells, workers=workers.count, own_environment=workers.own_environment)
        raise ConfigError("far enough")

    def lanes(count: int, setup: WorkerSetup) -> LocalWorkers:
        given.update(variables=setup.variables)
        return LocalWorkers(count, setup)

    monkeypatch.setattr(runner, "run_study", run_study)
    monkeypatch.setattr(start_workers, "LocalWorkers", lanes)
    assert call(tmp_path, capsys, "run", *SMALL, *args).err == "mppi-belief: far enough\n"
    (cell,) = given["cells"]
    assert (given["workers"], cell.config["batch"]) == (workers, batch)
    assert given["variables"].get("JAX_PLATFORMS") == platforms
    assert given["own_environment"] == (platforms is not None)


def test_without_a_gpu_it_is_one_line_that_names_the_extra_and_nothing_is_written(tmp_path, capfd):
    if any(device.platform == "gpu" for device in jax.devices()):
        pytest.skip("there is a GPU")
    for platforms in (None, "cpu"):
        changed = {} if platforms is None else {"JAX_PLATFORMS": platforms}
        answer = call(tmp_path, capfd, "run", *SMALL, "n_trials=2", "platform=gpu", **changed)
        assert (answer.code, answer.out) == (2, "")
        line = answer.err.splitlines()[-1]
        extra = r"the extra \"gpu\": pip install \"\.\[gpu\]\" in the checkout"
        selected = rf"JAX_PLATFORMS={platforms or 'cuda'}\b"
        assert re.fullmatch(rf"mppi-belief: platform=gpu: .*{extra}.*{selected}.*", line)
        assert "Traceback" not in answer.err
        assert files_in(tmp_path) == []


def test_a_gpu_is_named_and_multiplies_in_full_precision(monkeypatch):
    config = compose(*SMALL, "platform=gpu")
    pretend(monkeypatch, "gpu", "NVIDIA H100 80GB HBM3")
    assert device(config) == "NVIDIA H100 80GB HBM3"
    with computing(config):
        assert jax.config.jax_default_matmul_precision == "highest"
    assert jax.config.jax_default_matmul_precision is None
    with pytest.raises(
        ConfigError, match=r"^platform=cpu: needs JAX_PLATFORMS unset or cpu; .*on the gpu$"
    ):
        device(config | {"platform": "cpu"})


def test_nothing_is_computed_anywhere_else(monkeypatch):
    config = compose(*SMALL, "platform=gpu") | {"record": 0}
    check(config)  # which computes nothing
    pretend(monkeypatch, "cpu", "cpu")
    for compute in (lambda config: run_trials(config, [0]), time_steps, record):
        with pytest.raises(ConfigError, match=r"^platform=gpu: .* JAX computes on the cpu$"):
            compute(config)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (AssertionError(), "none is there"),
        (RuntimeError("Unable to load it (set JAX_PLATFORMS='' to choose)"), "Unable to load it"),
        (RuntimeError("first\nsecond"), "first"),
    ],
)
def test_the_reason_for_no_device_is_one_line(error, words, monkeypatch):
    def devices() -> list[Any]:
        raise error

    monkeypatch.setattr(jax, "devices", devices)
    with pytest.raises(ConfigError, match=rf"^platform=gpu: [^\n]*: {words}$") as caught:
        device(compose(*SMALL, "platform=gpu"))
    assert "\n" not in str(caught.value)


def test_a_plugin_that_fails_is_the_reason_and_no_traceback(monkeypatch, caplog):
    def devices() -> list[Any]:
        log = logging.getLogger(BACKEND_LOGGER)
        try:
            raise RuntimeError("Unable to load CUDA. Is it installed?")
        except RuntimeError:
            log.exception("Jax plugin configuration error")
        raise RuntimeError("Backend 'cuda' is not in the list of known backends")

    monkeypatch.setattr(jax, "devices", devices)
    with pytest.raises(ConfigError, match=r": Unable to load CUDA. Is it installed\?$"):
        device(compose(*SMALL, "platform=gpu"))
    assert caplog.records == []


def test_the_setting_of_jax_is_made_where_a_process_starts_to_compute_and_not_at_import():
    program = (
        "import jax\n"
        "import mppi_belief.trial, mppi_belief.verify.compute\n"
        "name = 'jax_cpu_enable_async_dispatch'\n"
        "before = jax.config.read(name)\n"
        "mppi_belief.trial.device({'platform': 'cpu'})\n"
        "print(before, jax.config.read(name))\n"
    )
    environment = dict(os.environ, JAX_PLATFORMS="cpu")
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["True", "False"]
