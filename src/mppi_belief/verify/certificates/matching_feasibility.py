"""Proposition 3: when a weight makes the belief's diffusion match, and the least residual else.

    (i)  D = lambda G W G' for some W >= 0        if and only if  range(D) is contained in range(G)
    (ii) D = lambda G R^-1 G' for some R > 0      if and only if  range(D) = range(G)

With P the projector on range(G), the nearest G W G' is P D P, so the least residual is
sqrt(1 - |P D P|^2 / |D|^2).
"""

import numpy as np

from ...matching.weights import numerical_rank
from ...results.certificate import Certificate, Check
from ..bands import EPSILON, at_least, at_most, rounding
from ..scenarios.rank_patterns import (
    LARGEST,
    Constructions,
    RankCase,
    WeightResiduals,
    construct,
    rank_cases,
    weight_residuals,
)

# G^+ twice: LAPACK's dbdsqr leaves off-diagonals of 50 eps and its reflections 10 n; then come
# products of n operations.
OPERATIONS = 2 * 50 + 25 * LARGEST
FEASIBILITY_TEXT = (
    "random pairs of D and G: up to 5 states and 5 controls, all ranks, range(D) inside range(G), "
    "equal to it or not inside, D made from its range or from a weight. Where a weight exists, it "
    "is constructed and meets the condition to rounding times the square of G's condition number. "
    "Where none exists, the construction refuses and the least residual is the closed form. With "
    "range(D) inside but smaller than range(G), every W has the same singular block on the row "
    "space of G, so no R > 0 exists. Ranks are numerical: singular values up to max(shape) eps "
    "times the largest count as zero, and the verdict changes there."
)


def certify(seed: int = 0) -> Certificate:
    """Returns the certificate over all patterns of ranks, and where ranges are nearly equal."""
    all_cases = list(rank_cases(np.random.default_rng(seed)))
    cases = [case for case in all_cases if case.D.any()]
    zero_cases = [case for case in all_cases if not case.D.any()]
    built = [construct(case) for case in cases]
    residuals = weight_residuals(cases, built)
    wrong = sum(not b.right for b in built + [construct(case) for case in zero_cases])
    return Certificate(
        "matching_feasibility",
        "Proposition 3, matching feasibility",
        f"{len(all_cases)} {FEASIBILITY_TEXT}",
        [
            at_most(
                "wrong verdicts and constructions over all patterns",
                wrong,
                0,
                "the patterns' ranges are known",
            ),
            *_included_checks(cases, built, residuals),
            *_equal_checks(cases, built, residuals),
            _singular_check(cases, built),
            *_infeasible_checks(cases, residuals),
            *_nearly_equal_checks(),
        ],
    )


def _condition(M: np.ndarray) -> float:
    """Returns the largest over the smallest of the singular values that are not zero."""
    values = np.linalg.svd(M, compute_uv=False)[: numerical_rank(M)]
    return float(values[0] / values[-1]) if len(values) else 1.0


def _included_checks(
    cases: list[RankCase], built: list[Constructions], residuals: WeightResiduals
) -> list[Check]:
    """Checks (i) where it holds."""
    errors = []
    eigenvalue_ratios = []
    for i, (case, constructions) in enumerate(zip(cases, built, strict=True)):
        if case.included and constructions.W is not None:
            residual = max(residuals.constructed[i], residuals.least[i])
            errors.append(residual / _condition(case.G) ** 2)
            eigenvalues = np.linalg.eigvalsh(constructions.W)
            eigenvalue_ratios.append(eigenvalues[0] / eigenvalues[-1])
    return [
        rounding("(i) largest |D - λGWG'| / |D|, over cond(G)²", max(errors), OPERATIONS),
        at_least(
            "(i) least eigenvalue of W over its largest",
            min(eigenvalue_ratios),
            -OPERATIONS * EPSILON,
            "rounding of W ≥ 0",
        ),
    ]


def _equal_checks(
    cases: list[RankCase], built: list[Constructions], residuals: WeightResiduals
) -> list[Check]:
    """Checks (ii) where it holds."""
    errors = []
    condition_ratios = []
    largest_condition = 1.0
    for i, (case, constructions) in enumerate(zip(cases, built, strict=True)):
        if case.equal and constructions.R is not None:
            magnification = _condition(case.G) ** 2
            eigenvalues = np.linalg.eigvalsh(constructions.R)
            relative = residuals.controlled[i] / magnification
            errors.append(relative * eigenvalues[0] / eigenvalues[-1])
            largest_condition = max(largest_condition, eigenvalues[-1] / eigenvalues[0])
            condition_ratios.append(
                eigenvalues[0] / eigenvalues[-1] * magnification * _condition(case.D)
            )
    return [
        rounding(
            "(ii) largest |D - λGR⁻¹G'| / |D|, over cond(G)² cond(R)", max(errors), OPERATIONS
        ),
        at_least(
            "(ii) least of cond(G)² cond(D) / cond(R)",
            min(condition_ratios),
            1 - OPERATIONS * EPSILON * largest_condition,
            "R's eigenvalues are λ/eig(G⁺DG⁺'), those on ker G between them",
        ),
    ]


