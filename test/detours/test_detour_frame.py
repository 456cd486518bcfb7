"""The coordinates of detours: a base path by its own length, null vectors, and the demonstrations' variance."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import DETOUR_METRES_PER_RADIAN, DETOUR_NARROWEST_SPREAD
from geodesic_motion_ros.detours.detour_frame import DemonstratedSpread, DetourFrame, demonstrated_mode
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

PANDA = Robot.named("panda")


def swing(robot: Robot, samples: int = 90) -> np.ndarray:
    """A path (m, eta) whose first half goes twice as fast as its second one."""
    share = np.concatenate([np.linspace(0.0, 2 / 3, samples // 2), np.linspace(2 / 3, 1.0, samples // 2)[1:]])
    start = robot.ready if len(robot.joint_names) == 7 else np.array([0.2, 0.4, 0.9, 0.3, 0.8, 0.1])
    away = np.linspace(0.5, -0.3, len(start))
    return start + share[:, None] * away


def frame_of(robot: Robot, covariance: np.ndarray) -> DetourFrame:
    path = swing(robot)
    latent = np.linspace(0.0, 1.0, len(path))[:, None] * [1.0, -2.0]
    return DetourFrame.of_base_path(robot, path, latent, np.tile(covariance, (len(path), 1, 1)))


@pytest.mark.parametrize("joints", [7, 6])
def test_samples_are_as_far_apart_from_the_first_to_the_last(joints: int, six: Robot) -> None:
    robot = PANDA if joints == 7 else six
    frame = frame_of(robot, np.zeros((3, 3)))
    path = swing(robot)
    np.testing.assert_allclose(frame.configurations[[0, -1]], path[[0, -1]])
    np.testing.assert_allclose(frame.latent[[0, -1]], [[0.0, 0.0], [1.0, -2.0]])
    moved = np.linalg.norm(np.diff(frame.positions, axis=0), axis=1)
    turned = angle_between(frame.quaternions[1:], frame.quaternions[:-1])
    joint = np.linalg.norm(np.diff(frame.configurations, axis=0), axis=1)
    steps = np.hypot(moved, DETOUR_METRES_PER_RADIAN * np.hypot(turned, joint))
    # A sample lies on a chord of the path, so that steps are shorter than the path by what it bends.
    np.testing.assert_allclose(steps, frame.step, rtol=0.01)
    there, _ = end_effector_poses(np.ascontiguousarray(frame.configurations), robot.chain)
    np.testing.assert_allclose(there, frame.positions)


def test_null_vectors_leave_the_tool_and_do_not_turn_round() -> None:
    frame = frame_of(PANDA, np.zeros((3, 3)))
    for configuration, null in zip(frame.configurations, frame.nulls, strict=True):
        assert np.max(np.abs(PANDA.jacobian(configuration) @ null)) < 1e-8
    assert np.all(np.sum(frame.nulls[1:] * frame.nulls[:-1], axis=1) > 0.9)
    np.testing.assert_allclose(np.linalg.norm(frame.nulls, axis=1), 1.0)


def test_an_arm_of_six_joints_has_none(six: Robot) -> None:
    assert not np.any(frame_of(six, np.zeros((3, 3))).nulls)


def test_leaving_is_cheap_where_demonstrations_varied() -> None:
    covariance = np.diag([0.05**2, 0.0, 0.01**2])
    frame = frame_of(PANDA, covariance)
    wanted = np.diag(1.0 / (np.diag(covariance) + DETOUR_NARROWEST_SPREAD**2))
    np.testing.assert_allclose(frame.precisions, np.tile(wanted, (len(frame), 1, 1)), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["panda_pouring", "panda_reach_to_grasp"])
def test_the_spread_is_the_covariance_of_each_mode_at_both_ends_and_between(name: str) -> None:
    skill = Skill.load(name)
    robot = Robot.named(skill.robot)
    spread = DemonstratedSpread.of(skill, robot).covariances
    modes = skill.canonical.modes
    assert len(spread) == modes.max() + 1
    eigenvalues = np.linalg.eigvalsh(spread)
    assert np.all(eigenvalues > -1e-12)
    for mode in range(len(spread)):
        codes = skill.codes[modes == mode]
        decode = skill.decoder.poses if skill.space == "task" else None
        flat = codes.reshape(-1, codes.shape[-1])
        positions = (
            decode(flat)[0]
            if decode
            else end_effector_poses(np.ascontiguousarray(skill.decoder.configurations(flat)), robot.chain)[0]
        ).reshape(*codes.shape[:2], 3)
        total = np.mean([np.trace(np.cov(positions[:, s].T)) for s in range(positions.shape[1])])
        # Smoothing along the path leaves the mean, but for what it takes at the ends.
        assert np.mean(np.trace(spread[mode], axis1=1, axis2=2)) == pytest.approx(total, rel=0.1)
        middle, ends = np.trace(spread[mode, 50]), np.trace(spread[mode, [0, -1]], axis1=1, axis2=2)
        # Both ends were taken out of the demonstrations before the training.
        assert np.all(ends < middle)


def test_progress_beyond_the_ends_counts_as_the_ends() -> None:
    spread = DemonstratedSpread(np.array([[1.0, 2.0], [5.0, 7.0]])[:, :, None, None] * np.eye(3))
    np.testing.assert_allclose(spread.at(np.array([-0.5, 0.5]), 1), [5.0 * np.eye(3), 6.0 * np.eye(3)])
    np.testing.assert_allclose(spread.at(np.array([1.5]), 0), [2.0 * np.eye(3)])


def test_the_mode_is_the_one_of_most_shares() -> None:
    assert demonstrated_mode(np.array([[0.3, 0.7], [0.8, 0.2], [0.3, 0.7]])) == 1
    assert demonstrated_mode(np.empty((3, 0))) == 0
