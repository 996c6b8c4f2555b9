"""Which workers a study gets: the group `executor` of a configuration."""

import logging
import math
import os
import re
import shlex
import shutil
import signal
import sys
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from ..errors import ConfigError, unknown_key
from .dask import Cluster, Site, close_cluster
from .local import Lanes, WorkersGone
from .pool import Workers
from .signals import masked
from .slurm import Jobs
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
        raise ConfigError(
            f"executor.{key}={given.get(key)}: {str(error).splitlines()[0]}"
        ) from error
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
            raise ConfigError(
                f"executor.walltime={settings.walltime}: must be a time such as 01:30:00"
            )
        if settings.workers_per_job < 1:
            raise ConfigError(
                f"executor.workers_per_job={settings.workers_per_job}: must be at least 1"
            )


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


def _start(cluster: Callable[[], Any]) -> tuple[Any, Any]:
    """A scheduler in this process, as `cluster()` makes it, and its client. Raises `ConfigError`."""
    import dask
    from distributed import Client

    dask.config.set(
        {"distributed.scheduler.allowed-failures": 0}
    )  # the pool decides what is tried again
    try:
        with masked():  # workers must not answer a Ctrl-C in the terminal
            made = cluster()
            return made, Client(made)
    except (OSError, RuntimeError, ValueError) as error:
        raise ConfigError(
            f"executor: no scheduler starts here: {str(error).splitlines()[0]}"
        ) from error


def _dask(settings: Dask, count: int) -> Site:
    from distributed import Client, LocalCluster

    if settings.address is None:
        how = {"threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": logging.CRITICAL}
        cluster, client = _start(lambda: LocalCluster(n_workers=count, **how))
        return Site(client, lambda: close_cluster(cluster))
    try:
        return Site(Client(settings.address, timeout=settings.patience), lambda: None)
    except (OSError, ValueError) as error:
        raise WorkersGone(
            f"executor.address={settings.address}: no scheduler answers ({error})"
        ) from error


def _slurm(settings: Slurm, count: int) -> Site:
    from distributed import Scheduler
    from distributed.deploy.spec import SpecCluster

    if shutil.which("sbatch") is None:
        raise ConfigError("executor=slurm: there is no sbatch on this machine")
    options = {"interface": settings.interface, "dashboard_address": ":0"}
    scheduler = {"cls": Scheduler, "options": options}
    cluster, client = _start(
        lambda: SpecCluster(workers={}, scheduler=scheduler, silence_logs=logging.CRITICAL)
    )
    per_job = min(settings.workers_per_job, count)
    name = f"mppi-belief-{uuid.uuid4().hex[:8]}"
    jobs = Jobs(
        script(settings, per_job, name, cluster.scheduler_address),
        name,
        math.ceil(count / per_job),
        per_job,
    )

    def end() -> None:
        jobs.end()
        close_cluster(cluster)

    return Site(client, end, jobs.tend)


def script(settings: Slurm, per_job: int, name: str, address: str) -> str:
    """What sbatch is given: `per_job` workers for the scheduler at `address`. What is not set here is taken from a
    `jobqueue.slurm` of the user's own Dask configuration."""
    from dask.utils import parse_bytes

    with (
        masked()
    ):  # dask_jobqueue answers Ctrl-C in its own way from its import on, and with exit code 0
        answer = signal.getsignal(signal.SIGINT)
        from dask_jobqueue.slurm import SLURMJob

        signal.signal(signal.SIGINT, answer)

    silent = [] if settings.logs else [f"--output={os.devnull}", f"--error={os.devnull}"]
    job = SLURMJob(
        address,
        "$SLURM_JOB_ID",
        queue=settings.partition,
        account=settings.account,
        cores=per_job,
        processes=per_job,
        memory=f"{parse_bytes(settings.memory) * per_job}B",
        walltime=settings.walltime,
        interface=settings.interface,
        log_directory=settings.logs,
        job_name=name,
        job_extra_directives=[*silent, *settings.directives],
        python=shlex.quote(sys.executable),
        config_name="slurm",
    )
    return str(job.job_script())
