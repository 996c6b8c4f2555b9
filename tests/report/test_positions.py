"""Tests that pictures get the position as the first components of the state."""

import numpy as np
import pandas as pd
import pytest

from mppi_belief.report.positions import position_first

STATE = np.array([10.0, 20.0, 30.0])
COV = np.array([[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]])


def steps() -> pd.DataFrame:
    """Returns two steps of a trial with a state of three components."""
    rows = [{"step": k, "state": STATE + k, "mean": STATE - k, "cov": COV.ravel()} for k in (0, 1)]
    return pd.DataFrame(rows)


def test_the_position_comes_to_the_front_of_state_mean_and_covariance():
    reordered, scene = position_first(steps(), {"dt": 0.1, "position": [2, 0]})
    np.testing.assert_array_equal(np.stack(list(reordered["state"])), [[30, 10, 20], [31, 11, 21]])
    np.testing.assert_array_equal(np.stack(list(reordered["mean"])), [[30, 10, 20], [29, 9, 19]])
    expected = [[3.0, 0.2, 0.3], [0.2, 1.0, 0.1], [0.3, 0.1, 2.0]]
    np.testing.assert_array_equal(reordered["cov"].iloc[1].reshape(3, 3), expected)
    assert scene == {"dt": 0.1, "position": [0, 1]}


def test_a_second_time_changes_nothing():
    once = position_first(steps(), {"position": [2, 0]})
    twice = position_first(*once)
    assert twice[0] is once[0]
    assert twice[1] is once[1]


@pytest.mark.parametrize("scene", [None, {"dt": 0.1}, {"position": [0]}, {"position": [0, 1]}])
def test_a_leading_or_unknown_position_changes_nothing(scene):
    given = steps()
    reordered, same = position_first(given, scene)
    assert reordered is given
    assert same is scene


def test_without_steps_there_is_nothing_to_reorder():
    empty = steps().iloc[:0]
    assert position_first(empty, {"position": [2]})[0] is empty
