"""The paper's formulas once more, slow and plain, in NumPy and SciPy: what the package is compared
with.
"""

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

Matrix = np.ndarray
Function = Callable[[np.ndarray], np.ndarray]


class Linear(NamedTuple):
    """dx = (A x + B u) dt + dw, E dw dw' = Q dt, measured through C with intensity R_o(x)."""

    A: Matrix
    B: Matrix
    C: Matrix
    Q: Matrix
    intensity: Function


def light_dark(sampled: bool, dt: float, slope: float = 0.5**0.5, floor: float = 0.1) -> Linear:
    """Sec. VII; `sampled` says that sigma_o is the standard deviation of one measurement."""
    eye = np.eye(2)
    none = np.zeros((2, 2))
    scale = dt if sampled else 1.0
    return Linear(
        A=np.block([[none, eye], [none, none]]),
        B=np.vstack([none, eye]),
        C=np.hstack([eye, none]),
        Q=np.diag([0, 0, 0.3**2, 0.3**2]),
        intensity=lambda x: (slope * abs(x[0] - 5) + floor) ** 2 * scale * eye,
    )


# Filtering


def jacobian(fn: Function, x: np.ndarray, h: float = 1e-5) -> Matrix:
    """Central differences."""
    return np.stack([(fn(x + h * e) - fn(x - h * e)) / (2 * h) for e in np.eye(len(x))], axis=-1)


def kalman_step(
    mean: np.ndarray,
    cov: Matrix,
    y: np.ndarray,
    step: Function,
    measure: Function,
    Q: Matrix,
    R: Function,
) -> tuple[np.ndarray, Matrix]:
    """Predict through `step`, then update in information form, (Sigma^-1 + C' R^-1 C)^-1."""
    F = jacobian(step, mean)
    mean = step(mean)
    cov = F @ cov @ F.T + Q
    C = jacobian(measure, mean)
    R_inverse = np.linalg.inv(R(mean))
    cov = np.linalg.inv(np.linalg.inv(cov) + C.T @ R_inverse @ C)
    return mean + cov @ C.T @ R_inverse @ (y - measure(mean)), cov


def riccati_flow(
    cov: Matrix, A: Matrix, Q: Matrix, C: Matrix, R_o: Matrix, duration: float
) -> Matrix:
    """(8b) integrated by an adaptive Runge-Kutta method."""

    def rate(_: float, flat: np.ndarray) -> np.ndarray:
        S = flat.reshape(cov.shape)
        return (A @ S + S @ A.T + Q - S @ C.T @ np.linalg.inv(R_o) @ C @ S).ravel()

    return integrate(rate, cov.ravel(), duration).reshape(cov.shape)


def belief_flow(
    model: Linear, mean: np.ndarray, cov: Matrix, u: np.ndarray, duration: float
) -> Matrix:
    """Sigma after `duration` where mean and covariance move together and no innovation comes."""
    n = len(mean)

    def rate(_: float, flat: np.ndarray) -> np.ndarray:
        x = flat[:n]
        S = flat[n:].reshape(n, n)
        D = S @ model.C.T @ np.linalg.inv(model.intensity(x)) @ model.C @ S
        return np.concatenate(
            [model.A @ x + model.B @ u, (model.A @ S + S @ model.A.T + model.Q - D).ravel()]
        )

    return integrate(rate, np.concatenate([mean, cov.ravel()]), duration)[n:].reshape(n, n)


def integrate(
    rate: Callable[[float, np.ndarray], np.ndarray], start: np.ndarray, duration: float
) -> np.ndarray:
    return solve_ivp(rate, (0, duration), start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]


# Gaussian expectations


def expectation(
    fn: Function, mean: np.ndarray, cov: Matrix, nodes: int = 200, reach: float = 9.0
) -> np.ndarray:
    """E fn(x) by a tensor rule; fn maps points (P, n) to (..., P).

    Equal steps over +-9 standard deviations: for a smooth function times a Gaussian they converge
    as fast as Gauss-Hermite nodes, and unlike those they resolve a bump much narrower than the
    Gaussian.
    """
    n = len(mean)
    line = np.linspace(-reach, reach, nodes)
    density = np.exp(-(line**2) / 2)
    grid = np.stack(np.meshgrid(*[line] * n, indexing="ij"), axis=-1).reshape(-1, n)
    weights = np.array(density / density.sum())
    for _ in range(n - 1):
        weights = np.multiply.outer(weights, density / density.sum())
    return fn(mean + grid @ np.linalg.cholesky(cov).T) @ weights.ravel()


