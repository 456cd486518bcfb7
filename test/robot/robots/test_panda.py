"""Closed-form inverse kinematics: what is found holds the pose, and what holds the pose is found."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.solutions import solutions as solutions_of

ROBOT = Robot.named("panda")
CONFIGURATIONS = ROBOT.sample(200, np.random.default_rng(0))
#: Nearly stretched: the fourth joint, which bends by half a turn, is almost straight.
STRETCHED = np.array([0.3, 0.4, -0.2, -0.2, 0.5, 2.1, 0.7])


def solutions(configuration: np.ndarray) -> np.ndarray:
    return solutions_of(ROBOT, *ROBOT.forward(configuration), configuration[6])


def test_every_configuration_is_among_the_solutions_for_its_own_pose() -> None:
    for configuration in (*CONFIGURATIONS, STRETCHED):
        assert np.min(np.max(np.abs(solutions(configuration) - configuration), axis=1)) < 1e-7


def test_every_solution_holds_the_pose_inside_the_limits_and_they_differ() -> None:
    counts = []
    for configuration in CONFIGURATIONS:
        position, quaternion = ROBOT.forward(configuration)
        found = solutions(configuration)
        counts.append(len(found))
        for solution in found:
            reached, turned = ROBOT.forward(ROBOT.checked(solution))
            np.testing.assert_allclose(reached, position, atol=1e-9)
            assert angle_between(turned, quaternion) < 1e-7
            assert solution[6] == configuration[6]
        apart = np.abs(found[:, None] - found).max(axis=2)
        assert np.all(apart[~np.eye(len(found), dtype=bool)] > 1e-3)
    # Most poses have several.
    assert np.mean(counts) > 2.0


def test_a_pose_out_of_reach_has_none() -> None:
    position, quaternion = ROBOT.forward(CONFIGURATIONS[0])
    assert len(solutions_of(ROBOT, position + [2.0, 0.0, 0.0], quaternion, 0.0)) == 0
