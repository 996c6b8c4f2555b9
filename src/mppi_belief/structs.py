"""Frozen dataclasses that are JAX pytrees: numbers are data, sizes and choices are metadata.

    @struct
    class Thermostat:
        gain: float = number(1.0, ge=0)            # traced: a sweep over it compiles once
        weights: Array = array(ndim=1)             # lists become arrays
        n_samples: int = size(500)                 # static: a new value compiles anew
        mode: str = choice("mean", "belief")       # static, first option is the default

Values given by a person (Python numbers, lists, NumPy arrays) are converted and checked when the
object is made; a bad one raises `ValueError` naming the field. Traced values pass unchecked.
"""

import dataclasses
import math
from typing import Any, TypeVar, dataclass_transform

import jax
import numpy as np

T = TypeVar("T")
_STRUCTS: set[type] = set()


def number(
    default: Any = dataclasses.MISSING,
    *,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    optional: bool = False,
) -> Any:
    """A scalar leaf; `optional` also allows None."""
    rule = {"kind": "number", "ge": ge, "gt": gt, "le": le, "optional": optional}
    return dataclasses.field(default=default, metadata=rule)


def array(
    default: Any = dataclasses.MISSING,
    *,
    ndim: int | tuple[int, ...],
    ge: float | None = None,
    gt: float | None = None,
    optional: bool = False,
) -> Any:
    """An array leaf with the given number(s) of dimensions; `optional` also allows None.

    Bounds are for every entry; for a weight that may be a diagonal or a matrix, `ndim=(1, 2)`, they
    are for the eigenvalues of the matrix, which must then be symmetric.
    """
    allowed = (ndim,) if isinstance(ndim, int) else ndim
    rule = {"kind": "array", "ndim": allowed, "ge": ge, "gt": gt, "optional": optional}
    return dataclasses.field(default=default, metadata=rule)


def size(default: Any = dataclasses.MISSING, *, ge: int = 1) -> Any:
    """A static whole number."""
    return dataclasses.field(default=default, metadata={"kind": "size", "ge": ge})


def choice(*options: Any) -> Any:
    """A static value out of `options`; the first is the default."""
    return dataclasses.field(default=options[0], metadata={"kind": "choice", "options": options})


@dataclass_transform(
    frozen_default=True,
    eq_default=False,
    field_specifiers=(number, array, size, choice, dataclasses.field),
)
def struct(cls: type[T]) -> type[T]:
    """Make `cls` a frozen dataclass, check its fields on construction, register it as a pytree."""
    cls.__post_init__ = _check_fields  # type: ignore[attr-defined]
    made: Any = dataclasses.dataclass(frozen=True, eq=False)(cls)
    static = [f.name for f in dataclasses.fields(made) if _is_static(f)]
    data = [f.name for f in dataclasses.fields(made) if not _is_static(f)]
    jax.tree_util.register_dataclass(made, data_fields=data, meta_fields=static)
    _STRUCTS.add(made)
    return made


def is_struct(cls: type) -> bool:
    """Whether `cls` itself was made with `struct`."""
    return cls in _STRUCTS


def _is_static(field: dataclasses.Field) -> bool:
    return field.metadata.get("kind") in ("size", "choice")


def _check_fields(self: Any) -> None:
    for field in dataclasses.fields(self):
        check = _CHECKS.get(field.metadata.get("kind", ""))
        if check is None:
            continue
        try:
            value = check(getattr(self, field.name), field.metadata)
        except ValueError as error:
            raise ValueError(f"{field.name} {error}") from None
        object.__setattr__(self, field.name, value)


def _is_traced(value: Any) -> bool:
    """Whether JAX made the value (or a placeholder for it), so that there is nothing to check."""
    return not isinstance(
        value, (bool, int, float, str, bytes, list, tuple, dict, np.ndarray, np.generic, type(None))
    )


def _number(value: Any, rule: Any) -> Any:
    if _is_traced(value) or (value is None and rule["optional"]):
        return value
    if isinstance(value, (bool, str, bytes, list, tuple, dict, type(None))) or np.ndim(value) != 0:
        raise ValueError(f"must be a number, got {value!r}")
    result = float(value)
    if not math.isfinite(result):
        raise ValueError(f"must be finite, got {value!r}")
    _check_range(result, rule)
    return result


def _check_range(value: float, rule: Any) -> None:
    if rule.get("ge") is not None and value < rule["ge"]:
        raise ValueError(f"must be at least {rule['ge']}, got {value:g}")
    if rule.get("gt") is not None and value <= rule["gt"]:
        raise ValueError(f"must be greater than {rule['gt']}, got {value:g}")
    if rule.get("le") is not None and value > rule["le"]:
        raise ValueError(f"must be at most {rule['le']}, got {value:g}")


def _array(value: Any, rule: Any) -> Any:
    if _is_traced(value) or (value is None and rule["optional"]):
        return value
    try:
        result = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"must be an array of numbers, got {value!r}") from None
    if result.size == 0 and 2 in rule["ndim"]:
        result = result.reshape(0, result.shape[-1])  # an empty list has lost its second dimension
    if result.ndim not in rule["ndim"]:
        wanted = " or ".join(str(n) for n in rule["ndim"])
        raise ValueError(f"must have {wanted} dimension(s), got {result.ndim}")
    if not np.all(np.isfinite(result)):
        raise ValueError("must be finite everywhere")
    _check_bounds(result, rule)
    return result


def _check_bounds(value: np.ndarray, rule: Any) -> None:
    what = "everywhere"
    if rule["ndim"] == (1, 2) and value.ndim == 2:
        if value.shape[0] != value.shape[1] or not np.allclose(value, value.T):
            raise ValueError("must be a diagonal or a symmetric matrix")
        value, what = np.linalg.eigvalsh(value), "in every eigenvalue"
        value = np.where(np.abs(value) < 1e-12 * np.max(np.abs(value), initial=0), 0.0, value)
    if rule["ge"] is not None and np.any(value < rule["ge"]):
        raise ValueError(f"must be at least {rule['ge']} {what}")
    if rule["gt"] is not None and np.any(value <= rule["gt"]):
        raise ValueError(f"must be greater than {rule['gt']} {what}")


def _size(value: Any, rule: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise ValueError(f"must be a whole number, got {value!r}")
    _check_range(int(value), rule)
    return int(value)


def _choice(value: Any, rule: Any) -> Any:
    if value not in rule["options"]:
        raise ValueError(f"must be one of {', '.join(map(str, rule['options']))}, got {value!r}")
    return value


_CHECKS = {"number": _number, "array": _array, "size": _size, "choice": _choice}
