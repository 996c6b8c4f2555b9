"""Nodes and weights for expectations under Gaussians; no weight is negative.

| rule | nodes | exact to degree | used by |
|---|---|---|---|
| `lattice_rule` | n = 1 to 3: 37, 37, 27 | 5 | costs of one to three components |
| `degree_five_rule` | n = 4: 25; 5: 42; 6: 44; 9: 146; 12: 280 | 5 | costs of more components |
| `sigma_points` | to n = 4: up to 2 n^2 + 1; beyond: 2 n | 5; beyond: 3 | unscented filter |
| `gaussian_nodes` | up to 1e5 | high | Theorem 1's residual |

A negative weight would let the expectation of a cost that is nowhere negative be negative. All
rules of degree 5 give the mean *and the variance* of any quadratic.
"""

import math
from functools import cache
from itertools import combinations, combinations_with_replacement

import numpy as np
from scipy.stats import qmc

MOST_STATES_OF_CENTRAL_RULE = 4  # up to which the rule with 2 n^2 + 1 points has no negative weight
MOST_STATES_OF_LATTICE = 3
LATTICE_SPACINGS = (0.25, 1.0, 1.7)  # standard deviations, for n = 1, 2, 3; chosen for speed
LATTICE_RADII = (4.5, 3.0, 2.9)  # standard deviations; see tests/numerics/test_quadrature.py
MOST_TENSOR_NODES = 100_000  # of a tensor product of Gauss-Hermite rules
MOST_NODES_PER_AXIS = 64
MOST_TENSOR_STATES = 6  # beyond, a Sobol sequence takes the place of the tensor product
SOBOL_NODES = 2**14


@cache
def cost_rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the points (P, n) and weights (P,) by which functions of n components are integrated.

    They are exact to degree 5 for every n, and all weights are positive.
    """
    points, weights = lattice_rule(n) if n <= MOST_STATES_OF_LATTICE else degree_five_rule(n)
    return points[weights > 0], weights[weights > 0]


def lattice_rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (P, n) and weights (P,) for N(0, I_n), n = 1, 2 or 3, exact to degree 5.

    The points are those of a lattice in a ball: equidistant, hexagonal, body-centred cubic. For a
    smooth function, the sum over a lattice, weighted by the density, converges faster than any
    power of the spacing (Poisson's summation formula), and for a steep one, as the edge of an
    obstacle, the error is that of the spacing, where Gauss-Hermite nodes are far apart. A factor of
    the weights, a polynomial of degree 4, makes the moments exact that the ball cuts off.
    """
    reach = int(np.ceil(2 * LATTICE_RADII[n - 1] / LATTICE_SPACINGS[n - 1])) + 1
    steps = np.arange(-reach, reach + 1)
    indices = np.stack(np.meshgrid(*[steps] * n, indexing="ij"), axis=-1).reshape(-1, n)
    points = LATTICE_SPACINGS[n - 1] * indices @ _lattice_basis(n)
    squares = np.sum(points**2, axis=1)
    inside = squares <= LATTICE_RADII[n - 1] ** 2 * (1 + 1e-9)
    points = points[inside]
    weights = np.exp(-0.5 * squares[inside])
    weights = weights / weights.sum()

    # The least change of the weights that makes all even moments up to the fourth exact.
    factors = [c for d in (0, 2, 4) for c in combinations_with_replacement(range(n), d)]
    monomials = np.array([np.prod(points[:, list(c)], axis=1) for c in factors])
    missing = np.array([_normal_moment(c) for c in factors]) - monomials @ weights
    gram = (monomials * weights) @ monomials.T
    coefficients = np.linalg.lstsq(gram, missing, rcond=1e-10)[0]
    return points, weights * (1 + coefficients @ monomials)


def _lattice_basis(n: int) -> np.ndarray:
    """Returns the basis (n, n), in rows, of the lattice A_n*, whose nearest points are 1 apart."""
    if n == 1:
        return np.eye(1)
    if n == 2:
        return np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
    return np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]]) / np.sqrt(3)


def _normal_moment(factors: tuple[int, ...]) -> int:
    """Returns E[x_i x_j ...] () under N(0, I) for the indices of the factors."""
    powers = np.bincount(factors, minlength=1) if factors else np.zeros(1, int)
    return math.prod(0 if p % 2 else math.prod(range(p - 1, 0, -2)) for p in powers.tolist())


