"""The group `executor` of a configuration: which workers a study gets, with the ranges of the
settings.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, get_type_hints

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from ..errors import ConfigError, first_line, unknown_key
from ..fields import Number, Text, WholeNumber, checked, ruled, rules
from .folders import FolderName

_ADDRESS = Text(r"(\w+://)?\S+:\d+", "an address such as tcp://HOST:8786", optional=True)
_MEMORY = Text(r"\d+(\.\d+)?\s*[KMGT]i?B", "an amount such as 2GB")
TEXT_TYPES = (str, str | None, list[str])
_TIME = Text(r"(\d+-)?\d{1,2}:\d{2}:\d{2}", "a time such as 01:30:00")


@dataclass
class LocalExecutor:
    """Describes worker processes on this machine."""


@dataclass
class DaskExecutor:
    """Describes the workers of a Dask scheduler."""

    address: str | None = ruled(_ADDRESS, None)  # of the scheduler; None: start one here
    patience: float = ruled(Number(gt=0), 60.0)  # s until the scheduler must answer


@dataclass
class SlurmExecutor:
    """Describes Dask workers in jobs of Slurm, each with one core."""

    partition: str | None = None
    account: str | None = None
    memory: str = ruled(_MEMORY, "2GB")  # of each worker
    walltime: str = ruled(_TIME, "01:00:00")  # of each job
    workers_per_job: int = ruled(WholeNumber(ge=1), 1)
    directives: list[str] = field(default_factory=list)  # further lines #SBATCH
    interface: str | None = None  # the network interface, such as ib0
    logs: str | None = ruled(FolderName(optional=True), None)  # of the jobs' output; None: not kept


Executor = LocalExecutor | DaskExecutor | SlurmExecutor
KINDS: dict[str, Callable[[], Any]] = {
    "local": LocalExecutor,
    "dask": DaskExecutor,
    "slurm": SlurmExecutor,
}


def read_executor(node: dict[str, Any]) -> Executor:
    """Returns the settings of an executor; raises `ConfigError` for a wrong key, type or value."""
    kind: Any = KINDS.get(str(node.get("kind")))
    if kind is None:
        raise ConfigError(f"executor.kind={node.get('kind')}: must be one of {', '.join(KINDS)}")
    values = {key: value for key, value in node.items() if key != "kind"}
    known = [f"executor.{setting.name}" for setting in fields(kind)]
    for key in values:
        if f"executor.{key}" not in known:
            raise ConfigError(unknown_key(f"executor.{key}", known))

    # OmegaConf converts and checks the types, the rules check the ranges.
    _check_texts(kind, values)
    try:
        settings: Any = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(kind), values))
    except OmegaConfBaseException as error:
        key = getattr(error, "full_key", None) or next(iter(values), "")
        message = first_line(error)
        raise ConfigError(f"executor.{key}={values.get(key)}: {message}") from error
    for name, rule in rules(kind).items():
        try:
            setattr(settings, name, checked(name, getattr(settings, name), rule))
        except ValueError as error:
            raise ConfigError(f"executor.{error}") from error
    return settings


def folders_of(settings: Executor) -> dict[str, str | None]:
    """Returns the settings of an executor that name folders, with the home folder for `~`."""
    names = [name for name, rule in rules(type(settings)).items() if isinstance(rule, FolderName)]
    return {name: getattr(settings, name) for name in names}


def _check_texts(kind: Any, values: dict[str, Any]) -> None:
    """Raises `ConfigError` for a number in place of a text: OmegaConf would write it anew."""
    hints = get_type_hints(kind)
    for name, value in values.items():
        texts = value if hints[name] == list[str] and isinstance(value, list) else [value]
        for text in texts:
            if hints[name] in TEXT_TYPES and not isinstance(text, str | None):
                raise ConfigError(
                    f"executor.{name}: {text!r} must be a text; in a list or a mapping of the "
                    "command line a text that looks like a number has quotes"
                )
