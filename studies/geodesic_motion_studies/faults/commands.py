"""Commands: hears every command of the planner, and judges them all."""

from __future__ import annotations

import math
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.contract.settings import TOOL_LIMITS
from geodesic_motion_ros.nodes.messages import MessageRefused, read_joint_trajectory, read_pose, seconds
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.faults.bench_clock import BenchClock
from geodesic_motion_studies.faults.command_ear import Command, CommandEar
from geodesic_motion_studies.faults.fault import STATE_TIMEOUT, Findings
from geodesic_motion_studies.faults.judge import LARGEST_STEP, Target, TargetJudge, Trajectory, TrajectoryJudge
from geodesic_motion_studies.faults.record import Record

#: A status that explains a command is heard this long [s] after it at most.
_EXPLAINED_AFTER = 0.1
_DEFAULTS = {parameter.name: parameter.default for parameter in PLANNER}
_SCALES = _DEFAULTS["speed_scale"], _DEFAULTS["acceleration_scale"]
#: No tool is accelerated by more [m/s^2]: a path entered in motion exceeds the planner's limit by a tenth.
_MOST_ACCELERATION = 2.0 * TOOL_LIMITS.acceleration
#: The messages of what commands the arm, by topic, which is what the planner's parameter `output` names.
KINDS = {"joint_trajectory": JointTrajectory, "target_pose": PoseStamped}
#: So many sentences on what is wrong are enough.
_MOST_SENTENCES = 3


class Commands:
    """What the planner commands the arm.

    Attributes
    ----------
    topic, kind : of the messages. limits : that the joints keep, those of the robot where poses are commanded.
    """

    def __init__(
        self, context: rclpy.Context, skill: Skill, robot: Robot, topic: str, clock: BenchClock, record: Record
    ) -> None:
        """topic : joint_trajectory or target_pose. clock : that stamps are of. record : of what the nodes have said
        meanwhile.
        """
        self._skill, self._robot, self._clock, self._record = skill, robot, clock, record
        self.topic, self.kind = topic, KINDS[topic]
        self.limits = JointLimits.of(robot, *(_SCALES if self.kind is JointTrajectory else ()))
        self._ear = CommandEar(context, self.kind, self.topic)
        self.begin()

    def close(self) -> None:
        """Hear nothing more."""
        self._ear.close()

    def begin(self) -> None:
        """Another run begins: what was heard so far is forgotten."""
        # By a simulated clock poses move on as it arrives, unevenly; a skill of configurations limits no tool.
        free = self._clock.simulated or self._skill.space == "joint"
        self._most_acceleration = math.inf if free else _MOST_ACCELERATION
        self._judge: TrajectoryJudge | TargetJudge
        if self.kind is JointTrajectory:
            self._judge = TrajectoryJudge(self.limits)
        else:
            self._judge = TargetJudge(self._most_acceleration, 1.0 / _DEFAULTS["rate"])
        self._anew: list[float] = []
        self._began = time.monotonic()
        self._ear.take()

    def begin_anew(self) -> None:
        """The next command is the first of a planner that has just begun."""
        self._anew.append(time.monotonic())

    def judge(self, findings: Findings) -> None:
        """Judge every command of the run so far; what is judged is forgotten."""
        lost = np.array([status.sent for status in self._record.statuses if status.lost])
        wrong: list[str] = []
        before = -math.inf
        for command in self._ear.take():
            anew = before == -math.inf or any(before < moment <= command.sent for moment in self._anew)
            explained = (before - _EXPLAINED_AFTER < lost) & (lost < command.sent + _EXPLAINED_AFTER)
            for sentence in self._judged(command, anew or bool(np.any(explained))):
                wrong.append(f"command {self._judge.count} at {command.sent - self._began:.2f} s {sentence}")
            before = command.sent
        for sentence in wrong[:_MOST_SENTENCES]:
            findings.require(False, sentence)
        findings.require(len(wrong) <= _MOST_SENTENCES, f"and {len(wrong) - _MOST_SENTENCES} more")
        findings.note(f"{self._judge.count} commands")
        findings.figure("largest step", self._judge.largest_step, LARGEST_STEP, "rad")
        if isinstance(self._judge, TargetJudge) and math.isfinite(self._most_acceleration):
            findings.figure("largest acceleration", self._judge.largest_acceleration, self._most_acceleration, "m/s^2")

    def _judged(self, command: Command, anew: bool) -> list[str]:
        message = deserialize_message(command.message, self.kind)
        stamp = seconds(message.header.stamp)
        sent = self._clock.at(command.sent, stamp)
        places = self._places(command.sent) if anew else None
        try:
            if isinstance(self._judge, TrajectoryJudge):
                waypoints = read_joint_trajectory(message, self._robot)
                return self._judge.hear(Trajectory(sent, stamp, waypoints), places)
            pose = read_pose(message, self._skill.base_frame)
        except MessageRefused as error:
            return [str(error)]
        poses = None if places is None else [self._robot.forward(place) for place in places]
        return self._judge.hear(Target(sent, stamp, *pose), poses)

    def _places(self, moment: float) -> np.ndarray | None:
        """Configurations (k, eta) [rad] one of which the planner took for that of the arm; None where none is known."""
        before = [state for state in self._record.states if state.arrived <= moment]
        recent = [state.configuration for state in before if state.arrived > moment - STATE_TIMEOUT]
        return np.array(recent or [state.configuration for state in before[-1:]]) if before else None
