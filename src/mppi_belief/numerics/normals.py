"""Standard normals, many at a time, from Threefry counters (Salmon et al. 2011).

The normals are the largest single cost of a planning step. `jax.random.normal` spends two outputs
of Threefry on each 32-bit number, where one is enough, and keeps the states of its rounds in
memory, where written out they stay in registers. Its inverse of the error function takes log1p: on
a CPU (jax 0.10) that is slower than log in single precision, and a relative 6e-6 off in the tails,
where log with (1 - x) (1 + x) is at most 3e-7 off. In double precision the normals are those of
`jax.random.normal`.

Measured gain: the 30 000 normals of one MPPI-Belief step take 0.077 ms instead of 0.109 ms
(docs/benchmarks_more.md).
"""

import functools
import math

import jax
import jax.numpy as jnp
from jax import Array

_ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
_PARITY = 0x1BD11BDA

# Giles (2010), "Approximating the erfinv function", single precision, highest power first:
# coefficients in w - 2.5 for w < 5, and in sqrt(w) - 3 otherwise
_ERFINV = (
    (2.81022636e-08, -0.000200214257),
    (3.43273939e-07, 0.000100950558),
    (-3.5233877e-06, 0.00134934322),
    (-4.39150654e-06, -0.00367342844),
    (0.00021858087, 0.00573950773),
    (-0.00125372503, -0.0076224613),
    (-0.00417768164, 0.00943887047),
    (0.246640727, 1.00167406),
    (1.50140941, 2.83297682),
)


@functools.partial(jax.jit, static_argnames="shape")
def standard_normal(key: Array, shape: tuple[int, ...]) -> Array:
    """Draws independent N(0, 1) of the default precision.

    They are a function of the (Threefry) key and the shape alone.
    """
    words = jax.random.key_data(key)
    n = math.prod(shape)
    if jnp.zeros(()).dtype == jnp.float32:
        # The centres of 2^23 equal cells of (-1, 1): symmetric, and never -1 or 1.
        uniform = ((threefry_2x32(words, n) >> 9).astype(jnp.float32) + 0.5) * 2.0**-22 - 1.0
        return math.sqrt(2) * erf_inv(uniform.reshape(shape))
    high, low = threefry_blocks(words, jnp.zeros(n, jnp.uint32), jnp.arange(n, dtype=jnp.uint32))
    mantissa = (high.astype(jnp.uint64) << 20) | (low >> 12).astype(jnp.uint64)
    least = math.nextafter(-1.0, 0.0)
    uniform = jnp.maximum(least, mantissa.astype(jnp.float64) * 2.0**-52 * (1.0 - least) + least)
    return math.sqrt(2) * jax.lax.erf_inv(uniform.reshape(shape))


def threefry_2x32(key: Array, n: int) -> Array:
    """Returns n pseudo-random uint32 (n,) from key words (2,), for the counters 0..n-1.

    Counter i makes a block with counter i + (n + 1) // 2, as in `jax.extend.random.threefry_2x32`.
    """
    half = (n + 1) // 2
    x0 = jnp.arange(half, dtype=jnp.uint32)
    x1 = jnp.pad(jnp.arange(half, n, dtype=jnp.uint32), (0, 2 * half - n))
    return jnp.concatenate(threefry_blocks(key, x0, x1))[:n]


def threefry_blocks(key: Array, x0: Array, x1: Array) -> tuple[Array, Array]:
    """Returns Threefry-2x32 with 20 rounds, of blocks of two counters, under key words (2,).

    Counters and results are two uint32 (n,) each.
    """
    words = (key[0], key[1], key[0] ^ key[1] ^ jnp.uint32(_PARITY))
    x0 = x0 + words[0]
    x1 = x1 + words[1]
    for i in range(20):
        x0 = x0 + x1
        x1 = _rotate_left(x1, _ROTATIONS[i % 8]) ^ x0
        if i % 4 == 3:
            injection = i // 4 + 1
            x0 = x0 + words[injection % 3]
            x1 = x1 + words[(injection + 1) % 3] + jnp.uint32(injection)
    return x0, x1


def _rotate_left(x: Array, places: int) -> Array:
    return (x << places) | (x >> (32 - places))


def erf_inv(x: Array) -> Array:
    """Returns the inverse error function in single precision, for -1 < x < 1.

    Its relative error is below 3e-7.
    """
    w = -jnp.log((1 - x) * (1 + x))
    central = w < 5
    t = jnp.where(central, w - 2.5, jnp.sqrt(w) - 3)
    p = jnp.zeros_like(x)
    for near, far in _ERFINV:
        p = p * t + jnp.where(central, near, far)
    return p * x
