"""What an arm is commanded, a position every millisecond: trajectories, one after the other, without a step between.

Nothing is faded: one that does not continue what is commanded is refused, and the arm goes on, by what it had, to the
rest at its end. So does an arm that hears nothing more.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from geodesic_motion_ros.hardware.judged_commands import PERIOD, SEEN, check_motion, check_takeover
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints, TrajectoryPlayer
from geodesic_motion_ros.utils.errors import RobotError

#: A trajectory that lies more [s] in the future than this waits for no takeover that anybody meant.
LONGEST_WAIT = 1.0
#: Why a motion is refused that the arm was not there for: one text for all of its trajectories, which is logged once.
_UNDERWAY = (
    "the motion began before the arm was armed, and the arm is not where it has come to: it stands until a trajectory "
    "begins where it is"
)


class CommandStream:
    """Commands of an arm that begins at rest; times are of one clock [s].

    Other than joint_trajectory_controller it plays a trajectory that begins in the future from then on alone: until
    then the one before goes on, from which it was planned.

    Parameters
    ----------
    positions : (eta,) [rad] that are commanded. limits : that each command keeps. names : of the joints.
    """

    def __init__(self, positions: np.ndarray, limits: JointLimits, names: Sequence[str]) -> None:
        self._limits, self._names = limits, tuple(names)
        self._player = TrajectoryPlayer(positions, np.zeros(len(positions)))
        self._sent = deque([positions.copy() for _ in range(SEEN)], maxlen=SEEN)
        self._newest = -math.inf
        # The time of the first command, until a trajectory is played; -inf then.
        self._began = math.inf
        # In the order in which they begin, with that time.
        self._waiting: list[tuple[float, JointWaypoints, float]] = []

    def receive(self, waypoints: JointWaypoints, begin: float | None, now: float) -> None:
        """Take a trajectory that begins at a time, or one that begins now (None); it replaces those that would begin
        later.

        Raises
        ------
        RobotError : it has ended, or begins too far in the future.
        """
        begin = now if begin is None else begin
        due = begin + float(waypoints.times[0])
        if (late := now - begin - float(waypoints.times[-1])) > 0.0:
            raise RobotError(f"the trajectory ends in the past, {late:.3f} s ago")
        if due - now > LONGEST_WAIT:
            raise RobotError(f"the trajectory begins in {due - now:.1f} s: at most {LONGEST_WAIT:g} s ahead is planned")
        self._waiting = [other for other in self._waiting if other[0] < due]
        self._waiting.append((due, waypoints, begin))

    def command(self, now: float) -> tuple[np.ndarray, str]:
        """Positions, velocities and accelerations (3, eta) to command now, and why a trajectory whose time has come is
        not played; "" where none is refused. To be called once a millisecond: what it returns counts as sent. Of
        milliseconds that were missed what should have been sent does: an arm goes on by itself, nearly so.
        """
        refused = ""
        self._began = min(self._began, now)
        missed = round((now - self._newest) / PERIOD) - 1 if math.isfinite(self._newest) else 0
        for step in range(min(missed, SEEN), 0, -1):
            self._sent.append(self._player.sample(now - PERIOD * step)[0])
        self._newest = now
        due = None
        while self._waiting and self._waiting[0][0] <= now:
            due = self._waiting.pop(0)
        if due is not None:
            try:
                self._player = self._continued(due[1], due[2], now)
                self._began = -math.inf
            except RobotError as error:
                late = f"{error}; it came into effect {1000.0 * (now - due[0]):.0f} ms after its begin"
                refused = _UNDERWAY if due[0] < self._began else late
        state = self._player.sample(now)
        self._sent.append(state[0])
        return state, refused

    def _continued(self, waypoints: JointWaypoints, begin: float, now: float) -> TrajectoryPlayer:
        player = copy.copy(self._player)
        player.replace(waypoints, begin, now)
        coming = np.stack([player.sample(now + PERIOD * step)[0] for step in range(SEEN)])
        check_takeover(np.stack(self._sent), coming, self._limits, self._names)
        return player


def load_kernels(limits: JointLimits) -> None:
    """Load all that is compiled of the judging and playing of a trajectory, so that the first one does not wait."""
    middle = 0.5 * (limits.lower + limits.upper)
    still = np.zeros((2, len(middle)))
    waypoints = JointWaypoints(np.array([0.0, 1.0]), np.tile(middle, (2, 1)), still, still)
    check_motion(waypoints, limits, ())
    stream = CommandStream(middle, limits, ())
    stream.receive(waypoints, 0.0, 0.0)
    stream.command(0.0)
