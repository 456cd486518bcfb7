"""Means of poses: limits are kept, jerk gets one, and what stands stays where it is."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.motion_curve import MotionLimits
from geodesic_motion_ros.pose_smoothing import LAG, SMOOTHING, PoseSmoothing, corners_cut
from geodesic_motion_ros.quaternions import normalise, rotate

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
PERIOD = 0.01


def smoothed(positions: np.ndarray, period: float = PERIOD) -> np.ndarray:
    """Positions (n, 3) that a stream which stood at the first of (n, 3) commands."""
    smoothing = PoseSmoothing()
    smoothing.reset(positions[0], UPRIGHT)
    return np.array([smoothing.add(period, position, UPRIGHT)[0] for position in positions])


def bang_bang(period: float = PERIOD, acceleration: float = 0.5) -> np.ndarray:
    """Positions (n, 3): at rest, full acceleration for 0.4 s along x, as much braking, at rest."""
    times = period * np.arange(round(2.0 / period))
    pushes = np.where((times >= 0.2) & (times < 0.6), 1.0, np.where((times >= 0.6) & (times < 1.0), -1.0, 0.0))
    velocity = np.cumsum(acceleration * period * pushes)
    return np.stack([np.cumsum(period * velocity), np.zeros(len(times)), np.full(len(times), 0.3)], axis=1)


def test_jerk_is_at_most_twice_the_acceleration_over_the_window():
    asked = bang_bang()
    given = smoothed(asked)
    third = [np.max(np.abs(np.diff(positions[:, 0], 3))) / PERIOD**3 for positions in (asked, given)]
    assert third[0] == pytest.approx(1.0 / PERIOD)  # the control: from full acceleration to full braking in one period
    assert third[1] <= 1.0 / SMOOTHING * (1.0 + 1e-6)


def test_speed_and_acceleration_are_not_larger_than_what_was_asked():
    asked = bang_bang()
    given = smoothed(asked)
    for order in (1, 2):
        assert np.max(np.abs(np.diff(given, order, axis=0))) <= np.max(np.abs(np.diff(asked, order, axis=0))) + 1e-15


def test_it_comes_to_rest_where_the_stream_does_and_not_a_bit_elsewhere():
    asked = bang_bang()
    given = smoothed(asked)
    np.testing.assert_array_equal(given[-1], asked[-1])
    rests = int(np.argmax(np.all(asked == asked[-1], axis=1))) + round(SMOOTHING / PERIOD)
    assert np.all(given[rests:] == asked[-1])


@pytest.mark.parametrize("period", [0.002, 0.005, 0.01, 0.025])
def test_a_steady_motion_comes_half_a_window_later_at_any_rate(period):
    times = period * np.arange(200)
    positions = np.outer(times, [0.2, 0.0, 0.1])
    given = smoothed(positions, period)
    # A pose counts for the period that ends with it.
    late = LAG - 0.5 * period
    np.testing.assert_allclose(given[-1], (times[-1] - late) * np.array([0.2, 0.0, 0.1]), atol=1e-12)


def test_a_pause_of_the_clock_moves_nothing():
    smoothing = PoseSmoothing()
    smoothing.reset(np.zeros(3), UPRIGHT)
    for position in np.outer(np.arange(1, 9), [0.002, 0.0, 0.0]):
        before = smoothing.add(PERIOD, position, UPRIGHT)[0]
    kept = len(smoothing._poses)
    for _ in range(20):
        np.testing.assert_array_equal(smoothing.add(0.0, position, UPRIGHT)[0], before)
    assert len(smoothing._poses) == kept


def test_corners_are_cut_by_no_more_than_is_said():
    turns = np.linspace(0.0, np.pi, 400)
    # 0.2 m/s on a circle of 8 cm: 0.5 m/s^2 across
    circle = 0.08 * np.stack([np.cos(turns), np.sin(turns), np.zeros(400)], axis=1)
    period = 0.08 * (turns[1] - turns[0]) / 0.2
    given = smoothed(circle, period)[100:]
    off = 0.08 - np.linalg.norm(given, axis=1)
    assert np.max(np.abs(off)) <= 1.05 * 0.5 * SMOOTHING**2 / 24.0
    assert np.max(np.abs(off)) >= 0.5 * 0.5 * SMOOTHING**2 / 24.0


def test_quaternions_stay_of_unit_length_and_follow():
    smoothing = PoseSmoothing()
    smoothing.reset(np.zeros(3), UPRIGHT)
    for angle in np.linspace(0.0, 1.0, 60):
        turned = normalise(np.array([np.cos(angle / 2.0), np.sin(angle / 2.0), 0.0, 0.0]))
        _, given = smoothing.add(PERIOD, np.zeros(3), turned)
        assert np.linalg.norm(given) == pytest.approx(1.0, abs=1e-12)
    assert 2.0 * np.arccos(given @ turned) == pytest.approx(2.0 / 59.0, rel=1e-3)  # two periods late


@pytest.mark.parametrize("acceleration", [0.5, 10.0])
def test_no_tool_point_is_taken_further_off_the_way_than_the_certificate_allows_for(acceleration):
    """Full acceleration along x and full angular acceleration about z: both take a point on -y the same way."""
    period, lever, angular = 0.002, 0.15, 4.0 * acceleration
    limits = MotionLimits(1.0, 1.0, acceleration, angular)
    smoothing, points, late = PoseSmoothing(), np.array([[0.0, -lever, 0.0]]), LAG - 0.5 * period

    def pose(time: float) -> tuple[np.ndarray, np.ndarray]:
        half = 0.25 * angular * time**2
        return np.array([0.5 * acceleration * time**2, 0.0, 0.0]), np.array([np.cos(half), 0.0, 0.0, np.sin(half)])

    smoothing.reset(*pose(-0.05))
    for time in period * np.arange(-25, 26):
        given = smoothing.add(period, *pose(time))
        if abs(time - late) < 0.5 * period:
            at, on_the_way = given, pose(time - late)
    off = np.linalg.norm(at[0] + rotate(at[1], points) - on_the_way[0] - rotate(on_the_way[1], points))
    allowed = float(corners_cut(limits, 1.0, np.array([lever]))[0])
    assert 0.95 * allowed <= off <= allowed * (1.0 + 1e-9)
