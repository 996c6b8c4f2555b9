"""Small matrices, many at a time: explicit inverses, roots and factors, quadratic forms.

LAPACK calls cost more than the arithmetic for the 1x1 and 2x2 blocks met in every planning step, so
those are written out; larger ones go to LAPACK. Products with a vector that differs from sample to
sample work on its components: under `vmap` with the samples as last axis, each is then a plain
vector over the samples, where `M @ x` would transpose the whole batch.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array

Vector = Array | Sequence[Array]  # (n,), whole or by components


def symmetrise(M: Array) -> Array:
    """(M + M') / 2 for (..., n, n)."""
    return (M + jnp.swapaxes(M, -1, -2)) / 2


def spd_inverse(M: Array) -> Array:
    """Inverse of a symmetric positive definite (n, n)."""
    if M.shape[-1] == 1:
        return 1.0 / M
    if M.shape[-1] == 2:
        a, b = M[0, 0], M[0, 1]
        schur = _schur(M)
        off = -b / a / schur
        return jnp.array([[1.0 / a - off * (b / a), off], [off, 1.0 / schur]])
    return symmetrise(jnp.linalg.inv(M))


def _schur(M: Array) -> Array:
    """Schur complement () of M[0, 0] in a definite (2, 2); positive under scales as different as 1e-12 and 1e12."""
    b, d = M[0, 1], M[1, 1]
    return jnp.maximum(d - b * (b / M[0, 0]), d * jnp.finfo(M.dtype).eps)


def log_det_1p(M: Array) -> Array:
    """log det(I + M) for positive semidefinite M (n, n), accurate for small M."""
    if M.shape[-1] == 1:
        return jnp.log1p(M[0, 0])
    if M.shape[-1] == 2:
        det = M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0]
        return jnp.log1p(
            M[0, 0] + M[1, 1] + jnp.maximum(det, 0.0)
        )  # a rank-one M can round to a negative one
    return jnp.sum(jnp.log1p(jnp.linalg.eigvalsh(symmetrise(M))))


def log_det_spd(M: Array) -> Array:
    """log det M () for symmetric positive definite (n, n)."""
    if M.shape[-1] == 1:
        return jnp.log(M[0, 0])
    if M.shape[-1] == 2:
        return jnp.log(M[0, 0]) + jnp.log(_schur(M))
    return 2 * jnp.sum(jnp.log(jnp.diagonal(jnp.linalg.cholesky(M))))


def psd_factor(M: Array) -> tuple[Array, Array]:
    """L (n, n) with L L' = M and columns beyond the numerical rank zero, and that rank ().

    Eigenvalues below n * eps * max(eigenvalue) count as zero, NumPy's `matrix_rank` rule. The
    leading columns come first, so `L[:, :rank]` is the paper's L_t.
    """
    values, vectors = jnp.linalg.eigh(symmetrise(M))
    values, vectors = values[::-1], vectors[:, ::-1]
    cutoff = M.shape[-1] * jnp.finfo(M.dtype).eps * jnp.max(jnp.abs(values))
    kept = values > cutoff
    return vectors * jnp.sqrt(jnp.where(kept, values, 0.0)), jnp.sum(kept)


def pivoted_cholesky(M: Array) -> Array:
    """L (n, n) with L L' = M, positive semidefinite, up to the rounding of M in the units of each of its components.

    Cholesky with complete pivoting (Higham 1990) of the correlations: what is left of a component's variance below
    n * eps of it counts as zero. A matrix that is not finite has no finite root.
    """
    n, variances = M.shape[-1], jnp.diagonal(M)
    units = jnp.where(variances == 0, 1.0, variances)
    columns = []
    for _ in range(n):
        left = jnp.diagonal(M) / units
        chosen = jnp.arange(n) == jnp.argmax(left)
        pivot = jnp.max(left)
        column = jnp.sum(jnp.where(chosen, M, 0.0), axis=1)
        unit = jnp.sum(jnp.where(chosen, units, 0.0))
        scale = jnp.sqrt(jnp.where(pivot <= n * jnp.finfo(M.dtype).eps, jnp.inf, pivot)) * jnp.sqrt(
            unit
        )
        columns.append(column / scale)
        M = M - columns[-1][:, None] * columns[-1]
    return jnp.stack(columns, axis=1)


def tria(M: Array) -> Array:
    """Lower triangular L (n, n) with L L' = M M' for M (n, m), by Gram-Schmidt on the rows.

    M M' is never formed, so what is small beside terms that cancel keeps its digits.
    """
    rows: list[Array] = list(M)
    columns: list[Array] = []
    while rows:
        first, *rest = rows
        length = jnp.sqrt(first @ first)
        direction = first / jnp.where(length == 0, 1.0, length)
        along = [row @ direction for row in rest]
        columns.append(jnp.stack([*[jnp.zeros_like(length)] * len(columns), length, *along]))
        rows = [row - part * direction for row, part in zip(rest, along, strict=True)]
    return jnp.stack(columns, axis=1)


