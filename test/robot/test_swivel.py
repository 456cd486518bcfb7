"""The swivel angle is what its definition says, and poses are solved with it on one branch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.robot.description import shipped_robots
from geodesic_motion_ros.robot.inverse_kinematics import pose_error
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import elbow_position, solve_with_swivel, swivel_angle
from geodesic_motion_ros.utils.errors import RobotError

ROBOT = Robot.named("panda")
REACHING = np.array([-0.5, 0.5, 0.0, -1.75, 0.0, 2.2, 1.0])
TWO_JOINTS = """
<robot name="short"><link name="base"/><link name="middle"/><link name="tool"/>
<joint name="one" type="revolute"><parent link="base"/><child link="middle"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="two" type="revolute"><parent link="middle"/><child link="tool"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>
"""


def around(angle: float) -> float:
    """The same angle within half a turn of zero."""
    return float(np.arctan2(np.sin(angle), np.cos(angle)))


@pytest.mark.parametrize("turn", [-2.0, 0.0, 1.0])
def test_an_elbow_above_the_line_from_shoulder_to_wrist_has_no_swivel(turn: float) -> None:
    q = ROBOT.ready.copy()
    q[0] = turn
    assert swivel_angle(ROBOT, q) == pytest.approx(0.0, abs=1e-12)


def test_it_is_the_angle_by_which_the_elbow_is_turned_about_the_line() -> None:
    """Measured by turning the plane of the elbow back by it: then the elbow is above the line."""
    for q in ROBOT.sample(100, np.random.default_rng(1)):
        shoulder, elbow, wrist = ROBOT.link_frames(q)[1][[2, 4, 6]]
        n = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
        e = elbow - shoulder
        psi = -swivel_angle(ROBOT, q)
        back = e * np.cos(psi) + np.cross(n, e) * np.sin(psi) + n * (n @ e) * (1.0 - np.cos(psi))
        normal = np.cross(n, [0.0, 0.0, 1.0])
        assert back @ normal == pytest.approx(0.0, abs=1e-9)
        assert (back - (back @ n) * n)[2] > 0.0


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_pose_and_swivel_near_a_start_are_reached_inside_the_limits(seed: int) -> None:
    generator = np.random.default_rng(seed)
    start = REACHING + generator.uniform(-0.2, 0.2, 7)
    target = start + generator.uniform(-0.1, 0.1, 7)
    position, quaternion = ROBOT.forward(target)
    found = solve_with_swivel(ROBOT, position, quaternion, swivel_angle(ROBOT, target), start)
    error = pose_error(*ROBOT.forward(found), position, quaternion)
    assert np.max(np.abs(error)) < 1e-6
    assert abs(around(swivel_angle(ROBOT, found) - swivel_angle(ROBOT, target))) < 1e-6
    assert np.all((found >= ROBOT.lower) & (found <= ROBOT.upper))
    # the very posture, not another one with the same tool and elbow
    np.testing.assert_allclose(found, target, atol=1e-5)


def test_a_swept_swivel_moves_the_elbow_alone_and_without_a_leap() -> None:
    position, quaternion = ROBOT.forward(REACHING)
    swept, q = [], REACHING
    for swivel in np.radians(np.arange(0.0, 75.0, 1.0)):
        q = solve_with_swivel(ROBOT, position, quaternion, swivel, q)
        swept.append(q)
    steps = np.abs(np.diff(swept, axis=0))
    assert np.max(steps) < np.radians(5.0)
    elbows = np.array([elbow_position(ROBOT, q) for q in swept])
    assert np.linalg.norm(elbows[-1] - elbows[0]) > 0.2
    tools = np.array([ROBOT.forward(q)[0] for q in swept])
    np.testing.assert_allclose(tools - position, 0.0, atol=1e-6)
    # and back again: no other branch was entered in between
    for swivel in np.radians(np.arange(75.0, -1.0, -1.0)):
        q = solve_with_swivel(ROBOT, position, quaternion, swivel, q)
    np.testing.assert_allclose(q, swept[0], atol=1e-6)


def test_whole_turns_do_not_count() -> None:
    position, quaternion = ROBOT.forward(REACHING)
    once, again = (solve_with_swivel(ROBOT, position, quaternion, 0.3 + turn, REACHING) for turn in (0.0, 2.0 * np.pi))
    np.testing.assert_allclose(once, again, atol=1e-9)


def test_what_cannot_be_reached_is_refused_with_what_remains() -> None:
    _, quaternion = ROBOT.forward(REACHING)
    with pytest.raises(RobotError, match=r"swivel angle 10\.0 deg: .* mm, .* deg of swivel remain"):
        solve_with_swivel(ROBOT, np.array([2.0, 0.0, 0.3]), quaternion, np.radians(10.0), REACHING)


def test_a_solution_outside_the_limits_is_refused_by_the_joint() -> None:
    start = REACHING.copy()
    start[6] = ROBOT.upper[6] - 0.05
    beyond = start.copy()
    beyond[6] += 0.2
    with pytest.raises(RobotError, match="'panda_joint7' is at"):
        solve_with_swivel(ROBOT, *ROBOT.forward(beyond), swivel_angle(ROBOT, beyond), start)


def test_a_solution_on_the_other_branch_is_refused() -> None:
    """With joint 6 at half a turn the axes of joints 5 and 7 are one line: beyond it, tool and elbow move otherwise."""
    before, beyond = REACHING.copy(), REACHING.copy()
    before[5], beyond[5] = np.pi - 0.2, np.pi + 0.2
    with pytest.raises(RobotError, match=r"lie on another branch than the start .*start nearer to the target"):
        solve_with_swivel(ROBOT, *ROBOT.forward(beyond), swivel_angle(ROBOT, beyond), before)
    found = solve_with_swivel(ROBOT, *ROBOT.forward(beyond), swivel_angle(ROBOT, beyond), beyond + 0.02)
    np.testing.assert_allclose(found, beyond, atol=1e-6)


def test_other_arms_are_refused(tmp_path: Path) -> None:
    (tmp_path / "short.urdf").write_text(TWO_JOINTS)
    short = Robot.from_urdf(tmp_path / "short.urdf", "base", "tool")
    with pytest.raises(RobotError, match=r"2 joints, 2 of them revolute.*7 revolute joints"):
        swivel_angle(short, np.zeros(2))


@pytest.mark.parametrize("name", shipped_robots())
def test_the_elbow_is_where_the_middle_joint_begins(name: str) -> None:
    """It is moved by the joints of the shoulder, and by none from the middle one on."""
    robot = Robot.named(name)
    middle, posture = (len(robot.joint_names) - 1) // 2, robot.ready + 0.3
    moved = [elbow_position(robot, posture + turn) for turn in 0.1 * np.eye(len(posture))]
    off = np.linalg.norm(np.array(moved) - elbow_position(robot, posture), axis=1)
    assert np.all(off[:2] > 1e-3)
    assert np.all(off[middle:] == 0.0)
