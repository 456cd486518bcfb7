"""Offering: what a bench asks a filter for, the motions of a skill to its goal, which know of no obstacle."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_studies.faults.asking import Asking, Wait
from geodesic_motion_studies.faults.fault import NotSeenError
from geodesic_motion_studies.faults.record import Record
from geodesic_motion_studies.faults.relay import Relay

#: A thread waits so long [s] for another one to let go of the interpreter.
_SWITCH_INTERVAL = 1e-4
#: Where a filter that has the name of the planner hears what is offered.
TOPIC = "planner/joint_trajectory"
#: A filter is as fast as the planner by its defaults: commands are judged by the same limits.
AS_PLANNED = {name: getattr(PlannerSettings(), name) for name in ("speed_scale", "acceleration_scale")}


class Offering(Asking):
    """Talks to filter and twin: where a planner is asked for a goal, a motion there is offered.

    Attributes
    ----------
    newest : the motion that was offered last to lead to the goal; None: none was.
    """

    def __init__(self, node: Node, skill: Skill, obstacles: Relay, wait: Wait, seen: Record) -> None:
        """seen : knows where the arm is, from where motions begin."""
        super().__init__(node, skill, obstacles, wait)
        # What is passed on while a motion is planned would wait 5 ms each time for the interpreter.
        sys.setswitchinterval(_SWITCH_INTERVAL)
        self._seen, self._planner = seen, ReactivePlanner(skill, scene=DeclaredScene.empty())
        self.newest: JointReference | None = None
        self._thread = ThreadPoolExecutor(1)
        mean = skill.mean_configuration("goal")
        self._goal = self._planner.arm.queries.goal_by_configuration(mean, TaskFrame.identity())
        self._offers = node.create_publisher(JointTrajectory, TOPIC, QoSProfile(depth=10))

    @property
    def is_heard(self) -> bool:
        """Whether a filter listens to trajectories."""
        return bool(self._offers.get_subscription_count())

    def send_goal(self, pose: np.ndarray | None = None, frame: str | None = None) -> None:
        """Offer the motion to the mean of the shown goals from where the arm is, at once; to no other goal."""
        self.newest = self.motion()
        self.offer(self.newest)

    def offer(self, motion: JointReference, stamp: float = 0.0) -> None:
        """Offer a motion that begins at a time [s] of the ROS clock; 0: at once."""
        knots = motion.times, motion.positions, motion.velocities, motion.accelerations
        names = self._planner.robot.joint_names
        self._offers.publish(joint_trajectory_bytes(names, *knots, round(1e9 * stamp)))

    def motion(self) -> JointReference:
        """The motion from where the arm is to that goal, as planned where nothing stands."""
        # Messages are passed on meanwhile.
        planned = self._thread.submit(self._planner.plan_configurations, self._seen.configuration, self._goal)
        self._wait(planned.done, "a motion to offer")
        plan = planned.result()
        if plan.reference is None:
            raise NotSeenError(f"no motion to offer: {plan.verdict.sentence}")
        return plan.reference

    def plan(self, start: np.ndarray | None = None) -> list[Any]:
        """The poses of the tool on the motion that would be offered, as messages."""
        robot = self._planner.robot
        poses = [np.concatenate(robot.forward(position)) for position in self.motion().positions]
        return [self.goal_message(pose).pose for pose in poses]
