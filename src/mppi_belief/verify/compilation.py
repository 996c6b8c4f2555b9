"""Compilation of programs that take longer to compile than to run."""

from functools import partial
from typing import Any

import jax

_jit_without_optimisation = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


def quick_jit(function: Any, **settings: Any) -> Any:
    """Returns `jax.jit` of `function` without optimisation; `settings` are those of `jax.jit`."""
    return _jit_without_optimisation(function, **settings)
