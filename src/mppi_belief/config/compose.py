"""Composes the configurations of the cells of a request: parse, compose, check, label.

    words            ["sweep=theta", "seed=3"]    typed by a person, parsed by `mppi_belief.cli`
      |
    Request          overrides, --config-dir, -m  `request.py`
      | grids
    [Request]        one per yaml file of a study (`studies.py`)
      | jobs
    [ComposedJob]    one per combination of swept values (`sweep.py`), composed by Hydra
      | _configuration, check_settings
    [dict]           plain values, every `${...}` resolved, types and ranges checked (`settings.py`)
      | cell_labels, fingerprints
    [dict]           with `names` (option of each group), `swept` (given settings), `code` (own
                     modules)

`collect` does all of it, so a mistake in any cell is found before the first trial of any other.
`Cell` (cell.py) gives each dict its identity.

Of Hydra this module uses `initialize_config_dir`, `compose` and the `ConfigStore`: a job is a
composed configuration. Hydra starts no launcher, sweeper, callback or logger, makes no folder, and
reads no command line.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

from omegaconf import DictConfig, OmegaConf

from ..errors import ConfigError
from . import sweep
from .cell_labels import cell_labels
from .conf_files import conf_dir
from .hydra_errors import config_error_line
from .hydra_words import quoted
from .request import Request, key_of
from .settings import RUNTIME_KEYS, Settings, check_settings
from .studies import grids
from .targets import fingerprints

LONGEST_WORD = 10_000  # characters of an override
# Keys of the top level that are no groups.
ALWAYS_SET = [setting.name for setting in fields(Settings) if setting.type != dict[str, Any]]
HYDRA_KEYS = ("hydra.mode", "hydra.sweeper.params")  # of Hydra's own settings, those in use


class ComposedJob(NamedTuple):
    """Holds one composed configuration and what it was composed from."""

    overrides: list[str]  # words of the command line and of a sweep
    config: DictConfig  # without Hydra's own settings; `${...}` unresolved
    options: dict[str, str | None]  # the chosen option of each group


def collect(request: Request) -> list[dict[str, Any]]:
    """Returns the configuration of every cell that a request asks for, checked.

    Each is a dict of plain values: the top level of conf/config.yaml and its groups, with `names`,
    `swept` and `code`. Raises `ConfigError`.
    """
    jobs_of_request = [job for grid in grids(request) for job in jobs(grid)]
    configs = []
    for job in jobs_of_request:
        config = _configuration(job)
        labels = cell_labels(job.overrides, job.options, config)
        check_settings(config)
        configs.append(config | labels)
    _check_shared_settings(configs)
    for config in configs:
        config["code"] = fingerprints(config, request.config_dirs)
    return configs


def jobs(request: Request) -> list[ComposedJob]:
    """Returns the jobs of one grid, composed but not checked. Raises `ConfigError`."""
    with _composing(request):
        return list(_jobs(request))


def first_job(request: Request) -> ComposedJob:
    """Returns the first job of a request, composed but not checked, to be shown. Raises
    `ConfigError`.
    """
    with _composing(request):
        return next(_jobs(grids(request)[0]))


def _jobs(request: Request) -> Iterator[ComposedJob]:
    """Yields the job that the overrides describe, or each of the sweep that they or a yaml file ask
    for.
    """
    from hydra.types import RunMode

    choices = sweep.choices_of(request.overrides, request.config_dirs)
    config = _compose(request, sweep.first(choices))
    if not request.multirun and config.hydra.mode != RunMode.MULTIRUN:
        for choice in choices:
            if len(choice.overrides) > 1:
                raise ConfigError(f"{choice.word}: several values; add -m to sweep over them")
        yield _job(list(request.overrides), config)
        return
    swept = OmegaConf.to_container(config.hydra.sweeper, resolve=True)
    params = swept.get("params") if isinstance(swept, dict) else None
    choices = sweep.choices_of(request.overrides, request.config_dirs, params)
    for overrides in sweep.product(choices):
        yield _job(overrides, _compose(request, overrides))


def _compose(request: Request, overrides: Sequence[str]) -> DictConfig:
    """Returns the configuration that Hydra composes from conf/, the folders of the request and some
    overrides.
    """
    import hydra

    from .yaml_source import address

    addresses = [quoted(address(Path(folder).resolve())) for folder in request.config_dirs]
    search_path = [f"hydra.searchpath=[{','.join(addresses)}]"] if addresses else []
    return hydra.compose("config", [*search_path, *overrides], return_hydra_config=True)


def _job(overrides: list[str], composed: DictConfig) -> ComposedJob:
    keys = [str(key) for key in composed if key != "hydra"]
    options = {
        str(group): option
        for group, option in composed.hydra.runtime.choices.items()
        if not str(group).startswith("hydra/")
    }
    return ComposedJob(overrides, OmegaConf.masked_copy(composed, keys), options)


@contextmanager
def _composing(request: Request) -> Iterator[None]:
    """Initialises Hydra for one request; what it raises becomes a `ConfigError` of one line."""
    from hydra import initialize_config_dir
    from hydra.core.config_store import ConfigStore

    from . import yaml_source

    _check_words(request.overrides)
    for folder in request.config_dirs:
        if not Path(folder).is_dir():
            raise ConfigError(f"--config-dir {folder}: no such folder")
    yaml_source.register()
    ConfigStore.instance().store(name="schema", node=Settings)
    try:
        with initialize_config_dir(str(conf_dir()), job_name="mppi-belief", version_base="1.3"):
            yield
    except Exception as error:
        raise ConfigError(config_error_line(error, request.config_dirs)) from error


def _check_words(overrides: Sequence[str]) -> None:
    """Raises `ConfigError` for words that cannot be settings, before they are parsed."""
    for word in overrides:
        if len(word) > LONGEST_WORD:
            raise ConfigError(f"{word[:40]}...: longer than {LONGEST_WORD} characters")
        if not word.isprintable():  # control characters, bytes that are not UTF-8
            raise ConfigError(f"{word}: must be printable text")
        key = key_of(word)
        if "=" not in word and not word.startswith("~"):
            raise ConfigError(f"{word}: must have the form KEY=VALUE")
        if word.startswith("~") and key in ALWAYS_SET:
            raise ConfigError(f"{word}: {key} cannot be removed, only set to another value")
        if "hydra" in re.split(r"[@:./]", key) and not key.startswith(HYDRA_KEYS):
            raise ConfigError(f"{key} cannot be set; of Hydra only {' and '.join(HYDRA_KEYS)} can")
    for group in ("sweep", "experiment"):
        if any(word.startswith(f"{group}=") and "," in word for word in overrides):
            raise ConfigError(f"{group}: choose one")


def _configuration(job: ComposedJob) -> dict[str, Any]:
    """Returns a job's configuration as plain values. Raises `ConfigError`."""
    try:
        config: Any = OmegaConf.to_container(job.config, resolve=True)
    except Exception as error:
        raise ConfigError(config_error_line(error)) from error
    return {str(key): value for key, value in config.items()}


def _check_shared_settings(configs: Sequence[dict[str, Any]]) -> None:
    """Raises `ConfigError` where a setting that all cells of a study share differs between them."""
    shared = configs[0]
    for key in RUNTIME_KEYS:
        if any(config[key] != shared[key] for config in configs):
            raise ConfigError(f"{key} cannot be swept: it does not change what a trial is")
    if any(config["platform"] != shared["platform"] for config in configs):
        raise ConfigError("platform cannot be swept: a study is run on one device")
