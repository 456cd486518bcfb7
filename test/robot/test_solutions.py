"""Numerical inverse kinematics: whatever is found holds the pose within the limits, and nearly all is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.solutions import numerical_solutions, solutions, spread
from geodesic_motion_ros.utils.errors import RobotError

PANDA = Robot.named("panda")
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{origin}"/>
<axis xyz="{axis}"/><limit lower="-6.2" upper="6.2" velocity="1" effort="1"/></joint>"""


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """An arm of six joints, each of which turns nearly twice around."""
    axes = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
    origins = ("0 0 0.09", "0 0.13 0", "0 -0.12 0.42", "0 0 0.39", "0 0.09 0", "0 0 0.09")
    links = ["base", *(f"link{number}" for number in range(1, 6)), "tool"]
    joints = [
        JOINT.format(name=f"joint{i + 1}", kind="revolute", parent=links[i], child=links[i + 1], origin=o, axis=a)
        for i, (o, a) in enumerate(zip(origins, axes, strict=True))
    ]
    path: Path = tmp_path_factory.mktemp("arm") / "six.urdf"
    named = [f'<link name="{link}"/>' for link in links]
    path.write_text(f'<robot name="six">{"".join([*named, *joints])}</robot>')
    return Robot.from_urdf(path, "base", "tool")


def check(robot: Robot, found: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
    for one in found:
        reached, turned = robot.forward(robot.checked(one))
        np.testing.assert_allclose(reached, position, atol=1e-8)
        assert angle_between(turned, quaternion) < 1e-7
    apart = np.abs(found[:, None] - found).max(axis=2)
    assert np.all(apart[~np.eye(len(found), dtype=bool)] > 1e-4)


def test_the_closed_form_finds_nearly_nothing_that_is_not_found_numerically() -> None:
    """Of 300 poses within the limits, from starts within 0.02 rad of its solutions, and from evenly spread ones."""
    generator = np.random.default_rng(0)
    wanted = nearby = spread_out = 0
    starts = spread(PANDA, 256)
    for configuration in PANDA.sample(300, generator):
        pose, last = PANDA.forward(configuration), configuration[-1]
        closed = solutions(PANDA, *pose, last)
        beside = closed + generator.uniform(-0.02, 0.02, closed.shape)
        for begin in (beside, starts):
            found = numerical_solutions(PANDA, *pose, last, begin)
            check(PANDA, found, *pose)
            gaps = np.abs(closed[:, None] - found).max(axis=2).min(axis=1, initial=np.inf)
            nearby += np.sum(gaps < 1e-4) if begin is beside else 0
            spread_out += np.sum(gaps < 1e-4) if begin is starts else 0
        wanted += len(closed)
    assert wanted > 600
    assert nearby >= 0.99 * wanted
    assert spread_out >= 0.99 * wanted


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_what_an_arm_of_six_joints_is_found_in_holds_the_pose(six: Robot, seed: int) -> None:
    """Whole turns count as one: that nearest to ready is given."""
    pose = six.forward(six.sample(1, np.random.default_rng(seed))[0])
    found = solutions(six, *pose)
    check(six, found, *pose)
    assert np.all(np.abs(found) <= np.pi + 1e-9)


def test_an_arm_of_six_joints_has_its_own_configuration_among_them(six: Robot) -> None:
    """In 99 of 100 draws: a singular posture is approached slowly."""
    drawn = six.sample(100, np.random.default_rng(0))
    found = [np.exp(1j * solutions(six, *six.forward(one))) - np.exp(1j * one) for one in drawn]
    assert np.mean([np.abs(gaps).max(axis=1).min(initial=np.inf) < 1e-4 for gaps in found]) >= 0.99


def test_the_same_pose_has_the_same_answer(six: Robot) -> None:
    pose = six.forward(np.full(6, 0.7))
    np.testing.assert_array_equal(solutions(six, *pose), solutions(six, *pose))


def test_what_is_out_of_reach_has_none(six: Robot) -> None:
    position, quaternion = six.forward(np.full(6, 0.7))
    assert solutions(six, position + 3.0, quaternion).shape == (0, 6)


def test_what_cannot_be_solved_is_named(six: Robot, tmp_path: Path) -> None:
    pose = PANDA.forward(PANDA.ready)
    with pytest.raises(RobotError, match="the last joint of 7 is not given: say where it is"):
        solutions(PANDA, *pose)
    with pytest.raises(RobotError, match=r"joint 'panda_joint7' is to be at 4\.0000 rad"):
        solutions(PANDA, *pose, 4.0)
    with pytest.raises(RobotError, match="the last joint of 6 is given"):
        solutions(six, *pose, 0.0)
    with pytest.raises(RobotError, match="target quaternion"):
        solutions(six, pose[0], 2.0 * pose[1])
    foreign = Robot(PANDA.urdf, PANDA.base_link, PANDA.tool_link, inverse_kinematics="no_such_module")
    with pytest.raises(RobotError, match="inverse_kinematics is 'no_such_module', which cannot be imported"):
        solutions(foreign, *pose, 0.0)
    planar = Robot.from_urdf(PANDA.urdf, "panda_link0", "panda_link3")
    with pytest.raises(RobotError, match="has 3 joints: solutions are of arms with 6 or 7"):
        solutions(planar, *pose)
