"""Finds out what a function depends on: which components of its argument, and to which degree.

The operations of the traced function are replayed on tables whose entries say of each component
what it depends on. The answer holds for all values and errs on the safe side: an operation without
a rule depends on all of its operands, and to no degree.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax import Array
from jax.extend import core

from .component_table import Table
from .dependence_algebra import (
    CONSTANT,
    Dependence,
    described,
    function_of,
    power_of,
    product_of,
    quotient_of,
    selected_of,
    sum_of,
)
from .jaxpr_interpreter import (
    ELEMENTWISE,
    RuleTable,
    aval,
    evaluate,
    interpret,
)

LARGEST_KNOWN = 256  # entries of a constant whose values are kept, to know which are zero

# Operations that move the entries of their first operand.
MOVING = frozenset(
    [
        "broadcast_in_dim",
        "concatenate",
        "copy",
        "dynamic_slice",
        "expand_dims",
        "gather",
        "reshape",
        "rev",
        "slice",
        "split",
        "squeeze",
        "stack",
        "transpose",
    ]
)
CUSTOM_DERIVATIVES = ("custom_jvp_call", "custom_vjp_call")


def dependence(function: Callable[[Array], Array], x: Array) -> Dependence:
    """Returns what a function (n,) -> () depends on; only shape and type of x count."""
    sample = jax.ShapeDtypeStruct(x.shape, x.dtype)
    closed_jaxpr = jax.make_jaxpr(function)(sample)
    argument = np.empty(len(x), object)
    for i in range(len(x)):
        argument[i] = Dependence(frozenset([i]), 1)
    (result,) = interpret(closed_jaxpr, [argument], _DEPENDENCES, 1)
    return described(result.item())


def _constant(value: Any) -> Table:
    """Represents an array that does not depend on the argument, by its values if they are few."""
    shape = np.shape(value)
    table = np.empty(shape, object)
    has_values = not isinstance(value, jax.core.Tracer) and value.dtype.kind in "biufc"
    if not has_values or np.size(value) > LARGEST_KNOWN:
        table.fill(CONSTANT)
        return table
    values = np.asarray(value)
    for index in np.ndindex(*shape):
        table[index] = values[index]
    return table


def _is_known(table: Table) -> bool:
    return not any(isinstance(entry, Dependence) for entry in table.flat)


# Rules.


def _carry_out(equation: core.JaxprEqn, tables: list[Table], n: int) -> list[Table]:
    """Carries an operation out on tables of dependences."""
    results = _by_rule(equation, tables)
    return _opaque(equation, tables) if results is None else results


def _by_rule(equation: core.JaxprEqn, tables: list[Table]) -> list[Table] | None:
    """Carries an operation out; None where there is no rule for it."""
    name = equation.primitive.name
    if all(map(_is_known, tables)) and not equation.effects:
        return _evaluated(equation, tables)
    if name in MOVING:
        return _moved(equation, tables)
    if name in CUSTOM_DERIVATIVES:
        return _called(equation, tables)
    outputs = [aval(variable) for variable in equation.outvars]
    operation = _operation(equation)
    if operation is not None:
        return [_for_each_entry(operation, outputs[0].shape, tables)]
    if name == "reduce_sum":
        return [_reduced(sum_of, equation, tables[0])]
    if name == "dot_general":
        return [_contracted(equation, *tables)]
    return None


def _operation(equation: core.JaxprEqn) -> Callable[..., Any] | None:
    """Returns what becomes of the entries of an operation that acts on each by itself."""
    name = equation.primitive.name
    if name not in ELEMENTWISE and name != "add_any":
        return None
    if name == "integer_pow":
        return functools.partial(power_of, exponent=equation.params["y"])
    if name == "square":
        return functools.partial(power_of, exponent=2)
    if name == "convert_element_type":
        types = [aval(equation.invars[0]).dtype, equation.params["new_dtype"]]
        is_float = all(np.issubdtype(dtype, np.floating) for dtype in types)
        return sum_of if is_float else function_of
    by_name: dict[str, Callable[..., Any]] = {
        "add": sum_of,
        "add_any": sum_of,
        "copy": sum_of,
        "div": quotient_of,
        "mul": product_of,
        "neg": sum_of,
        "pow": power_of,
        "select_n": selected_of,
        "sub": sum_of,
    }
    return by_name.get(name, function_of)


def _for_each_entry(
    operation: Callable[..., Any], shape: tuple[int, ...], tables: Sequence[Table]
) -> Table:
    spread = [np.broadcast_to(table, shape) for table in tables]
    result = np.empty(shape, object)
    for index in np.ndindex(*shape):
        result[index] = operation(*(table[index] for table in spread))
    return result


def _reduced(operation: Callable[..., Any], equation: core.JaxprEqn, table: Table) -> Table:
    """Joins the entries along the axes of a reduction."""
    axes = equation.params["axes"]
    shape = aval(equation.outvars[0]).shape
    rows = np.moveaxis(table, axes, range(len(axes))).reshape(-1, *shape)
    result = np.empty(shape, object)
    for index in np.ndindex(*shape):
        result[index] = operation(*rows[(slice(None), *index)])
    return result


def _contracted(equation: core.JaxprEqn, a: Table, b: Table) -> Table:
    """Multiplies two tables as `dot_general` does."""
    (a_sum, b_sum), (a_batch, b_batch) = equation.params["dimension_numbers"]
    shape = aval(equation.outvars[0]).shape
    sides = []
    for table, batch, summed in ((a, a_batch, a_sum), (b, b_batch, b_sum)):
        free = [axis for axis in range(table.ndim) if axis not in (*batch, *summed)]
        table = table.transpose([*batch, *free, *summed])
        sizes = [table.shape[: len(batch)], table.shape[len(batch) : len(batch) + len(free)]]
        sides.append(table.reshape(int(np.prod(sizes[0])), int(np.prod(sizes[1])), -1))
    left_side, right_side = sides
    result = np.empty((len(left_side), left_side.shape[1], right_side.shape[1]), object)
    for batch, i, j in np.ndindex(*result.shape):
        pairs = zip(left_side[batch, i], right_side[batch, j], strict=True)
        result[batch, i, j] = sum_of(*(product_of(*pair) for pair in pairs))
    return result.reshape(shape)


def _evaluated(equation: core.JaxprEqn, tables: Sequence[Table]) -> list[Table]:
    """Carries out an operation on numbers that are known."""
    types = [aval(variable).dtype for variable in equation.invars]
    with jax.ensure_compile_time_eval():
        numbers = [
            jax.numpy.asarray(table.tolist(), dtype).reshape(table.shape)
            for table, dtype in zip(tables, types, strict=True)
        ]
        return [_constant(value) for value in evaluate(equation, *numbers)]


def _moved(equation: core.JaxprEqn, tables: Sequence[Table]) -> list[Table] | None:
    """Moves entries as an operation moves numbers: it is carried out on the entries' positions.

    Where to the entries are moved must be known: it is an operand of some operations.
    """
    n_data = len(tables) if equation.primitive.name in ("concatenate", "stack") else 1
    if not all(map(_is_known, tables[n_data:])):
        return None
    entries = np.concatenate([table.reshape(-1) for table in tables[:n_data]])
    ends = np.cumsum([table.size for table in tables[:n_data]])
    positions = [
        np.arange(end - table.size, end).reshape(table.shape)
        for end, table in zip(ends, tables, strict=False)
    ]
    with jax.ensure_compile_time_eval():
        data = [jax.numpy.asarray(position, np.int32) for position in positions]
        rest = [
            jax.numpy.asarray(table.tolist(), aval(variable).dtype).reshape(table.shape)
            for table, variable in zip(tables[n_data:], equation.invars[n_data:], strict=True)
        ]
        results = [np.asarray(value) for value in evaluate(equation, *data, *rest)]
    if any(np.any((value < 0) | (value >= len(entries))) for value in results):
        return None
    return [_entries_at(entries, value) for value in results]


def _entries_at(entries: np.ndarray, positions: np.ndarray) -> Table:
    """Returns a table of the entries at the positions (...)."""
    result = np.empty(positions.shape, object)
    for index in np.ndindex(*positions.shape):
        result[index] = entries[positions[index]]
    return result


def _called(equation: core.JaxprEqn, tables: list[Table]) -> list[Table] | None:
    """Replays a function with derivatives of its own: no polynomial, since these may be any."""
    inner = equation.params.get("call_jaxpr")
    if not isinstance(inner, core.ClosedJaxpr):
        return None
    results = interpret(inner, tables, _DEPENDENCES, 1)
    return [_for_each_entry(function_of, table.shape, [table]) for table in results]


def _opaque(equation: core.JaxprEqn, tables: list[Table]) -> list[Table]:
    """Lets every result depend on all operands, as if the operation could do anything."""
    entries = [entry for table in tables for entry in table.flat]
    result = function_of(*entries)
    outputs = []
    for variable in equation.outvars:
        table = np.empty(aval(variable).shape, object)
        table.fill(result)
        outputs.append(table)
    return outputs


_DEPENDENCES: RuleTable[Table] = RuleTable(constant=_constant, rules={}, fallback=_carry_out)
