"""What the planner node does by this package's planner, and may leave to another one; all the rest is the same."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from types import MappingProxyType
from typing import Any

import numpy as np

from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.nodes.joint_cycle import JointCycle
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.parameters import Value
from geodesic_motion_ros.nodes.planner_outputs import PlannerOutputs
from geodesic_motion_ros.nodes.scene_parameter import declared_scene
from geodesic_motion_ros.nodes.stream_cycle import CycleOutput, Pose, StreamCycle
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.detour_worker import DetourWorker
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.settings import CHANGEABLE, PlannerSettings
from geodesic_motion_ros.planning.status import Verdict
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.collision_model import tool_spheres
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization.arm_view import ArmView
from geodesic_motion_ros.visualization.latent_view import LatentPicture, LatentView

_SETTINGS = (
    "avoidance", "avoid", "obstacle_margin", "obstacle_position_error", "ambient_strength", "ambient_width_ratio",
    "ambient_law", "cost_cap", "ridge_strength", "query_conditioning", "prediction", "maximum_offset",
    "maximum_offset_angle", "maximum_joint_offset", "speed_scale", "acceleration_scale", "latency", "body_radius",
    "refine", "detour", "unseen", "patience", "approach_covered_goal",
)  # fmt: skip
#: Methods besides "certified", each with the module and the class of its `SkillKind`. They are no part of the product,
#: which names them here alone, and loads them where the parameter requests them.
_METHODS = {"paper": ("geodesic_motion_ros.paper.paper_kind", "PaperKind")}
#: Negative: what belongs to the kind of skill.
_TOOL_LIMITS = ("speed", "angular_speed", "acceleration")


class SkillKind(ABC):
    """A planner and the cycle that calls it.

    Attributes
    ----------
    robot : that the skill is of. guarded : "arm", "tool" or "nothing" of it is certified to stay off obstacles.
    cycle : the stream of its commands. subject : what moves, for a person.
    command_topic, command_type : where commands go: "target_pose", or "joint_trajectory".
    may_be_early : whether a cycle need not wait for its time where obstacles have changed: what it sends says itself
        when it begins, and not that it is to be followed at once.
    fixed : the parameters that cannot change with this planner, though others' can, with their values.
    """

    robot: Robot
    cycle: StreamCycle
    guarded: str
    command_topic: str
    subject: str
    may_be_early: bool
    fixed: Mapping[str, Value] = MappingProxyType({})

    def __init__(self) -> None:
        self._goals = ThreadPoolExecutor(1, thread_name_prefix="goals")

    @abstractmethod
    def place(self, joints: np.ndarray) -> Any:
        """Where measured joint positions (eta,) put the arm, as the cycle wants it."""

    @abstractmethod
    def send(self, outputs: PlannerOutputs, output: CycleOutput) -> None:
        """Send a cycle's commands."""

    @abstractmethod
    def tool_poses(self, reference: Any) -> Pose:
        """Tool positions (n, 3) [m] and quaternions (n, 4) along a reference."""

    def margins(self) -> dict[str, float]:
        """What the certificate counts, for the status."""
        return {}

    @abstractmethod
    def body(self, output: CycleOutput) -> np.ndarray:
        """Spheres (K, 4) that obstacles are kept away from, where they are commanded to be: centre and radius [m]."""

    def held(self) -> tuple[HeldObject, ...]:
        """The objects in the hand that are counted."""
        return ()

    @abstractmethod
    def plan(self, start: Pose, goal: Pose) -> tuple[Pose | None, Verdict]:
        """Tool poses of a path between two poses under the present obstacles, and the verdict."""

    @abstractmethod
    def view(self, skill: Skill, size: int) -> LatentPicture | None:
        """What draws the latent space; None where it cannot be drawn."""

    @abstractmethod
    def update(self, values: Mapping[str, Value]) -> None:
        """Take parameters that may change while the node runs."""

    @property
    def scene(self) -> DeclaredScene:
        """What always stands around the arm, as far as it is declared."""
        return DeclaredScene.empty()

    @property
    def caution(self) -> str:
        """What a person should know as it starts; "" for nothing."""
        return ""

    def close(self) -> None:
        """End what it runs besides the node's threads."""
        self._goals.shutdown(wait=True, cancel_futures=True)


