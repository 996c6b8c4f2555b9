"""A map over samples that stay on the last axis of every array on the way.

`jax.vmap(f, in_axes=-1, out_axes=-1)` takes and gives such arrays, but inside most of its rules move the
samples to the front and back: on a CPU a step of the dynamics then spends most of its time transposing.
Here the operations of f are replayed one by one on arrays with one more axis at the end, where they need
no other change. What has no rule here is left to `jax.vmap`.
"""

import functools
import itertools
import math
import operator
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.extend import core

LARGEST_UNROLLED = 8  # products longer than this are left to the matrix multiplication
_NAMES = """
    abs add and atan2 ceil clamp convert_element_type copy cos div eq erf erf_inv exp exp2 expm1 floor ge gt integer_pow
    is_finite le log log1p logistic lt max min mul ne neg not or pow rem round rsqrt select_n sign sin sqrt square sub
    tan tanh xor
"""
ELEMENTWISE = frozenset(_NAMES.split())
_SAME_AXES = ["reduce_max", "reduce_min", "reduce_sum", "squeeze"]


class Value(NamedTuple):
    """An array, and whether its last axis is the samples'."""

    array: Any
    mapped: bool


def vmap_last(function: Callable[..., Any], mapped: Sequence[bool]) -> Callable[..., Any]:
    """`jax.vmap(function, in_axes=-1 where mapped and None where not, out_axes=-1)` of array arguments."""

    def mapping(*arrays: Any) -> Any:
        values = [Value(jnp.asarray(a), m) for a, m in zip(arrays, mapped, strict=True)]
        n = samples_of(*zip(*values, strict=True))
        one = [
            jax.ShapeDtypeStruct(v.array.shape[:-1] if v.mapped else v.array.shape, v.array.dtype)
            for v in values
        ]
        traced, shapes = jax.make_jaxpr(function, return_shape=True)(*one)
        outputs = _replay(traced, values, n)
        return jax.tree.unflatten(jax.tree.structure(shapes), [_spread(v, n) for v in outputs])

    return mapping


def samples_of(arrays: Sequence[Any], mapped: Sequence[bool]) -> int:
    """The size of the last axis of what is mapped."""
    sizes = sorted({a.shape[-1] for a, m in zip(arrays, mapped, strict=True) if m})
    if len(sizes) > 1:
        raise ValueError(
            f"the last axes must have one size, the number of samples; they have {sizes}"
        )
    return int(sizes[0])


def _replay(closed: core.ClosedJaxpr, inputs: Sequence[Value], n: int) -> list[Value]:
    jaxpr = closed.jaxpr
    known: dict[Any, Value] = {
        v: Value(c, False) for v, c in zip(jaxpr.constvars, closed.consts, strict=True)
    }
    known |= dict(zip(jaxpr.invars, inputs, strict=True))

    def read(variable: Any) -> Value:
        if isinstance(variable, core.Literal):
            return Value(jnp.asarray(variable.val, aval(variable).dtype), False)
        return known[variable]

    for equation in jaxpr.eqns:
        known |= dict(
            zip(
                equation.outvars,
                _apply(equation, [read(v) for v in equation.invars], n),
                strict=True,
            )
        )
    return [read(v) for v in jaxpr.outvars]


def _apply(equation: core.JaxprEqn, inputs: list[Value], n: int) -> list[Value]:
    """One operation, on arrays whose last axis is the samples' where mapped."""
    primitive, params = equation.primitive, equation.params
    if primitive.name == "jit":
        return _replay(params["jaxpr"], inputs, n)
    if not any(v.mapped for v in inputs):
        return [Value(a, False) for a in _alone(equation, *(v.array for v in inputs))]
    if primitive.name in ELEMENTWISE:
        shape = aval(equation.outvars[0]).shape
        arrays = [_spread(v, n, shape) for v in inputs]
        return [Value(primitive.bind(*arrays, **params), True)]
    if primitive.name == "concatenate":
        return [Value(jnp.concatenate([_spread(v, n) for v in inputs], params["dimension"]), True)]
    if primitive.name == "dot_general" and _is_short(equation):
        return [Value(_product(params["dimension_numbers"][0], *inputs), True)]
    if inputs[0].mapped and not any(v.mapped for v in inputs[1:]):
        adapted = _adapted(primitive.name, params, inputs[0].array)
        if adapted is not None:
            return [Value(primitive.bind(*(v.array for v in inputs), **adapted), True)]
    return left_to_vmap(equation, inputs)


