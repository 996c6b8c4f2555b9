"""Replays the operations of a traced function by rules, on another representation of its values.

JAX traces a function of one sample into a jaxpr, a list of operations. `interpret` walks that list
and calls, for each operation, the rule of a table with the operation's name. The two tables of this
package carry N samples at once: `vmap_last` keeps an array with one more axis, `scalarized` keeps
one vector of N numbers per component. What a table has no rule for is left to its fallback.

The module relies on the names and parameters of JAX's primitives, which JAX may change without
notice. Hence the upper bound on `jax` in pyproject.toml; tests/numerics/test_jax_canary.py says
what has changed when the bound is raised.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.extend import core

Represented = TypeVar("Represented")  # a value as a table of rules represents it
PrimitiveRule = Callable[[core.JaxprEqn, list[Any], int], Sequence[Any] | None]

# Primitives that act on each component by itself.
ELEMENTWISE = frozenset(
    [
        "abs",
        "add",
        "and",
        "atan2",
        "ceil",
        "clamp",
        "convert_element_type",
        "copy",
        "cos",
        "div",
        "eq",
        "erf",
        "erf_inv",
        "exp",
        "exp2",
        "expm1",
        "floor",
        "ge",
        "gt",
        "integer_pow",
        "is_finite",
        "le",
        "log",
        "log1p",
        "logistic",
        "lt",
        "max",
        "min",
        "mul",
        "ne",
        "neg",
        "not",
        "or",
        "pow",
        "rem",
        "round",
        "rsqrt",
        "select_n",
        "sign",
        "sin",
        "sqrt",
        "square",
        "sub",
        "tan",
        "tanh",
        "xor",
    ]
)


class RuleTable(NamedTuple, Generic[Represented]):
    """Says how values are represented and what becomes of each operation.

    A rule takes the operation, its represented inputs and the number of samples; it returns the
    represented outputs, or None where it does not cover the case.
    """

    constant: Callable[[Any], Represented]  # represents an array that is the same for all samples
    rules: Mapping[str, PrimitiveRule]  # by the names of primitives
    fallback: PrimitiveRule  # for operations without a rule; never returns None


class TracedSample(NamedTuple):
    """Holds a function traced for one sample."""

    closed_jaxpr: core.ClosedJaxpr
    outputs: Any  # the pytree of the function's results, of `jax.ShapeDtypeStruct`
    samples: int  # N, the size of the last axis of every mapped argument


def trace_sample(
    function: Callable[..., Any], arrays: Sequence[Array], mapped: Sequence[bool]
) -> TracedSample:
    """Traces `function` for one sample of its arguments.

    The last axis of mapped arguments is the samples'. Raises ValueError if the mapped arguments
    have different numbers of samples.
    """
    sizes = sorted({a.shape[-1] for a, m in zip(arrays, mapped, strict=True) if m})
    if len(sizes) > 1:
        raise ValueError(
            f"the last axes must have one size, the number of samples; they have {sizes}"
        )
    sample = sample_shapes(arrays, mapped)
    closed_jaxpr, outputs = jax.make_jaxpr(function, return_shape=True)(*sample)
    return TracedSample(closed_jaxpr, outputs, int(sizes[0]))


def sample_shapes(arrays: Sequence[Array], mapped: Sequence[bool]) -> list[jax.ShapeDtypeStruct]:
    """Returns the shapes and types of one sample of each array."""
    return [
        jax.ShapeDtypeStruct(a.shape[:-1] if m else a.shape, a.dtype)
        for a, m in zip(arrays, mapped, strict=True)
    ]


def interpret(
    closed_jaxpr: core.ClosedJaxpr,
    inputs: Sequence[Represented],
    table: RuleTable[Represented],
    samples: int,
) -> list[Represented]:
    """Replays a jaxpr on represented inputs and returns its represented outputs."""
    jaxpr = closed_jaxpr.jaxpr
    known: dict[Any, Represented] = {}

    def read(variable: Any) -> Represented:
        if isinstance(variable, core.Literal):
            return table.constant(np.asarray(variable.val, aval(variable).dtype))
        return known[variable]

    for variable, constant in zip(jaxpr.constvars, closed_jaxpr.consts, strict=True):
        known[variable] = table.constant(constant)
    known.update(zip(jaxpr.invars, inputs, strict=True))
    for equation in jaxpr.eqns:
        operands = [read(variable) for variable in equation.invars]
        results = _apply(equation, operands, table, samples)
        known.update(zip(equation.outvars, results, strict=True))
    return [read(variable) for variable in jaxpr.outvars]


def _apply(
    equation: core.JaxprEqn,
    operands: list[Represented],
    table: RuleTable[Represented],
    samples: int,
) -> Sequence[Represented]:
    """Returns the results of one operation; the body of a `jit` is replayed in its place."""
    name = equation.primitive.name
    if name == "jit":
        return interpret(equation.params["jaxpr"], operands, table, samples)
    rule = table.rules.get(name, table.fallback)
    results = rule(equation, operands, samples)
    if results is None:
        results = table.fallback(equation, operands, samples)
    assert results is not None  # the promise of a fallback
    return results


def evaluate(equation: core.JaxprEqn, *arrays: Any) -> list[Array]:
    """Carries out one operation as it stands, with any functions among its parameters."""
    primitive = equation.primitive
    functions: tuple = ()
    params = primitive.get_bind_params(equation.params)
    if isinstance(params, tuple):  # JAX before 0.10 returned functions and parameters apart
        functions, params = params
    results = primitive.bind(*functions, *arrays, **params)
    return list(results) if primitive.multiple_results else [results]


def vmap_operation(
    equation: core.JaxprEqn, arrays: Sequence[Array], mapped: Sequence[bool]
) -> list[Array]:
    """Carries out one operation for all samples, by `jax.vmap` over last axes."""
    axes = tuple(-1 if m else None for m in mapped)
    mapping = jax.vmap(lambda *operands: evaluate(equation, *operands), in_axes=axes, out_axes=-1)
    results: list[Array] = mapping(*map(jnp.asarray, arrays))
    return results


def aval(variable: Any) -> jax.ShapeDtypeStruct:
    """Returns shape and type of a jaxpr's variable or literal."""
    return variable.aval


def count_components(closed_jaxpr: core.ClosedJaxpr) -> int:
    """Returns how many numbers the operations of a traced function compute.

    Those inside the body of a `jit` count, terms of a product's sums do not.
    """
    count = 0
    for equation in closed_jaxpr.jaxpr.eqns:
        if equation.primitive.name == "jit":
            count += count_components(equation.params["jaxpr"])
        else:
            count += sum(math.prod(aval(variable).shape) for variable in equation.outvars)
    return count


def is_plain_product(equation: core.JaxprEqn) -> bool:
    """Says whether a `dot_general` has one type, no batch axes, and at least one term."""
    (contracted, _), (batch, _) = equation.params["dimension_numbers"]
    a, b = (aval(variable) for variable in equation.invars)
    same_type = a.dtype == b.dtype
    plain = same_type and equation.params["preferred_element_type"] in (None, a.dtype)
    return plain and not batch and math.prod(a.shape[i] for i in contracted) > 0
