"""Which workers a study gets: the group `executor` of a configuration."""

import math
import os
import re
import sys
from dataclasses import dataclass, field, fields
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from ..settings import ConfigError, unknown_key
from .cluster import Cluster
from .lanes import Lanes, WorkersGone
from .pool import Workers
from .worker import Setup

NEEDS = 'needs pip install "mppi-belief[cluster]"'


@dataclass
class Local:
    """Processes on this machine."""


@dataclass
class Dask:
    """The workers of a Dask scheduler, of one that is started here where `address` is null."""

    address: str | None = None
    patience: float = 60.0


@dataclass
class Slurm:
    """Dask workers in jobs of Slurm: `workers` in all, each with one core and `memory`."""

    partition: str | None = None
    account: str | None = None
    memory: str = "2GB"
    walltime: str = "01:00:00"
    workers_per_job: int = 1
    directives: list[str] = field(default_factory=list)
    interface: str | None = None
    logs: str | None = None


KINDS: dict[str, type] = {"local": Local, "dask": Dask, "slurm": Slurm}


def read(node: dict[str, Any]) -> Local | Dask | Slurm:
    """The settings of an executor from a configuration; raises `ConfigError`."""
    given = {key: value for key, value in node.items() if key != "kind"}
    kind = KINDS.get(str(node.get("kind")))
    if kind is None:
        raise ConfigError(f"executor.kind={node.get('kind')}: must be one of {', '.join(KINDS)}")
    known = [f"executor.{setting.name}" for setting in fields(kind)]
    for key in given:
        if f"executor.{key}" not in known:
            raise ConfigError(unknown_key(f"executor.{key}", known))
    try:
        made: Any = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(kind), given))
    except OmegaConfBaseException as error:
        key = getattr(error, "full_key", None) or next(iter(given), "")
        raise ConfigError(f"executor.{key}={given.get(key)}: {str(error).splitlines()[0]}") from error
    _check(made)
    return made


def _check(settings: Local | Dask | Slurm) -> None:
    """Raise `ConfigError` for values that make no sense."""
    if isinstance(settings, Dask) and not 0 < settings.patience < math.inf:
        raise ConfigError(f"executor.patience={settings.patience:g}: must be above 0 and finite")
    if isinstance(settings, Slurm):
        if not re.fullmatch(r"\d+(\.\d+)?\s*[KMGT]i?B", settings.memory):
            raise ConfigError(f"executor.memory={settings.memory}: must be an amount such as 2GB")
        if not re.fullmatch(r"(\d+-)?\d{1,2}:\d{2}:\d{2}", settings.walltime):
            raise ConfigError(f"executor.walltime={settings.walltime}: must be a time such as 01:30:00")
        if settings.workers_per_job < 1:
            raise ConfigError(f"executor.workers_per_job={settings.workers_per_job}: must be at least 1")


def workers(node: dict[str, Any], count: int, setup: Setup, everything: dict[str, str]) -> Workers:
    """`count` workers of a kind. `setup` is what processes of this machine need, which inherit its environment;
    `everything` the variables that others need. Raises `ConfigError`; nothing is started yet."""
    settings = read(node)
    if isinstance(settings, Local):
        return Lanes(count, setup)
    _need("distributed")
    away = setup._replace(variables={**everything, **setup.variables})
    if isinstance(settings, Dask):
        dask = settings
        return Cluster(lambda: _dask(dask, count), count, away)
    _need("dask_jobqueue")
    slurm = settings
    return Cluster(lambda: _slurm(slurm, count), count, away)


def _need(module: str) -> None:
    from importlib.util import find_spec

    if find_spec(module) is None:
        raise ConfigError(f"executor: {NEEDS}")


def _configure() -> None:
    """The settings of a scheduler that is started here."""
    import dask

    dask.config.set(
        {
            "distributed.scheduler.allowed-failures": 0,  # the pool decides what is tried again
            "distributed.deploy.lost-worker-timeout": "2s",  # a cancelled job is replaced after it
        }
    )


def _dask(settings: Dask, count: int) -> Any:
    from distributed import Client, LocalCluster

    _configure()
    if settings.address is None:
        return Client(LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=":0"))
    try:
        return Client(settings.address, timeout=settings.patience)
    except (OSError, ValueError) as error:
        raise WorkersGone(f"executor.address={settings.address}: no scheduler answers ({error})") from error


def _slurm(settings: Slurm, count: int) -> Any:
    from dask_jobqueue.slurm import SLURMCluster
    from distributed import Client

    _configure()
    per_job = min(settings.workers_per_job, count)
    cluster = SLURMCluster(
        queue=settings.partition,
        account=settings.account,
        cores=per_job,
        processes=per_job,
        memory=settings.memory,
        walltime=settings.walltime,
        interface=settings.interface,
        log_directory=settings.logs or os.devnull,
        job_extra_directives=list(settings.directives),
        python=sys.executable,
        scheduler_options={"dashboard_address": ":0"},
    )
    jobs = math.ceil(count / per_job)
    cluster.adapt(minimum_jobs=jobs, maximum_jobs=jobs)  # a job that is cancelled or ends is replaced
    return Client(cluster)