def ldl_solve(M: Array, R: Array) -> tuple[Array, list[Array]]:
    """T M (n, m) and variances [()] with T unit lower triangular and T R T' = diag(variances), for definite R (n, n).

    A variance is at least what the rounding of R leaves uncertain, eps of it.
    """
    slopes: list[list[Array]] = []  # R = slopes diag(variances) slopes', by components
    variances: list[Array] = []
    rows: list[Array] = []
    for j in range(len(R)):
        row: list[Array] = []
        for i in range(j):
            row.append(
                (R[j, i] - sum(row[k] * slopes[i][k] * variances[k] for k in range(i)))
                / variances[i]
            )
        left = R[j, j] - sum(row[k] * row[k] * variances[k] for k in range(j))
        variances.append(jnp.maximum(left, R[j, j] * jnp.finfo(R.dtype).eps) if j else left)
        rows.append(M[j] - sum(row[k] * rows[k] for k in range(j)))
        slopes.append(row)
    return jnp.stack(rows), variances


def mahalanobis_squared(x: Array, M: Array) -> Array:
    """x' M^-1 x () for x (n,) and semidefinite M (n, n); nan where M is singular: where others leave n * eps or less of
    the variance of a component."""
    apart, variances = ldl_solve(x[:, None], M)
    left = jnp.stack(variances)
    regular = jnp.all(left > len(left) * jnp.finfo(M.dtype).eps * jnp.diagonal(M))
    return jnp.where(regular, jnp.sum(apart[:, 0] ** 2 / jnp.where(regular, left, 1.0)), jnp.nan)


def log_normal_density(x: Array, M: Array) -> Array:
    """Returns log N(x; 0, M) () without its constant -n/2 log(2 pi), for x (n,) and definite M (n, n)."""
    decoupled, variances = ldl_solve(x[:, None], M)
    spread = jnp.stack(variances)
    return -0.5 * jnp.sum(decoupled[:, 0] ** 2 / spread + jnp.log(spread))


def as_matrix(weight: Array) -> Array:
    """A weight given as a diagonal (n,) or a matrix (n, n), as a matrix."""
    weight = jnp.asarray(weight)
    return jnp.diag(weight) if weight.ndim == 1 else weight


def minus(x: Vector, reference: Array) -> list[Array]:
    """The components of x - reference (n,), n the length of the reference."""
    reference = jnp.asarray(reference)
    return [x[i] - reference[i] for i in range(reference.shape[0])]


def apply(M: Array, x: Vector) -> list[Array]:
    """The components of M x, M a diagonal (n,) or a matrix (m, n)."""
    M = _fitting(M, x)
    if M.ndim == 1:
        return [M[i] * x[i] for i in range(len(x))]
    return [dot(row, x) for row in M]


def _fitting(M: Array, x: Vector) -> Array:
    """M as an array; JAX itself would read past the end of a weight that is too short."""
    M = jnp.asarray(M)
    if M.shape[-1] != len(x):
        raise ValueError(f"a weight of shape {M.shape} does not fit a vector of {len(x)}")
    return M


def dot(a: Vector, b: Vector) -> Array:
    """a' b ()."""
    return sum((a[i] * b[i] for i in range(1, len(b))), a[0] * b[0])


def quadratic_form(M: Array, x: Vector) -> Array:
    """x' M x () for symmetric M, a diagonal (n,) or a matrix (n, n)."""
    M = _fitting(M, x)
    if M.ndim == 1:
        return dot(M, [a * a for a in x])
    halves = [M[i, i] * x[i] + sum(2 * M[i, j] * x[j] for j in range(i)) for i in range(len(x))]
    return dot(halves, x)


def potter_update(root: Array, C: Array, R_s: Array) -> tuple[Array, Array, Array]:
    """What measurements C x (ny,) with noise R_s make of a covariance root root': its new root, the gain
    K (nx, ny), and how the innovations move the mean, columns (nx, ny) with squares that add up to K S K'.

    One measurement after another, made independent first, with no matrix to invert (Potter 1963): with v = root' c and
    s = v'v + r the gain is root v / s, and the root shrinks by sqrt(r / s) along v.
    """
    C, variances = ldl_solve(C, R_s)
    T, _ = ldl_solve(jnp.eye(len(R_s), dtype=R_s.dtype), R_s)
    K, moves = jnp.zeros((len(root), 0), root.dtype), []
    for c, r in zip(C, variances, strict=True):
        v = c @ root
        squared = v @ v
        s = squared + r
        v = v / jnp.where(squared == 0, 1.0, jnp.sqrt(squared))
        seen = root @ v
        root = root + ((jnp.sqrt(r / s) - 1) * seen)[:, None] * v
        k = seen * (jnp.sqrt(squared) / s)
        K = jnp.column_stack([K - k[:, None] * (c @ K), k])
        moves.append(k * jnp.sqrt(s))
    return root, K @ T, jnp.stack(moves, axis=1)
