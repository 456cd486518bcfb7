"""All configurations in which an arm of six or seven joints holds its tool in a pose.

Six joints leave a pose finitely many of them, seven leave a freedom: the position of the last joint is given then, and
finitely many are left again. Where a robot's folder names a module for it, `solutions` of that module answers, in
closed form. Otherwise they are found numerically: damped least squares (Sugihara, "Solvability-unconcerned inverse
kinematics by the Levenberg-Marquardt method", IEEE Transactions on Robotics 27, 2011),

    dq = J^T (J J^T + (|e|^2 / 2) I)^-1 e,    e = (error of the position; of the orientation),

from many starts, which a Halton sequence spreads evenly over the joints' ranges: the same pose has the same answer.
Joints turn without regard to their limits as they descend. What has converged is turned back by whole turns, to the
place within the limits that is nearest to `Robot.ready`; what has none is dropped, and so is what was found before.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

import numba
import numpy as np
from scipy.stats import qmc

from geodesic_motion_ros.robot.inverse_kinematics import checked_pose, damped_step, pose_difference
from geodesic_motion_ros.robot.kinematics import (
    CHAIN,
    MATRIX,
    VECTOR,
    Robot,
    link_frames,
    quaternion_of,
    write_jacobian,
)
from geodesic_motion_ros.utils.errors import RobotError

STARTS = 256
"""Descents for one answer, unless set otherwise."""
STEPS = 40
"""Of one descent; those that come to a solution take about ten."""
TOLERANCE = 1e-9
"""A solution holds the pose up to this [m, rad]."""
LARGEST_STEP = 0.8
"""No joint moves farther than this [rad, m] in one step."""
APART = 1e-4
"""Solutions differ in a joint by more than this [rad, m]."""

ROWS = numba.types.Array(numba.float64, 2, "C")
FLAGS = numba.types.Array(numba.boolean, 1, "C", readonly=True)


def solutions(
    robot: Robot, position: np.ndarray, quaternion: np.ndarray, last: float | None = None, starts: int = STARTS
) -> np.ndarray:
    """Configurations (n, eta) [rad] within the limits that hold the tool in a pose; n is 0 where none was found.

    Parameters
    ----------
    position, quaternion : (3,) [m] and (4,) unit, scalar first, base frame.
    last : where the last joint of an arm of seven is to be [rad]; None with six.
    starts : more of them find more of the solutions; a closed form finds all.

    Raises
    ------
    RobotError : the arm has neither six nor seven joints, `last` is missing, too much or outside its limits, the pose
        is none, or the module that the robot names for it cannot be imported.
    """
    position, quaternion = checked_pose(position, quaternion)
    _check_last(robot, last)
    if robot.inverse_kinematics is not None:
        return _plug_in(robot.inverse_kinematics).solutions(robot, position, quaternion, last)
    return numerical_solutions(robot, position, quaternion, last, spread(robot, starts))


def numerical_solutions(
    robot: Robot, position: np.ndarray, quaternion: np.ndarray, last: float | None, starts: np.ndarray
) -> np.ndarray:
    """What descents from starts (k, eta) [rad] find, as `solutions`, whatever the robot names for it."""
    free, begin = np.ones(len(robot.joint_names), dtype=bool), np.array(starts, dtype=float, order="C")
    if last is not None:
        free[-1], begin[:, -1] = False, last
    revolute = ~robot.chain[4][robot.chain[3] >= 0]
    found = np.empty_like(begin)
    count = _descend(
        begin, free, revolute, position, quaternion, robot.ready, robot.lower, robot.upper, robot.chain, found
    )
    return found[:count].copy()


def spread(robot: Robot, count: int) -> np.ndarray:
    """Configurations (count, eta) [rad] evenly over the joints' ranges, always the same."""
    bounded = np.isfinite(robot.lower)
    lower, upper = np.where(bounded, robot.lower, -np.pi), np.where(bounded, robot.upper, np.pi)
    return lower + qmc.Halton(len(lower), scramble=False).random(count + 1)[1:] * (upper - lower)