class CertifiedKind(SkillKind):
    """The certified planner as the node runs it (`method: certified`), for skills of both kinds.

    It commands configurations of the whole arm, as `joint_trajectory`, or as `target_pose` with `target_posture`.
    """

    def __init__(self, skill: Skill, values: Mapping[str, Value]) -> None:
        super().__init__()
        self._worker = DetourWorker()
        scene, self._scene_is_recorded = declared_scene(values["scene"], skill), values["scene"] == ""
        self.planner = ReactivePlanner(skill, planner_settings(values), detours=self._worker, scene=scene)
        self.robot = self.planner.robot
        self.command_topic = values["output"]
        self.may_be_early = self.command_topic == "joint_trajectory"
        self.guarded = self.planner.settings.avoid
        self.subject = "the whole arm" if self.guarded == "arm" else "the whole arm, of which the tool avoids obstacles"
        self.cycle: JointCycle = JointCycle(
            self.planner, values["state_timeout"], values["resume_timeout"], values["tracking_tolerance_joint"],
            values["horizon"], self.command_topic, background=self._goals, tool_tolerance=_tool_tolerance(values),
        )  # fmt: skip

    def place(self, joints: np.ndarray) -> np.ndarray:
        return joints

    def send(self, outputs: PlannerOutputs, output: CycleOutput) -> None:
        if self.command_topic == "joint_trajectory":
            if output.trajectory is not None:
                outputs.trajectory(*output.trajectory)
        elif output.configuration is not None:
            outputs.target(*self.robot.forward(output.configuration), output.configuration)

    def tool_poses(self, reference: Any) -> Pose:
        positions, quaternions = end_effector_poses(np.ascontiguousarray(reference.positions), self.robot.chain)
        return positions, continuous_signs(quaternions)

    def body(self, output: CycleOutput) -> np.ndarray:
        if output.configuration is None:
            return np.zeros((0, 4))
        model = self.planner.collision
        centres = model.positions(self.robot, output.configuration[None])[0]
        return np.concatenate([centres, model.radii[:, None]], axis=1)[model.moving]

    def held(self) -> tuple[HeldObject, ...]:
        return self.planner.held

    def margins(self) -> dict[str, float]:
        settings, tracking, obstacles = self.planner.settings, self.planner.tracking, self.planner.obstacles
        errors = np.concatenate([obstacles.velocity_errors, obstacles.solid_velocity_errors])
        return {
            "obstacle_margin": settings.obstacle_margin,
            "tracking_error": tracking.error,
            "tracking_lag": tracking.lag,
            "obstacle_position_error": settings.obstacle_position_error,
            "obstacle_velocity_error": float(np.max(errors, initial=0.0)),
        }

    def plan(self, start: Pose, goal: Pose) -> tuple[Pose | None, Verdict]:
        plan = self.planner.plan(*start, *goal)
        return None if plan.reference is None else self.tool_poses(plan.reference), plan.verdict

    def view(self, skill: Skill, size: int) -> LatentPicture | None:
        graph = self.planner.graph
        if isinstance(graph, PoseGraph) and skill.decoder.latent_dimension == 2:
            settings = self.planner.settings
            return LatentView(skill, graph, np.array(settings.tool_points), np.array(settings.tool_radii), size)
        if not isinstance(graph, PoseGraph) and skill.decoder.latent_dimension == 3:
            return ArmView(skill, graph, self.planner.collision, size)
        return None

    def update(self, values: Mapping[str, Value]) -> None:
        self.cycle.state_timeout = values["state_timeout"]
        self.cycle.resume_timeout = values["resume_timeout"]
        self.cycle.tracking_tolerance = values["tracking_tolerance_joint"]
        self.cycle.tool_tolerance = _tool_tolerance(values)
        settings = planner_settings(values)
        self.cycle.changes = {name: getattr(settings, name) for name in CHANGEABLE}
        if self.planner.may_detour:
            self.planner.set_detour(values["detour"])

    @property
    def scene(self) -> DeclaredScene:
        return self.planner.scene

    @property
    def caution(self) -> str:
        planner = self.planner
        if not planner.may_detour:
            return "no detours: declare what stands around the arm with the parameter scene, or that nothing does: none"
        cautions = []
        if self._scene_is_recorded:
            names = ", ".join(planner.scene.names) or "nothing"
            cautions.append(
                f"around the arm stands what the skill says it was recorded in: {names}; detours leave what was "
                f"demonstrated by up to {planner.settings.detour:g} m. The parameter scene says otherwise"
            )
        if planner.settings.unseen == "blocked" and not len(planner.scene.seen):
            cautions.append(
                "unseen is blocked and the scene lists no boxes as seen: detours stay where the arm passes without them"
            )
        return "; ".join(cautions)

    def close(self) -> None:
        super().close()
        self._worker.close()


def _tool_tolerance(values: Mapping[str, Value]) -> tuple[float, float]:
    return values["tracking_tolerance"], values["tracking_tolerance_angle"]


def kind_of(skill: Skill, values: Mapping[str, Value]) -> SkillKind:
    """How the node treats a skill, with the values of its parameters."""
    if values["method"] not in _METHODS:
        return CertifiedKind(skill, values)
    module, name = _METHODS[values["method"]]
    return getattr(import_module(module), name)(skill, values)


def of_robot(skill: Skill, values: Mapping[str, Value]) -> dict[str, Value]:
    """Values of the skill's own robot for the parameters that are still those of the default one; RobotError: none."""
    of_default = {parameter.name: parameter.default for parameter in PLANNER}
    spheres = tool_spheres(skill.robot).ravel().tolist()
    own = {"base_frame": values["joint_prefix"] + skill.base_frame, "tool_spheres": spheres}
    return {name: value for name, value in own.items() if values[name] == of_default[name]}


def planner_settings(values: Mapping[str, Value]) -> PlannerSettings:
    """The planner's settings; PlanningError where parameters do not go together."""
    spheres = np.array(values["tool_spheres"]).reshape(-1, 4)
    limits = {name: None if values[name] < 0.0 else values[name] for name in _TOOL_LIMITS}
    return PlannerSettings(
        tool_points=tuple(map(tuple, spheres[:, :3].tolist())),
        tool_radii=tuple(spheres[:, 3].tolist()),
        **limits,
        **{name: values[name] for name in _SETTINGS},
    )