def degree_five_rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (P, n) and weights (P,) for N(0, I_n), exact to degree 5.

    Up to n = 4 it is the rule of McNamee and Stenger (1967) in the form of Lu and Darmofal (2004).
    Beyond, where this one has negative weights, the points are two on each axis and the vertices of
    a cube (Stroud 1971, E_n^{r^2} 5-3), of which a part suffices: any in which each choice of five
    signs is equally frequent (Victoir 2004).
    """
    if n <= MOST_STATES_OF_CENTRAL_RULE:
        return _central_rule(n)
    axes = np.sqrt((n + 2) / 2) * np.vstack([np.eye(n), -np.eye(n)])
    vertices = np.sqrt((n + 2) / (n - 2)) * _balanced_signs(n)
    axis_weights = np.full(2 * n, 4 / (n + 2) ** 2)
    vertex_weights = np.full(len(vertices), ((n - 2) / (n + 2)) ** 2 / len(vertices))
    return np.vstack([axes, vertices]), np.concatenate([axis_weights, vertex_weights])


def _central_rule(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the rule of degree 5 with the centre, points on axes and on diagonals."""
    axes = np.sqrt(n + 2.0) * np.eye(n)
    diagonals = []
    for i, j in combinations(range(n), 2):
        for sign in (1, -1):
            diagonals.append(np.sqrt((n + 2.0) / 2) * (np.eye(n)[i] + sign * np.eye(n)[j]))
    half = np.vstack([axes, *diagonals])
    axis_weights = np.full(n, (4 - n) / (2 * (n + 2) ** 2))
    diagonal_weights = np.full(len(diagonals), 1 / (n + 2) ** 2)
    half_weights = np.concatenate([axis_weights, diagonal_weights])
    points = np.vstack([np.zeros((1, n)), half, -half])
    return points, np.concatenate([[2 / (n + 2)], half_weights, half_weights])


def _balanced_signs(n: int) -> np.ndarray:
    """Returns rows of signs (P, n), an orthogonal array of strength 5.

    In row t column i has the sign (-1)^(c_i . t), with binary vectors c_i of which no two and no
    four add up to zero modulo 2; a leading 1 does the same for odd numbers. They are searched
    greedily, which gives the smallest known arrays up to n = 18.
    """
    codes = [0]
    sums_of_three: set[int] = set()
    candidate = 0
    while len(codes) < n:
        candidate += 1
        if candidate in sums_of_three:
            continue
        sums_of_three |= {candidate ^ a ^ b for a, b in combinations(codes, 2)}
        codes.append(candidate)
    bits = codes[-1].bit_length()
    leading = 1 << bits
    rows = range(2 * leading)
    parities = [[((leading | code) & row).bit_count() % 2 for code in codes] for row in rows]
    return 1.0 - 2.0 * np.array(parities)


def sigma_points(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (P, n) and positive weights (P,) for N(0, I_n), few enough for a filter.

    Up to 4 states they are those of the rule of degree 5, without the points of weight zero. With
    more states they are the 2 n points of degree 3 (Arasaratnam and Haykin 2009).
    """
    if n > MOST_STATES_OF_CENTRAL_RULE:
        return np.sqrt(n) * np.vstack([np.eye(n), -np.eye(n)]), np.full(2 * n, 0.5 / n)
    points, weights = degree_five_rule(n)
    return points[weights > 0], weights[weights > 0]


@cache
def gaussian_nodes(nx: int, per_axis: int | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (P, nx) and weights (P,), which sum to 1, for N(0, I).

    The nodes are the tensor product of the Gauss-Hermite rule with `per_axis` points, by default as
    many as keep P within 1e5 but at most 64. Without `per_axis` and for nx > 6 they are a scrambled
    Sobol sequence with equal weights, always the same.
    """
    if per_axis is None and nx > MOST_TENSOR_STATES:
        sequence = qmc.MultivariateNormalQMC(np.zeros(nx), inv_transform=True, seed=0)
        return sequence.random(SOBOL_NODES), np.full(SOBOL_NODES, 1 / SOBOL_NODES)
    per_axis = per_axis or min(MOST_NODES_PER_AXIS, int(MOST_TENSOR_NODES ** (1 / nx)))
    abscissae, axis_weights = np.polynomial.hermite_e.hermegauss(per_axis)
    axis_weights = axis_weights / axis_weights.sum()
    points = np.stack(np.meshgrid(*[abscissae] * nx, indexing="ij"), axis=-1).reshape(-1, nx)
    factors = np.stack(np.meshgrid(*[axis_weights] * nx, indexing="ij"), axis=-1)
    return points, factors.prod(axis=-1).ravel()
