"""Motions of an FR3 for what commands one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import reject

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints


class Arm:
    """An FR3: its limits, its joints' names, and motions inside the limits that a planner would keep."""

    def __init__(self) -> None:
        self.robot = Robot.named("fr3")
        self.names, self.limits = self.robot.joint_names, JointLimits.of(self.robot)
        self._planned = JointLimits.of(self.robot, 0.8, 0.8)

    @staticmethod
    def sent(motion: JointReference) -> JointWaypoints:
        """A motion as it is sent."""
        return JointWaypoints(motion.times, motion.positions, motion.velocities, motion.accelerations)

    def motion(self, seed: int, *state: np.ndarray) -> JointReference:
        """A motion of one quintic, from a state or from rest near ready, to rest elsewhere near ready: the fastest of
        some that keeps the limits. A seed of which none does, in motion towards a limit, is no example.
        """
        random = np.random.default_rng(seed)
        start, goal = self.robot.ready + random.uniform(-0.3, 0.3, size=(2, 7))
        position, velocity, acceleration = state or (start, np.zeros(7), np.zeros(7))
        ends = [np.stack(pair) for pair in ((position, goal), (velocity, np.zeros(7)), (acceleration, np.zeros(7)))]
        for duration in np.geomspace(0.3, 10.0, 30):
            motion = JointReference(np.array([0.0, duration]), *ends, np.zeros((2, 1)))
            if motion.keeps(self._planned):
                return motion
        reject()


@pytest.fixture(scope="session")
def arm() -> Arm:
    return Arm()
