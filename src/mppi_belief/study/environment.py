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


_XLA = (
    "--xla_cpu_multi_thread_eigen=false",
    # loops of less data than this many bytes become one kernel: a scan over a horizon otherwise spends most of its time
    # between the kernels of its steps
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000",
    "--xla_cpu_prefer_vector_width=512",  # a third off the cost of exponentials where the CPU has AVX-512
)


def cache_dir() -> Path:
    """Where compiled programs are kept: mppi-belief/xla in the user's cache directory."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "mppi-belief" / "xla"


def prepare() -> None:
    """Set the environment of this process and of those it will start; what the user has set stays."""
    for name, value in _ONE_THREAD.items():
        os.environ.setdefault(name, value)
    given = os.environ.get("XLA_FLAGS", "").split()
    names = {flag.partition("=")[0] for flag in given}
    os.environ["XLA_FLAGS"] = " ".join([*given, *(flag for flag in _XLA if flag.partition("=")[0] not in names)])
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_dir()))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def threads() -> dict[str, str]:
    """The thread settings in force, for provenance."""
    return {name: os.environ.get(name, "") for name in (*_ONE_THREAD, "XLA_FLAGS")}
