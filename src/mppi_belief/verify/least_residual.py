"""One W for a schedule: that no other W >= 0 leaves less (Assumption 2, the matching residual).

    f(W) = sum_k |D_k - G_k W G_k'|^2 / |D_k|^2     over W >= 0, convex

is least where the Karush-Kuhn-Tucker conditions hold, for the gradient S: W >= 0, S >= 0, S W = 0. They are looked at
in plain NumPy, whatever the search of the package says of itself.
"""

from functools import partial

import jax
import numpy as np
from jax import Array
from scipy.linalg import eigh

from ..matching.weights import best_constant_weight, residual
from ..results.certificate import Check
from .bands import EPSILON, at_least, at_most, near
from .compilation import quick_jit

SEARCH = 1e-12  # the duality gap a step that the search is asked for
TOLD = "the gap the search is asked for; rounding"
TURNS = 40  # steps of controls that turn


@quick_jit
@partial(jax.vmap, in_axes=(None, None, 0))
def relative(D: Array, G: Array, W: Array) -> Array:
    """epsilon (M, T) of weights (M, nu, nu) along D (T, nx, nx) and G (T, nx, nu)."""
    return jax.vmap(residual, in_axes=(0, 0, None))(D, G, W)


def turning(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """D (T, 2, 2) and G (T, 2, 2) of a velocity on a rail, pushed by two controls that turn by a right angle; the
    diffusion is largest half way, where without W >= 0 an off-diagonal larger than the diagonal would fit best."""
    angle = rng.uniform(0, np.pi / 2, TURNS)
    push = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    gain = (
        np.stack([rng.normal(0.3, 0.2, TURNS), np.ones(TURNS)], axis=-1)
        * (1 + 9 * np.sin(2 * angle[:, None]) ** 2) ** 0.5
    )
    return gain[:, :, None] * gain[:, None, :], np.array([0.0, 1.0])[:, None] * push[:, None, :]


def optimum(D: np.ndarray, G: np.ndarray, W: np.ndarray) -> tuple[float, float]:
    """f = sum |D - G W G'|^2 / |D|^2 at W, and by at most how much it is above the least over W >= 0.

    For the gradient S and any W' >= 0, f(W) - f(W') <= tr(S W) - tr(S W'); S >= -e M for M = sum G' G / |D| bounds the
    last by e tr(M W'), which at a minimiser is at most e T sqrt(rank of G).
    """
    size, Gt = np.linalg.norm(D, axis=(1, 2))[:, None, None], G.transpose(0, 2, 1)
    left = D - G @ W @ Gt
    S = -2 * np.sum(Gt @ left @ G / size**2, axis=0)
    excess = max(0.0, -eigh(S, np.sum(Gt @ G / size, axis=0), eigvals_only=True)[0])
    return float(np.sum((left / size) ** 2)), float(
        np.sum(S * W) + excess * len(D) * np.sqrt(min(G.shape[1:]))
    )


def gap_rounding(steps: int) -> float:
    """Of a gap a step: the gradient, in units of M, sums as many terms, whose sizes add up to at most 4."""
    return 4 * (steps + 40) * EPSILON


def least(rng: np.random.Generator) -> list[Check]:
    """Controls that turn, where without W >= 0 the best weight is indefinite; and three steps solved by hand."""
    D, G = turning(rng)
    W, scale = best_constant_weight(D, G, SEARCH).weight, np.linalg.norm(D, axis=(1, 2))[:, None]
    design = (np.stack([np.kron(g, g) for g in G]) / scale[:, None]).reshape(-1, 4)
    free = np.linalg.lstsq(design, (D.reshape(TURNS, -1) / scale).ravel(), rcond=None)[0].reshape(
        2, 2
    )
    lowest, eigenvalues = np.linalg.eigvalsh(free)[0], np.linalg.eigvalsh(W)
    # it is found in units of sum G' G / |D|
    condition = np.linalg.cond(np.sum(G.transpose(0, 2, 1) @ G / scale[:, None], axis=0))
    said = "turning controls: least eigenvalue of the best W ≥ 0, over its largest"
    return [
        at_most(
            "turning controls: least eigenvalue of the W free of W ≥ 0", lowest, 0.0, "by design"
        ),
        at_least(
            said,
            eigenvalues[0] / eigenvalues[-1],
            -20 * condition * EPSILON,
            "rounding of a change of units",
        ),
        *_optimal(rng, D, G, W),
        _by_hand(),
    ]


def _optimal(rng: np.random.Generator, D: np.ndarray, G: np.ndarray, W: np.ndarray) -> list[Check]:
    """By the gradient, and among random W >= 0."""
    value, gap = optimum(D, G, W)
    steps = rng.normal(size=(300, 2, 2)) * 10.0 ** rng.uniform(-6, 0.5, (300, 1, 1))
    others = (_root(W) + steps) @ (_root(W) + steps).transpose(0, 2, 1)
    beyond = np.min(np.sum(np.asarray(relative(D, G, others)) ** 2, axis=1)) - value
    said = "turning controls: duality gap of the best W ≥ 0, a step, from the gradient by NumPy"
    allowed = -TURNS * SEARCH - 40 * TURNS * EPSILON
    return [
        near(said, gap / TURNS, 0.0, SEARCH + gap_rounding(TURNS), TOLD),
        at_least(
            "turning controls: what 300 other W ≥ 0 leave beyond it, the least",
            beyond,
            allowed,
            TOLD,
        ),
    ]


def _by_hand() -> Check:
    """D = 1, 10, 1 at angles 0, 45 and 90 degrees: W = a [1 1; 1 1] with a = 55 / 51."""
    push = np.array([[1.0, 0.0], [0.5**0.5, 0.5**0.5], [0.0, 1.0]])[:, None, :]
    D = np.array([1.0, 10.0, 1.0])[:, None, None]
    value, _ = optimum(D, push, best_constant_weight(D, push, SEARCH).weight)
    said = "D = 1, 10, 1 at 0°, 45°, 90°: least sum of squares"
    return near(said, value, 32 / 51, 3 * SEARCH + 40 * EPSILON, f"by hand; {TOLD}")


def _root(W: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(W)
    return vectors * np.sqrt(np.maximum(values, 0))
