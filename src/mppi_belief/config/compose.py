"""From a request to the configurations of its cells: parse, compose, check, label.

    words        ["sweep=theta", "seed=3"]        typed by a person, parsed by `mppi_belief.cli`
      |
    Request      overrides, --config-dir, -m      `request.py`
      | grids
    [Request]    one for each yaml file of a study
      | jobs
    [Job]        one per combination of swept values (`sweep.py`), composed by Hydra
      | _configuration
    [dict]       plain values, every `${...}` resolved, checked (`settings.py`)
      | _labels, fingerprints
    [dict]       with `names` (option of each group), `swept` (what was set), `code` (a user's own)

`collect` does all of it, so a mistake in any cell is found before the first trial of any other.
`Cell` (cell.py) gives each dict its identity.

Of Hydra this module uses `initialize_config_dir`, `compose` and the `ConfigStore`: a job is a
composed configuration. Hydra starts no launcher, sweeper, callback or logger, makes no folder, and
reads no command line.
"""

import dataclasses
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from omegaconf import DictConfig, OmegaConf

from ..errors import ConfigError
from . import sweep
from .conf_files import conf_dir
from .hydra_errors import one_line
from .request import Request, key_of
from .settings import Settings, batch_size
from .settings import check as check_settings
from .targets import fingerprints

# Settings that do not change what a trial is.
RUNTIME_KEYS = (
    "n_trials",
    "workers",
    "results_dir",
    "report_dir",
    "verify_dir",
    "record",
    "executor",
    "shard",
    "trial_timeout",
)
NAMED_GROUPS = ("system", "cost", "filter", "controller")  # their options name a cell
LONGEST_WORD = 10_000  # characters of an override
HYDRA_KEYS = ("hydra.mode", "hydra.sweeper.params")  # all that is heeded of Hydra's own settings


class Job(NamedTuple):
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
        labels = _labels(job, config)
        check_settings(config)
        configs.append(config | labels)
    _check_shared_settings(configs)
    for config in configs:
        config["code"] = fingerprints(config, request.config_dirs)
    return configs


def grids(request: Request) -> list[Request]:
    """Returns one request for each grid of a study NAME: NAME.yaml, then every NAME.*.yaml beside
    it.

    A grid crosses all that it sweeps, so methods whose settings are different keys need a grid
    each. A request that sets a key which NAME.yaml sweeps asks for a part of that grid, and for no
    other.
    """
    for position, override in enumerate(request.overrides):
        group, _, study = override.partition("=")
        if group != "experiment":
            continue
        files = _studies(request)
        keys = {key_of(word) for word in request.overrides}
        if study not in files or swept_keys(files[study]) & keys:
            return [request]
        names = [study, *(name for name in sorted(files) if name.startswith(f"{study}."))]
        before = request.overrides[:position]
        after = request.overrides[position + 1 :]
        return [
            dataclasses.replace(request, overrides=(*before, f"experiment={name}", *after))
            for name in names
        ]
    return [request]


def swept_keys(path: Path) -> set[str]:
    """Returns the keys that a study's file sweeps."""
    try:
        return set(OmegaConf.select(OmegaConf.load(path), "hydra.sweeper.params") or ())
    except Exception as error:
        raise ConfigError(one_line(error, conf_dir())) from error


def jobs(request: Request) -> list[Job]:
    """Returns the jobs of one grid, composed but not checked. Raises `ConfigError`."""
    with _composing(request):
        return list(_jobs(request))


def first_job(request: Request) -> Job:
    """Returns the first job of a request, composed but not checked, to be shown. Raises
    `ConfigError`.
    """
    with _composing(request):
        return next(_jobs(grids(request)[0]))


def _jobs(request: Request) -> Iterator[Job]:
    """Yields the job that the overrides describe, or each of the sweep that they or a yaml file ask
    for.
    """
    from hydra.types import RunMode

    choices = sweep.choices_of(request.overrides)
    config = _compose(request, sweep.first(choices))
    if not request.multirun and config.hydra.mode != RunMode.MULTIRUN:
        for choice in choices:
            if len(choice.overrides) > 1:
                raise ConfigError(f"{choice.word}: several values; add -m to sweep over them")
        yield _job(list(request.overrides), config)
        return
    swept = OmegaConf.to_container(config.hydra.sweeper, resolve=True)
    params = swept.get("params") if isinstance(swept, dict) else None
    for overrides in sweep.product(sweep.choices_of(request.overrides, params)):
        yield _job(overrides, _compose(request, overrides))


def _compose(request: Request, overrides: Sequence[str]) -> DictConfig:
    """Returns the configuration that Hydra composes from conf/, the folders of the request and some
    overrides.
    """
    import hydra
    from hydra.core.override_parser.types import Quote, QuotedString

    folders = [f"file://{Path(folder).resolve()}" for folder in request.config_dirs]
    quoted = [QuotedString(text=folder, quote=Quote.single).with_quotes() for folder in folders]
    search_path = [f"hydra.searchpath=[{','.join(quoted)}]"] if quoted else []
    return hydra.compose("config", [*search_path, *overrides], return_hydra_config=True)


