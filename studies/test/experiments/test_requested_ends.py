"""Ends along and beyond demonstrations that are known exactly, the control, and what counts as answered."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.convex_hull import beyond_hull
from geodesic_motion_studies.experiments.requested_ends import (
    ALONG,
    NEAREST,
    EndsAnswer,
    answers_to,
    ends_beyond,
    ends_summary,
    ends_table,
    nearest_piece,
    pieces_of,
)

TIMES = np.linspace(0.0, 5.0, 101)
UPRIGHT = np.tile([1.0, 0.0, 0.0, 0.0], (101, 1))
ALONG_X = np.linspace(0.0, 1.0, 101)[:, None] * [1.0, 0.0, 0.0]


@pytest.fixture
def lines() -> Demonstrations:
    """Four lines of 1 m along x at the corners of a square of 0.2 m."""
    corners = [(0.0, y, z) for y in (0.0, 0.2) for z in (0.0, 0.2)]
    return Demonstrations(tuple(Demonstration(ALONG_X + corner, UPRIGHT, TIMES, str(corner)) for corner in corners))


def test_pieces_lie_on_the_demonstration_that_is_right_for_them(lines) -> None:
    for item in pieces_of(lines, 20, np.random.default_rng(0)):
        assert item.where == ALONG
        (right,) = item.right
        np.testing.assert_array_equal(right.start[0], item.start[0])
        assert 0.0 <= item.start[0][0] <= 0.4 + 1e-9
        assert 0.59 <= item.goal[0][0] <= 1.0
        np.testing.assert_allclose(item.start[0][1:], item.goal[0][1:])


def test_rings_are_so_far_outside_of_the_convex_hull(lines) -> None:
    starts = np.array([item.positions[0] for item in lines])
    goals = np.array([item.positions[-1] for item in lines])
    for item in ends_beyond(lines, 0.05, 20, np.random.default_rng(1)):
        assert item.where == "50 mm beyond"
        for pose, corners in ((item.start, starts), (item.goal, goals)):
            assert np.linalg.norm(beyond_hull(pose[0], corners)) == pytest.approx(0.05)
        assert len(item.right) == len(lines)


def test_the_control_is_the_piece_that_is_nearest_and_ends_where_it_was_requested_to(lines) -> None:
    start, goal = (np.array([0.3, 0.21, 0.0]), UPRIGHT[0]), (np.array([0.8, 0.21, 0.0]), UPRIGHT[0])
    piece = nearest_piece(lines, start, goal)
    np.testing.assert_allclose(piece.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)
    np.testing.assert_allclose(piece.positions[:, 1:], np.tile([0.21, 0.0], (len(piece.positions), 1)), atol=1e-9)


def test_the_control_does_not_run_back_along_a_demonstration(lines) -> None:
    start, goal = (np.array([0.8, 0.0, 0.0]), UPRIGHT[0]), (np.array([0.3, 0.0, 0.0]), UPRIGHT[0])
    piece = nearest_piece(lines, start, goal)
    assert len(piece.positions) >= 2
    np.testing.assert_allclose(piece.positions[[0, -1]], [start[0], goal[0]], atol=1e-9)


def test_ends_that_are_refused_count_as_such_and_have_a_motion_with_the_limits_lifted(
    reach_pose_skill, reach_poses
) -> None:
    requested = ends_beyond(reach_poses, 0.2, 1, np.random.default_rng(2))
    geodesic, control = answers_to(requested, {"geodesic": reach_pose_skill}, reach_poses, 0)
    assert "allowed are 50 mm" in geodesic.reason
    assert math.isnan(geodesic.off)
    assert geodesic.off_unlimited > 0.0
    assert (control.method, control.reason) == (NEAREST, "")
    assert control.missed == pytest.approx(0.0, abs=1e-9)


def test_figures_leave_out_the_refused() -> None:
    answers = [
        EndsAnswer(ALONG, "geodesic", 0, "", 0.001, 0.010, 0.020),
        EndsAnswer(ALONG, "geodesic", 1, "too far", math.nan, math.nan, 0.040),
    ]
    assert ends_summary(answers, ALONG, "geodesic") == pytest.approx(
        {"requested": 2, "answered": 1, "missed_mm": 1.0, "off_mm": 10.0, "off_unlimited_mm": 30.0}
    )
    assert "along" in ends_table(answers)
