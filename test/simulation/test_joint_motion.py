"""Whatever is asked, the commanded joints keep position, velocity and acceleration limits."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.robot.inverse_kinematics import pose_error
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.joint_motion import JointMotion

ROBOT = Robot.named("panda")
DT = 1.0 / 240.0


def play(motion: JointMotion, targets: list[tuple], steps: int) -> np.ndarray:
    """Velocities (steps * len(targets), 7) while following each target for so many steps."""
    velocities = []
    for position, quaternion, twist in targets:
        for _ in range(steps):
            motion.follow(position, quaternion, twist, DT)
            velocities.append(motion.velocities)
    return np.array(velocities)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_limits_hold_for_leaping_targets(seed: int) -> None:
    generator = np.random.default_rng(seed)
    motion = JointMotion(ROBOT, ROBOT.sample(1, generator)[0])
    targets = [(*ROBOT.forward(q), generator.normal(size=6)) for q in ROBOT.sample(4, generator)]
    velocities = np.vstack([np.zeros(7), play(motion, targets, 60)])
    accelerations = np.diff(velocities, axis=0) / DT
    assert np.all(np.abs(velocities) <= ROBOT.velocity_limits * (1.0 + 1e-9))
    assert np.all(np.abs(accelerations) <= ROBOT.acceleration_limits * (1.0 + 1e-6))
    assert np.all(motion.positions >= ROBOT.lower)
    assert np.all(motion.positions <= ROBOT.upper)


def test_a_far_step_is_reached_and_not_overshot() -> None:
    motion = JointMotion(ROBOT, ROBOT.ready)
    position, quaternion = ROBOT.forward(ROBOT.ready)
    target = position + [0.05, -0.3, -0.1]
    distances = []
    for _ in range(480):
        motion.follow(target, quaternion, np.zeros(6), DT)
        distances.append(np.linalg.norm(pose_error(*ROBOT.forward(motion.positions), target, quaternion)[:3]))
    assert distances[-1] < 1e-4
    arrived = int(np.argmax(np.array(distances) < 2e-3))
    assert max(distances[arrived:]) < 2.5e-3


def test_stop_brakes_to_rest_as_fast_as_allowed() -> None:
    motion = JointMotion(ROBOT, ROBOT.ready)
    position, quaternion = ROBOT.forward(ROBOT.ready)
    play(motion, [(position + [0.0, -0.4, 0.0], quaternion, np.zeros(6))], 60)
    moving = motion.velocities.copy()
    assert np.max(np.abs(moving)) > 0.2
    for _ in range(int(np.ceil(np.max(np.abs(moving) / (ROBOT.acceleration_limits * DT)))) + 1):
        motion.stop(DT)
    np.testing.assert_allclose(motion.velocities, 0.0, atol=1e-9)


def test_limits_hold_for_leaping_joint_targets() -> None:
    generator = np.random.default_rng(5)
    motion = JointMotion(ROBOT, ROBOT.ready)
    velocities = [motion.velocities]
    for target in ROBOT.sample(6, generator):
        passing = generator.normal(size=7)
        for _ in range(60):
            motion.follow_joints(target, target + DT * passing, DT)
            velocities.append(motion.velocities)
    accelerations = np.diff(velocities, axis=0) / DT
    assert np.all(np.abs(velocities) <= ROBOT.velocity_limits * (1.0 + 1e-9))
    assert np.all(np.abs(accelerations) <= ROBOT.acceleration_limits * (1.0 + 1e-6))


def test_a_far_joint_target_is_reached_and_not_overshot() -> None:
    motion = JointMotion(ROBOT, ROBOT.ready)
    target = ROBOT.ready + [0.5, 0.2, -0.4, 0.3, 0.0, -0.2, 0.6]
    distances = []
    for _ in range(720):
        motion.follow_joints(target, target, DT)
        distances.append(np.linalg.norm(target - motion.positions))
    assert distances[-1] < 1e-4
    assert np.all(np.diff(distances) < 1e-6)


def test_a_motion_within_the_limits_is_followed_exactly() -> None:
    motion = JointMotion(ROBOT, ROBOT.ready)
    swing = np.array([0.4, 0.2, -0.3, 0.3, 0.5, -0.3, 0.6])
    path = ROBOT.ready + np.outer(0.5 - 0.5 * np.cos(np.pi * np.arange(0.0, 1.0, DT)), swing)
    for present, ahead in pairwise(path):
        motion.follow_joints(present, ahead, DT)
        np.testing.assert_allclose(motion.positions, ahead, atol=1e-12)


def test_a_joint_brakes_before_its_limit() -> None:
    """Pulled over the edge of joint 1 at speed, the arm decelerates within its limits and ends inside."""
    start = ROBOT.ready.copy()
    start[0] = ROBOT.upper[0] - 0.3
    motion = JointMotion(ROBOT, start)
    previous = np.zeros(7)
    for _ in range(400):
        position, quaternion = ROBOT.forward(motion.positions)
        tangent = np.array([-position[1], position[0], 0.0])
        motion.follow(position, quaternion, np.concatenate([1.5 * tangent, [0.0, 0.0, 1.5]]), DT)
        change = np.abs(motion.velocities - previous) / DT
        assert np.all(change <= ROBOT.acceleration_limits * (1.0 + 1e-6))
        previous = motion.velocities
        assert np.all(motion.positions <= ROBOT.upper)
    assert motion.positions[0] == pytest.approx(ROBOT.upper[0], abs=0.05)


def swinging(time: float) -> np.ndarray:
    """A motion of all joints that swings the elbow: (7,) [rad]."""
    return ROBOT.ready + np.array([0.3, 0.1, 0.4, 0.1, -0.3, 0.1, 0.3]) * (1.0 - np.cos(0.8 * time))


def test_with_a_posture_the_whole_configuration_is_followed_and_without_one_the_pose_alone() -> None:
    off = {}
    for with_posture in (True, False):
        motion, apart = JointMotion(ROBOT, ROBOT.ready), []
        for step in range(1, 1200):
            now, later = swinging(step * DT), swinging((step + 1) * DT)
            twist = ROBOT.jacobian(now) @ (later - now) / DT
            motion.follow(*ROBOT.forward(now), twist, DT, now if with_posture else None)
            apart.append(np.max(np.abs(motion.positions - now)))
            assert np.linalg.norm(pose_error(*ROBOT.forward(motion.positions), *ROBOT.forward(now))) < 5e-3
        off[with_posture] = np.max(apart)
    assert off[True] < 0.03
    assert off[False] > 0.2
