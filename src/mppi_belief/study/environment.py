"""The environment of computing processes: one thread each, and a compilation cache that lasts.

To be set before JAX, NumPy or a worker process starts; two workers with two XLA or BLAS threads each
are many times slower than with one.
"""

import os
from pathlib import Path

_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NPROC": "1",  # the size of XLA's own thread pools
}


def cache_dir() -> Path:
    """Where compiled programs are kept: mppi-belief/xla in the user's cache directory."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "mppi-belief" / "xla"


def prepare() -> None:
    """Set the environment of this process and of those it will start; what the user has set stays."""
    for name, value in _ONE_THREAD.items():
        os.environ.setdefault(name, value)
    flags = os.environ.get("XLA_FLAGS", "")
    if "xla_cpu_multi_thread_eigen" not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --xla_cpu_multi_thread_eigen=false".strip()
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_dir()))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.2")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def threads() -> dict[str, str]:
    """The thread settings in force, for provenance."""
    return {name: os.environ.get(name, "") for name in (*_ONE_THREAD, "XLA_FLAGS")}
