"""The arm that the topic `robot_description` describes: whether it is the one that the skill was learned on."""

from __future__ import annotations

import math

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.same_arm import SAME, difference
from geodesic_motion_ros.robot.urdf import parse_urdf
from geodesic_motion_ros.utils.errors import RobotError

#: Differences from this on [m] are worth a remark: more than a URDF's digits.
_REMARKED = 0.001


class DescribedArm:
    """The newest description, compared with the arm of a skill.

    Attributes
    ----------
    fault : why it is another arm; "" while it is not. remark : what a person should know otherwise; "" for nothing.
    """

    def __init__(self, robot: Robot, skill_robot: str, topic: str) -> None:
        """robot : its names are those of the topic, a full name; skill_robot : what the arm is called."""
        self._robot, self._called, self._topic = robot, skill_robot, topic
        self.fault = self.remark = ""

    def receive(self, urdf: str) -> None:
        """Compare a URDF that was published."""
        self.fault = self.remark = ""
        try:
            found = difference(self._robot, parse_urdf(urdf, self._topic))
        except RobotError as error:
            self.remark = self._unknown(str(error))
            return
        if found is None:
            self.remark = self._unknown(f"it has no {self._robot.base_link}, or no other link of {self._called!r}")
            return
        other = f"{self._topic} is of another arm than the skill's, {self._called!r}"
        if math.isinf(found.largest):
            expected = ", ".join(self._robot.joint_names)
            self.fault = f"{other}: its joints up to {found.link} are {', '.join(found.joints)}; expected {expected}"
            return
        apart = f"its {found.link} comes up to {1e3 * found.largest:.1f} mm from where that of {self._called!r} does"
        if not found.is_same:
            self.fault = f"{other}: {apart} (allowed: {1e3 * SAME:.0f} mm)"
        elif found.largest > _REMARKED:
            self.remark = f"{self._topic}: {apart}: where that matters add it to obstacle_position_error"

    def _unknown(self, why: str) -> str:
        return f"{self._topic}: {why}: whether it is of the skill's arm is not known"
