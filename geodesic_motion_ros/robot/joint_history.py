"""JointHistory: where the arm was measured lately, for data of other sensors that have a time of their own."""

from __future__ import annotations

import threading
from collections import deque
from itertools import pairwise

import numpy as np

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError

#: States are kept for so long [s]: no cloud that is later is of use to an arm that moves.
_SPAN = 5.0
#: Times that differ by less [s] are the same: what is left of nanoseconds in sums of seconds.
_SAME = 1e-6


class JointHistory:
    """The joint positions of the last seconds; any thread may add to them and ask."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._lock = threading.Lock()
        # Times [s], increasing, and positions (n,) [rad].
        self._states: deque[tuple[float, np.ndarray]] = deque()

    def add(self, joints: np.ndarray, time: float) -> None:
        """Append positions (n,) [rad] of a time [s] after those before."""
        with self._lock:
            self._states.append((time, joints))
            while self._states[0][0] < time - _SPAN:
                self._states.popleft()

    def reaches(self, time: float) -> bool:
        """Whether there is a state of a time [s] or of later."""
        with self._lock:
            return bool(self._states) and self._states[-1][0] >= time - _SAME

    def at(self, time: float, apart: float) -> np.ndarray:
        """Interpolate the positions (n,) [rad] at a time [s] between the two states around it.

        apart : two states that are farther apart [s] do not say where the arm was between them.

        Raises
        ------
        RobotError : there are no two such states; says what there is.
        """
        with self._lock:
            states = list(self._states)
        if not states:
            raise RobotError("there is no joint state yet")
        first, last = states[0][0], states[-1][0]
        if time < first - _SAME:
            raise RobotError(f"the oldest joint state that is known is {1e3 * (first - time):.0f} ms newer")
        if time > last + _SAME:
            raise RobotError(f"the newest joint state is {1e3 * (time - last):.0f} ms older")
        time = min(max(time, first), last)
        if time == last:
            return states[-1][1]
        # The time is a recent one: it is found sooner from the end.
        before, after = next(pair[::-1] for pair in pairwise(reversed(states)) if pair[1][0] <= time)
        length = after[0] - before[0]
        if length > apart:
            raise RobotError(
                f"the joint states around it are {1e3 * length:.0f} ms apart, of {1e3 * apart:g} ms at most"
            )
        start = self._robot.nearest_turn(before[1], after[1])
        return start + (time - before[0]) / length * (after[1] - start)
