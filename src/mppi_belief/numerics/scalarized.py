"""A map over samples of functions that do much with small matrices: every component becomes a vector over the samples.

`numerics.vmap_last.vmap_last` keeps a matrix of every sample as one array (n, m, N). A filter step inside a rollout
takes such arrays apart and puts them together again between any two products, which costs more than the products.
Here a function is traced once and its operations are replayed on tables of components, each a vector (N,), a number
that is the same for all samples, or one that is known in advance. Moving components about costs nothing then, and
what is known to be 0 or 1 (a Jacobian's entries, say) is not multiplied with; 0 times anything counts as 0.

Rounding differs from `jax.vmap` in the order of sums only. Larger matrices are left to `vmap_last`, operations
without a rule here to `jax.vmap`.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.extend import core

from .vmap_last import ELEMENTWISE, Value, aval, is_plain, left_to_vmap, samples_of, vmap_last

LARGEST = (
    36  # components of an array; beyond, a program of single components takes too long to compile
)
Table = np.ndarray  # of objects: components


def componentwise(function: Callable[..., Any], mapped: Sequence[bool]) -> Callable[..., Any]:
    """`jax.vmap(function, in_axes=-1 where mapped and None where not, out_axes=-1)` of array arguments."""

    def mapping(*arrays: Any) -> Any:
        arrays = tuple(map(jnp.asarray, arrays))
        one = [
            jax.ShapeDtypeStruct(a.shape[:-1] if m else a.shape, a.dtype)
            for a, m in zip(arrays, mapped, strict=True)
        ]
        if max(np.prod(a.shape, dtype=int) for a in one) > LARGEST:
            return vmap_last(function, mapped)(*arrays)
        n = samples_of(arrays, mapped)
        traced, shapes = jax.make_jaxpr(function, return_shape=True)(*one)
        outputs = _replay(traced, [_table(a, s.shape) for a, s in zip(arrays, one, strict=True)], n)
        leaves, tree = jax.tree.flatten(shapes)
        joined = [
            _joined(table, leaf.dtype, n) for table, leaf in zip(outputs, leaves, strict=True)
        ]
        return jax.tree.unflatten(tree, joined)

    return mapping


def _table(array: Any, shape: tuple[int, ...]) -> Table:
    """The components of an array, whose first axes have this shape."""
    return _made(shape, lambda at: array[at])


def _made(shape: tuple[int, ...], component: Callable[[tuple[int, ...]], Any]) -> Table:
    table = np.empty(shape, object)
    for at in np.ndindex(*shape):
        table[at] = component(at)
    return table


def _joined(table: Table, dtype: Any, n: int) -> Array:
    """The array (..., n) of a table."""
    parts = [jnp.broadcast_to(jnp.asarray(x, dtype), (n,)) for x in table.reshape(-1)]
    return (
        jnp.stack(parts).reshape(*table.shape, n) if parts else jnp.zeros((*table.shape, n), dtype)
    )


def _replay(closed: core.ClosedJaxpr, inputs: Sequence[Table], n: int) -> list[Table]:
    jaxpr = closed.jaxpr
    tables: dict[Any, Table] = dict(zip(jaxpr.invars, inputs, strict=True))
    for variable, constant in zip(jaxpr.constvars, closed.consts, strict=True):
        tables[variable] = _table(
            constant if isinstance(constant, jax.core.Tracer) else np.asarray(constant),
            constant.shape,
        )

    def read(variable: Any) -> Table:
        if isinstance(variable, core.Literal):
            return _table(np.asarray(variable.val, aval(variable).dtype), ())
        return tables[variable]

    for equation in jaxpr.eqns:
        results = _apply(equation, [read(v) for v in equation.invars], n)
        tables |= dict(zip(equation.outvars, results, strict=True))
    return [read(v) for v in jaxpr.outvars]


def _apply(equation: core.JaxprEqn, inputs: list[Table], n: int) -> Sequence[Table]:
    name, params = equation.primitive.name, equation.params
    if name == "jit":
        return _replay(params["jaxpr"], inputs, n)
    if name in _ARITHMETIC:
        return [_each(_ARITHMETIC[name], inputs)]
    if name in ELEMENTWISE:
        return [_each(functools.partial(_bound, equation), inputs)]
    if name in _MOVES:
        return [_MOVES[name](aval(equation.outvars[0]), params, *inputs)]
    if name == "split":
        return np.split(inputs[0], np.cumsum(params["sizes"])[:-1], axis=params["axis"])
    if name == "dot_general" and is_plain(equation):
        return [_product(params["dimension_numbers"][0], *inputs)]
    arrays = [
        Value(_joined(t, aval(v).dtype, n), True)
        for t, v in zip(inputs, equation.invars, strict=True)
    ]
    return [
        _table(result.array, result.array.shape[:-1]) for result in left_to_vmap(equation, arrays)
    ]


def _known(x: Any) -> bool:
    return not isinstance(x, Array)


def _add(a: Any, b: Any) -> Any:
    if _known(a) and a == 0:
        return b
    return a if _known(b) and b == 0 else a + b


def _subtract(a: Any, b: Any) -> Any:
    if _known(a) and a == 0:
        return -b
    return a if _known(b) and b == 0 else a - b


def _multiply(a: Any, b: Any) -> Any:
    a, b = (b, a) if _known(b) else (a, b)
    if _known(a) and not _known(b) and a in (0, 1):
        return b if a == 1 else a
    return a * b


def _bound(equation: core.JaxprEqn, *components: Any) -> Any:
    """An operation on one component of each operand; on known ones its value is known."""
    kinds = [aval(v).dtype for v in equation.invars]
    if equation.primitive.name == "select_n" and _known(components[0]):
        return components[1 + int(components[0])]
    if all(map(_known, components)):
        with jax.ensure_compile_time_eval():
            given = [jnp.asarray(x, kind) for x, kind in zip(components, kinds, strict=True)]
            return np.asarray(equation.primitive.bind(*given, **equation.params))[()]
    shape = max((np.shape(x) for x in components), key=len)
    given = [
        jnp.broadcast_to(jnp.asarray(x, kind), shape)
        for x, kind in zip(components, kinds, strict=True)
    ]
    return equation.primitive.bind(*given, **equation.params)


def _each(operation: Callable[..., Any], inputs: Sequence[Table]) -> Table:
    spread = np.broadcast_arrays(*inputs)
    return _made(spread[0].shape, lambda at: operation(*(table[at] for table in spread)))


def _product(contracted: tuple[Sequence[int], Sequence[int]], A: Table, B: Table) -> Table:
    """A product of matrices, contracted over some axes of each."""
    k = len(contracted[0])
    A, B = (np.moveaxis(M, axes, range(k)) for M, axes in zip((A, B), contracted, strict=True))
    inner, free = A.shape[:k], A.ndim - k

    def entry(at: tuple[int, ...]) -> Any:
        terms = (_multiply(A[i + at[:free]], B[i + at[free:]]) for i in np.ndindex(*inner))
        return functools.reduce(_add, terms)

    return _made(A.shape[k:] + B.shape[k:], entry)


def _reduced(operation: Callable[..., Any], params: dict[str, Any], x: Table) -> Table:
    x = np.moveaxis(x, params["axes"], range(len(params["axes"])))
    inner = x.shape[: len(params["axes"])]
    return _made(
        x.shape[len(inner) :],
        lambda at: functools.reduce(operation, (x[i + at] for i in np.ndindex(*inner))),
    )


def _slice(shape: Any, params: dict[str, Any], x: Table) -> Table:
    strides = params["strides"] or itertools.repeat(1)
    return x[tuple(map(slice, params["start_indices"], params["limit_indices"], strides))]


def _broadcast(shape: Any, params: dict[str, Any], x: Table) -> Table:
    sizes = [1] * len(shape.shape)
    for axis, size in zip(params["broadcast_dimensions"], x.shape, strict=True):
        sizes[axis] = size
    return np.broadcast_to(x.reshape(sizes), shape.shape)


def _pad(shape: Any, params: dict[str, Any], x: Table, value: Table) -> Table:
    padded = _made(shape.shape, lambda at: value[()])
    steps = zip(params["padding_config"], x.shape, strict=True)
    padded[
        tuple(slice(low, low + size * (inner + 1), inner + 1) for (low, _, inner), size in steps)
    ] = x
    return padded


def _iota(shape: Any, params: dict[str, Any]) -> Table:
    return _made(shape.shape, lambda at: shape.dtype.type(at[params["dimension"]]))


_ARITHMETIC: dict[str, Callable[..., Any]] = {
    "add": _add,
    "add_any": _add,
    "sub": _subtract,
    "mul": _multiply,
}
_MOVES: dict[str, Callable[..., Table]] = {
    "broadcast_in_dim": _broadcast,
    "concatenate": lambda shape, params, *parts: np.concatenate(parts, params["dimension"]),
    "iota": _iota,
    "pad": _pad,
    "reduce_max": lambda shape, params, x: _reduced(jnp.maximum, params, x),
    "reduce_min": lambda shape, params, x: _reduced(jnp.minimum, params, x),
    "reduce_sum": lambda shape, params, x: _reduced(_add, params, x),
    "reshape": lambda shape, params, x: x.reshape(shape.shape),
    "rev": lambda shape, params, x: np.flip(x, params["dimensions"]),
    "slice": _slice,
    "squeeze": lambda shape, params, x: x.reshape(shape.shape),
    "stack": lambda shape, params, *parts: np.stack(parts, params.get("axis", 0)),
    "transpose": lambda shape, params, x: x.transpose(params["permutation"]),
}
