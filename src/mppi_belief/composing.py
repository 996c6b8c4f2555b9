"""From the words of a command line to configurations. The only file that imports Hydra.

Collect, then execute: Hydra composes one configuration per job of a sweep and hands it to a function
that only puts it on a list; when all are there they are checked as a whole.
"""

import contextlib
import io
import json
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from .complaints import one_line
from .settings import ConfigError, Settings, batch_size
from .settings import check as check_settings

# they do not change what a trial is
RUNTIME_KEYS = (
    *("n_trials", "workers", "results_dir", "report_dir", "verify_dir", "record"),
    *("executor", "shard", "trial_timeout"),
)
NAMED_GROUPS = ("system", "cost", "filter", "controller")


def conf_dir() -> Path:
    """The configuration of the checkout this file is in, or the copy installed beside it."""
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "pyproject.toml").is_file() and (checkout / "conf").is_dir():
        return checkout / "conf"
    return Path(__file__).resolve().parent / "conf"


def compose(args: Sequence[str], job: Callable[[Any], None]) -> None:
    """Let Hydra compose the configuration of each job and call `job` with it; raises `ConfigError`."""
    import hydra
    from hydra.core.config_store import ConfigStore

    ConfigStore.instance().store(name="schema", node=Settings)
    os.environ["HYDRA_FULL_ERROR"] = "1"  # exceptions come to us, not to Hydra's own printer
    flags, overrides, _ = parse(args)
    sys.argv = ["mppi-belief", *flags, *overrides]  # the only order that argparse takes
    said = io.StringIO()
    with tempfile.TemporaryDirectory(prefix="mppi-belief-") as scratch:
        os.environ["MPPI_BELIEF_SCRATCH"] = scratch  # Hydra writes multirun.yaml somewhere
        try:
            with contextlib.redirect_stderr(said):
                hydra.main(version_base="1.3", config_path=str(conf_dir()), config_name="config")(job)()
        except SystemExit as stop:
            if stop.code not in (None, 0):
                raise ConfigError(said.getvalue().strip().splitlines()[-1].partition("error: ")[2]) from None
        except Exception as error:
            raise ConfigError(one_line(error, conf_dir())) from error


def parse(args: Sequence[str]) -> tuple[list[str], list[str], list[str]]:
    """The flags that come with a value or may stand anywhere; all other words; the folders of --config-dir, where
    modules beside a user's yaml can be named."""
    flags, words, folders, left = [], [], [], list(args)
    while left:
        arg = left.pop(0)
        if arg in ("--config-dir", "-cd") and left:
            folders.append(left.pop(0))
            flags += [arg, folders[-1]]
        elif arg.startswith("--config-dir="):
            folders.append(arg.partition("=")[2])
            flags.append(arg)
        elif arg in ("-m", "--multirun"):
            flags.append(arg)
        elif arg in ("--cfg", "-c", "--info", "-i", "--package", "-p") and left and "=" not in left[0]:
            flags += [arg, left.pop(0)]
        elif arg.startswith("-"):
            flags.append(arg)
        else:
            words.append(arg)
    return flags, words, folders


def grids(args: Sequence[str]) -> list[list[str]]:
    """The arguments of each grid of a study NAME: NAME.yaml, then every NAME.*.yaml beside it.

    One grid crosses all it sweeps; methods whose settings are different keys need one each. Setting a key that
    NAME.yaml sweeps asks for a part of that grid, and for no other.
    """
    made = [list(args)]
    for at, arg in enumerate(args):
        group, _, study = arg.partition("=")
        if group == "experiment":
            folders = [folder / group for folder in (conf_dir(), *map(Path, parse(args)[2]))]
            files = {path.stem: path for folder in folders for path in sorted(folder.glob("*.yaml"))}
            if study not in files or swept(files[study]) & {word.partition("=")[0].lstrip("+~") for word in args}:
                return made
            more = [option for option in sorted(files) if option.startswith(f"{study}.")]
            made += [[*args[:at], f"{group}={option}", *args[at + 1 :]] for option in more]
    return made


def swept(grid: Path) -> set[str]:
    """The keys that a grid's file sweeps."""
    return set(OmegaConf.select(OmegaConf.load(grid), "hydra.sweeper.params") or ())


def collect(args: Sequence[str]) -> list[dict[str, Any]]:
    """The configurations the arguments ask for, checked for types, ranges and spelling."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import DictConfig

    configs: list[dict[str, Any]] = []
    labels: list[dict[str, Any]] = []

    def job(composed: DictConfig) -> None:
        config: Any = OmegaConf.to_container(composed, resolve=True)
        config["batch"] = batch_size(config)
        settings = HydraConfig.get()
        names = {group: settings.runtime.choices[group] for group in NAMED_GROUPS}
        keys = [override.lstrip("+~").partition("=")[0] for override in settings.overrides.task]
        swept = [key for key in keys if key.split(".")[0] not in (*RUNTIME_KEYS, "sweep", "experiment")]
        configs.append(config)
        labels.append({"names": names, "swept": {key: names.get(key) or _scalar(config, key) for key in swept}})

    for group in ("sweep", "experiment"):
        if any(arg.startswith(f"{group}=") and "," in arg for arg in args):
            raise ConfigError(f"{group}: choose one")
    for grid in grids(args):
        compose(grid, job)
        if not configs:  # --help, --cfg, --info: once is enough
            return []
    for config in configs:
        check_settings(config)
    for key in RUNTIME_KEYS:
        if any(config[key] != configs[0][key] for config in configs):
            raise ConfigError(f"{key} cannot be swept: it does not change what a trial is")
    if any(config["platform"] != configs[0]["platform"] for config in configs):
        raise ConfigError("platform cannot be swept: a study is run on one device")
    return [config | label for config, label in zip(configs, labels, strict=True)]


def _scalar(config: dict[str, Any], key: str) -> Any:
    """What `key` (dotted) is set to, lists and dicts as JSON, so that it fits a column."""
    value: Any = config
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return json.dumps(value) if isinstance(value, list | dict) else value
