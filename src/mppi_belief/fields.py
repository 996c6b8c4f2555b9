"""Checks the values of fields: numbers, whole numbers, choices and texts.

This is the one validator of the package, for structs as well as for the settings of a command.

A rule is a small frozen object. Its `check(value)` returns the value in its final type or raises
`ValueError` with what is allowed and what was given: "must be at least 0, got -1". A dataclass
carries its rules in its fields' metadata:

    @dataclass
    class Settings:
        theta: float = ruled(Number(ge=0), default=1.0)
        workers: int = ruled(WholeNumber(ge=1, le=1024), default=2)
        platform: str = ruled(Choice(("cpu", "gpu")), default="cpu")

    checked("theta", -1, rules(Settings)["theta"])  # ValueError: theta must be at least 0, got -1

Imports neither JAX nor NumPy, so that a command line with a wrong setting ends at once.
"""

import dataclasses
import math
import numbers
import re
from collections.abc import Iterable
from typing import Any, Protocol

RULE = "rule"  # the key of a field's metadata under which its rule lies


class Rule(Protocol):
    """Says what a value of a field must be."""

    def check(self, value: Any) -> Any:
        """Returns the value in its final type; raises `ValueError` without the field's name."""


@dataclasses.dataclass(frozen=True)
class Number:
    """Accepts a finite real number within bounds, and None where it is optional."""

    ge: float | None = None  # at least
    gt: float | None = None  # greater than
    le: float | None = None  # at most
    optional: bool = False  # whether None is allowed

    def check(self, value: Any) -> float | None:
        """Returns the value as a float."""
        if value is None and self.optional:
            return None
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise ValueError(f"must be a number, got {value!r}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ValueError(f"must be finite, got {value!r}")
        check_range(number, self)
        return number


@dataclasses.dataclass(frozen=True)
class WholeNumber:
    """Accepts an integer within bounds, and None where it is optional."""

    ge: int | None = None  # at least
    gt: int | None = None  # greater than
    le: int | None = None  # at most
    optional: bool = False  # whether None is allowed

    def check(self, value: Any) -> int | None:
        """Returns the value as an int."""
        if value is None and self.optional:
            return None
        if isinstance(value, bool) or not isinstance(value, numbers.Integral):
            raise ValueError(f"must be a whole number, got {value!r}")
        number = int(value)
        check_range(number, self)
        return number


@dataclasses.dataclass(frozen=True)
class Indices:
    """Accepts distinct whole numbers from 0, and None where that is optional; gives a tuple."""

    optional: bool = False  # whether None is allowed

    def check(self, value: Any) -> tuple[int, ...] | None:
        """Returns the value as a tuple of int."""
        if value is None and self.optional:
            return None
        if isinstance(value, (str, bytes, dict)) or not isinstance(value, Iterable):
            raise ValueError(f"must be a list of whole numbers, got {value!r}")
        given = tuple(value)
        for number in given:
            WholeNumber(ge=0).check(number)
        indices = tuple(map(int, given))
        if not indices or len(set(indices)) < len(indices):
            raise ValueError(f"must be one or more distinct whole numbers, got {list(given)}")
        return indices


@dataclasses.dataclass(frozen=True)
class Choice:
    """Accepts one of a few options."""

    options: tuple[Any, ...]

    def check(self, value: Any) -> Any:
        """Returns the value as it is."""
        if value not in self.options:
            allowed = ", ".join(map(str, self.options))
            raise ValueError(f"must be one of {allowed}, got {value!r}")
        return value


@dataclasses.dataclass(frozen=True)
class Text:
    """Accepts a string that a regular expression matches as a whole, and None where optional."""

    pattern: str
    description: str  # completes "must be ...", with an example: "an amount such as 2GB"
    optional: bool = False  # whether None is allowed

    def check(self, value: Any) -> str | None:
        """Returns the value as it is."""
        if value is None and self.optional:
            return None
        if not isinstance(value, str) or not re.fullmatch(self.pattern, value):
            raise ValueError(f"must be {self.description}, got {value!r}")
        return value


def check_range(value: Any, bounds: Any, where: str = "") -> None:
    """Raises `ValueError` if the value is outside `bounds.ge`, `bounds.gt` or `bounds.le`.

    `where` ("everywhere") names the part of an array that the value is taken from.
    """
    given = f"{value:g}" if isinstance(value, float) else f"{value}"
    ending = f" {where}" if where else f", got {given}"
    if bounds.ge is not None and value < bounds.ge:
        raise ValueError(f"must be at least {bounds.ge}{ending}")
    if bounds.gt is not None and value <= bounds.gt:
        raise ValueError(f"must be greater than {bounds.gt}{ending}")
    if bounds.le is not None and value > bounds.le:
        raise ValueError(f"must be at most {bounds.le}{ending}")


def checked(name: str, value: Any, rule: Rule) -> Any:
    """Returns the value in its final type; a `ValueError` begins with the field's name."""
    try:
        return rule.check(value)
    except ValueError as error:
        raise ValueError(f"{name} {error}") from None


def ruled(rule: Rule, default: Any = dataclasses.MISSING) -> Any:
    """Returns a dataclass field that carries a rule."""
    return dataclasses.field(default=default, metadata={RULE: rule})


def rules(cls: Any) -> dict[str, Rule]:
    """Returns the rules of a dataclass by name of the field, of those fields that have one."""
    rules_by_name: dict[str, Rule] = {}
    for field in dataclasses.fields(cls):
        if RULE in field.metadata:
            rules_by_name[field.name] = field.metadata[RULE]
    return rules_by_name
