"""The jobs of a command line, composed by Hydra and by nothing else of it.

Hydra would also make folders, write logs, change the working directory, and call whatever class a configuration names
as its launcher, sweeper or callback. None of that happens here: a job is a composed configuration.
"""

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from ..errors import ConfigError
from .yaml_files import read_yaml

MOST_JOBS = 10_000  # of a sweep
OURS = (
    "mode",
    "sweeper",
    "runtime",
    "overrides",
    "job",
    "searchpath",
)  # of Hydra's settings: ours, or told by it


def jobs(conf: Path, folders: Sequence[str], words: Sequence[str], multirun: bool) -> Iterator[Any]:
    """The configuration of each job with Hydra's own settings under `hydra`, set as its current one meanwhile.

    `conf` is the folder with the primary configuration, `folders` have more, `words` are Hydra's overrides. Raises
    what Hydra and OmegaConf raise, and `ConfigError`.
    """
    from hydra._internal.utils import create_config_search_path
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.hydra_config import HydraConfig
    from hydra.version import setbase

    setbase("1.3")
    _teach_hydra()
    path = create_config_search_path(str(conf))
    for folder in map(Path, folders):
        if not folder.is_dir():
            raise ConfigError(f"--config-dir {folder}: no such folder")
        path.prepend("command-line", f"checked://{folder.resolve()}", _schema())
    before = HydraConfig.instance().cfg
    try:
        usual = _usual(conf) if folders else None
        for config in _composed(_loader(path), list(words), multirun, usual):
            HydraConfig.instance().set_config(config)
            yield config
    finally:
        HydraConfig.instance().cfg = before
        GlobalHydra.instance().clear()


@functools.cache
def _teach_hydra() -> None:
    """Files of --config-dir are read by `read_yaml`: Hydra knows sources of configurations by their scheme."""
    from hydra._internal.core_plugins.file_config_source import FileConfigSource
    from hydra.core.plugins import Plugins
    from hydra.plugins.config_source import ConfigResult

    class CheckedFileSource(FileConfigSource):
        @staticmethod
        def scheme() -> str:
            return "checked"

        def load_config(self, config_path: str) -> ConfigResult:
            text, config = read_yaml(Path(self.path, self._normalize_file_name(config_path)))
            header = self._get_header_dict(text[:512])
            return ConfigResult(
                config=config, path=f"file://{self.path}", provider=self.provider, header=header
            )

    Plugins.instance().register(CheckedFileSource)


def _schema() -> Any:
    from hydra.core.config_search_path import SearchPathQuery

    return SearchPathQuery(provider="schema")


def _loader(path: Any) -> Any:
    from hydra._internal.hydra import Hydra
    from hydra.core.global_hydra import GlobalHydra

    GlobalHydra.instance().clear()  # there is one at a time
    return Hydra.create_main_hydra2("mppi-belief", path).config_loader


def _composed(
    loader: Any, words: list[str], multirun: bool, usual: dict[str, Any] | None
) -> Iterator[Any]:
    """The configuration of the one job, or of each of a sweep."""
    from hydra.types import RunMode

    if not (multirun or _sweeps(loader, words)):
        config = loader.load_configuration("config", words, RunMode.RUN)
        _refuse_others(config, usual)
        yield config
        return
    main = loader.load_configuration("config", words, RunMode.MULTIRUN)
    _refuse_others(main, usual)
    params = OmegaConf.to_container(main.hydra.sweeper, resolve=True)
    swept = params.get("params") or {} if isinstance(params, dict) else {}
    task: Any = OmegaConf.to_container(main.hydra.overrides.task, resolve=False)
    for job in _product(
        loader, [*(f"{key}={value}" for key, value in swept.items()), *map(str, task)]
    ):
        config = loader.load_sweep_config(main, job)
        _refuse_others(config, usual)
        yield config


def _sweeps(loader: Any, words: list[str]) -> bool:
    """Whether the configuration itself asks for a sweep; one that cannot be composed is told when it is."""
    from hydra.types import RunMode

    try:
        main = loader.load_configuration(
            "config", words, RunMode.MULTIRUN, validate_sweep_overrides=False
        )
    except Exception:
        return False
    return bool(main.hydra.mode == RunMode.MULTIRUN)


def _product(loader: Any, words: list[str]) -> Iterator[list[str]]:
    """The overrides of each job: all combinations of the values that are swept."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    choices: dict[str, list[str]] = {}
    for override in OverridesParser.create(config_loader=loader).parse_overrides(words):
        key = override.get_key_element()
        if not override.is_sweep_override():
            choices[key] = [f"{key}={override.get_value_element_as_str()}"]
            continue
        if not override.is_discrete_sweep() or _is_long(override.value()):
            raise ConfigError(
                f"{override.input_line}: a sweep takes a list of at most {MOST_JOBS} values"
            )
        values = [f"{key}={value}" for value in override.sweep_string_iterator()]
        if not values:
            raise ConfigError(f"{override.input_line}: no value to sweep over")
        choices[key] = values
    if math.prod(map(len, choices.values())) > MOST_JOBS:
        raise ConfigError(f"a sweep of more than {MOST_JOBS} settings")
    return map(list, itertools.product(*choices.values()))


def _is_long(sweep: Any) -> bool:
    """Whether a range has more values than anyone would run: it is counted, not listed."""
    if not hasattr(sweep, "step"):
        return False
    return not sweep.step or not (sweep.stop - sweep.start) / sweep.step <= MOST_JOBS


@functools.cache
def _usual(conf: Path) -> dict[str, Any]:
    """What `conf` sets of Hydra itself."""
    from hydra._internal.utils import create_config_search_path
    from hydra.types import RunMode

    return _settings(
        _loader(create_config_search_path(str(conf))).load_configuration("config", [], RunMode.RUN)
    )


def _settings(config: Any) -> dict[str, Any]:
    """What a configuration sets of Hydra itself, beyond what is ours."""
    hydra: Any = OmegaConf.to_container(config.hydra, resolve=False)
    job = {f"job.{key}": hydra["job"].get(key) for key in ("chdir", "env_set", "env_copy")}
    return {key: value for key, value in hydra.items() if key not in OURS} | job


def _refuse_others(config: Any, usual: dict[str, Any] | None) -> None:
    """Raise `ConfigError` where somebody's yaml sets what only Hydra would heed."""
    if usual is not None:
        for key, value in _settings(config).items():
            if value != usual.get(key):
                raise ConfigError(
                    f"hydra.{key} cannot be set; only hydra.mode and hydra.sweeper.params are heeded"
                )
