"""The flags of XLA: those that this package sets, and those of the user that change no number.

XLA reads `XLA_FLAGS` when it compiles its first program, and ends the process where it does not
know one of them. Any flag may change the last digits of a trial, and some (fast mathematics) its
outcome, while the cell of the trial is the same. So all others are refused.
"""

from collections.abc import Sequence

from ..errors import ConfigError

OF_EVERY_PLATFORM = (
    "--xla_cpu_multi_thread_eigen=false",
    # A loop over less data than this many bytes becomes one kernel. Otherwise a scan over a horizon
    # spends most of its time between the kernels of its steps.
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000",
    "--xla_cpu_prefer_vector_width=512",  # exponentials take a third less time on AVX-512
)
# Without this flag XLA takes the fastest of several algorithms, as timed in each run.
OF_GPU = ("--xla_gpu_deterministic_ops=true",)
# Beginnings of flags that say where files lie and how many devices and threads there are.
HARMLESS = (
    "--xla_dump_",
    "--xla_force_host_platform_device_count",
    "--xla_gpu_cuda_data_dir",
    "--xla_gpu_force_compilation_parallelism",
)


def combined(given: str, own: Sequence[str]) -> str:
    """Returns the given flags with our own added.

    Raises `ConfigError` for a given flag that is neither harmless nor one that this package sets to
    the same value.
    """
    words = given.split()
    for word in words:
        if word not in (*OF_EVERY_PLATFORM, *OF_GPU) and not word.startswith(HARMLESS):
            allowed = ", ".join(f"{flag}..." for flag in HARMLESS)
            raise ConfigError(
                f"XLA_FLAGS: {word} may change the numbers of a trial, whose cell would be the"
                f" same; unset it (allowed are {allowed})"
            )
    return " ".join([*words, *(flag for flag in own if flag not in words)])
