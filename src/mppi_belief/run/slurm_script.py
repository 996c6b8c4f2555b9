"""Writes the script of a Slurm job that holds Dask workers."""

import os
import shlex
import signal
import sys
from typing import Any

from ..config.executors import SlurmExecutor
from .signals import masked


def job_script(settings: SlurmExecutor, per_job: int, name: str, address: str) -> str:
    """Returns the script of a job with `per_job` workers for the scheduler at `address`.

    What is not set here comes from `jobqueue.slurm` of the user's own Dask configuration.
    """
    from dask.utils import parse_bytes

    silent = [] if settings.logs else [f"--output={os.devnull}", f"--error={os.devnull}"]
    job = _slurm_job_class()(
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


def _slurm_job_class() -> Any:
    """Imports the class without its handler of Ctrl-C, which would end this process with exit code
    0.
    """
    with masked():
        handler = signal.getsignal(signal.SIGINT)
        from dask_jobqueue.slurm import SLURMJob

        signal.signal(signal.SIGINT, handler)
    return SLURMJob
