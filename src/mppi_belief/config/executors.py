"""The group `executor` of a configuration: which workers a study gets, with the ranges of the
settings.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from ..errors import ConfigError, first_line, unknown_key
from ..fields import Number, Text, WholeNumber, checked, ruled, rules

_MEMORY = Text(r"\d+(\.\d+)?\s*[KMGT]i?B", "an amount such as 2GB")
_TIME = Text(r"(\d+-)?\d{1,2}:\d{2}:\d{2}", "a time such as 01:30:00")


@dataclass
class LocalExecutor:
    """Describes worker processes on this machine."""


@dataclass
class DaskExecutor:
    """Describes the workers of a Dask scheduler."""

    address: str | None = None  # of the scheduler; None: start one here
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
    logs: str | None = None  # the folder of the jobs' output; None: it is not kept


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
    try:
        settings: Any = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(kind), values))
    except OmegaConfBaseException as error:
        key = getattr(error, "full_key", None) or next(iter(values), "")
        message = first_line(error)
        raise ConfigError(f"executor.{key}={values.get(key)}: {message}") from error
    for name, rule in rules(kind).items():
        try:
            checked(name, getattr(settings, name), rule)
        except ValueError as error:
            raise ConfigError(f"executor.{error}") from error
    return settings