def _spread(value: Value, n: int, shape: tuple[int, ...] | None = None) -> Array:
    """The array for n samples, stretched to `shape` before them if one is given: what is not mapped is repeated."""
    array = value.array if value.mapped else value.array[..., None]
    shape = array.shape[:-1] if shape is None else shape
    return jnp.broadcast_to(
        array.reshape((1,) * (len(shape) + 1 - array.ndim) + array.shape), (*shape, n)
    )


def _adapted(name: str, params: dict[str, Any], x: Array) -> dict[str, Any] | None:
    """The parameters with which an operation on one array does the same beside one more axis at the end."""
    n = x.shape[-1]
    if name in _SAME_AXES:
        return params
    if name == "slice":
        strides = params["strides"]
        ends = {
            "start_indices": (*params["start_indices"], 0),
            "limit_indices": (*params["limit_indices"], n),
        }
        return params | ends | {"strides": None if strides is None else (*strides, 1)}
    if name == "reshape" and params["dimensions"] is None:
        return params | {"new_sizes": (*params["new_sizes"], n)}
    if name == "transpose":
        return params | {"permutation": (*params["permutation"], x.ndim - 1)}
    if name == "pad":
        return params | {"padding_config": (*params["padding_config"], (0, 0, 0))}
    if name == "broadcast_in_dim":
        shape = params["shape"]
        return params | {
            "shape": (*shape, n),
            "broadcast_dimensions": (*params["broadcast_dimensions"], len(shape)),
        }
    return None


def aval(variable: Any) -> jax.ShapeDtypeStruct:
    return variable.aval


def is_plain(equation: core.JaxprEqn) -> bool:
    """Whether a `dot_general` has one type and no batch axes, and adds up something."""
    (left, _), (batch, _) = equation.params["dimension_numbers"]
    a, b = (aval(v) for v in equation.invars)
    plain = equation.params["preferred_element_type"] in (None, a.dtype) and a.dtype == b.dtype
    return plain and not batch and math.prod(a.shape[i] for i in left) > 0


def _is_short(equation: core.JaxprEqn) -> bool:
    (left, _), _ = equation.params["dimension_numbers"]
    return (
        is_plain(equation)
        and math.prod(aval(equation.invars[0]).shape[i] for i in left) <= LARGEST_UNROLLED
    )


def _product(contracted: tuple[Sequence[int], Sequence[int]], a: Value, b: Value) -> Array:
    """A product of matrices, written out over the contracted axes."""
    A, B = (
        jnp.moveaxis(v.array if v.mapped else v.array[..., None], axes, range(len(axes)))
        for v, axes in zip((a, b), contracted, strict=True)
    )
    k = len(contracted[0])
    free_a, free_b = A.ndim - k - 1, B.ndim - k - 1
    terms = [
        A[at].reshape(*A.shape[k:-1], *(1,) * free_b, A.shape[-1])
        * B[at].reshape(*(1,) * free_a, *B.shape[k:])
        for at in itertools.product(*(range(size) for size in A.shape[:k]))
    ]
    return functools.reduce(operator.add, terms)


def left_to_vmap(equation: core.JaxprEqn, inputs: list[Value]) -> list[Value]:
    axes = tuple(-1 if v.mapped else None for v in inputs)
    mapping = jax.vmap(functools.partial(_alone, equation), in_axes=axes, out_axes=-1)
    return [Value(a, True) for a in mapping(*(v.array for v in inputs))]


def _alone(equation: core.JaxprEqn, *arrays: Array) -> list[Array]:
    """One operation as it stands, whatever functions are among its parameters."""
    given = {
        id(v): a
        for v, a in zip(equation.invars, arrays, strict=True)
        if not isinstance(v, core.Literal)
    }
    inputs = {id(v): v for v in equation.invars if not isinstance(v, core.Literal)}
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # no DebugInfo, which only JAX itself can make
        jaxpr = core.Jaxpr(
            (), list(inputs.values()), equation.outvars, [equation], equation.effects
        )
    results: list[Array] = core.jaxpr_as_fun(core.ClosedJaxpr(jaxpr, ()))(*given.values())
    return results