def _check_last(robot: Robot, last: float | None) -> None:
    count = len(robot.joint_names)
    if count not in (6, 7):
        raise RobotError(f"the arm to '{robot.tool_link}' has {count} joints: solutions are of arms with 6 or 7")
    if (last is None) != (count == 6):
        raise RobotError(
            f"the last joint of {count} is {'not given' if last is None else 'given'}: "
            f"{'say where it is' if count == 7 else 'six joints leave no freedom'}"
        )
    if last is not None and not robot.lower[-1] <= last <= robot.upper[-1]:
        raise RobotError(
            f"joint '{robot.joint_names[-1]}' is to be at {last:.4f} rad: "
            f"its limits are [{robot.lower[-1]:.4f}, {robot.upper[-1]:.4f}]"
        )


def _plug_in(name: str) -> ModuleType:
    try:
        return import_module(name)
    except ImportError as error:
        raise RobotError(
            f"inverse_kinematics is {name!r}, which cannot be imported ({error}): install it, or leave the key out"
        ) from error


@numba.njit(cache=True, nogil=True)
def _descent(q, moves, still, position, quaternion, chain):
    """Move q (eta,) to a configuration that holds the pose, by the joints that may move; whether it got there."""
    joints = len(q)
    matrix = np.empty((6, joints))
    for _ in range(STEPS):
        rotations, origins = link_frames(q, chain)
        error = pose_difference(origins[-1].copy(), quaternion_of(rotations[-1]), position, quaternion)
        squared, largest = 0.0, 0.0
        for i in range(6):
            squared += error[i] ** 2
            largest = max(largest, abs(error[i]))
        if largest <= TOLERANCE:
            return True
        matrix[:] = 0.0
        write_jacobian(rotations, origins, chain, matrix)
        step = damped_step(matrix, moves, error, still, 0.5 * squared)
        longest = 0.0
        for i in range(joints):
            longest = max(longest, abs(step[i]))
        shrink = min(1.0, LARGEST_STEP / longest) if longest > 0.0 else 0.0
        for i in range(joints):
            q[i] += shrink * step[i]
    return False


@numba.njit(cache=True, nogil=True)
def _within(q, free, revolute, ready, lower, upper):
    """Turn the joints of q (eta,) by whole turns to within their limits, near `ready`; whether that is possible."""
    turn = 2.0 * np.pi
    for i in range(len(q)):
        if free[i] and revolute[i]:
            q[i] -= turn * np.round((q[i] - ready[i]) / turn)
            if q[i] < lower[i]:
                q[i] += turn * np.ceil((lower[i] - q[i]) / turn)
            if q[i] > upper[i]:
                q[i] -= turn * np.ceil((q[i] - upper[i]) / turn)
        if not lower[i] <= q[i] <= upper[i]:
            return False
    return True


@numba.njit(
    numba.int64(MATRIX, FLAGS, FLAGS, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, CHAIN, ROWS), cache=True, nogil=True
)
def _descend(starts, free, revolute, position, quaternion, ready, lower, upper, chain, found):
    """Write the solutions to found (k, eta), and return how many there are."""
    joints = starts.shape[1]
    moves, still = np.empty(joints), np.zeros(joints)
    for i in range(joints):
        moves[i] = 1.0 if free[i] else 0.0
    count = 0
    for k in range(len(starts)):
        q = starts[k].copy()
        if not _descent(q, moves, still, position, quaternion, chain):
            continue
        if not _within(q, free, revolute, ready, lower, upper):
            continue
        known = False
        for other in range(count):
            distance = 0.0
            for i in range(joints):
                distance = max(distance, abs(found[other, i] - q[i]))
            known = known or distance <= APART
        if not known:
            for i in range(joints):
                found[count, i] = q[i]
            count += 1
    return count
