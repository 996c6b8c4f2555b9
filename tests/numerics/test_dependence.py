"""What a function depends on, read from its operations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from mppi_belief.numerics.dependence import dependence
from mppi_belief.numerics.dependence_algebra import NOT_QUADRATIC

W = np.arange(16.0).reshape(4, 4)
MAP = jnp.arange(10000.0).reshape(100, 100)
MANY = NOT_QUADRATIC


@jax.custom_jvp
def _square_without_slope(x):
    return x**2


_square_without_slope.defjvp(lambda primals, tangents: (primals[0] ** 2, 0 * tangents[0]))

FUNCTIONS = {
    "nothing": (lambda x: jnp.float32(3.0), [], 0),
    "zero times a component": (lambda x: 0.0 * x[0], [], 0),
    "a component": (lambda x: x[2], [2], 1),
    "a mean": (lambda x: jnp.mean(x[1:3]), [1, 2], 1),
    "a dynamic slice": (lambda x: jax.lax.dynamic_slice(x, (1,), (1,))[0], [1], 1),
    "a reversed state": (lambda x: x[::-1][0] - x[0], [0, 3], 1),
    "a product": (lambda x: x[0] * x[3] / 3.0, [0, 3], 2),
    "a power": (lambda x: x[1] ** 2.0 + jnp.square(x[1]), [1], 2),
    "chosen components": (lambda x: jnp.sum(x[jnp.array([3, 1])] ** 2), [1, 3], 2),
    "a quadratic form": (lambda x: x @ W @ x, [0, 1, 2, 3], 2),
    "a part of a matrix": (lambda x: x @ np.diag([1.0, 0, 0, 2.0]) @ x, [0, 3], 2),
    "an einsum": (lambda x: jnp.einsum("i,ij,j->", x[:2], W[:2, :2], x[:2]), [0, 1], 2),
    "squared distances": (
        lambda x: jnp.sum(jax.vmap(lambda c: jnp.sum((x[:2] - c) ** 2))(jnp.ones((3, 2)))),
        [0, 1],
        2,
    ),
    "a choice that is known": (lambda x: jnp.where(W[0, 0] > 1, x[0], x[1] ** 2), [0, 1], 2),
    "a cube": (lambda x: x[0] * x[1] ** 2, [0, 1], MANY),
    "a distance": (lambda x: jnp.linalg.norm(x[:2] - 1.0), [0, 1], MANY),
    "a ratio": (lambda x: 1.0 / x[3], [3], MANY),
    "a choice by the state": (lambda x: jnp.where(x[2] > 0, x[0], x[1]), [0, 1, 2], MANY),
    "a maximum": (lambda x: jnp.max(x[:3]), [0, 1, 2], MANY),
    "a sorted state": (lambda x: jnp.sort(x[:2])[0], [0, 1], MANY),
    "a whole number": (lambda x: jnp.floor(x[1]) + x[2].astype(int), [1, 2], MANY),
    "a look-up": (lambda x: MAP[x[0].astype(int) % 100, x[2].astype(int)], [0, 2], MANY),
    "a function with its own derivative": (lambda x: _square_without_slope(x[1]), [1], MANY),
    "softplus": (lambda x: jax.nn.softplus(x[3]), [3], MANY),
    "a stopped gradient": (lambda x: jax.lax.stop_gradient(x[0]) ** 2, [0], MANY),
    "a loop": (lambda x: jax.lax.fori_loop(0, 3, lambda i, c: c * x[2], x[0]), range(4), MANY),
    "a branch": (
        lambda x: jax.lax.cond(x[0] > 0, lambda y: y[1], lambda y: y[2], x),
        range(4),
        MANY,
    ),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_components_and_degree(name):
    function, components, degree = FUNCTIONS[name]
    assert dependence(function, jnp.zeros(4)) == (frozenset(components), degree)


def test_parameters_that_are_traced_count_as_constants():
    results = []

    def program(weight, centre):
        results.append(dependence(lambda x: weight * jnp.sum((x[:2] - centre) ** 2), jnp.zeros(4)))
        return weight

    jax.make_jaxpr(program)(2.0, jnp.ones(2))
    assert results == [(frozenset([0, 1]), 2)]
