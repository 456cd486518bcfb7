"""Limits of joints are a robot's own, scaled; what is no limit is refused."""

import numpy as np
import pytest

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.utils.errors import RobotError

ROBOT = Robot.named("panda")


def test_limits_are_the_robots_scaled_and_with_a_margin():
    limits = JointLimits.of(ROBOT, speed_scale=0.5, acceleration_scale=0.25, position_margin=0.1)
    np.testing.assert_allclose(limits.lower, ROBOT.lower + 0.1)
    np.testing.assert_allclose(limits.upper, ROBOT.upper - 0.1)
    np.testing.assert_allclose(limits.velocity, 0.5 * ROBOT.velocity_limits)
    np.testing.assert_allclose(limits.acceleration, 0.25 * ROBOT.acceleration_limits)
    np.testing.assert_allclose(limits.jerk, 0.25 * ROBOT.jerk_limits)


def test_limits_are_copies_that_nobody_changes():
    velocity = np.full(2, 1.0)
    limits = JointLimits(np.full(2, -1.0), np.full(2, 1.0), velocity, np.full(2, 5.0), np.full(2, np.inf))
    velocity[0] = 9.0
    assert limits.velocity[0] == 1.0
    with pytest.raises(ValueError):
        limits.velocity[0] = 9.0


@pytest.mark.parametrize("scales", [(0.0, 1.0), (1.5, 1.0), (1.0, -0.1), (np.nan, 1.0)])
def test_a_scale_outside_its_range_is_refused(scales):
    with pytest.raises(RobotError, match=r"must be in \(0, 1\]"):
        JointLimits.of(ROBOT, *scales)


def test_a_robot_whose_servo_would_overshoot_its_limits_takes_no_larger_scale():
    robot = Robot.named("fr3")
    assert robot.largest_speed_scale == 0.8
    assert JointLimits.of(robot, 0.8).velocity[0] == pytest.approx(0.8 * robot.velocity_limits[0])
    with pytest.raises(RobotError, match=r"speed_scale is 0\.81: it must be in \(0, 0\.8\]: above that a servo"):
        JointLimits.of(robot, 0.81)
    np.testing.assert_array_equal(JointLimits.of(robot).velocity, robot.velocity_limits)


def test_the_wider_of_two_limits_keeps_those_towards_stops():
    robot = Robot.named("fr3")
    wider = JointLimits.of(robot, 0.2, 0.5).covering(JointLimits.of(robot, 0.5, 0.2))
    np.testing.assert_array_equal(wider.velocity, JointLimits.of(robot, 0.5).velocity)
    assert wider.position_based_velocity is robot.position_based_velocity


def test_limits_towards_stops_are_of_all_joints():
    robot, ones = Robot.named("fr3"), np.ones(2)
    with pytest.raises(RobotError, match="7 joints have limits towards stops: there are 2"):
        JointLimits(-ones, ones, ones, ones, ones, robot.position_based_velocity)


def test_a_robot_without_acceleration_limits_is_refused():
    bare = Robot.from_urdf(ROBOT.urdf, ROBOT.base_link, ROBOT.tool_link)
    with pytest.raises(RobotError, match=r"joint_limits\.yaml"):
        JointLimits.of(bare)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lower": [1.0, 1.0]}, "below"),
        ({"velocity": [1.0, 0.0]}, "velocity must be positive"),
        ({"acceleration": [1.0, np.inf]}, "acceleration must be positive"),
        ({"jerk": [1.0, np.nan]}, "jerk must be positive"),
        ({"upper": [1.0]}, r"all be \(eta,\)"),
    ],
)
def test_what_is_no_limit_is_refused(change, message):
    ones = np.ones(2)
    good = {"lower": -ones, "upper": ones, "velocity": ones, "acceleration": ones, "jerk": ones}
    with pytest.raises(RobotError, match=message):
        JointLimits(**(good | {name: np.array(values) for name, values in change.items()}))
