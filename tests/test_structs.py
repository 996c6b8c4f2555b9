"""Structs: what is checked on construction, and how they behave under JAX."""

import copy
import dataclasses
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import mppi_belief as mb
from helpers import light_dark_problem
from mppi_belief.structs import struct_fields


@mb.struct
class Thermostat:
    weights: Array = mb.array(ndim=1, ge=0, le=100)
    shape: Array = mb.array(ndim=(1, 2))
    gain: float = mb.number(default=1.0, ge=0)
    limit: float = mb.number(default=2.0, gt=0, le=5)
    offset: float | None = mb.number(default=None, optional=True)
    count: int = mb.size(default=4, ge=2)
    mode: str = mb.choice("mean", "belief", default="mean")

    def output(self, x: Array) -> Array:
        return self.gain * jnp.sum(jnp.asarray(self.weights) * x) * self.count


def thermostat(**fields) -> Thermostat:
    return Thermostat(**{"weights": [1, 2], "shape": [1.0]} | fields)


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("gain", -0.1, "at least 0"),
        ("gain", np.nan, "finite"),
        ("gain", -np.inf, "finite"),
        ("gain", "1", "a number"),
        ("gain", None, "a number"),
        ("gain", True, "a number"),
        ("gain", [1.0], "a number"),
        ("gain", np.ones(1), "a number"),
        ("limit", 0, "greater than 0"),
        ("limit", 5.1, "at most 5"),
        ("offset", np.inf, "finite"),
        ("weights", 1.0, "1 dimension"),
        ("weights", [[1.0]], "1 dimension"),
        ("weights", [1.0, np.nan], "finite everywhere"),
        ("weights", [1.0, -2.0], "at least 0 everywhere"),
        ("weights", [1.0, 101.0], "at most 100 everywhere"),
        ("weights", [1.0, "a"], "array of numbers"),
        ("weights", [[1.0], [1.0, 2.0]], "array of numbers"),
        ("weights", None, "dimension"),
        ("shape", np.ones((1, 1, 1)), "1 or 2 dimension"),
        ("count", 1, "at least 2"),
        ("count", 3.0, "whole number"),
        ("count", True, "whole number"),
        ("count", "3", "whole number"),
        ("mode", "median", "one of mean, belief"),
        ("mode", None, "one of mean, belief"),
    ],
)
def test_a_bad_value_is_refused_by_name(field, value, reason):
    with pytest.raises(ValueError, match=f"^{field} .*{reason}"):
        thermostat(**{field: value})


def test_values_are_converted_once_and_for_all():
    device = thermostat(
        gain=np.float32(3), limit=np.asarray(2), weights=(1, 2), count=np.int64(7), offset=1
    )
    assert type(device.gain) is type(device.limit) is type(device.offset) is float
    assert type(device.count) is int
    assert isinstance(device.weights, np.ndarray)
    assert device.weights.dtype == float
    assert thermostat(limit=5).limit == 5


def test_the_first_choice_and_none_are_defaults():
    assert thermostat().mode == "mean"
    assert thermostat().offset is None
    assert thermostat(mode="belief").mode == "belief"


def test_structs_are_frozen_and_replace_checks_again():
    device = thermostat()
    with pytest.raises(dataclasses.FrozenInstanceError):
        device.gain = 2.0
    assert dataclasses.replace(device, gain=2).gain == 2.0
    with pytest.raises(ValueError, match="gain"):
        dataclasses.replace(device, gain=-2)


def test_numbers_and_arrays_are_leaves_sizes_and_choices_are_not():
    leaves = jax.tree.leaves(thermostat(gain=3))
    assert [np.shape(leaf) for leaf in leaves] == [(2,), (1,), (), ()]
    assert len(jax.tree.leaves(thermostat(offset=0))) == 5
    doubled = jax.tree.map(lambda leaf: 2 * leaf, thermostat(gain=3))
    assert (doubled.gain, doubled.count, doubled.mode) == (6, 4, "mean")


def test_jit_traces_once_for_all_numbers_and_again_for_a_size_or_choice():
    traces = []

    @jax.jit
    def run(device: Thermostat) -> Array:
        traces.append(device)
        return device.output(jnp.ones(2))

    for gain in (1.0, 2.0, 0.0):
        assert run(thermostat(gain=gain, weights=[gain, 1.0])) == gain * (gain + 1) * 4
    assert len(traces) == 1
    assert run(thermostat(count=5)) == 15
    assert len(traces) == 2
    run(thermostat(mode="belief"))
    run(thermostat(offset=1.0))
    assert len(traces) == 4
    run(thermostat(offset=2.0))
    assert len(traces) == 4


def test_vmap_and_grad_go_through_a_struct():
    stacked = jax.tree.map(
        lambda *leaves: jnp.stack(leaves), *[thermostat(gain=g) for g in (1.0, 2.0, 3.0)]
    )
    np.testing.assert_allclose(
        jax.vmap(lambda device: device.output(jnp.ones(2)))(stacked), [12, 24, 36]
    )
    slope = jax.grad(lambda device: device.output(jnp.ones(2)))(thermostat())
    assert slope.gain == 12
    np.testing.assert_allclose(slope.weights, [4, 4])


def test_traced_values_pass_unchecked():
    device = jax.jit(lambda gain: thermostat(gain=gain).output(jnp.ones(2)))(-1.0)
    assert device == -12


@pytest.mark.parametrize(
    "duplicate", [copy.deepcopy, lambda device: pickle.loads(pickle.dumps(device))]
)
def test_copies_and_pickles_are_equal(duplicate):
    problem = light_dark_problem()
    again = duplicate(problem)
    assert jax.tree.structure(again) == jax.tree.structure(problem)
    for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(problem), strict=True):
        np.testing.assert_array_equal(a, b)


@mb.struct
class Celsius:
    degrees: float = mb.number(default=0.0)

    def kelvin(self) -> Array:
        return self.degrees + 273.15


@mb.struct
class Fahrenheit:
    degrees: float = mb.number(default=0.0)

    def kelvin(self) -> Array:
        return (self.degrees - 32) / 1.8 + 273.15


@mb.struct
class Calibrated(Celsius):
    offset: float = mb.number(default=0.0)


def test_two_classes_with_the_same_fields_have_different_structures():
    structures = [jax.tree.structure(each) for each in (Celsius(), Fahrenheit(), mb.EKF())]
    structures += [jax.tree.structure(each) for each in (mb.UKF(), mb.MixtureFilter())]
    for i, structure in enumerate(structures):
        assert structure not in structures[:i]


def test_a_program_belongs_to_one_class():
    kelvin = jax.jit(lambda each: each.kelvin())
    for cls, freezing in ((Celsius, 273.15), (Fahrenheit, 255.372)):
        assert float(kelvin(cls(0.0))) == pytest.approx(freezing, rel=1e-5)


def test_the_class_of_a_struct_is_not_one_of_its_declared_fields():
    names = [field.name for field in struct_fields(Calibrated)]
    assert names == ["degrees", "offset"]
    moved = dataclasses.replace(Calibrated(1.0, 2.0), offset=3.0)
    assert (type(moved), moved.struct_class) == (Calibrated, Calibrated)
    assert "struct_class" not in repr(moved)
    assert type(jax.tree.map(lambda leaf: leaf + 1, moved)) is Calibrated