def _job(overrides: list[str], composed: DictConfig) -> Job:
    keys = [str(key) for key in composed if key != "hydra"]
    options = {
        str(group): option
        for group, option in composed.hydra.runtime.choices.items()
        if not str(group).startswith("hydra/")
    }
    return Job(overrides, OmegaConf.masked_copy(composed, keys), options)


@contextmanager
def _composing(request: Request) -> Iterator[None]:
    """Initialises Hydra for one request; what it raises becomes a `ConfigError` of one line."""
    from hydra import initialize_config_dir
    from hydra.core.config_store import ConfigStore

    _check_words(request.overrides)
    for folder in request.config_dirs:
        if not Path(folder).is_dir():
            raise ConfigError(f"--config-dir {folder}: no such folder")
    ConfigStore.instance().store(name="schema", node=Settings)
    try:
        with initialize_config_dir(str(conf_dir()), job_name="mppi-belief", version_base="1.3"):
            yield
    except Exception as error:
        raise ConfigError(one_line(error, conf_dir())) from error


def _check_words(overrides: Sequence[str]) -> None:
    """Raises `ConfigError` for words that no setting is made of, before they are parsed."""
    for word in overrides:
        if len(word) > LONGEST_WORD:
            raise ConfigError(f"{word[:40]}...: longer than {LONGEST_WORD} characters")
        if not word.isprintable():  # control characters, bytes that are not UTF-8
            raise ConfigError(f"{word}: must be printable text")
        key = key_of(word)
        if "hydra" in re.split(r"[@:./]", key) and not key.startswith(HYDRA_KEYS):
            raise ConfigError(f"{key} cannot be set; only {' and '.join(HYDRA_KEYS)} are heeded")
    for group in ("sweep", "experiment"):
        if any(word.startswith(f"{group}=") and "," in word for word in overrides):
            raise ConfigError(f"{group}: choose one")


def _studies(request: Request) -> dict[str, Path]:
    """Returns the file of every study by its name; as in Hydra, conf/ comes before the folders of
    --config-dir.
    """
    files: dict[str, Path] = {}
    for folder in reversed([conf_dir(), *map(Path, request.config_dirs)]):
        files |= {path.stem: path for path in sorted((folder / "experiment").glob("*.yaml"))}
    return files


def _configuration(job: Job) -> dict[str, Any]:
    """Returns a job's configuration as plain values. Raises `ConfigError`."""
    try:
        config: Any = OmegaConf.to_container(job.config, resolve=True)
    except Exception as error:
        raise ConfigError(one_line(error, conf_dir())) from error
    return {str(key): value for key, value in config.items()}


def _labels(job: Job, config: dict[str, Any]) -> dict[str, Any]:
    """Returns what a configuration is called (`names`), what was set (`swept`), and the size of its
    batches.
    """
    names = _names(job.options, config)
    keys = [key_of(override) for override in job.overrides]
    no_label = (*RUNTIME_KEYS, "sweep", "experiment", "hydra")
    swept = {
        label_of(key): names.get(key) or job.options.get(key) or _scalar(config, key)
        for key in keys
        if key.split(".")[0] not in no_label
    }
    return {"names": names, "swept": swept, "batch": batch_size(config)}


def label_of(key: str) -> str:
    """Returns what a swept key is called in rows and reports: a part of the controller,
    `controller/sampler`, `sampler`.
    """
    return key.rpartition("/")[2]


def _names(options: dict[str, str | None], config: dict[str, Any]) -> dict[str, str]:
    """Returns the option of each group that names a cell. Raises `ConfigError` for one that is no
    file of its group.

    A system's file may give the cost itself, which then has the system's name.
    """
    for group, option in options.items():
        if option is not None and not re.fullmatch(r"\w[\w.-]*", str(option)):
            raise ConfigError(f"{group}={option}: an option is one word")
    chosen = dict(options)
    if chosen.get("cost") is None and config.get("cost"):
        chosen["cost"] = chosen.get("system")
    for group in NAMED_GROUPS:
        if chosen.get(group) is None:
            raise ConfigError(f"{group}: one must be chosen")
    return {group: str(chosen[group]) for group in NAMED_GROUPS}


def _scalar(config: dict[str, Any], key: str) -> Any:
    """Returns the value of a dotted key; lists and dicts as JSON, so that it fits a column."""
    value: Any = config
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return json.dumps(value) if isinstance(value, list | dict) else value


def _check_shared_settings(configs: Sequence[dict[str, Any]]) -> None:
    """Raises `ConfigError` where a setting that all cells of a study share differs between them."""
    first = configs[0]
    for key in RUNTIME_KEYS:
        if any(config[key] != first[key] for config in configs):
            raise ConfigError(f"{key} cannot be swept: it does not change what a trial is")
    if any(config["platform"] != first["platform"] for config in configs):
        raise ConfigError("platform cannot be swept: a study is run on one device")