def _singular_check(cases: list[RankCase], built: list[Constructions]) -> Check:
    """Checks that W is singular on the row space of G where it exists and R does not."""
    least_eigenvalues = []
    for case, constructions in zip(cases, built, strict=True):
        if case.included and not case.equal and constructions.W is not None:
            largest = np.linalg.eigvalsh(constructions.W)[-1]
            block = np.linalg.eigvalsh(case.row_basis.T @ constructions.W @ case.row_basis)
            least_eigenvalues.append(abs(block[0]) / largest / _condition(case.G) ** 2)
    return rounding(
        "W without R: largest least eigenvalue on the row space, over |W| cond(G)²",
        max(least_eigenvalues),
        OPERATIONS,
    )


def _infeasible_checks(cases: list[RankCase], residuals: WeightResiduals) -> list[Check]:
    """Checks the least residual and its bound where range(D) is not contained in range(G)."""
    errors = []
    margins = []
    for case, least in zip(cases, residuals.least, strict=True):
        if not case.included:
            P = case.column_basis @ case.column_basis.T
            size = np.linalg.norm(case.D)
            magnification = _condition(case.G) ** 2
            matched_share = np.linalg.norm(P @ case.D @ P) / size
            errors.append(abs(least**2 - (1 - matched_share**2)) / magnification)
            margins.append((least - case.outside / size) / magnification)
    return [
        rounding(
            "not included: largest error of the squared least residual, over cond(G)²",
            max(errors),
            OPERATIONS,
        ),
        at_least(
            "not included: least residual less |(I-P)D(I-P)| / |D|, the smallest, over cond(G)²",
            min(margins),
            -OPERATIONS * EPSILON,
            "(I-P)D(I-P) is orthogonal to every GWG'; rounding",
        ),
    ]


def _nearly_equal_checks() -> list[Check]:
    """Checks a D that leans out of range(G) by delta, and a G with a singular value delta."""
    cases: list[RankCase] = []
    expected: list[float] = []
    for delta in (10.0 ** (0.5 - np.arange(1, 19))).tolist():
        leaning, singular = _near_cases(delta)
        cases += [leaning, singular]
        expected += [delta * np.sqrt(2 - delta**2), 0.0 if singular.included else np.sqrt(0.5)]
    built = [construct(case) for case in cases]
    errors = weight_residuals(cases, built).least - np.array(expected)
    return [
        at_most(
            "wrong verdicts for δ from 0.3 to 3e-18",
            sum(not constructions.right for constructions in built),
            0,
            "tan(angle/2) against 4 eps, s_min against 3 eps",
        ),
        rounding(
            "δ from 0.3 to 3e-18: largest error of the least residual",
            np.max(np.abs(errors)),
            OPERATIONS,
        ),
    ]


def _near_cases(delta: float) -> tuple[RankCase, RankCase]:
    """Returns a case whose D leans by delta, and one whose G has a singular value delta."""
    direction = np.array([np.sqrt(1 - delta**2), 0.0, delta])
    first_axis = np.eye(3)[:, :1]
    # Singular values of [e_1, D] are sqrt(1 +- cos) of the angle: their ratio is tan(angle / 2).
    counts_as_included = bool(np.tan(np.arcsin(delta) / 2) <= 4 * EPSILON)
    leaning = RankCase(
        D=np.outer(direction, direction),
        G=first_axis,
        temperature=1.0,
        column_basis=first_axis,
        row_basis=np.eye(1),
        included=counts_as_included,
        equal=counts_as_included,
    )
    plane = np.eye(3)[:, :2]
    counts_as_full_rank = bool(delta > 3 * EPSILON)
    singular = RankCase(
        D=plane @ plane.T,
        G=plane * [1, delta],
        temperature=1.0,
        column_basis=plane,
        row_basis=np.eye(2),
        included=counts_as_full_rank,
        equal=counts_as_full_rank,
    )
    return leaning, singular
