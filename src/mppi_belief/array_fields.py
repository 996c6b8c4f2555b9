"""Declares the type of a field that holds an array, and checks its values.

A constructor takes a list, a tuple or an array and stores an array. Type checkers learn both types
from a descriptor, which exists for them only:

    goal: ArrayField = array(ndim=1)  # set from [1.0, 2.0], read as an array
"""

import dataclasses
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jax import Array

from .fields import check_range

ROUNDING = 1e-12  # relative to the largest eigenvalue; smaller ones count as zero

if TYPE_CHECKING:
    _Numbers: TypeAlias = Array | np.ndarray | list[Any] | tuple[Any, ...]

    class ArrayField(Array):
        """Describes a field made with `array`: set from a list or an array, read as an array.

        It is an array itself, so that an object with such a field fits a protocol that asks for
        an array.
        """

        def __get__(self, instance: object, owner: Any = None) -> Array: ...

        def __set__(self, instance: object, value: _Numbers) -> None: ...

    class OptionalArrayField:
        """Describes an optional field made with `array`."""

        def __get__(self, instance: object, owner: Any = None) -> Array | None: ...

        def __set__(self, instance: object, value: _Numbers | None) -> None: ...
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
