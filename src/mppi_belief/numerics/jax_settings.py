"""The settings of JAX under which every number of this package is computed.

A user's shell, or a module that is imported, may set them to something else: other streams of
random numbers under the same seed, other rounding, or diagnostics that raise where a number may be
nan. Variables of the environment are dealt with in `config/environment.py` before JAX reads them.
"""

from typing import Any

import jax

PINNED: dict[str, Any] = {
    # Streams of random numbers.
    "jax_default_prng_impl": "threefry2x32",
    "jax_enable_custom_prng": False,
    "jax_high_dynamic_range_gumbel": False,
    "jax_legacy_prng_key": "allow",
    "jax_random_seed_offset": 0,
    "jax_threefry_partitionable": True,
    # Rounding.
    "jax_default_matmul_precision": None,
    "jax_disable_jit": False,
    "jax_enable_pgle": False,
    "jax_numpy_dtype_promotion": "standard",
    # Where programs run. `jax_platforms` chooses, and `trial.device` checks it.
    "jax_cpu_enable_async_dispatch": False,
    "jax_default_device": None,
    # Diagnostics that raise: an effective sample size, for one, is nan by design without samples.
    "jax_array_garbage_collection_guard": None,
    "jax_check_static_indices": False,
    "jax_check_tracer_leaks": False,
    "jax_debug_infs": False,
    "jax_debug_key_reuse": False,
    "jax_debug_nans": False,
    "jax_enable_checks": False,
    "jax_error_checking_behavior_divide": "ignore",
    "jax_error_checking_behavior_nan": "ignore",
    "jax_error_checking_behavior_oob": "ignore",
    "jax_explicit_x64_dtypes": "warn",
    "jax_no_execution": False,
    "jax_no_tracing": False,
    "jax_numpy_rank_promotion": "allow",
    "jax_raise_persistent_cache_errors": False,
    "jax_thread_guard": False,
    "jax_transfer_guard": None,
    "jax_transfer_guard_device_to_device": None,
    "jax_transfer_guard_device_to_host": None,
    "jax_transfer_guard_host_to_device": None,
}


def pin_jax_settings() -> None:
    """Gives every setting in `PINNED` its value, for the rest of this process.

    It is to be called before JAX's first computation, since the CPU backend keeps the dispatch that
    it starts with: in the calling thread, without handing over to another one. Measured gain:
    0.030 ms per control step of MPPI-Belief (docs/benchmarks_more.md). Settings that this version
    of JAX does not have are left out. `jax_enable_x64` is not among them, since every computation
    sets its own precision.
    """
    known = jax.config.values
    for name, value in PINNED.items():
        if name in known:
            jax.config.update(name, value)
