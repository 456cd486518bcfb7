"""What an arm lets pass that judges every command by those before it.

A Franka Research 3 is sent a position every millisecond. It differences what it is sent three times, and stops where
that breaks a limit of velocity, acceleration or jerk. So a trajectory is looked at before it is played: as a whole, and
where it takes over from what was sent.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geodesic_motion_ros.robot.kinematics import contiguous
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_ros.utils.errors import RobotError

#: From one command to the next [s].
PERIOD = 1e-3
#: Commands before and after a takeover that a third difference sees: three each.
SEEN = 3
_NAMES, _UNITS = ("velocity", "acceleration", "jerk"), ("rad/s", "rad/s^2", "rad/s^3")
#: Rounding of what is exactly at a limit.
_ROUNDING = 1e-6


def check_motion(waypoints: JointWaypoints, limits: JointLimits, names: Sequence[str]) -> None:
    """Refuse a trajectory that leaves the limits of the arm anywhere, between its waypoints too.

    names : of the joints.

    Raises
    ------
    RobotError : waypoints have no accelerations, a limit is not kept, or the end is no rest; with the figure.
    """
    if waypoints.velocities is None or waypoints.accelerations is None:
        raise RobotError(
            "the trajectory has no velocities and accelerations at its points: without them they step from one point "
            "to the next, and the arm stops itself"
        )
    last = np.abs(waypoints.accelerations[-1])
    joint = int(np.argmax(last / (limits.jerk * PERIOD)))
    if last[joint] > limits.jerk[joint] * PERIOD:
        raise RobotError(
            f"the trajectory ends with an acceleration of {last[joint]:.3g} rad/s^2 of {names[joint]}, which cannot "
            f"end in a millisecond: at most {limits.jerk[joint] * PERIOD:.3g}"
        )
    if len(waypoints.times) < 2:
        return
    # Of one layout, that of `load_kernels`: kernels are compiled anew for another one, and the arm waits.
    rows = (waypoints.times, waypoints.positions, waypoints.velocities, waypoints.accelerations)
    motion = JointReference(*map(contiguous, rows), np.empty((len(waypoints.times), 0)))
    inside, shares = motion.measured(limits)
    if not inside:
        low, high = waypoints.positions.min(axis=0), waypoints.positions.max(axis=0)
        joint = int(np.argmax(np.maximum(limits.lower - low, high - limits.upper)))
        raise RobotError(
            f"the trajectory leaves the range of {names[joint]}: it goes from {low[joint]:.3f} to {high[joint]:.3f} "
            f"rad, allowed is {limits.lower[joint]:.3f} to {limits.upper[joint]:.3f}"
        )
    worst = np.max(shares, axis=1)
    order = int(np.argmax(worst))
    if worst[order] > 1.0 + _ROUNDING:
        begin = motion.times[int(np.argmax(shares[order]))]
        raise RobotError(
            f"the trajectory has {worst[order]:.2f} times the {_NAMES[order]} that the arm allows, {begin:.2f} s after "
            "its begin: lower speed_scale or acceleration_scale of what sends it"
        )


def check_takeover(sent: np.ndarray, coming: np.ndarray, limits: JointLimits, names: Sequence[str]) -> None:
    """Refuse commands that do not continue those before.

    sent, coming : (3, eta) [rad], a millisecond apart: the last that were sent, and the first that would be.

    Raises
    ------
    RobotError : differenced as the arm does they break a limit; names the joint, the figure and the limit.
    """
    rows = np.concatenate([sent, coming])
    worst = (1.0 + _ROUNDING, 0, 0, 0.0, 0.0)
    differences = rows
    for order in range(3):
        differences = np.diff(differences, axis=0) / PERIOD
        # Those that reach from what was sent into what comes, and beyond.
        crossing = differences[SEEN - 1 - order :]
        allowed = _allowed(order, crossing, rows[SEEN:], limits)
        shares = np.abs(crossing) / allowed
        row, joint = np.unravel_index(int(np.argmax(shares)), shares.shape)
        if shares[row, joint] > worst[0]:
            figure = float(abs(crossing[row, joint]))
            worst = (float(shares[row, joint]), order, int(joint), figure, float(allowed[row, joint]))
    share, order, joint, figure, most = worst
    if share > 1.0 + _ROUNDING:
        raise RobotError(
            f"the trajectory does not continue what is commanded: within a millisecond {names[joint]} would have a "
            f"{_NAMES[order]} of {figure:.3g} {_UNITS[order]}, at most {most:.3g} is allowed"
        )


def _allowed(order: int, crossing: np.ndarray, positions: np.ndarray, limits: JointLimits) -> np.ndarray:
    """What is allowed of differences (k, eta): of velocities towards where they lead, at positions (3, eta)."""
    if order:
        return np.broadcast_to(limits.acceleration if order == 1 else limits.jerk, crossing.shape)
    downwards, upwards = limits.largest_speeds(positions)
    # Beyond where no speed is allowed none is: a share of nothing is infinite, but for an arm that stands.
    return np.maximum(np.where(crossing < 0.0, downwards, upwards), 1e-9)
