"""Optimality of one weight for a whole schedule: no W >= 0 leaves less (Assumption 2).

    f(W) = sum_k |D_k - G_k W G_k'|^2 / |D_k|^2     over W >= 0, convex

is least where the Karush-Kuhn-Tucker conditions hold for the gradient S: W >= 0, S >= 0, S W = 0.
They are examined in plain NumPy, independently of what the package's search reports.
"""

from functools import partial

import jax
import numpy as np
from jax import Array
from scipy.linalg import eigh

from ...matching.constant_weight import best_constant_weight
from ...matching.weights import residual
from ...results.certificate import Check
from ..bands import EPSILON, at_least, at_most, near
from ..compilation import quick_jit

SEARCH_GAP = 1e-12  # the duality gap per step that the search is asked for
GAP_SOURCE = "the gap the search is asked for; rounding"
TURNING_STEPS = 40  # steps of controls that turn


@quick_jit
@partial(jax.vmap, in_axes=(None, None, 0))
def residuals_of_weights(D: Array, G: Array, W: Array) -> Array:
    """Returns epsilon (M, T) of weights (M, nu, nu) along D (T, nx, nx) and G (T, nx, nu)."""
    return jax.vmap(residual, in_axes=(0, 0, None))(D, G, W)


def turning_controls(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Returns D (T, 2, 2) and G (T, 2, 2) of a velocity on a rail under two controls that turn.

    The controls turn by a right angle. The diffusion is largest half way, where without W >= 0 an
    off-diagonal entry larger than the diagonal would fit best.
    """
    angle = rng.uniform(0, np.pi / 2, TURNING_STEPS)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    size = (1 + 9 * np.sin(2 * angle[:, None]) ** 2) ** 0.5
    position_gain = rng.normal(0.3, 0.2, TURNING_STEPS)
    gain = np.stack([position_gain, np.ones(TURNING_STEPS)], axis=-1) * size
    D = gain[:, :, None] * gain[:, None, :]
    return D, np.array([0.0, 1.0])[:, None] * direction[:, None, :]


def duality_gap(D: np.ndarray, G: np.ndarray, W: np.ndarray) -> tuple[float, float]:
    """Returns f(W) = sum |D - G W G'|^2 / |D|^2 and a bound on f(W) less its least value.

    For the gradient S and any W' >= 0, f(W) - f(W') <= tr(S W) - tr(S W'). S >= -e M for
    M = sum G' G / |D| bounds the last trace by e tr(M W'), which at a minimiser is at most
    e T sqrt(rank of G).
    """
    size = np.linalg.norm(D, axis=(1, 2))[:, None, None]
    G_transposed = G.transpose(0, 2, 1)
    difference = D - G @ W @ G_transposed
    S = -2 * np.sum(G_transposed @ difference @ G / size**2, axis=0)
    M = np.sum(G_transposed @ G / size, axis=0)
    e = max(0.0, -eigh(S, M, eigvals_only=True)[0])
    value = float(np.sum((difference / size) ** 2))
    return value, float(np.sum(S * W) + e * len(D) * np.sqrt(min(G.shape[1:])))


def gap_rounding(steps: int) -> float:
    """Returns the rounding of a gap per step.

    The gradient, in units of M, sums as many terms, whose sizes add up to at most 4.
    """
    return 4 * (steps + 40) * EPSILON


def optimal_weight_checks(rng: np.random.Generator) -> list[Check]:
    """Returns checks for controls that turn, and for three steps solved by hand.

    For the turning controls the best weight without W >= 0 is indefinite.
    """
    D, G = turning_controls(rng)
    W = best_constant_weight(D, G, SEARCH_GAP).weight
    eigenvalues = np.linalg.eigvalsh(W)

    # The unconstrained minimiser, by least squares over the entries of W.
    scale = np.linalg.norm(D, axis=(1, 2))[:, None]
    design = (np.stack([np.kron(g, g) for g in G]) / scale[:, None]).reshape(-1, 4)
    target = (D.reshape(TURNING_STEPS, -1) / scale).ravel()
    unconstrained = np.linalg.lstsq(design, target, rcond=None)[0].reshape(2, 2)
    lowest = np.linalg.eigvalsh(unconstrained)[0]

    # The search works in units of sum G' G / |D|.
    condition = np.linalg.cond(np.sum(G.transpose(0, 2, 1) @ G / scale[:, None], axis=0))
    return [
        at_most(
            "turning controls: least eigenvalue of the W free of W ≥ 0", lowest, 0.0, "by design"
        ),
        at_least(
            "turning controls: least eigenvalue of the best W ≥ 0, over its largest",
            eigenvalues[0] / eigenvalues[-1],
            -20 * condition * EPSILON,
            "rounding of a change of units",
        ),
        *_optimality_checks(rng, D, G, W),
        _three_step_check(),
    ]


def _optimality_checks(
    rng: np.random.Generator, D: np.ndarray, G: np.ndarray, W: np.ndarray
) -> list[Check]:
    """Checks the gradient, and that no random W >= 0 is better."""
    value, gap = duality_gap(D, G, W)
    perturbations = rng.normal(size=(300, 2, 2)) * 10.0 ** rng.uniform(-6, 0.5, (300, 1, 1))
    roots = _square_root(W) + perturbations
    candidates = roots @ roots.transpose(0, 2, 1)
    sums = np.sum(np.asarray(residuals_of_weights(D, G, candidates)) ** 2, axis=1)
    allowed = -TURNING_STEPS * SEARCH_GAP - 40 * TURNING_STEPS * EPSILON
    return [
        near(
            "turning controls: duality gap of the best W ≥ 0, a step, from the gradient by NumPy",
            gap / TURNING_STEPS,
            0.0,
            SEARCH_GAP + gap_rounding(TURNING_STEPS),
            GAP_SOURCE,
        ),
        at_least(
            "turning controls: least Σ ε² of 300 other W ≥ 0, less that of the best",
            np.min(sums) - value,
            allowed,
            GAP_SOURCE,
        ),
    ]


def _three_step_check() -> Check:
    """Checks D = 1, 10, 1 at angles 0, 45 and 90 degrees: W = a [1 1; 1 1] with a = 55 / 51."""
    direction = np.array([[1.0, 0.0], [0.5**0.5, 0.5**0.5], [0.0, 1.0]])[:, None, :]
    D = np.array([1.0, 10.0, 1.0])[:, None, None]
    W = best_constant_weight(D, direction, SEARCH_GAP).weight
    value, _ = duality_gap(D, direction, W)
    computed = "D = 1, 10, 1 at 0°, 45°, 90°: least sum of squares"
    tolerance = 3 * SEARCH_GAP + 40 * EPSILON
    return near(computed, value, 32 / 51, tolerance, f"by hand; {GAP_SOURCE}")


def _square_root(W: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(W)
    return vectors * np.sqrt(np.maximum(values, 0))
