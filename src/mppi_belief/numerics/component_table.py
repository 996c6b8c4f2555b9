"""Tables of components: arrays over samples taken apart into single vectors and numbers.

A component is a vector (N,) over the samples, a number that is the same for all samples (), or a
number known while tracing.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

Table = np.ndarray  # of objects, the components of one value


def table_of(array: Any, shape: tuple[int, ...]) -> Table:
    """Returns the components of an array whose first axes have this shape."""
    return build_table(shape, lambda index: array[index])


def build_table(shape: tuple[int, ...], component: Callable[[tuple[int, ...]], Any]) -> Table:
    """Returns the table with `component(index)` at every index."""
    table = np.empty(shape, object)
    for index in np.ndindex(*shape):
        table[index] = component(index)
    return table


def join_table(table: Table, dtype: Any, n: int) -> Array:
    """Returns the array (..., N) of a table."""
    components = table.reshape(-1)
    if not len(components):
        return jnp.zeros((*table.shape, n), dtype)
    vectors = [jnp.broadcast_to(jnp.asarray(x, dtype), (n,)) for x in components]
    return jnp.stack(vectors).reshape(*table.shape, n)


def constant_table(array: Any) -> Table:
    """Represents an array that all samples share, by known numbers unless it is traced."""
    values = array if isinstance(array, jax.core.Tracer) else np.asarray(array)
    return table_of(values, values.shape)


def is_known(x: Any) -> bool:
    """Says whether a component is a number known while tracing."""
    return not isinstance(x, Array)


def add_components(a: Any, b: Any) -> Any:
    """Returns a + b (), without adding a known 0."""
    if is_known(a) and a == 0:
        return b
    return a if is_known(b) and b == 0 else a + b


def subtract_components(a: Any, b: Any) -> Any:
    """Returns a - b (), without subtracting from or by a known 0."""
    if is_known(a) and a == 0:
        return -b
    return a if is_known(b) and b == 0 else a - b


def multiply_components(a: Any, b: Any) -> Any:
    """Returns a b (), without multiplying by a known 0 or 1; 0 times anything counts as 0."""
    if is_known(b):
        a, b = b, a
    if is_known(a) and not is_known(b) and a in (0, 1):
        return b if a == 1 else a
    return a * b
