"""Joint states that no arm can have come to: one alone is a fault of the sensor, two that agree are the arm.

A single wrong state looks like an arm that was pushed far away, and what the planner commands would follow it. Where
states jump again and again two sources alternate, as a driver and a joint_state_publisher, and neither is believed.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from geodesic_motion_ros.nodes.messages import MessageRefused
from geodesic_motion_ros.robot.kinematics import Robot

#: What a state may differ from the one before besides what the joints' speeds allow [rad].
NOISE = 0.1
#: After a longer silence [s] the arm may be anywhere.
FORGOTTEN = 0.5
#: A state that was overtaken is older than the newest one by less [s]; another one has a wrong stamp.
OVERTAKEN = 0.1
#: So many jumps within so long [s] are two sources that alternate.
_JUMPS, _WITHIN = 3, 2.0


class PlausibleJoints:
    """A check that refuses joint states that the arm cannot have reached since the one before, or that are older than
    that, and all while two sources alternate.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._known: tuple[np.ndarray, float] | None = None
        self._doubted: tuple[np.ndarray, float] | None = None
        # Times of the newest jumps [s].
        self._jumps: deque[float] = deque(maxlen=_JUMPS)

    def check(self, joints: np.ndarray, taken: float) -> None:
        """Take a state (eta,) [rad] of a time [s].

        Raises
        ------
        MessageRefused : the state is of long before the newest one that was taken, or the joints cannot have come there
            since, nor from one that was refused just before; or two sources alternate.
        """
        self._check_alone(joints, taken)
        if len(self._jumps) == _JUMPS and taken - self._jumps[0] < _WITHIN:
            raise MessageRefused(
                "the states are of two places in turn: do two nodes publish them, as a driver and a "
                "joint_state_publisher? Leave one"
            )

    def _check_alone(self, joints: np.ndarray, taken: float) -> None:
        if self._known is not None and taken < self._known[1] - OVERTAKEN:
            # Not to be compared with the next one either: after so long the arm may be anywhere.
            raise MessageRefused(f"its stamp is {self._known[1] - taken:.3g} s older than that of the newest state")
        doubted, self._doubted = self._doubted, None
        jump = None if self._known is None else self._jump(self._known, joints, taken)
        if jump is not None and (doubted is None or self._jump(doubted, joints, taken) is not None):
            self._doubted = joints, taken
            self._jumps.append(taken)
            raise MessageRefused(f"{jump}, faster than it can move: the next state is believed if it agrees")
        self._known = joints, taken

    def _jump(self, before: tuple[np.ndarray, float], joints: np.ndarray, taken: float) -> str | None:
        """The joint that cannot have come to a state from one before, and how far it is; None where all can."""
        if taken - before[1] > FORGOTTEN:
            return None
        moved = np.abs(self._robot.nearest_turn(joints, before[0]) - before[0])
        excess = moved - NOISE - abs(taken - before[1]) * self._robot.velocity_limits
        worst = int(np.argmax(excess))
        if excess[worst] <= 0.0:
            return None
        return f"joint '{self._robot.joint_names[worst]}' has jumped by {moved[worst]:.2f} rad"
