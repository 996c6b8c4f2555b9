"""Makes the workers that the group `executor` of a configuration asks for."""

import logging
import math
import shutil
import uuid
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from ..config.executors import DaskExecutor, LocalExecutor, SlurmExecutor, read_executor
from ..errors import ConfigError, first_line
from .dask import DaskWorkers, SchedulerConnection, close_cluster
from .local import LocalWorkers
from .signals import masked
from .slurm import SlurmJobs
from .slurm_script import job_script
from .worker import WorkerSetup
from .workers import Workers, WorkersGone

EXTRA = 'needs the extra "cluster": pip install ".[cluster]" in the checkout'


def make_workers(
    node: dict[str, Any], count: int, setup: WorkerSetup, environment: dict[str, str]
) -> Workers:
    """Returns `count` workers as the group `executor` asks for; starts none of them. Raises
    `ConfigError`.

    `setup` is what processes of this machine need, which inherit its environment; `environment` has
    the variables that workers elsewhere need in addition.
    """
    settings = read_executor(node)
    if isinstance(settings, LocalExecutor):
        return LocalWorkers(count, setup)
    _require("distributed")
    remote_setup = setup._replace(variables={**environment, **setup.variables})
    if isinstance(settings, DaskExecutor):
        return DaskWorkers(lambda: connect_dask(settings, count), count, remote_setup)
    _require("dask_jobqueue")
    return DaskWorkers(lambda: connect_slurm(settings, count), count, remote_setup)


def _require(module: str) -> None:
    if find_spec(module) is None:
        raise ConfigError(f"executor: {EXTRA}")


def connect_dask(settings: DaskExecutor, count: int) -> SchedulerConnection:
    """Connects to the scheduler at `address`, or starts one here with `count` workers.

    Raises `ConfigError`, or `WorkersGone` if no scheduler answers.
    """
    from distributed import Client, LocalCluster

    if settings.address is None:
        options = {
            "threads_per_worker": 1,
            "dashboard_address": ":0",
            "silence_logs": logging.CRITICAL,
        }
        cluster, client = _start_scheduler(lambda: LocalCluster(n_workers=count, **options))
        return SchedulerConnection(client, lambda: close_cluster(cluster))
    try:
        client = Client(settings.address, timeout=settings.patience)
    except (OSError, ValueError) as error:
        raise WorkersGone(
            f"executor.address={settings.address}: no scheduler answers ({error})"
        ) from error
    return SchedulerConnection(client, lambda: None)


def connect_slurm(settings: SlurmExecutor, count: int) -> SchedulerConnection:
    """Starts a scheduler here, whose workers are in jobs of Slurm; raises `ConfigError`."""
    from distributed import Scheduler
    from distributed.deploy.spec import SpecCluster

    if shutil.which("sbatch") is None:
        raise ConfigError("executor=slurm: there is no sbatch on this machine")
    options = {"interface": settings.interface, "dashboard_address": ":0"}
    scheduler = {"cls": Scheduler, "options": options}
    cluster, client = _start_scheduler(
        lambda: SpecCluster(workers={}, scheduler=scheduler, silence_logs=logging.CRITICAL)
    )
    per_job = min(settings.workers_per_job, count)
    name = f"mppi-belief-{uuid.uuid4().hex[:8]}"
    script = job_script(settings, per_job, name, cluster.scheduler_address)
    jobs = SlurmJobs(script, name, math.ceil(count / per_job), per_job)

    def end() -> None:
        jobs.cancel_all()
        close_cluster(cluster)

    return SchedulerConnection(client, end, jobs.replace_missing)


def _start_scheduler(make_cluster: Callable[[], Any]) -> tuple[Any, Any]:
    """Returns a cluster with a scheduler in this process, and its client; raises `ConfigError`."""
    import dask
    from distributed import Client

    # The pool decides what is tried again.
    dask.config.set({"distributed.scheduler.allowed-failures": 0})
    try:
        with masked():  # workers must not answer a Ctrl-C in the terminal
            cluster = make_cluster()
            return cluster, Client(cluster)
    except (OSError, RuntimeError, ValueError) as error:
        raise ConfigError(f"executor: no scheduler starts here: {first_line(error)}") from error
