"""The moment at which the arm has come to rest at its goal, and how far from it. Knows nothing of ROS."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.nodes.arm_watch import REST_TIME
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput, PoseArrays
from geodesic_motion_ros.nodes.deviation import has_pose_moved


class ArrivalWatch:
    """A watch for the arm that comes to rest at a goal that was accepted: once for each.

    It rests at the end of its path once its tool has stayed near one place for REST_TIME.
    """

    def __init__(
        self,
        forward: Callable[[np.ndarray], PoseArrays],
        tool_poses: Callable[[Any], PoseArrays],
        end: str = "the goal",
    ) -> None:
        """forward : the tool pose of a configuration (eta,) [rad]; tool_poses : those along a reference. end : what a
        person calls the place where it rests then.
        """
        self._forward, self._tool_poses, self._end = forward, tool_poses, end
        self._goal_number, self._accepted = 0, 0.0
        self._arrived = True
        self._resting: tuple[PoseArrays, float] | None = None  # near which place, and since when [s]

    def observe(self, inputs: CycleInputs, output: CycleOutput) -> str:
        """Return the line for the log in the cycle in which the arm is found to rest at its goal; "" in all others.

        The time is from the acceptance of the goal to the beginning of the rest, the distance that of the measured tool
        from the end of the path.
        """
        if output.goal_verdict.ok and inputs.goal_number != self._goal_number:
            self._goal_number, self._accepted = inputs.goal_number, inputs.heard
            self._arrived, self._resting = False, None
        if self._arrived:
            return ""
        if not (output.verdict.ok and output.time_to_goal == 0.0 and output.speed == 0.0):
            self._resting = None
            return ""
        tool = self._forward(inputs.measured)
        if self._resting is None or has_pose_moved(tool, self._resting[0]):
            self._resting = tool, inputs.heard
        since = self._resting[1]
        if inputs.heard - since < REST_TIME:
            return ""
        self._arrived = True
        positions, quaternions = self._tool_poses(output.reference)
        off = 1e3 * float(np.linalg.norm(tool[0] - positions[-1]))
        turned = math.degrees(angle_between(tool[1], quaternions[-1]))
        return f"at {self._end} after {since - self._accepted:.1f} s, {off:.1f} mm and {turned:.1f} deg from it"
