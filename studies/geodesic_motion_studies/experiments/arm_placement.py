"""Where arms stand to the region in which a tool was demonstrated: one rule for each of them.

The demonstrations are moved as a whole, forward and up in the arm's base frame and without a turn, as if the base were
mounted elsewhere. Of all moves on a lattice the one is taken with which the arm can hold the most demonstrations, each
from the configuration nearest to `Robot.ready`, with the swivels that the planner tries. Among these it is the one with
which the arm is farthest from singular postures: the least singular value of the tool's Jacobian, metres and radians
counted alike, is largest. The tool is the tool frame that the robot's folder names; it is not turned on the flange.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.contract.settings import SWIVELS
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.queries.posture import solve_path, swivel_steps
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError

#: Moves of the demonstrations that are tried [m]. None is down: there the arm stands.
FORWARD, UP = (-0.4, -0.3, -0.2, -0.1, 0.0, 0.1), (0.0, 0.1, 0.2, 0.3, 0.4)
#: Poses of a demonstration that the arm is to hold.
_POSES = 20


@dataclass(frozen=True, eq=False)
class Placement:
    """An arm, and where the frame of the demonstrations stands in its base frame.

    Attributes
    ----------
    row : what tables call it. arm : name of the robot. move : (3,) [m] of the demonstrations.
    held : demonstrations that the arm can hold there. dexterity : least singular value of the Jacobian along these.
    places : moves of the lattice with which it can hold them all; None where the move was given.
    """

    row: str
    arm: str
    move: np.ndarray
    held: int
    dexterity: float
    places: int | None = None

    @classmethod
    def at(cls, row: str, arm: str, move: np.ndarray, shown: Sequence[PoseCurve]) -> Placement:
        """With the demonstrations moved by (3,) [m]."""
        robot, least = Robot.named(arm), []
        for curve in shown:
            even = curve.resample(_POSES)
            configurations = _held(robot, even.positions + move, even.quaternions)
            if configurations is not None:
                slopes = np.stack([robot.jacobian(configuration) for configuration in configurations])
                least.append(float(np.linalg.svd(slopes, compute_uv=False).min()))
        return cls(row, arm, move, len(least), min(least, default=0.0))

    @classmethod
    def best(cls, arm: str, shown: Sequence[PoseCurve]) -> Placement:
        """By the rule of this module."""
        moves = [np.array([forward, 0.0, up]) for forward in FORWARD for up in UP]
        found = [cls.at(arm, arm, move, shown) for move in moves]
        best = max(found, key=lambda each: (each.held, each.dexterity))
        return replace(best, places=sum(each.held == len(shown) for each in found))

    @property
    def frame(self) -> TaskFrame:
        """That of the demonstrations, in the arm's base frame."""
        return TaskFrame(self.move, TaskFrame.identity().quaternion)


def _held(robot: Robot, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray | None:
    """Configurations (n, eta) that hold poses (n, 3), (n, 4), with the first swivel that serves; None with none."""
    try:
        start = solve(robot, positions[0], quaternions[0])
    except RobotError:
        return None
    for swivel in SWIVELS:
        path = solve_path(robot, positions, quaternions, start, swivel_steps(swivel, len(positions)))
        if np.all(path.reached):
            return path.configurations
    return None
