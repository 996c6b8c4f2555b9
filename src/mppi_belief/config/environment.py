"""The environment variables of processes that compute: one thread each, and a compilation cache on
the disk.

They must be set before JAX or NumPy is imported and before a worker process starts. Two workers
with two XLA or BLAS threads each are many times slower than two with one thread.
"""

import os
from collections.abc import Sequence
from pathlib import Path

_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NPROC": "1",  # the size of XLA's own thread pools
}


_XLA = (
    "--xla_cpu_multi_thread_eigen=false",
    # A loop over less data than this many bytes becomes one kernel. Otherwise a scan over a horizon
    # spends most of its time between the kernels of its steps.
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000",
    "--xla_cpu_prefer_vector_width=512",  # exponentials take a third less time on AVX-512
)
# Without this flag XLA takes the fastest of several algorithms, as timed in each run.
_XLA_GPU = ("--xla_gpu_deterministic_ops=true",)


def cache_dir() -> Path:
    """Returns the folder of compiled programs: mppi-belief/xla in the user's cache directory."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "mppi-belief" / "xla"


def prepare(platform: str = "cpu") -> dict[str, str]:
    """Sets the environment of this process and of those that it starts; what the user has set
    stays.

    Returns the variables that the workers of a platform need besides. Only workers compute on a
    GPU; they allocate its memory as they need it.
    """
    for name, value in _ONE_THREAD.items():
        os.environ.setdefault(name, value)
    os.environ["XLA_FLAGS"] = _with_flags(_XLA)
    given = os.environ.get("JAX_PLATFORMS")
    if platform == "gpu" or not given:
        os.environ["JAX_PLATFORMS"] = "cpu"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_dir()))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    if platform == "cpu":
        return {}
    return {
        "JAX_PLATFORMS": given or "cuda",
        "XLA_FLAGS": _with_flags(_XLA_GPU),
        "XLA_PYTHON_CLIENT_PREALLOCATE": os.environ.get("XLA_PYTHON_CLIENT_PREALLOCATE", "false"),
    }


def _with_flags(flags: Sequence[str]) -> str:
    """Returns XLA_FLAGS with these flags added, except those that are set already."""
    given = os.environ.get("XLA_FLAGS", "").split()
    names = {flag.partition("=")[0] for flag in given}
    return " ".join([*given, *(flag for flag in flags if flag.partition("=")[0] not in names)])


def in_force() -> dict[str, str]:
    """Returns all that `prepare` has set, for workers that do not inherit it."""
    names = (
        *_ONE_THREAD,
        "XLA_FLAGS",
        "JAX_PLATFORMS",
        "JAX_COMPILATION_CACHE_DIR",
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS",
        "TF_CPP_MIN_LOG_LEVEL",
    )
    return {name: os.environ[name] for name in names}


def threads() -> dict[str, str]:
    """Returns the thread settings in force, for provenance."""
    return {name: os.environ.get(name, "") for name in (*_ONE_THREAD, "XLA_FLAGS")}