def covariance(
    f: Function, g: Function, mean: np.ndarray, cov: Matrix, nodes: int = 200
) -> tuple[float, float, float, float, float]:
    """E f, E g, Var f, Var g, Cov(f, g); deviations are squared after the means are taken off."""
    f_mean, g_mean = (float(expectation(h, mean, cov, nodes)) for h in (f, g))

    def products(x: np.ndarray) -> np.ndarray:
        df = f(x) - f_mean
        dg = g(x) - g_mean
        return np.stack([df**2, dg**2, df * dg])

    return f_mean, g_mean, *(float(v) for v in expectation(products, mean, cov, nodes))


def bumps(x: np.ndarray, centers: np.ndarray, width: float) -> np.ndarray:
    """Sum of bumps at points (P, n) -> (P,)."""
    d = np.shape(centers)[1]
    return sum(
        np.exp(-np.sum((x[:, :d] - z) ** 2, axis=1) / (2 * width**2))
        for z in np.asarray(centers, dtype=float)
    )


def quadratic(x: np.ndarray, reference: np.ndarray, weight: Matrix) -> np.ndarray:
    """1/2 (x - r)' W (x - r) at points (P, n) -> (P,)."""
    return 0.5 * np.einsum("pi,ij,pj->p", x - reference, weight, x - reference)


def bump_expectation(
    mean: np.ndarray, cov: Matrix, center: np.ndarray, squared_width: float
) -> float:
    """E exp(-|p - z|^2 / (2 s)): a Gaussian convolution."""
    d = len(center)
    total = squared_width * np.eye(d) + cov[:d, :d]
    offset = mean[:d] - center
    scale = np.sqrt(squared_width**d / np.linalg.det(total))
    return float(scale * np.exp(-0.5 * offset @ np.linalg.solve(total, offset)))


def bump_moments(
    mean: np.ndarray, cov: Matrix, centers: np.ndarray, width: float
) -> tuple[float, float]:
    """Mean and variance of the sum of bumps, a product of two being a bump of width l / sqrt(2)
    half-way.
    """
    centers = np.asarray(centers, dtype=float)
    first = sum(bump_expectation(mean, cov, z, width**2) for z in centers)
    second = sum(
        np.exp(-np.sum((z - y) ** 2) / (4 * width**2))
        * bump_expectation(mean, cov, (z + y) / 2, width**2 / 2)
        for z, y in product(centers, centers)
    )
    return first, second - first**2


# Path integral control


def control_map(G: Matrix, R: Matrix) -> Matrix:
    """R^-1 G' (G R^-1 G')^+."""
    R_inverse = np.linalg.inv(R)
    return R_inverse @ G.T @ np.linalg.pinv(G @ R_inverse @ G.T, rcond=1e-10)


class Planner(NamedTuple):
    """The inputs of Algorithm 1 that are not the system: q(mu, Sigma), phi(mu, Sigma), R, lambda,
    Delta t.
    """

    q: Callable[[np.ndarray, Matrix], float]
    phi: Callable[[np.ndarray, Matrix], float]
    R: Matrix
    temperature: float
    dt: float


def schedule(
    model: Linear, mean: np.ndarray, cov: Matrix, dt: float, steps: int, method: str
) -> tuple[list[np.ndarray], list[Matrix], list[Matrix]]:
    """Line 1 without controls: nominal means and Sigma_k at t_0..t_H, D_k at t_0..t_{H-1}."""
    means = [mean]
    covs = [cov]
    diffusions = []
    F = np.eye(len(mean)) + model.A * dt
    for _ in range(steps):
        if method == "riccati":
            R_o = model.intensity(means[-1])
            diffusions.append(covs[-1] @ model.C.T @ np.linalg.inv(R_o) @ model.C @ covs[-1])
            covs.append(riccati_flow(covs[-1], model.A, model.Q, model.C, R_o, dt))
        else:
            predicted = F @ covs[-1] @ F.T + model.Q * dt
            S = model.C @ predicted @ model.C.T + model.intensity(F @ means[-1]) / dt
            K = predicted @ model.C.T @ np.linalg.inv(S)
            diffusions.append(K @ S @ K.T / dt)
            covs.append(predicted - K @ S @ K.T)
        means.append(F @ means[-1])
    return means, covs, diffusions


