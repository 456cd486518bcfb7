"""Numbers that a caller gives are judged by type, shape and range; none is made to fit."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from geodesic_motion_ros.utils.checked_numbers import check_number, check_range, check_time, check_unit, real_array
from geodesic_motion_ros.utils.errors import PlanningError, RobotError, SkillError


@pytest.mark.parametrize(
    ("value", "shape"),
    [
        ([[1, 2, 3]], ("o", 3)),
        (np.zeros((4, 3), dtype=np.float32), ("o", 3)),
        (torch.zeros(2, 3), ("o", 3)),
        ((0.5,), ("o",)),
        ([1, 2, 3], (3,)),
        ([], ("o", 3)),
        (np.empty((0, 3)), ("o", 3)),
    ],
)
def test_numbers_of_a_shape_are_taken_as_floats_of_their_own(value, shape) -> None:
    array = real_array("numbers", value, shape)
    assert array.dtype == float
    assert array.ndim == len(shape)
    assert array.shape[1:] == tuple(shape[1:])
    assert array is not value
    np.testing.assert_array_equal(array.ravel(), np.asarray(value, dtype=float).ravel())


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (np.zeros((3, 4)), r"shape \(3, 4\): expected \(o, 3\)"),
        (np.zeros(6), r"shape \(6,\): expected \(o, 3\)"),
        (np.zeros(3), r"shape \(3,\): expected \(o, 3\)"),
        (0.5, r"shape \(\): expected \(o, 3\)"),
        ([[1.0, 2.0, 3.0], [4.0]], "cannot be read as numbers"),
        (torch.zeros(2, 3, requires_grad=True), "cannot be read as numbers of shape .*grad"),
        ("here", "is 'here': real numbers"),
        ([["1", "2", "3"]], "real numbers"),
        ([[True, False, True]], "real numbers"),
        (np.zeros((1, 3), dtype=complex), "real numbers"),
        (None, "is None: real numbers"),
        (np.empty((0, 4)), r"shape \(0, 4\)"),
    ],
)
def test_what_is_no_array_of_the_shape_is_refused_by_name(value, said) -> None:
    with pytest.raises(PlanningError, match=f"^centres .*{said}"):
        real_array("centres", value, ("o", 3))
    with pytest.raises(RobotError):
        real_array("centres", value, ("o", 3), RobotError)


@pytest.mark.parametrize("value", [0, -2.5, 1.8e9, np.float64(3.0), np.float32(3.0), np.int64(3)])
def test_times_in_seconds_are_taken(value) -> None:
    check_time("now", value)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (np.nan, "is nan: it must lie between"), (np.inf, "is inf"), (-np.inf, "is -inf"), (1.8e12, ".*4e\\+09"),
        ("x", "is 'x': a real number"), (None, "is None"), (True, "is True"), (1j, "is 1j"), ([1.0], "is \\[1.0\\]"),
    ],
)  # fmt: skip
def test_what_is_no_time_in_seconds_is_refused(value, said) -> None:
    """A time of today in milliseconds is none."""
    with pytest.raises(PlanningError, match=rf"^now \[s\] {said}"):
        check_time("now", value)


def test_what_cannot_be_compared_lies_in_no_range() -> None:
    check_number("length", 1.0, 0.0, 2.0)
    check_range("lengths", np.array([0.0, 2.0]), 0.0, 2.0)
    check_unit("turn", np.array([1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(PlanningError, match="length is nan"):
        check_number("length", np.nan, -np.inf, np.inf)
    with pytest.raises(SkillError, match="lengths holds nan"):
        check_range("lengths", np.array([0.0, np.nan]), -np.inf, np.inf)
    with pytest.raises(SkillError, match="length nan"):
        check_unit("turn", np.array([np.nan, 0.0, 0.0, 0.0]))
