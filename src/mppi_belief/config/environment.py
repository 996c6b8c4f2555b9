"""The environment variables of processes that compute: one thread each, settings of JAX that change
no number, and a compilation cache on the disk.

They must be set before JAX or NumPy is imported and before a worker process starts. Two workers
with two XLA or BLAS threads each are many times slower than two with one thread.
"""

import os
import sys

from ..errors import plain_line
from . import cache_folders, xla_flags

_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NPROC": "1",  # the size of XLA's own thread pools
}
# Variables of JAX that are left as they are: they choose a device, which `trial.device` checks, the
# precision, which every computation sets, caches, and what is logged.
HARMLESS = frozenset(
    {
        "JAX_CAPTURED_CONSTANTS_REPORT_FRAMES",
        "JAX_CAPTURED_CONSTANTS_WARN_BYTES",
        "JAX_CHECK_PROXY_ENVS",
        "JAX_COMPILATION_CACHE_CHECK_CONTENTS",
        cache_folders.VARIABLE,
        "JAX_COMPILATION_CACHE_INCLUDE_METADATA_IN_KEY",
        "JAX_COMPILATION_CACHE_MAX_SIZE",
        "JAX_COMPILER_DETAILED_LOGGING_MIN_OPS",
        "JAX_CUDA_VISIBLE_DEVICES",
        "JAX_DEBUG_LOG_MODULES",
        "JAX_DUMP_IR_MODES",
        "JAX_DUMP_IR_TO",
        "JAX_ENABLE_COMPILATION_CACHE",
        "JAX_ENABLE_X64",
        "JAX_EXPLAIN_CACHE_MISSES",
        "JAX_HLO_SOURCE_FILE_CANONICALIZATION_REGEX",
        "JAX_INCLUDE_DEBUG_INFO_IN_DUMPS",
        "JAX_INCLUDE_FULL_TRACEBACKS_IN_LOCATIONS",
        "JAX_LOG_CHECKPOINT_RESIDUALS",
        "JAX_LOG_COMPILES",
        "JAX_LOGGING_LEVEL",
        "JAX_NUM_CPU_DEVICES",
        "JAX_ONEAPI_VISIBLE_DEVICES",
        "JAX_PERSISTENT_CACHE_ENABLE_XLA_CACHES",
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES",
        "JAX_PLATFORM_NAME",
        "JAX_PLATFORMS",
        "JAX_PPRINT_USE_COLOR",
        "JAX_ROCM_VISIBLE_DEVICES",
        "JAX_SOURCE_URL_SCHEMA",
        "JAX_TRACEBACK_FILTERING",
        "JAX_TRACEBACK_IN_LOCATIONS_LIMIT",
        "JAX_TRACER_ERROR_NUM_TRACEBACK_FRAMES",
    }
)
_NOT_OF_JAX_ALONE = ("EAGER_CONSTANT_FOLDING", "NVIDIA_TF32_OVERRIDE")  # these change numbers, too
# Variables that choose other kernels, as another processor does; they stay, and results name them.
_KERNELS = ("MKL_CBWR", "MKL_ENABLE_INSTRUCTIONS", "OPENBLAS_CORETYPE")


def prepare(platform: str = "cpu") -> dict[str, str]:
    """Sets the environment of this process and of those that it starts.

    What the user has set stays, but for variables that may change numbers (`remove_unsafe`), which
    are named on stderr. Returns the variables that the workers of a platform need besides. Only
    workers compute on a GPU; they allocate its memory as they need it. Raises `ConfigError` for
    `XLA_FLAGS` that may change numbers.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    os.environ["XLA_FLAGS"] = xla_flags.combined(flags, xla_flags.OF_EVERY_PLATFORM)
    removed = remove_unsafe()
    if removed:
        listed = ", ".join(f"{name}={value}" for name, value in removed.items())
        _note(f"{listed}: not used; may change the numbers of a trial or fail it")

    for name, value in _ONE_THREAD.items():
        os.environ.setdefault(name, value)
    given = os.environ.get("JAX_PLATFORMS")
    if platform == "gpu" or not given:
        os.environ["JAX_PLATFORMS"] = "cpu"
    _set_program_folder()
    set_matplotlib_folder()
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    if platform == "cpu":
        return {}
    return {
        "JAX_PLATFORMS": given or "cuda",
        "XLA_FLAGS": xla_flags.combined(os.environ["XLA_FLAGS"], xla_flags.OF_GPU),
        "XLA_PYTHON_CLIENT_PREALLOCATE": os.environ.get("XLA_PYTHON_CLIENT_PREALLOCATE", "false"),
    }


def remove_unsafe() -> dict[str, str]:
    """Removes and returns the variables of JAX that are not known to be harmless.

    They may change streams of random numbers or rounding, or make JAX raise. JAX reads them when it
    is imported; `numerics.jax_settings` pins what it has read before, or what a module has set.
    """
    unsafe = [
        name
        for name in sorted(os.environ)
        if (name.startswith("JAX_") and name not in HARMLESS) or name in _NOT_OF_JAX_ALONE
    ]
    return {name: os.environ.pop(name) for name in unsafe}


def _set_program_folder() -> None:
    """Sets the folder of compiled programs where none is set; notes on stderr where it is not that
    of the user's cache directory.
    """
    folder = cache_folders.program_folder()
    if folder is None:
        base = cache_folders.temporary_cache_folder()
        folder = base / cache_folders.PROGRAMS if base else None
        instead = f"kept in {folder}" if folder else "compiled anew by every worker"
        _note(f"no cache directory of this user can be written to; compiled programs are {instead}")
    if folder is not None:
        os.environ[cache_folders.VARIABLE] = str(folder)
    else:
        os.environ.pop(cache_folders.VARIABLE, None)


def set_matplotlib_folder() -> None:
    """Gives Matplotlib a folder of ours where the user has no home directory to write to.

    Matplotlib would make a temporary one in every command, and say so.
    """
    if os.environ.get("MPLCONFIGDIR") or cache_folders.has_writable_home():
        return
    folder = cache_folders.user_cache_folder() or cache_folders.temporary_cache_folder()
    if folder is not None:
        os.environ["MPLCONFIGDIR"] = str(folder / "matplotlib")


def prepare_drawing() -> None:
    """Lets Matplotlib draw as this package asks, whatever backend and matplotlibrc a user has.

    It reads these variables when it is imported; a backend that is not installed ends the import.
    """
    os.environ["MPLBACKEND"] = "agg"
    os.environ["MATPLOTLIBRC"] = os.devnull


def in_force() -> dict[str, str]:
    """Returns all that `prepare` has set, for workers that do not inherit it."""
    names = (
        *_ONE_THREAD,
        "XLA_FLAGS",
        "JAX_PLATFORMS",
        cache_folders.VARIABLE,
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS",
        "TF_CPP_MIN_LOG_LEVEL",
    )
    return {name: os.environ[name] for name in names if name in os.environ}


def threads() -> dict[str, str]:
    """Returns the thread settings in force, for provenance."""
    return {name: os.environ.get(name, "") for name in _ONE_THREAD}


def numeric_settings() -> dict[str, str]:
    """Returns the variables in force on which the digits of a number depend, for provenance."""
    names = ("XLA_FLAGS", *_KERNELS)
    return {name: os.environ[name] for name in names if os.environ.get(name)}


def _note(line: str) -> None:
    print(f"mppi-belief: {plain_line(line)}", file=sys.stderr)
