"""Demonstrations of a tool as motions of an arm that carries it.

The arm's joints were not recorded, and a pose leaves them one freedom. Here the arm takes, for every pose, the
configuration nearest to its ready posture: the one in which the twin comes to rest that follows a stream of poses. It
depends on the pose alone, so that motions which meet in a pose meet in a configuration.

Hands tremble. A little of that is smoothed away: no arm that keeps limits of acceleration and jerk would play it in the
time that the task takes.
"""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.geometry.curves import Pose, PoseCurve
from geodesic_motion_ros.geometry.quaternions import continuous_signs, rotation_vector_between
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.queries.path_smoothing import smooth_poses
from geodesic_motion_ros.robot.inverse_kinematics import differential_step, pose_error
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.sheet import CanonicalSheet
from geodesic_motion_ros.utils.errors import ParameterError

#: Width of the smoothing, in samples of a demonstration, which has a hundred.
_SMOOTHED = 1.0
#: A configuration holds its pose up to this [m, rad], and is found where no joint moves more in a step [rad].
_POSE, _SETTLED = 1e-5, 1e-7
#: Steps for one pose.
_STEPS = 200
#: Configurations that should be one are so near [rad].
_SAME = 1e-3


def recorded_curves(sheet: CanonicalSheet) -> list[PoseCurve]:
    """The demonstrations with their own starts and goals, trembling as they were recorded."""
    ends = zip(sheet.start_offsets, sheet.goal_offsets, strict=True)
    return [_carried(sheet, i, *offsets) for i, offsets in enumerate(ends)]


def shown_curves(sheet: CanonicalSheet) -> list[PoseCurve]:
    """The same as they are played."""
    return [_smooth(curve) for curve in recorded_curves(sheet)]


def moved_curves(sheet: CanonicalSheet, start: Pose, goal: Pose) -> list[PoseCurve]:
    """The demonstrations moved so that all begin at a start and end at a goal."""
    ends = []
    for at, (position, quaternion) in ((0, start), (-1, goal)):
        # All canonical curves begin, and end, in one pose.
        turn = rotation_vector_between(sheet.quaternions[0, at], quaternion)
        ends.append(np.concatenate([position - sheet.positions[0, at], turn]))
    return [_smooth(_carried(sheet, i, *ends)) for i in range(len(sheet.positions))]


def _carried(sheet: CanonicalSheet, i: int, start_offset: np.ndarray, goal_offset: np.ndarray) -> PoseCurve:
    share = np.linspace(0.0, 1.0, sheet.positions.shape[1])[:, None]
    displacements = (1.0 - share) * start_offset + share * goal_offset
    positions, quaternions = carried(sheet.positions[i], sheet.quaternions[i], displacements)
    return PoseCurve(positions, continuous_signs(quaternions))


def _smooth(curve: PoseCurve) -> PoseCurve:
    return PoseCurve(*smooth_poses(curve.positions, curve.quaternions, _SMOOTHED))


def followed(robot: Robot, curve: PoseCurve, begin: np.ndarray, end: np.ndarray | None = None) -> np.ndarray:
    """Configurations (n, eta) [rad] of an arm whose tool follows a curve of n poses.

    Parameters
    ----------
    begin : (eta,) [rad] near where the arm begins. end : where it must come to, if that is known.

    Raises
    ------
    ParameterError : a pose cannot be held near the one before, or the arm comes to another configuration.
    """
    configurations, present = [], begin
    for position, quaternion in zip(curve.positions, curve.quaternions, strict=True):
        present = _nearest_to_ready(robot, position, quaternion, present)
        configurations.append(present)
    if end is not None and np.max(np.abs(present - end)) > _SAME:
        raise ParameterError("moved to this start and goal a demonstration ends in another posture of the arm")
    return np.array(configurations)


def _nearest_to_ready(robot: Robot, position: np.ndarray, quaternion: np.ndarray, begin: np.ndarray) -> np.ndarray:
    present = begin
    for _ in range(_STEPS):
        # In one step all of the pose's error and all that the pose leaves of the difference from the ready posture.
        step = differential_step(robot, present, position, quaternion, 1.0, gain=1.0, posture_gain=1.0)
        present = present + step
        if np.max(np.abs(step)) < _SETTLED:
            break
    if np.max(np.abs(pose_error(*robot.forward(present), position, quaternion))) > _POSE:
        raise ParameterError(f"the arm does not hold its tool at {np.round(position, 3).tolist()} m as it was shown")
    return present
