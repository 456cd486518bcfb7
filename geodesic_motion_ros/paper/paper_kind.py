"""The planner node with the paper's planner, for `method: paper`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from geodesic_motion_ros.nodes.parameters import Value
from geodesic_motion_ros.nodes.planner_outputs import PlannerOutputs
from geodesic_motion_ros.nodes.skill_kinds import SkillKind, planner_settings
from geodesic_motion_ros.nodes.stream_cycle import CycleOutput, Pose
from geodesic_motion_ros.paper.paper_cycle import PaperCycle, PaperJointCycle, PaperPoseCycle
from geodesic_motion_ros.paper.paper_planner import CAUTION, PaperPlanner, PaperSettings
from geodesic_motion_ros.planning.settings import CHANGEABLE, TOOL_LIMITS
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization.latent_view import LatentPicture, LatentView


class PaperKind(SkillKind):
    """The paper's planner, for skills of either space."""

    may_be_early = False
    guarded = "nothing"

    def __init__(self, skill: Skill, values: Mapping[str, Value]) -> None:
        super().__init__()
        strength = values["ambient_strength"] if values["avoidance"] else 0.0
        tool = planner_settings(values).tool_limits(TOOL_LIMITS)
        settings = PaperSettings(strength, tool.speed, tool.angular_speed, values["speed_scale"])
        self.planner = PaperPlanner(skill, settings)
        self.robot = self.planner.robot
        common = self.planner, values["state_timeout"], values["resume_timeout"]
        offsets = values["maximum_offset"], values["maximum_offset_angle"]
        self._of_joints = skill.space == "joint"
        self.fixed = {name: values[name] for name in CHANGEABLE}
        self.cycle: PaperCycle
        if self._of_joints:
            self.command_topic, self.subject = "joint_trajectory", "the whole arm, by the paper's planner"
            self.cycle = PaperJointCycle(
                *common, latency=values["latency"], tracking_tolerance=values["tracking_tolerance_joint"],
                offsets=offsets, background=self._goals,
            )  # fmt: skip
        else:
            self.command_topic, self.subject = "target_pose", "the tool, by the paper's planner"
            tolerances = {name: values[name] for name in ("tracking_tolerance", "tracking_tolerance_angle")}
            self.cycle = PaperPoseCycle(*common, **tolerances, offsets=offsets, background=self._goals)

    def place(self, joints: np.ndarray) -> Any:
        return joints if self._of_joints else self.robot.forward(joints)

    def send(self, outputs: PlannerOutputs, output: CycleOutput) -> None:
        if output.trajectory is not None:
            outputs.trajectory(*output.trajectory)
        if output.commanded is not None:
            outputs.target(*output.commanded)

    def tool_poses(self, reference: Any) -> Pose:
        return self.planner.tool_poses(reference)

    def body(self, output: CycleOutput) -> np.ndarray:
        return np.zeros((0, 4))  # the paper's metric sees points

    def held(self) -> tuple[HeldObject, ...]:
        return self.planner.held

    def plan(self, start: Pose, goal: Pose) -> tuple[Pose | None, Verdict]:
        return self.tool_poses(self.planner.plan(start, goal)), Verdict(VerdictCode.OK, CAUTION)

    def view(self, skill: Skill, size: int) -> LatentPicture | None:
        if skill.decoder.latent_dimension != 2 or self._of_joints:
            return None
        return LatentView(skill, self.planner.graph, np.zeros((1, 3)), np.zeros(1), size)

    def update(self, values: Mapping[str, Value]) -> None:
        self.cycle.state_timeout = values["state_timeout"]
        self.cycle.resume_timeout = values["resume_timeout"]
        if isinstance(self.cycle, PaperPoseCycle):
            self.cycle.tracking_tolerance = values["tracking_tolerance"]
            self.cycle.tracking_tolerance_angle = values["tracking_tolerance_angle"]
        elif isinstance(self.cycle, PaperJointCycle):
            self.cycle.tracking_tolerance = values["tracking_tolerance_joint"]
