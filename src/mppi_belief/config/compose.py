"""From the words of a command line to configurations. The only file that imports Hydra.

Collect, then execute: Hydra composes one configuration per job of a sweep and hands it to a function
that only puts it on a list; when all are there they are checked as a whole.
"""

import contextlib
import io
import json
import os
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from ..errors import ConfigError, unknown_key
from .conf_files import conf_dir
from .hydra_errors import one_line
from .settings import Settings, batch_size
from .settings import check as check_settings
from .sweep import jobs
from .targets import fingerprints
from .yaml_files import read_yaml

# they do not change what a trial is
RUNTIME_KEYS = (
    *("n_trials", "workers", "results_dir", "report_dir", "verify_dir", "record"),
    *("executor", "shard", "trial_timeout"),
)
NAMED_GROUPS = ("system", "cost", "filter", "controller")
FOLDER = ("--config-dir", "-cd")
PRINTING = ("--help", "-h", "--cfg", "-c", "--info", "-i", "--shell-completion", "-sc")
VALUED = (*FOLDER, "--cfg", "-c", "--info", "-i", "--package", "-p")
FLAGS = ("--help", "-h", "--multirun", "-m", "--resolve", "--shell-completion", "-sc")
LONGEST_WORD = 10_000  # characters of an argument


def compose(args: Sequence[str], job: Callable[[Any], None]) -> None:
    """Compose the configuration of each job and call `job` with it, or let Hydra print what a flag asks for; raises
    `ConfigError`."""
    import hydra
    from hydra.core.config_store import ConfigStore

    ConfigStore.instance().store(name="schema", node=Settings)
    os.environ["HYDRA_FULL_ERROR"] = "1"  # exceptions come to us, not to Hydra's own printer
    flags, overrides, folders = parse(args)
    _check_words(overrides)
    sys.argv = ["mppi-belief", *flags, *overrides]  # the only order that argparse takes
    said = io.StringIO()
    prints = any(flag.partition("=")[0] in PRINTING for flag in flags)
    if not prints and any(
        flag.partition("=")[0] in ("--package", "-p", "--resolve") for flag in flags
    ):
        raise ConfigError("--package and --resolve go with --cfg")
    with tempfile.TemporaryDirectory(prefix="mppi-belief-") as scratch:
        os.environ["MPPI_BELIEF_SCRATCH"] = scratch  # what Hydra would take for the folder of a run
        try:
            with contextlib.redirect_stderr(said):
                if (
                    folders or not prints
                ):  # what somebody else's yaml says is looked at before Hydra acts on it
                    multirun = any(flag in ("-m", "--multirun") for flag in flags)
                    for composed in jobs(conf_dir(), folders, overrides, multirun):
                        if not prints:
                            job(
                                OmegaConf.masked_copy(
                                    composed, [key for key in composed if key != "hydra"]
                                )
                            )
                if prints:
                    hydra.main(
                        version_base="1.3", config_path=str(conf_dir()), config_name="config"
                    )(job)()
        except SystemExit as stop:
            if stop.code not in (None, 0):
                last = (said.getvalue().strip().splitlines() or ["cannot be understood"])[-1]
                raise ConfigError(last.partition("error: ")[2] or last) from None
        except Exception as error:
            raise ConfigError(one_line(error, conf_dir())) from error


def parse(args: Sequence[str]) -> tuple[list[str], list[str], list[str]]:
    """The flags with their values, which may stand anywhere; all other words; the folders of --config-dir, where
    modules beside a user's yaml can be named. Raises `ConfigError` for a flag that is not ours."""
    flags, words, folders, left = [], [], [], list(args)
    while left:
        arg = left.pop(0)
        name, equals, value = arg.partition("=")
        if not arg.startswith("-"):
            words.append(arg)
            continue
        if name not in (*FLAGS, *VALUED):
            raise ConfigError(unknown_key(name, (*FLAGS, *VALUED), what="option"))
        flags.append(arg)
        if name in VALUED and not equals and left and (name in FOLDER or "=" not in left[0]):
            value = left.pop(0)
            flags.append(value)
        if name in FOLDER:
            folders.append(value)
    return flags, words, folders


def _check_words(words: Sequence[str]) -> None:
    """Raise `ConfigError` for words that no setting is made of, before they are parsed."""
    for word in words:
        if len(word) > LONGEST_WORD:
            raise ConfigError(f"{word[:40]}...: longer than {LONGEST_WORD} characters")
        if not word.isprintable():  # control characters, bytes that are not UTF-8
            raise ConfigError(f"{word}: must be printable text")
        key = word.lstrip("+~").partition("=")[0]
        for part in re.split(r"[@:]", key):
            named = re.split(r"[./\s]", part.strip())[0]
            if (
                named == "hydra"
                and key != "hydra.mode"
                and not key.startswith("hydra.sweeper.params")
            ):
                raise ConfigError(
                    f"{key} cannot be set; only hydra.mode and hydra.sweeper.params are heeded"
                )


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
            files = {
                path.stem: path for folder in folders for path in sorted(folder.glob("*.yaml"))
            }
            if study not in files or swept(files[study]) & {
                word.partition("=")[0].lstrip("+~") for word in args
            }:
                return made
            more = [option for option in sorted(files) if option.startswith(f"{study}.")]
            made += [[*args[:at], f"{group}={option}", *args[at + 1 :]] for option in more]
    return made


def swept(grid: Path) -> set[str]:
    """The keys that a grid's file sweeps."""
    return set(OmegaConf.select(read_yaml(grid)[1], "hydra.sweeper.params") or ())


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
        names = _chosen(settings.runtime.choices, config)
        keys = [override.lstrip("+~").partition("=")[0] for override in settings.overrides.task]
        swept = [
            key for key in keys if key.split(".")[0] not in (*RUNTIME_KEYS, "sweep", "experiment")
        ]
        choices = settings.runtime.choices
        configs.append(config)
        labels.append(
            {
                "names": names,
                "swept": {
                    _label(key): names.get(key) or choices.get(key) or _scalar(config, key)
                    for key in swept
                },
            }
        )

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
    folders = parse(args)[2]
    codes = [{"code": fingerprints(config, folders)} for config in configs]
    return [
        config | label | code for config, label, code in zip(configs, labels, codes, strict=True)
    ]


def _label(key: str) -> str:
    """What a swept key is called in rows and reports: a part of the controller, `controller/sampler`, by its own name."""
    return key.rpartition("/")[2]


def _chosen(choices: Any, config: dict[str, Any]) -> dict[str, str]:
    """The option of each group that names a cell; raises `ConfigError` for one that is not a file of its group.

    A system's file may give the cost itself, which then goes by the system's name.
    """
    for group, option in choices.items():
        if (
            option is not None
            and not re.fullmatch(r"\w[\w.-]*", str(option))
            and not group.startswith("hydra")
        ):
            raise ConfigError(f"{group}={option}: an option is one word")
    options = dict(choices)
    if options.get("cost") is None and config.get("cost"):
        options["cost"] = options.get("system")
    for group in NAMED_GROUPS:
        if options.get(group) is None:
            raise ConfigError(f"{group}: one must be chosen")
    return {group: str(options[group]) for group in NAMED_GROUPS}


def _scalar(config: dict[str, Any], key: str) -> Any:
    """What `key` (dotted) is set to, lists and dicts as JSON, so that it fits a column."""
    value: Any = config
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return json.dumps(value) if isinstance(value, list | dict) else value
