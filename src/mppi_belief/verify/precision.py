"""What several certificates compute with."""

from functools import partial
from typing import Any

import jax
import numpy as np

_jit = partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


def quick_jit(function: Any, **settings: Any) -> Any:
    """`jax.jit` for what takes longer to compile than to compute; `settings` are those of `jax.jit`."""
    return _jit(function, **settings)


def rms(values: Any) -> float:
    """Root mean square over all entries of an array."""
    return float(np.sqrt(np.mean(np.square(values))))
