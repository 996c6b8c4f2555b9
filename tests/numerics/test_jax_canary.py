"""What `numerics.jaxpr_interpreter` relies on in JAX; these tests fail first where it has changed.

A failure here names the assumption. Adapt the interpreter and its tables of rules, then raise the
upper bound on `jax` in pyproject.toml.
"""

import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend import core

from mppi_belief.numerics.jaxpr_interpreter import ELEMENTWISE, evaluate
from mppi_belief.numerics.scalarized import vmap_scalarized
from mppi_belief.numerics.vmap_last import vmap_last

ROOT = Path(__file__).parents[2]
X = jnp.arange(4.0)
ADVICE = (
    "JAX has changed what the jaxpr interpreter relies on, see the first lines of this module: "
)

# The primitive that an expression is traced to, and the parameters that a rule reads or replaces.
TRACED = {
    "broadcast_in_dim": (lambda x: x[:, None], {"shape", "broadcast_dimensions"}),
    "concatenate": (lambda x: jax.lax.concatenate([x, x], 0), {"dimension"}),
    "dot_general": (lambda x: x @ x, {"dimension_numbers", "preferred_element_type"}),
    "iota": (lambda x: jax.lax.iota(float, 4), {"dimension"}),
    "jit": (lambda x: jax.jit(jnp.sin)(x), {"jaxpr"}),
    "pad": (lambda x: jax.lax.pad(x, 0.0, [(1, 2, 0)]), {"padding_config"}),
    "reduce_max": (lambda x: jax.lax.reduce_max(x, (0,)), {"axes"}),
    "reduce_min": (lambda x: jax.lax.reduce_min(x, (0,)), {"axes"}),
    "reduce_sum": (lambda x: jax.lax.reduce_sum(x, (0,)), {"axes"}),
    "reshape": (lambda x: jax.lax.reshape(x, (2, 2)), {"new_sizes", "dimensions"}),
    "rev": (lambda x: jax.lax.rev(x, (0,)), {"dimensions"}),
    "slice": (
        lambda x: jax.lax.slice(x, (1,), (3,)),
        {"start_indices", "limit_indices", "strides"},
    ),
    "split": (lambda x: jax.lax.split(x, (1, 3)), {"sizes", "axis"}),
    "squeeze": (lambda x: jax.lax.squeeze(x[None], (0,)), {"dimensions"}),
    "transpose": (lambda x: jax.lax.transpose(x[None], (1, 0)), {"permutation"}),
}


def test_jax_has_an_upper_bound_right_after_the_tested_release():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    pinned = dict(
        line.split("==")
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if "==" in line and not line.startswith("#")
    )
    major, minor, *_ = pinned["jax"].split(".")
    (requirement,) = [text for text in project["dependencies"] if text.startswith("jax")]
    assert requirement.endswith(f",<{major}.{int(minor) + 1}"), requirement
    (gpu,) = project["optional-dependencies"]["gpu"]
    assert gpu.partition(">=")[2] == requirement.partition(">=")[2]


@pytest.mark.parametrize("name", TRACED)
def test_an_operation_is_traced_to_the_primitive_with_the_parameters_of_its_rule(name):
    function, params = TRACED[name]
    equations = jax.make_jaxpr(function)(X).jaxpr.eqns
    traced = {equation.primitive.name: set(equation.params) for equation in equations}
    assert name in traced, f"{ADVICE}no primitive {name!r} but {sorted(traced)}"
    assert params <= traced[name], f"{ADVICE}{name} has the parameters {sorted(traced[name])}"


def test_elementwise_primitives_exist_under_their_names():
    """A name that is no longer in JAX would silently send its operation to `jax.vmap`."""
    existing = {value.name for value in vars(core.primitives).values() if hasattr(value, "name")}
    assert not ELEMENTWISE - existing, f"{ADVICE}no primitives {sorted(ELEMENTWISE - existing)}"


def test_a_jaxpr_has_the_parts_that_the_interpreter_reads():
    closed = jax.make_jaxpr(lambda x: jnp.asarray(np.ones(4)) + 2.0 * x)(X)
    for part in ("consts", "jaxpr"):
        assert hasattr(closed, part), f"{ADVICE}a closed jaxpr has no {part!r}"
    for part in ("constvars", "invars", "outvars", "eqns"):
        assert hasattr(closed.jaxpr, part), f"{ADVICE}a jaxpr has no {part!r}"
    literals = [
        v for equation in closed.jaxpr.eqns for v in equation.invars if isinstance(v, core.Literal)
    ]
    assert [float(literal.val) for literal in literals] == [2.0], f"{ADVICE}literals differ"


def test_a_primitive_with_functions_among_its_parameters_can_be_bound():
    (equation,) = jax.make_jaxpr(lambda x: jax.lax.scan(lambda c, a: (c + a, c), x[0] * 0, x))(
        X
    ).jaxpr.eqns[-1:]
    assert equation.primitive.name == "scan", f"{ADVICE}a scan is traced to {equation.primitive}"
    total, partial_sums = evaluate(equation, jnp.zeros(()), X)
    assert total == 6, f"{ADVICE}a scan that is bound to its operands adds up to {total}"
    np.testing.assert_array_equal(partial_sums, [0, 0, 1, 3])


@pytest.mark.parametrize("over_samples", [vmap_last, vmap_scalarized])
def test_a_step_of_plain_arithmetic_needs_no_fallback(over_samples):
    """`jax.vmap` transposes where it has to; a rule that no longer fits would bring that back."""
    A = jnp.arange(12.0).reshape(3, 4)

    def step(x: jax.Array, u: jax.Array) -> jax.Array:
        return jnp.concatenate([(A @ x)[:2] * jnp.sin(u), x[1:3] - jnp.where(u > 0, u, 0.5)])

    text = str(
        jax.make_jaxpr(over_samples(step, (True, True)))(jnp.ones((4, 50)), jnp.ones((2, 50)))
    )
    assert "[50," not in text, f"{ADVICE}{over_samples.__name__} leaves operations to jax.vmap"
    assert "dot_general" not in text, (
        f"{ADVICE}{over_samples.__name__} leaves a product to jax.vmap"
    )
