"""MotionJudge: an arm with its limits and what it must keep clear of, and the certified motions along given curves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from geodesic_motion_ros.certification.certificate import ArmCertifier
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.certification.seen_volume import SeenVolume
from geodesic_motion_ros.contract.requirement import Requirements
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.motion.path_timer import JointCurve, meet_ends
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.query import PathEnds
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.trajectory.tool_limits import ToolLimits
from geodesic_motion_ros.trajectory.trajectory import JointReference


class MotionJudge(ABC):
    """A judge of the motions of one arm; any thread may call it, as no call changes it."""

    def __init__(
        self,
        robot: Robot,
        collision: CollisionModel,
        settings: PlannerSettings,
        limits: JointLimits,
        tool_limits: ToolLimits,
        scene: DeclaredScene | None,
    ) -> None:
        """tool_limits : of the tool, where the settings name none. scene : None: nothing."""
        self.robot, self.collision, self.settings, self.limits = robot, collision, settings, limits
        self.scene = scene or DeclaredScene.empty()
        self.tool = LimitedTool(robot, settings.tool_limits(tool_limits))
        self.requirements = Requirements.of(settings)
        self.certifier = ArmCertifier(robot, collision, self.scene)

    @abstractmethod
    def time_along(self, state: MotionState, curve: JointCurve) -> JointReference | Refusal:
        """Return the motion along a curve that begins where the arm is; or why there is none."""

    def plan_along(
        self,
        query: PathEnds,
        state: MotionState,
        curve: np.ndarray,
        latent: np.ndarray,
        obstacles: Obstacles,
        seen: SeenVolume,
    ) -> Plan:
        """Return the certified motion along configurations (m, eta) from where the arm is to a query's goal; or why it
        is not certified.

        latent : (m, d) latent points beside the configurations. seen : the motion stays inside of this volume.
        """
        met = meet_ends(curve, latent, state.position, query.goal)
        reference = self.time_along(state, met)
        if isinstance(reference, Refusal):
            return Plan(None, state.time, replace(reference, figures=query.misfits))
        swept = self.certifier.sweep(reference)
        certificate, objection = self.certifier.assess(swept, obstacles, self.requirements.detour)
        objection = objection or self.certifier.seen_objection(swept, seen)
        clearance = float(np.min(certificate.clearance))
        figures = replace(query.misfits, clearance=clearance, end_correction=met.correction)
        if objection:
            refusal = Refusal(VerdictCode.NO_FEASIBLE_PATH, f"on the detour {objection}", figures)
            return Plan(None, state.time, refusal)
        return Plan(self.certifier.judge(reference, certificate), state.time, Verdict(figures=figures))

    def seen_volume_beside(self, base: np.ndarray) -> SeenVolume:
        """Return the volume in which an arm may be that leaves configurations (k, eta) of a base path (setting
        `unseen`).
        """
        if self.settings.unseen == "free":
            return SeenVolume.unbounded()
        return SeenVolume.of_base_path(base, self.scene.seen, self.robot, self.collision)


def changed_limits(judge: MotionJudge, settings: PlannerSettings) -> JointLimits:
    """Return the limits of a judge's joints with the scales of other settings: the same object where these are alike.
    """
    scales = ("joint_speed_scale", "acceleration_scale")
    if all(getattr(settings, name) == getattr(judge.settings, name) for name in scales):
        return judge.limits
    return JointLimits.of(judge.robot, settings.joint_speed_scale, settings.acceleration_scale)
