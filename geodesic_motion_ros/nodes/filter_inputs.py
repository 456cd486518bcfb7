"""The trajectories and the targets that a filter hears, beside what every node that plans does."""

from __future__ import annotations

import numpy as np
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.filtering.offer import OfferRequest
from geodesic_motion_ros.nodes.joint_bytes import parse_joint_trajectory
from geodesic_motion_ros.nodes.messages import (
    MessageRefused,
    read_joint_positions,
    read_trajectory_points,
    seconds,
)
from geodesic_motion_ros.nodes.planner_inputs import PlannerInputs

#: The topics of what is offered.
TRAJECTORY, TARGET = "~/joint_trajectory", "~/joint_target"
#: Of chunks each is heard, even where several come at once: the newest counts.
_OFFERS = QoSProfile(depth=10)


class FilterInputs(PlannerInputs):
    """The subscriptions of a filter: what is offered takes the place of goals."""

    noun = MotionFilter.noun

    def _subscribe_goals(self) -> None:
        self.listener.subscribe(JointTrajectory, TRAJECTORY, self._on_trajectory, _OFFERS, raw=True)
        self.listener.subscribe(JointState, TARGET, self._on_target, _OFFERS)

    def _on_trajectory(self, wire: bytes) -> None:
        try:
            message = parse_joint_trajectory(wire)
            read = read_trajectory_points(message, self._robot, self._parameters["joint_prefix"])
        except MessageRefused as error:
            self._refuse(TRAJECTORY, error)
            raise
        stamp = seconds(message.header.stamp)
        moment = self.listener.time.read()
        begin = None if stamp == 0.0 else moment.now - moment.transit(stamp)
        self._take(OfferRequest(read.times, read.positions, read.velocities, begin))

    def _on_target(self, message: JointState) -> None:
        try:
            target = read_joint_positions(message, self._robot.joint_names)
        except MessageRefused as error:
            self._refuse(TARGET, error)
            raise
        self._take(OfferRequest(np.zeros(1), target[None]))

    def _take(self, request: OfferRequest) -> None:
        self._set_goal(request)
        # It is played from the next cycle on, which need not wait until it is due.
        self._changed()

    def _refuse(self, topic: str, error: MessageRefused) -> None:
        self._set_goal(Refusal(VerdictCode.BAD_INPUT, f"{topic}: {error}"))
