"""Combines dependences: on which components the result of an operation depends, to which degree.

An entry is a `Dependence`, or a number that is known. A sum of a zero and a product with a zero are
recognised, so what is multiplied with a known zero does not count.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

QUADRATIC = 2  # the highest degree that is distinguished
NOT_QUADRATIC = 3  # a polynomial of a higher degree, or none


class Dependence(NamedTuple):
    """Says what a number depends on."""

    components: frozenset[int]  # of the function's argument
    degree: int  # of the polynomial that it is; NOT_QUADRATIC beyond QUADRATIC


CONSTANT = Dependence(frozenset(), 0)


def described(entry: Any) -> Dependence:
    """Returns the entry of a table, where numbers are known, as a dependence."""
    return entry if isinstance(entry, Dependence) else CONSTANT


def is_zero(entry: Any) -> bool:
    """Says whether an entry is known to be zero."""
    return not isinstance(entry, Dependence) and entry == 0


def joined(entries: Sequence[Any], degree: Callable[[list[int]], int]) -> Dependence:
    """Returns what depends on all entries that vary, to a degree made of theirs."""
    varying = [e for e in map(described, entries) if e.components]
    if not varying:
        return CONSTANT
    components = frozenset().union(*(e.components for e in varying))
    return Dependence(components, min(degree([e.degree for e in varying]), NOT_QUADRATIC))


def sum_of(*entries: Any) -> Any:
    """Returns what becomes of a sum; known zeros do not count."""
    varying = [entry for entry in entries if not is_zero(entry)]
    return joined(varying, max) if varying else entries[0]


def product_of(*entries: Any) -> Any:
    """Returns what becomes of a product, zero if a factor is known to be."""
    if any(map(is_zero, entries)):
        return np.zeros((), float)[()]
    return joined(entries, sum)


def function_of(*entries: Any) -> Dependence:
    """Returns what becomes of a function that is no polynomial."""
    return joined(entries, lambda degrees: NOT_QUADRATIC)


def quotient_of(numerator: Any, denominator: Any) -> Dependence:
    """Returns what becomes of a quotient."""
    if described(denominator).components:
        return function_of(numerator, denominator)
    return sum_of(numerator)


def selected_of(which: Any, *cases: Any) -> Dependence:
    """Returns what becomes of a choice among cases."""
    return function_of(which, *cases) if described(which).components else sum_of(*cases)


def power_of(entry: Any, exponent: Any) -> Dependence:
    """Returns what becomes of a power."""
    is_polynomial = not isinstance(exponent, Dependence) and exponent >= 0 and exponent % 1 == 0
    if not is_polynomial:
        return function_of(entry, exponent)
    return joined([entry], lambda degrees: int(exponent) * degrees[0])
