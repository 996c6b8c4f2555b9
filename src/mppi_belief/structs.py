"""Defines frozen dataclasses that are JAX pytrees.

Numbers and arrays are data; sizes, indices and choices are metadata.

    @struct
    class Thermostat:
        gain: float = number(1.0, ge=0)            # traced: a sweep over it compiles once
        weights: Array = array(ndim=1)             # lists become arrays
        n_samples: int = size(500)                 # static: a new value compiles anew
        sensors: tuple = indices((0, 1))           # static
        mode: str = choice("mean", "belief")       # static, first option is the default

Values given by a person (Python numbers, lists, NumPy arrays) are converted and checked when the
object is made; a bad one raises `ValueError` naming the field. Traced values pass unchecked.
"""

import dataclasses
from typing import TYPE_CHECKING, Any, TypeVar, dataclass_transform

import jax
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from .fields import Choice, Indices, Number, WholeNumber, check_range, checked, ruled, rules

T = TypeVar("T")

ROUNDING = 1e-12  # relative to the largest eigenvalue; smaller ones count as zero

_STRUCTS: set[type] = set()

if TYPE_CHECKING:
    # The value that a constructor takes is converted, so it has another type than the field.

    class ArrayField:
        """Describes a field made with `array`: set from numbers in any form, read as an array."""

        def __get__(self, instance: object, owner: Any = None) -> Array: ...

        def __set__(
            self, instance: object, value: ArrayLike | list[Any] | tuple[Any, ...]
        ) -> None: ...

    class OptionalArrayField:
        """Describes an optional field made with `array`."""

        def __get__(self, instance: object, owner: Any = None) -> Array | None: ...

        def __set__(
            self, instance: object, value: ArrayLike | list[Any] | tuple[Any, ...] | None
        ) -> None: ...
else:
    ArrayField = Array
    OptionalArrayField = Array | None


@dataclasses.dataclass(frozen=True)
class ArrayOfNumbers:
    """Accepts an array of finite numbers, and None where it is optional.

    Bounds are for every entry; for a weight that may be a diagonal or a matrix, `ndim=(1, 2)`, they
    are for the eigenvalues of the matrix, which must then be symmetric.
    """

    ndim: tuple[int, ...]  # the numbers of dimensions that are allowed
    ge: float | None = None  # at least
    gt: float | None = None  # greater than
    le: float | None = None  # at most
    optional: bool = False  # whether None is allowed

    def check(self, value: Any) -> np.ndarray | None:
        """Returns the value as an array of floats."""
        if value is None and self.optional:
            return None
        try:
            result = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"must be an array of numbers, got {value!r}") from None
        if result.size == 0 and 2 in self.ndim:
            # An empty list has lost its second dimension.
            result = result.reshape(0, result.shape[-1])
        if result.ndim not in self.ndim:
            allowed = " or ".join(str(n) for n in self.ndim)
            raise ValueError(f"must have {allowed} dimension(s), got {result.ndim}")
        if not np.all(np.isfinite(result)):
            raise ValueError("must be finite everywhere")
        self._check_bounds(result)
        return result

    def _check_bounds(self, value: np.ndarray) -> None:
        """Raises `ValueError` if an entry or an eigenvalue of a weight is out of bounds."""
        where = "everywhere"
        if self.ndim == (1, 2) and value.ndim == 2:
            if value.shape[0] != value.shape[1] or not np.allclose(value, value.T):
                raise ValueError("must be a diagonal or a symmetric matrix")
            where = "in every eigenvalue"
            value = np.linalg.eigvalsh(value)
            value = np.where(
                np.abs(value) < ROUNDING * np.max(np.abs(value), initial=0), 0.0, value
            )
        if value.size:
            check_range(np.min(value), self, where)
            check_range(np.max(value), self, where)


def number(
    default: Any = dataclasses.MISSING,
    *,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    optional: bool = False,
) -> Any:
    """Declares a scalar leaf; `optional` also allows None."""
    return ruled(Number(ge, gt, le, optional), default)


def array(
    default: Any = dataclasses.MISSING,
    *,
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


def size(default: Any = dataclasses.MISSING, *, ge: int = 1) -> Any:
    """Declares a static whole number."""
    return ruled(WholeNumber(ge), default)


def indices(default: Any = dataclasses.MISSING, *, optional: bool = False) -> Any:
    """Declares a static tuple of distinct whole numbers from 0; `optional` also allows None."""
    return ruled(Indices(optional), default)


def choice(*options: Any, default: Any = dataclasses.MISSING) -> Any:
    """Declares a static value out of `options`; the first is the default unless another is named.

    Type checkers see a default only where it is named.
    """
    return ruled(Choice(options), options[0] if default is dataclasses.MISSING else default)


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

    cls.__post_init__ = check  # type: ignore[attr-defined]
    result: Any = dataclasses.dataclass(frozen=True, eq=False)(cls)
    names = [field.name for field in dataclasses.fields(result)]
    static = [name for name, rule in rules(result).items() if _is_static(rule)]
    data = [name for name in names if name not in static]
    jax.tree_util.register_dataclass(result, data_fields=data, meta_fields=static)
    _STRUCTS.add(result)
    return result


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
