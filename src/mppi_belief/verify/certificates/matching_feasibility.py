"""Proposition 3: when a weight makes the belief's diffusion match the controls, and how near it comes otherwise.

    (i)  D = lambda G W G' for some W >= 0        if and only if  range(D) is contained in range(G)
    (ii) D = lambda G R^-1 G' for some R > 0      if and only if  range(D) = range(G)

With P the projector on range(G), the nearest G W G' is P D P, so the least residual is sqrt(1 - |P D P|^2 / |D|^2).
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from jax import Array

from ...matching.weights import (
    best_weight,
    feasible_control_weight,
    feasible_weight,
    matched_weight,
    numerical_rank,
    range_included,
    residual,
)
from ...results.certificate import Certificate, Check
from ..bands import EPSILON, at_least, at_most, rounding

LARGEST = 5  # states, and controls
# G^+ twice: LAPACK's dbdsqr leaves off-diagonals of 50 eps and its reflections 10 n; then products of n operations
OPERATIONS = 2 * 50 + 25 * LARGEST
TEXT = (
    "random pairs of D and G: up to 5 states and 5 controls, all ranks, range(D) inside range(G), equal to it or not "
    "inside, D made from its range or from a weight. Where a weight exists it is constructed and meets the condition "
    "to rounding times the square of G's condition number; where none does, the construction refuses and the least "
    "residual is the closed form. With range(D) inside but smaller than range(G) every W has the same singular block "
    "on the row space of G, so no R > 0 exists. Ranks are numerical: singular values up to max(shape) eps times the "
    "largest count as zero, and the verdict changes there."
)


class Case(NamedTuple):
    """D (n, n), G (n, l) and what is known of them: `reached` (n, g) spans range(G), `rows` (l, g) its row space,
    `outside` () is |(I - P) D (I - P)| and thus at most |D - P D P|."""

    D: np.ndarray
    G: np.ndarray
    temperature: float
    reached: np.ndarray
    rows: np.ndarray
    included: bool
    equal: bool
    outside: float = 0.0


class Outcome(NamedTuple):
    """What the library makes of a case: weights, or None where it refuses, and whether each verdict is right."""

    W: np.ndarray | None
    R: np.ndarray | None
    right: bool


def matrix(
    rng: np.random.Generator, rows: int, columns: int, low: float = 0.5, high: float = 2.0
) -> np.ndarray:
    """A random matrix of full rank with singular values in [low, high]."""
    rank = min(rows, columns)
    left, right = (np.linalg.qr(rng.normal(size=(n, n)))[0][:, :rank] for n in (rows, columns))
    return left * np.exp(rng.uniform(np.log(low), np.log(high), rank)) @ right.T


def cases(rng: np.random.Generator) -> Iterator[Case]:
    """All numbers of states and controls up to 5, all ranks of G and D, every relation of their ranges."""
    for n, nu in np.ndindex(LARGEST, LARGEST):
        for g in range(min(n, nu) + 2):
            for d in range(n + 2):
                yield from _pattern(rng, n + 1, nu + 1, g, d)


def _pattern(rng: np.random.Generator, n: int, nu: int, g: int, d: int) -> Iterator[Case]:
    """D of rank d inside the range of G of rank g, and out of it; D made from a weight of rank d."""
    basis, rows = (
        np.linalg.qr(rng.normal(size=(n, n)))[0],
        np.linalg.qr(rng.normal(size=(nu, nu)))[0],
    )
    core = matrix(rng, g, g, 10 ** -rng.uniform(0, 2), 1.0)
    G, temperature = basis[:, :g] @ core @ rows[:, :g].T, 10 ** rng.uniform(-1, 1)

    def case(factor: np.ndarray, included: bool, equal: bool, out: np.ndarray) -> Case:
        D = factor @ factor.T
        return Case(
            D,
            G,
            temperature,
            basis[:, :g],
            rows[:, :g],
            included,
            equal,
            float(np.linalg.norm(out @ out.T)),
        )

    nothing = np.zeros((n - g, d))
    if d <= g:
        yield case(basis[:, :g] @ matrix(rng, g, d), True, d == g, nothing)
    if d and g < n:
        mixed = matrix(rng, n, d)
        yield case(basis @ mixed, False, False, mixed[g:])
        inside = np.vstack([matrix(rng, g, d), nothing])
        inside[-1, -1] = 1.0  # one direction of D leans out of range(G)
        yield case(basis @ inside, False, False, inside[g:])
    if d <= nu:
        weight = rows @ np.vstack([matrix(rng, g, d), rng.normal(size=(nu - g, d))])
        yield case(np.sqrt(temperature) * G @ weight, True, min(g, d) == g, nothing)


def outcome(case: Case) -> Outcome:
    """Verdict and constructions of the library."""
    W, R = (_built(build, case) for build in (feasible_weight, feasible_control_weight))
    verdicts = (range_included(case.D, case.G), W is not None, R is not None)
    return Outcome(W, R, verdicts == (case.included, case.included, case.equal))


def _built(build: Callable[..., np.ndarray], case: Case) -> np.ndarray | None:
    try:
        return build(case.D, case.G, case.temperature)
    except ValueError:
        return None


class Residuals(NamedTuple):
    """Relative residuals (N,) of the construction (i), of (ii), and the least over all weights."""

    constructed: np.ndarray
    controlled: np.ndarray
    least: np.ndarray


@jax.jit
@jax.vmap
def _residuals(D: Array, G: Array, W: Array, R: Array, temperature: Array) -> list[Array]:
    return [
        residual(D, G, weight)
        for weight in (temperature * W, matched_weight(R, temperature), best_weight(D, G))
    ]


def residuals(chosen: list[Case], found: list[Outcome]) -> Residuals:
    """By the library, all at once: filled up with zeros (R with ones) to 5 x 5, which changes no range."""

    def filled(M: np.ndarray | None, rest: np.ndarray) -> np.ndarray:
        whole = rest.copy()
        if M is not None:
            whole[: M.shape[0], : M.shape[1]] = M
        return whole

    zero, one = np.zeros((LARGEST, LARGEST)), np.eye(LARGEST)
    stacks = [
        [filled(case.D, zero) for case in chosen],
        [filled(case.G, zero) for case in chosen],
        [filled(built.W, zero) for built in found],
        [filled(built.R, one) for built in found],
        [case.temperature for case in chosen],
    ]
    made = _residuals(*(np.array(stack) for stack in stacks))
    return Residuals(*(np.asarray(part) for part in made))


def certify(seed: int = 0) -> Certificate:
    """Proposition 3 over all patterns of ranks, and where ranges are nearly equal."""
    chosen = [case for case in cases(np.random.default_rng(seed)) if case.D.any()]
    zero = [case for case in cases(np.random.default_rng(seed)) if not case.D.any()]
    found = [outcome(case) for case in chosen]
    wrong = sum(not built.right for built in found + [outcome(case) for case in zero])
    return Certificate(
        "matching_feasibility",
        "Proposition 3, matching feasibility",
        f"{len(chosen) + len(zero)} {TEXT}",
        [
            at_most(
                "wrong verdicts and constructions over all patterns",
                wrong,
                0,
                "the patterns' ranges are known",
            ),
            *_feasible(chosen, found),
            *_infeasible(chosen, residuals(chosen, found)),
            *_nearly(),
        ],
    )


def _condition(M: np.ndarray) -> float:
    """Largest over smallest singular value, of those that are not zero."""
    values = np.linalg.svd(M, compute_uv=False)[: numerical_rank(M)]
    return float(values[0] / values[-1]) if len(values) else 1.0


def _feasible(chosen: list[Case], found: list[Outcome]) -> list[Check]:
    """(i) and (ii) where they hold, and a W that exists without an R."""
    left = residuals(chosen, found)
    first, second, negative, singular, definite, worst = [], [], [], [], [], 1.0
    for i, (case, built) in enumerate(zip(chosen, found, strict=True)):
        magnified = _condition(case.G) ** 2
        if case.included and built.W is not None:
            first.append(max(left.constructed[i], left.least[i]) / magnified)
            eigenvalues = np.linalg.eigvalsh(built.W)
            negative.append(eigenvalues[0] / eigenvalues[-1])
            if not case.equal:
                block = np.linalg.eigvalsh(case.rows.T @ built.W @ case.rows)
                singular.append(abs(block[0]) / eigenvalues[-1] / magnified)
        if case.equal and built.R is not None:
            eigenvalues = np.linalg.eigvalsh(built.R)
            second.append(left.controlled[i] / magnified * eigenvalues[0] / eigenvalues[-1])
            worst = max(worst, eigenvalues[-1] / eigenvalues[0])
            definite.append(eigenvalues[0] / eigenvalues[-1] * magnified * _condition(case.D))
    return [
        rounding("(i) largest |D - λGWG'| / |D|, over cond(G)²", max(first), OPERATIONS),
        at_least(
            "(i) least eigenvalue of W over its largest",
            min(negative),
            -OPERATIONS * EPSILON,
            "rounding of W ≥ 0",
        ),
        rounding(
            "(ii) largest |D - λGR⁻¹G'| / |D|, over cond(G)² cond(R)", max(second), OPERATIONS
        ),
        at_least(
            "(ii) least of cond(G)² cond(D) / cond(R)",
            min(definite),
            1 - OPERATIONS * EPSILON * worst,
            "R's eigenvalues are λ/eig(G⁺DG⁺'), those on ker G between them",
        ),
        rounding(
            "W without R: largest least eigenvalue on the row space, over |W| cond(G)²",
            max(singular),
            OPERATIONS,
        ),
    ]


def _infeasible(chosen: list[Case], left: Residuals) -> list[Check]:
    """Where range(D) is not contained in range(G): the least residual and its bound."""
    errors, above = [], []
    for case, least in zip(chosen, left.least, strict=True):
        if not case.included:
            P, size, magnified = (
                case.reached @ case.reached.T,
                np.linalg.norm(case.D),
                _condition(case.G) ** 2,
            )
            met = np.linalg.norm(P @ case.D @ P) / size
            errors.append(abs(least**2 - (1 - met**2)) / magnified)
            above.append((least - case.outside / size) / magnified)
    bound = "(I-P)D(I-P) is orthogonal to every GWG'; rounding"
    return [
        rounding(
            "not included: largest error of the squared least residual, over cond(G)²",
            max(errors),
            OPERATIONS,
        ),
        at_least(
            "not included: least residual less |(I-P)D(I-P)| / |D|, the smallest, over cond(G)²",
            min(above),
            -OPERATIONS * EPSILON,
            bound,
        ),
    ]


def _nearly() -> list[Check]:
    """A direction of D that leans out of range(G) by delta, and a singular value delta of G."""
    chosen: list[Case] = []
    expected: list[float] = []
    for delta in (10.0 ** (0.5 - np.arange(1, 19))).tolist():
        lean = np.array([np.sqrt(1 - delta**2), 0.0, delta])
        first, second = np.eye(3)[:, :1], np.eye(3)[:, :2]
        # singular values of [e_1, D] are sqrt(1 +- cos) of the angle: their ratio is tan(angle / 2)
        angle = np.arcsin(delta)
        close = bool(np.tan(angle / 2) <= 4 * EPSILON)
        chosen.append(Case(np.outer(lean, lean), first, 1.0, first, np.eye(1), close, close))
        expected.append(delta * np.sqrt(2 - delta**2))
        seen = bool(delta > 3 * EPSILON)
        chosen.append(
            Case(second @ second.T, second * [1, delta], 1.0, second, np.eye(2), seen, seen)
        )
        expected.append(0.0 if seen else np.sqrt(0.5))
    found = [outcome(case) for case in chosen]
    errors = residuals(chosen, found).least - np.array(expected)
    wrong = sum(not built.right for built in found)
    return [
        at_most(
            "wrong verdicts for δ from 0.3 to 3e-18",
            wrong,
            0,
            "tan(angle/2) against 4 eps, s_min against 3 eps",
        ),
        rounding(
            "δ from 0.3 to 3e-18: largest error of the least residual",
            np.max(np.abs(errors)),
            OPERATIONS,
        ),
    ]
