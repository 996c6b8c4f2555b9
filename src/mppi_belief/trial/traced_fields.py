"""Explains why a user's own class cannot be traced: a field that is not declared as static.

A struct's field `n: int = 3` is data like every number, so JAX puts a placeholder in its place, and
`jnp.zeros(self.n)` fails. The messages of JAX name the placeholder and not the field.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any

import jax

from ..config.targets import with_source_line
from ..errors import first_line
from ..structs import struct_fields

_UNTRACED_ERRORS = (
    jax.errors.ConcretizationTypeError,
    jax.errors.TracerArrayConversionError,
    jax.errors.TracerIntegerConversionError,
)
_UNTRACED = (
    "it needs the values of its state, as `if`, `float` and NumPy do; "
    "JAX has jnp.where and jnp.* for that"
)


def reason_of(error: Exception, *owners: Any) -> str:
    """Returns in one line why a function of one of the objects cannot be traced.

    The line names fields that are data but may be used as a size, an index or a choice, with what
    to write instead. It ends with the line of the user's own code.
    """
    untraced = isinstance(error, _UNTRACED_ERRORS)
    reason = _UNTRACED if untraced else first_line(error)
    if untraced or "Tracer" in reason:
        undeclared = dict(pair for owner in owners for pair in _undeclared(owner))
        if undeclared:
            declarations = ", ".join(f"`{text}`" for text in undeclared.values())
            fields = f"the value of {', '.join(undeclared)}, which JAX traces; write {declarations}"
            reason = f"{_UNTRACED}; or it needs {fields}" if untraced else f"it needs {fields}"
    return with_source_line(reason, error)


def _undeclared(owner: Any) -> Iterator[tuple[str, str]]:
    """Yields name and declaration of every field of an object and of its parts that is no array and
    not declared: "Rows.n" and "n: int = mppi_belief.size(default=3)".
    """
    if not dataclasses.is_dataclass(owner):
        return
    for field in struct_fields(owner):
        declaration = None if field.metadata else _declaration(field)
        if declaration is not None:
            yield f"{type(owner).__name__}.{field.name}", f"{field.name}: {declaration}"
        yield from _undeclared(getattr(owner, field.name))


def _declaration(field: "dataclasses.Field[Any]") -> str | None:
    """Returns how a field that is no array is declared; None for any other."""
    annotation = field.type if isinstance(field.type, str) else getattr(field.type, "__name__", "")
    default = "" if field.default is dataclasses.MISSING else f"default={field.default!r}"
    if annotation == "int":
        lowest = ", ge=0" if field.default == 0 else ""
        return f"int = mppi_belief.size({default}{lowest})"
    if annotation == "bool":
        options = ", ".join(filter(None, ["False", "True", default]))
        return f"bool = mppi_belief.choice({options})"
    if annotation.startswith("tuple"):
        return f"{annotation} = mppi_belief.indices({default})"
    return None