def algorithm_1(
    model: Linear,
    planner: Planner,
    mean: np.ndarray,
    cov: Matrix,
    normals: np.ndarray,
    L: np.ndarray,
    method: str,
) -> np.ndarray:
    """Algorithm 1 as printed, line by line, on standard normals (H, n, N).

    L (H, n, n) is handed over, since L_k L_k' = D_k leaves it open up to a rotation; line 1 checks
    it.
    """
    dt = planner.dt
    temperature = planner.temperature
    H, _, N = normals.shape
    _, covs, D = schedule(model, mean, cov, dt, H, method)  # 1
    ranks = [np.linalg.matrix_rank(d, rtol=1e-12) for d in D]
    L = [factor[:, :r] for factor, r in zip(L, ranks, strict=True)]
    for factor, d in zip(L, D, strict=True):
        np.testing.assert_allclose(factor @ factor.T, d, atol=1e-12 * np.abs(d).max())
    G = model.B  # 2
    M = control_map(G, planner.R) @ L[0]  # 3
    first = np.zeros((N, ranks[0]))
    costs = np.zeros(N)
    for i in range(N):  # 4
        # 5
        mu = mean
        S = 0.0
        for k in range(H):  # 6
            eps = np.sqrt(dt) * normals[k, : ranks[k], i]  # 7
            if k == 0:
                first[i] = eps
            S = S + planner.q(mu, covs[k]) * dt  # 9, q at the mean before the step
            mu = mu + model.A @ mu * dt + L[k] @ eps  # 8
        S = S + planner.phi(mu, covs[H])  # 11
        costs[i] = S
    w = np.exp(-(costs - costs.min()) / temperature)  # 12, up to a factor that line 14 takes out
    w = w / w.sum()  # 14
    return M @ (w @ first) / dt  # 15


class GaussianPaths(NamedTuple):
    """Exact discrete-time answers for dmu = a mu dt + sqrt(D) dbeta and quadratic costs."""

    control: float
    log_psi: float


def gaussian_paths(
    a: float,
    b: float,
    diffusion: float,
    q: float,
    q_T: float,
    mean: float,
    dt: float,
    steps: int,
    temperature: float,
) -> GaussianPaths:
    """(19) and (17) with the expectation done exactly: S is quadratic in eps, so exp(-S / lambda)
    tilts N(0, I dt) into another Gaussian.

    mu_k = F^k mean + row_k . eps; S = sum over k of q/2 mu_k^2 dt, plus q_T/2 mu_H^2.
    """
    F = 1 + a * dt
    s = np.sqrt(diffusion)
    rows = np.array(
        [[s * F ** (k - 1 - j) if j < k else 0.0 for j in range(steps)] for k in range(steps + 1)]
    )
    drift = mean * F ** np.arange(steps + 1)
    cost = np.append(np.full(steps, q * dt), q_T) / temperature
    precision = np.eye(steps) / dt + rows.T @ np.diag(cost) @ rows
    slope = rows.T @ (cost * drift)
    posterior = -np.linalg.solve(precision, slope)
    log_psi = -0.5 * (cost @ drift**2 + slope @ posterior + np.linalg.slogdet(precision * dt)[1])
    return GaussianPaths(control=s / b * posterior[0] / dt, log_psi=log_psi)


def lqg_feedback(
    a: float, b: float, R: float, q: float, q_T: float, mean: float, duration: float
) -> float:
    """-R^-1 b P(0) mean, P from the control Riccati equation -dP/dt = q + 2 a P - (b P)^2 / R, P(T)
    = q_T.
    """
    P = integrate(lambda _, p: q + 2 * a * p - (b * p) ** 2 / R, np.array([q_T]), duration)[0]
    return -b * P * mean / R
