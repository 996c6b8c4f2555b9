"""A map over samples for functions of many small matrices, component by component.

`vmap_last` keeps a matrix of every sample as one array (n, m, N). A filter step inside a rollout
takes such arrays apart and puts them together again between any two products, which costs more than
the products. Here the operations are replayed on tables of components. A component is a vector
(N,), a number that is the same for all samples (), or a number known while tracing. Moving
components costs nothing then, and a factor known to be 0 or 1 (an entry of a Jacobian, say) is not
multiplied with; 0 times anything counts as 0.

Rounding differs from `jax.vmap` only in the order of sums. Larger matrices and longer programs are
left to `vmap_last`, operations without a rule to `jax.vmap`.

Measured gain: a step of MPPI-Belief with a covariance per path (N = 500, H = 30, float32, one core,
jax 0.10.2) takes 1.30 ms, 1.60 ms with `vmap_last` and 4.14 ms with `jax.vmap` (fifth percentiles
of interleaved calls on a busy machine).
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from .component_table import (
    Table,
    add_components,
    build_table,
    constant_table,
    is_known,
    join_table,
    multiply_components,
    subtract_components,
    table_of,
)
from .jaxpr_interpreter import (
    ELEMENTWISE,
    PrimitiveRule,
    RuleTable,
    aval,
    count_components,
    evaluate,
    interpret,
    is_plain_product,
    sample_shapes,
    trace_sample,
    vmap_operation,
)
from .vmap_last import vmap_last

LARGEST_TABLE = 36  # components of an argument; programs of more single components compile too long
LARGEST_PROGRAM = 3000  # components computed per sample; 2700 take half a minute to compile


def vmap_scalarized(
    function: Callable[..., Any], mapped: Sequence[bool], largest_program: int = LARGEST_PROGRAM
) -> Callable[..., Any]:
    """Maps a function of arrays over the last axes of those arguments that are mapped.

    Equals `jax.vmap(function, in_axes=-1 where mapped and None where not, out_axes=-1)`. A function
    that computes more than `largest_program` components per sample is left to `vmap_last`. Raises
    ValueError where the mapped arguments have different numbers of samples.
    """

    def mapping(*arguments: Any) -> Any:
        arrays = [jnp.asarray(argument) for argument in arguments]
        shapes = [sample.shape for sample in sample_shapes(arrays, mapped)]
        if max(np.prod(shape, dtype=int) for shape in shapes) > LARGEST_TABLE:
            return vmap_last(function, mapped)(*arrays)
        traced = trace_sample(function, arrays, mapped)
        if count_components(traced.closed_jaxpr) > largest_program:
            return vmap_last(function, mapped)(*arrays)
        inputs = [table_of(array, shape) for array, shape in zip(arrays, shapes, strict=True)]
        tables = interpret(traced.closed_jaxpr, inputs, _COMPONENTS, traced.samples)
        leaves, structure = jax.tree.flatten(traced.outputs)
        joined = [
            join_table(table, leaf.dtype, traced.samples)
            for table, leaf in zip(tables, leaves, strict=True)
        ]
        return jax.tree.unflatten(structure, joined)

    return mapping


def _bind_component(equation: core.JaxprEqn, *components: Any) -> Any:
    """Carries out an operation on one component of each operand.

    The result of known components is known.
    """
    if equation.primitive.name == "select_n" and is_known(components[0]):
        return components[1 + int(components[0])]
    types = [aval(variable).dtype for variable in equation.invars]
    if all(map(is_known, components)):
        with jax.ensure_compile_time_eval():
            numbers = [jnp.asarray(x, dtype) for x, dtype in zip(components, types, strict=True)]
            return np.asarray(equation.primitive.bind(*numbers, **equation.params))[()]
    shape = max((np.shape(x) for x in components), key=len)
    vectors = [
        jnp.broadcast_to(jnp.asarray(x, dtype), shape)
        for x, dtype in zip(components, types, strict=True)
    ]
    return equation.primitive.bind(*vectors, **equation.params)


# Rules.


def _for_each(operation: Callable[..., Any], tables: Sequence[Table]) -> Table:
    """Returns the table of `operation` on the components at every index."""
    spread = np.broadcast_arrays(*tables)
    return build_table(
        spread[0].shape, lambda index: operation(*(table[index] for table in spread))
    )


def _arithmetic(operation: Callable[[Any, Any], Any]) -> PrimitiveRule:
    return lambda equation, tables, n: [_for_each(operation, tables)]


def _elementwise_table(equation: core.JaxprEqn, tables: list[Table], n: int) -> list[Table]:
    return [_for_each(functools.partial(_bind_component, equation), tables)]


def _product(equation: core.JaxprEqn, tables: list[Table], n: int) -> list[Table] | None:
    """Multiplies matrices, contracted over some axes of each."""
    if not is_plain_product(equation):
        return None
    contracted, _ = equation.params["dimension_numbers"]
    k = len(contracted[0])
    A, B = (np.moveaxis(M, axes, range(k)) for M, axes in zip(tables, contracted, strict=True))
    inner = A.shape[:k]
    rows = A.ndim - k

    def entry(index: tuple[int, ...]) -> Any:
        terms = (
            multiply_components(A[i + index[:rows]], B[i + index[rows:]])
            for i in np.ndindex(*inner)
        )
        return functools.reduce(add_components, terms)

    return [build_table(A.shape[k:] + B.shape[k:], entry)]


def _split(equation: core.JaxprEqn, tables: list[Table], n: int) -> list[Table]:
    ends = np.cumsum(equation.params["sizes"])[:-1]
    return list(np.split(tables[0], ends, axis=equation.params["axis"]))


def _moving(move: Callable[..., Table]) -> PrimitiveRule:
    """Makes the rule of an operation that moves components.

    `move(output, params, *tables)` gets shape and type of the output.
    """

    def rule(equation: core.JaxprEqn, tables: list[Table], n: int) -> list[Table]:
        return [move(aval(equation.outvars[0]), equation.params, *tables)]

    return rule


def _reduction(operation: Callable[[Any, Any], Any]) -> PrimitiveRule:
    """Makes the rule of a reduction over axes."""

    def reduce(output: Any, params: dict[str, Any], x: Table) -> Table:
        axes = params["axes"]
        x = np.moveaxis(x, axes, range(len(axes)))
        inner = x.shape[: len(axes)]

        def entry(index: tuple[int, ...]) -> Any:
            return functools.reduce(operation, (x[i + index] for i in np.ndindex(*inner)))

        return build_table(x.shape[len(axes) :], entry)

    return _moving(reduce)


def _slice_table(output: Any, params: dict[str, Any], x: Table) -> Table:
    strides = params["strides"] or itertools.repeat(1)
    return x[tuple(map(slice, params["start_indices"], params["limit_indices"], strides))]


def _broadcast_table(output: Any, params: dict[str, Any], x: Table) -> Table:
    sizes = [1] * len(output.shape)
    for axis, size in zip(params["broadcast_dimensions"], x.shape, strict=True):
        sizes[axis] = size
    return np.broadcast_to(x.reshape(sizes), output.shape)


def _pad_table(output: Any, params: dict[str, Any], x: Table, value: Table) -> Table:
    padded = build_table(output.shape, lambda index: value[()])
    spans = [
        slice(low, low + size * (interior + 1), interior + 1)
        for (low, _, interior), size in zip(params["padding_config"], x.shape, strict=True)
    ]
    padded[tuple(spans)] = x
    return padded


def _iota(output: Any, params: dict[str, Any]) -> Table:
    return build_table(output.shape, lambda index: output.dtype.type(index[params["dimension"]]))


def _fallback_table(equation: core.JaxprEqn, tables: list[Table], n: int) -> list[Table]:
    """Carries the operation out on the arrays of the tables, by `jax.vmap` where samples differ."""
    mapped = [any(np.shape(component) for component in table.flat) for table in tables]
    joined = [
        join_table(table, aval(variable).dtype, n)
        for table, variable in zip(tables, equation.invars, strict=True)
    ]
    arrays = [array if m else array[..., 0] for array, m in zip(joined, mapped, strict=True)]
    if not any(mapped):
        return [table_of(array, array.shape) for array in evaluate(equation, *arrays)]
    results = vmap_operation(equation, arrays, mapped)
    return [table_of(array, array.shape[:-1]) for array in results]


_TABLE_RULES: dict[str, PrimitiveRule] = {
    **dict.fromkeys(ELEMENTWISE, _elementwise_table),
    "add": _arithmetic(add_components),
    "add_any": _arithmetic(add_components),
    "broadcast_in_dim": _moving(_broadcast_table),
    "concatenate": _moving(lambda out, params, *xs: np.concatenate(xs, params["dimension"])),
    "dot_general": _product,
    "iota": _moving(_iota),
    "mul": _arithmetic(multiply_components),
    "pad": _moving(_pad_table),
    "reduce_max": _reduction(jnp.maximum),
    "reduce_min": _reduction(jnp.minimum),
    "reduce_sum": _reduction(add_components),
    "reshape": _moving(lambda out, params, x: x.reshape(out.shape)),
    "rev": _moving(lambda out, params, x: np.flip(x, params["dimensions"])),
    "slice": _moving(_slice_table),
    "split": _split,
    "squeeze": _moving(lambda out, params, x: x.reshape(out.shape)),
    "stack": _moving(lambda out, params, *xs: np.stack(xs, params.get("axis", 0))),
    "sub": _arithmetic(subtract_components),
    "transpose": _moving(lambda out, params, x: x.transpose(params["permutation"])),
}
_COMPONENTS: RuleTable[Table] = RuleTable(
    constant=constant_table, rules=_TABLE_RULES, fallback=_fallback_table
)
