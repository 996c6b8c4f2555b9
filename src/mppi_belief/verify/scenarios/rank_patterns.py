"""Pairs of D and G with every pattern of ranks, whose ranges are known (Proposition 3)."""

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
    range_included,
    residual,
)

LARGEST = 5  # number of states, and of controls


class RankCase(NamedTuple):
    """Holds D and G and what is known of them."""

    D: np.ndarray  # (n, n)
    G: np.ndarray  # (n, l)
    temperature: float  # lambda
    column_basis: np.ndarray  # (n, g), spans range(G)
    row_basis: np.ndarray  # (l, g), spans the row space of G
    included: bool  # whether range(D) is contained in range(G)
    equal: bool  # whether range(D) = range(G)
    outside: float = 0.0  # |(I - P) D (I - P)|, at most |D - P D P|


class Constructions(NamedTuple):
    """Holds what the package makes of a case."""

    W: np.ndarray | None  # (l, l) of (i), None where the package refuses
    R: np.ndarray | None  # (l, l) of (ii), None where the package refuses
    right: bool  # whether each verdict and refusal is right


class WeightResiduals(NamedTuple):
    """Holds relative residuals |D - lambda G W G'| / |D|, each (N,)."""

    constructed: np.ndarray  # of the construction (i)
    controlled: np.ndarray  # of the construction (ii)
    least: np.ndarray  # over all weights


def well_conditioned_matrix(
    rng: np.random.Generator, rows: int, columns: int, low: float = 0.5, high: float = 2.0
) -> np.ndarray:
    """Returns a random matrix (rows, columns) of full rank with singular values in [low, high]."""
    rank = min(rows, columns)
    left_basis, right_basis = (
        np.linalg.qr(rng.normal(size=(n, n)))[0][:, :rank] for n in (rows, columns)
    )
    singular_values = np.exp(rng.uniform(np.log(low), np.log(high), rank))
    return left_basis * singular_values @ right_basis.T


def rank_cases(rng: np.random.Generator) -> Iterator[RankCase]:
    """Yields cases of all shapes up to 5 x 5, all ranks, and every relation of the ranges."""
    for n, nu in np.ndindex(LARGEST, LARGEST):
        for rank_G in range(min(n, nu) + 2):
            for rank_D in range(n + 2):
                yield from _cases_of_ranks(rng, n + 1, nu + 1, rank_G, rank_D)


def _cases_of_ranks(
    rng: np.random.Generator, n: int, nu: int, rank_G: int, rank_D: int
) -> Iterator[RankCase]:
    """Yields D of a rank inside the range of G and out of it, and D made from a weight."""
    basis = np.linalg.qr(rng.normal(size=(n, n)))[0]
    rows = np.linalg.qr(rng.normal(size=(nu, nu)))[0]
    core = well_conditioned_matrix(rng, rank_G, rank_G, 10 ** -rng.uniform(0, 2), 1.0)
    G = basis[:, :rank_G] @ core @ rows[:, :rank_G].T
    temperature = 10 ** rng.uniform(-1, 1)

    def case(
        factor: np.ndarray, included: bool, equal: bool, outside_factor: np.ndarray
    ) -> RankCase:
        return RankCase(
            D=factor @ factor.T,
            G=G,
            temperature=temperature,
            column_basis=basis[:, :rank_G],
            row_basis=rows[:, :rank_G],
            included=included,
            equal=equal,
            outside=float(np.linalg.norm(outside_factor @ outside_factor.T)),
        )

    zero = np.zeros((n - rank_G, rank_D))
    if rank_D <= rank_G:
        inner = well_conditioned_matrix(rng, rank_G, rank_D)
        yield case(basis[:, :rank_G] @ inner, True, rank_D == rank_G, zero)
    if rank_D and rank_G < n:
        mixed = well_conditioned_matrix(rng, n, rank_D)
        yield case(basis @ mixed, False, False, mixed[rank_G:])
        leaning = np.vstack([well_conditioned_matrix(rng, rank_G, rank_D), zero])
        leaning[-1, -1] = 1.0  # one direction of D leans out of range(G)
        yield case(basis @ leaning, False, False, leaning[rank_G:])
    if rank_D <= nu:
        inner = well_conditioned_matrix(rng, rank_G, rank_D)
        kernel_part = rng.normal(size=(nu - rank_G, rank_D))
        weight_factor = rows @ np.vstack([inner, kernel_part])
        equal = min(rank_G, rank_D) == rank_G
        yield case(np.sqrt(temperature) * G @ weight_factor, True, equal, zero)


def construct(case: RankCase) -> Constructions:
    """Returns the package's constructions, and whether its verdicts are right."""
    W = _constructed_or_none(feasible_weight, case)
    R = _constructed_or_none(feasible_control_weight, case)
    verdicts = (range_included(case.D, case.G), W is not None, R is not None)
    return Constructions(W, R, verdicts == (case.included, case.included, case.equal))


def _constructed_or_none(build: Callable[..., np.ndarray], case: RankCase) -> np.ndarray | None:
    try:
        return build(case.D, case.G, case.temperature)
    except ValueError:
        return None


@jax.jit
@jax.vmap
def stacked_residuals(D: Array, G: Array, W: Array, R: Array, temperature: Array) -> list[Array]:
    """Returns the residuals (N,) of W, of R and of the best weight for stacks (N, 5, 5)."""
    candidates = (temperature * W, matched_weight(R, temperature), best_weight(D, G))
    return [residual(D, G, weight) for weight in candidates]


def weight_residuals(cases: list[RankCase], built: list[Constructions]) -> WeightResiduals:
    """Returns the package's residuals of all cases at once.

    Matrices are filled up to 5 x 5 with zeros, R with the identity, which changes no range.
    """

    def filled(M: np.ndarray | None, background: np.ndarray) -> np.ndarray:
        enlarged = background.copy()
        if M is not None:
            enlarged[: M.shape[0], : M.shape[1]] = M
        return enlarged

    zero = np.zeros((LARGEST, LARGEST))
    identity = np.eye(LARGEST)
    stacks = [
        [filled(case.D, zero) for case in cases],
        [filled(case.G, zero) for case in cases],
        [filled(constructions.W, zero) for constructions in built],
        [filled(constructions.R, identity) for constructions in built],
        [case.temperature for case in cases],
    ]
    residuals = stacked_residuals(*(np.array(stack) for stack in stacks))
    return WeightResiduals(*(np.asarray(part) for part in residuals))
