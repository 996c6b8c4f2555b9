"""Standard normals, many at a time, from Threefry counters (Salmon et al. 2011).

`jax.random.normal` spends two outputs of Threefry on each 32-bit number; one is enough, and the normals
are the largest single cost of a planning step. Double precision is left to `jax.random.normal`.
"""

import math

import jax
import jax.numpy as jnp
from jax import Array
from jax.extend.random import threefry_2x32


def standard_normal(key: Array, shape: tuple[int, ...]) -> Array:
    """Independent N(0, 1) of the default precision, a function of the (Threefry) key and the shape alone."""
    if jnp.zeros(()).dtype != jnp.float32:
        return jax.random.normal(key, shape)
    bits = threefry_2x32(jax.random.key_data(key), jnp.arange(math.prod(shape), dtype=jnp.uint32)).reshape(shape)
    # the centres of 2^23 equal cells of (-1, 1): symmetric, and never -1 or 1
    uniform = ((bits >> 9).astype(jnp.float32) + 0.5) * 2.0**-22 - 1.0
    return math.sqrt(2) * jax.lax.erf_inv(uniform)
