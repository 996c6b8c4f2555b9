"""Maps over the last axis: equal to `jax.vmap`, samples stay there, components are vectors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from helpers import light_dark_problem
from mppi_belief.belief.kalman import filter_step
from mppi_belief.discretise import euler_step
from mppi_belief.numerics.scalarized import LARGEST_TABLE, vmap_scalarized
from mppi_belief.numerics.vmap_last import LARGEST_UNROLLED, vmap_last

A = jnp.arange(12.0).reshape(3, 4) / 7 - 0.6
LONG = jnp.linspace(-1.0, 1.0, 3 * (LARGEST_UNROLLED + 1)).reshape(3, -1)


@jax.custom_jvp
def doubled(x):
    return 2 * x


doubled.defjvp(lambda primals, tangents: (2 * primals[0], 2 * tangents[0]))

FUNCTIONS = {
    "elementwise": lambda x, u: jnp.sin(x) * 2 + jnp.exp(-x) / (1 + x**2),
    "scalar of a sample": lambda x, u: x * u[0] + x[1],
    "where": lambda x, u: jnp.where(x > 0, x, 0.5 * x),
    "where one number decides": lambda x, u: jnp.where(u[0] > 0, x, -x),
    "clip": lambda x, u: jnp.clip(x, -0.5, u[1]),
    "concatenate": lambda x, u: jnp.concatenate([x[2:], jnp.zeros(2), u]),
    "stack": lambda x, u: jnp.stack([x[0], 1.0, u[1]]),
    "slices": lambda x, u: x[::2] - x[1:3],
    "at": lambda x, u: x.at[1].set(u[0]),
    "pad": lambda x, u: jnp.pad(x, (1, 2)),
    "a matrix that is not mapped": lambda x, u: A @ x,
    "from the right": lambda x, u: u @ A[:2],
    "a matrix of the sample": lambda x, u: jnp.outer(u, x) @ x,
    "two matrices of the sample": lambda x, u: jnp.outer(x, u) @ jnp.outer(u, x),
    "a batch of products": lambda x, u: jnp.einsum("ij,ij->i", jnp.outer(u, x), A[:2]),
    "a product too long to write out": lambda x, u: LONG.T @ A @ x @ LONG.T,
    "a product of nothing": lambda x, u: jnp.zeros((3, 0)) @ x[:0],
    "reductions": lambda x, u: jnp.sum(jnp.outer(x, u), axis=0) + jnp.max(x) - jnp.min(u),
    "mean and variance": lambda x, u: jnp.mean(x) + jnp.var(x),
    "shapes": lambda x, u: jnp.outer(x, u).reshape(2, 4).T[None],
    "diagonal": lambda x, u: jnp.diag(x) @ jnp.eye(4, 2),
    "compiled inside": lambda x, u: jax.jit(lambda x: jnp.roll(x, 1) + A[0])(x),
    "a derivative of one's own": lambda x, u: doubled(x),
    "a derivative": lambda x, u: jax.jacfwd(lambda x: jnp.concatenate([x[2:] * x[0], jnp.sin(u)]))(
        x
    ),
    "a branch": lambda x, u: jax.lax.cond(u[0] > 0, lambda x: x, lambda x: -x, x),
    "a loop": lambda x, u: jax.lax.scan(lambda c, a: (c + a, c * a), u[0], x),
    "linear algebra": lambda x, u: jnp.linalg.solve(jnp.eye(4) + jnp.outer(x, x), x),
    "sorting": lambda x, u: jnp.sort(x) + jnp.cumsum(x) + jnp.argmax(x),
    "nothing of the sample": lambda x, u: A,
    "several": lambda x, u: {"a": x[0], "b": (u, jnp.ones(3))},
}


@pytest.mark.parametrize("over_samples", [vmap_last, vmap_scalarized])
@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
def test_it_is_vmap_on_the_last_axis(function, over_samples):
    x, u = (jax.random.normal(jax.random.key(i), (size, 5)) for i, size in enumerate((4, 2)))
    for mapped in ((True, True), (True, False)):
        args = (x, u if mapped[1] else u[:, 0])
        axes = tuple(-1 if m else None for m in mapped)
        wanted = jax.vmap(function, in_axes=axes, out_axes=-1)(*args)
        got = over_samples(function, mapped)(*args)
        assert jax.tree.structure(got) == jax.tree.structure(wanted)
        for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(wanted), strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-5)


def test_maps_nest():
    x = jax.random.normal(jax.random.key(0), (4, 3, 5))
    wanted = jax.vmap(jax.vmap(lambda x: A @ x, in_axes=-1, out_axes=-1), in_axes=-1, out_axes=-1)(
        x
    )
    np.testing.assert_allclose(
        vmap_last(vmap_last(lambda x: A @ x, [True]), [True])(x), wanted, rtol=1e-6
    )


def test_a_step_of_the_dynamics_moves_no_sample_to_another_axis():
    system = light_dark_problem().system
    step = vmap_last(lambda x, u: euler_step(system, x, u, 0.1), (True, True))
    text = str(jax.make_jaxpr(step)(jnp.ones((4, 500)), jnp.ones((2, 500))))
    assert "[500," not in text
    moved = jax.vmap(lambda x, u: euler_step(system, x, u, 0.1), in_axes=-1, out_axes=-1)
    assert "[500," in str(jax.make_jaxpr(moved)(jnp.ones((4, 500)), jnp.ones((2, 500))))


@pytest.mark.parametrize("over_samples", [vmap_last, vmap_scalarized])
def test_the_number_of_samples_must_agree(over_samples):
    for samples in (6, 1):
        with pytest.raises(ValueError, match="number of samples"):
            over_samples(lambda x, u: x + u[0], (True, True))(
                jnp.ones((4, 5)), jnp.ones((2, samples))
            )


@pytest.mark.parametrize("over_samples", [vmap_last, vmap_scalarized])
def test_a_product_has_the_type_asked_for(over_samples):
    a = jnp.full((4, 3), 100, jnp.int8)
    computed = over_samples(lambda a: jnp.dot(a, a, preferred_element_type=jnp.int32), [True])(a)
    assert computed.dtype == jnp.int32
    np.testing.assert_array_equal(computed, 40_000)


def test_a_filter_step_becomes_vectors_and_multiplies_with_nothing_that_is_known():
    problem = light_dark_problem()
    step = vmap_scalarized(
        lambda mean, root, u: filter_step(problem, mean, root, u)[:2], (True, True, True)
    )
    text = str(jax.make_jaxpr(step)(jnp.ones((4, 9)), jnp.ones((4, 4, 9)), jnp.ones((2, 9))))
    inside = text[: text.rindex("stack")]
    assert "dot_general" not in text
    assert "concatenate" not in inside
    dense = 4 * (4 * 4 * 4)  # the products of a dense transition with a root and of four such roots
    assert 0 < text.count(" mul ") < 2 * dense


def test_what_is_known_to_be_nothing_takes_nothing_along():
    computed = vmap_scalarized(lambda x: jnp.diag(x) @ jnp.ones(2), (True,))(
        jnp.array([[jnp.inf], [1.0]])
    )
    np.testing.assert_array_equal(
        computed, [[jnp.inf], [1.0]]
    )  # 0 times infinity would be no number


def test_long_programs_are_left_to_the_other_map():
    centers = np.random.default_rng(0).normal(size=(40, 2)).astype("float32")
    x = jax.random.normal(jax.random.key(0), (2, 3))

    def penalty(p):
        return jnp.sum(jnp.exp(-jnp.sum((p - centers) ** 2, axis=-1)))

    expected = jax.vmap(penalty, in_axes=-1)(x)
    for largest, has_arrays in {100: True, 1000: False}.items():
        over_samples = vmap_scalarized(penalty, (True,), largest)
        text = str(jax.make_jaxpr(over_samples)(x))
        assert ("f32[40,2,3]" in text) == has_arrays
        np.testing.assert_allclose(over_samples(x), expected, rtol=1e-5)


def test_large_matrices_are_left_to_the_other_map():
    n = LARGEST_TABLE // 6 + 1
    x = jax.random.normal(jax.random.key(0), (n, n, 3))
    text = str(jax.make_jaxpr(vmap_scalarized(lambda x: x @ x, (True,)))(x))
    assert f"f32[{n},{n},3]" in text
    np.testing.assert_allclose(
        vmap_scalarized(lambda x: x @ x, (True,))(x),
        jnp.einsum("ijn,jkn->ikn", x, x),
        rtol=1e-5,
        atol=1e-5,
    )
