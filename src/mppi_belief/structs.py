"""Defines frozen dataclasses that are JAX pytrees.

Numbers and arrays are data; sizes, indices and choices are metadata.

    @struct
    class Thermostat:
        gain: float = number(default=1.0, ge=0)                    # traced: compiled once
        weights: ArrayField = array(ndim=1)                        # lists become arrays
        n_samples: int = size(default=500)                         # static: compiled per value
        sensors: tuple[int, ...] = indices(default=(0, 1))         # static
        mode: str = choice("mean", "belief", default="mean")       # static

Values given by a person (Python numbers, lists, NumPy arrays) are converted and checked when the
object is made; a bad one raises `ValueError` naming the field. Traced values pass unchecked.

Every struct has one more static field, `struct_class`, which holds its class. Without it JAX
(0.10.2) holds the structures of objects of two dataclasses for equal where their static fields are,
and may then run the compiled program of the one for the other.

A default is named, `default=1.0`, since type checkers see no other. They learn the type of a field
from its specifier too, so that `gain: str = number()` is an error.
"""

import dataclasses
import inspect
from typing import Any, Literal, TypeVar, dataclass_transform, overload

import jax
import numpy as np

from .array_fields import ArrayField as ArrayField
from .array_fields import ArrayOfNumbers
from .array_fields import OptionalArrayField as OptionalArrayField
from .fields import Choice, Indices, Number, WholeNumber, checked, ruled, rules

T = TypeVar("T")
STRUCT_CLASS = "struct_class"  # name of the static field that holds the class

_STRUCTS: set[type] = set()


@overload
def number(
    *,
    default: float = ...,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    optional: Literal[False] = False,
) -> float: ...


@overload
def number(
    *,
    default: float | None = ...,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    optional: Literal[True],
) -> float | None: ...


def number(
    *,
    default: Any = dataclasses.MISSING,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    optional: bool = False,
) -> Any:
    """Declares a scalar leaf; `optional` also allows None."""
    return ruled(Number(ge, gt, le, optional), default)


def array(
    *,
    default: Any = dataclasses.MISSING,
    ndim: int | tuple[int, ...],
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    optional: bool = False,
) -> Any:
    """Declares an array leaf with the given number(s) of dimensions; `optional` also allows None.

    Bounds are for every entry; for a weight that may be a diagonal or a matrix, `ndim=(1, 2)`, they
    are for the eigenvalues of the matrix, which must then be symmetric.
    """
    allowed = (ndim,) if isinstance(ndim, int) else ndim
    return ruled(ArrayOfNumbers(allowed, ge, gt, le, optional), default)


def size(*, default: Any = dataclasses.MISSING, ge: int = 1) -> int:
    """Declares a static whole number."""
    field: Any = ruled(WholeNumber(ge), default)
    return field


@overload
def indices(
    *, default: tuple[int, ...] = ..., optional: Literal[False] = False
) -> tuple[int, ...]: ...


@overload
def indices(
    *, default: tuple[int, ...] | None = ..., optional: Literal[True]
) -> tuple[int, ...] | None: ...


def indices(*, default: Any = dataclasses.MISSING, optional: bool = False) -> Any:
    """Declares a static tuple of distinct whole numbers from 0; `optional` also allows None."""
    return ruled(Indices(optional), default)


def choice(*options: T, default: Any = dataclasses.MISSING) -> T:
    """Declares a static value out of `options`."""
    field: Any = ruled(Choice(options), default)
    return field


@dataclass_transform(
    frozen_default=True,
    eq_default=False,
    field_specifiers=(number, array, size, indices, choice, dataclasses.field),
)
def struct(cls: type[T]) -> type[T]:
    """Makes `cls` a frozen dataclass and a JAX pytree whose fields are checked on construction.

    A `__post_init__` of the class itself is called after its fields are checked.
    """
    own_check = getattr(cls, "__post_init__", None)

    def check(self: Any) -> None:
        _check_fields(self)
        if own_check is not None:
            own_check(self)

    _declare_struct_class(cls)
    cls.__post_init__ = check  # type: ignore[attr-defined]
    result: Any = dataclasses.dataclass(frozen=True, eq=False)(cls)
    names = [field.name for field in struct_fields(result)]
    static = [name for name, rule in rules(result).items() if _is_static(rule)]
    data = [name for name in names if name not in static]
    jax.tree_util.register_dataclass(result, data_fields=data, meta_fields=[*static, STRUCT_CLASS])
    _STRUCTS.add(result)
    return result


def _declare_struct_class(cls: type) -> None:
    """Adds the static field with the class to a class that becomes a dataclass."""
    field = dataclasses.field(default=cls, kw_only=True, repr=False)
    cls.__annotations__ = {**inspect.get_annotations(cls), STRUCT_CLASS: type}
    setattr(cls, STRUCT_CLASS, field)


def struct_fields(cls: Any) -> list["dataclasses.Field[Any]"]:
    """Returns the fields that a struct, or an object of one, was declared with."""
    return [field for field in dataclasses.fields(cls) if field.name != STRUCT_CLASS]


def is_struct(cls: type) -> bool:
    """Says whether `cls` itself was made with `struct`."""
    return cls in _STRUCTS


def _is_static(rule: Any) -> bool:
    return isinstance(rule, (WholeNumber, Indices, Choice))


def _check_fields(self: Any) -> None:
    """Checks and converts every field that has a rule."""
    for name, rule in rules(type(self)).items():
        value = getattr(self, name)
        if _is_static(rule) or not _is_traced(value):
            if isinstance(rule, Number) and isinstance(value, np.ndarray) and value.ndim == 0:
                value = value.item()
            object.__setattr__(self, name, checked(name, value, rule))


def _is_traced(value: Any) -> bool:
    """Says whether JAX made the value or a placeholder for it, which cannot be checked."""
    return not isinstance(
        value, (bool, int, float, str, bytes, list, tuple, dict, np.ndarray, np.generic, type(None))
    )
