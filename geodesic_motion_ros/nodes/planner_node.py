"""Node `planner`: hears goal, obstacles and joint states, and commands the arm a hundred times a second.

It sends `joint_trajectory`, or streams `target_pose` with `target_posture` (parameter `output`). `planner_face` has
what it hears and shows, `planner_cycle` one round of its loop.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from geodesic_motion_ros.contract.settings import CHANGEABLE
from geodesic_motion_ros.contract.status import Verdict
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.kernels.loading import load_kernels
from geodesic_motion_ros.motion.worker import Worker
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput, PoseArrays
from geodesic_motion_ros.nodes.extras import extra, lacking
from geodesic_motion_ros.nodes.goal_action import GoalAction
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.parameters import NodeParameters, Value
from geodesic_motion_ros.nodes.planner_cycle import PlannerCycle
from geodesic_motion_ros.nodes.planner_face import PlannerFace, Subject
from geodesic_motion_ros.nodes.planner_parameters import (
    load_skill,
    planner_settings,
    refuse_no_rotation,
    tool_tolerance,
    why_paused,
)
from geodesic_motion_ros.nodes.running import LoopingNode, run_node
from geodesic_motion_ros.nodes.scene_parameter import declared_scene
from geodesic_motion_ros.nodes.usage import PROGRAMS
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError, PlanningError, RobotError, SkillError
from geodesic_motion_ros.visualization.arm_view import ArmView
from geodesic_motion_ros.visualization.latent_view import LatentPicture, LatentView


class PlannerNode(LoopingNode):
    """The planner as a ROS 2 node.

    Raises
    ------
    ParameterError : a parameter does not exist or does not fit.
    SkillError : the skill is missing, damaged or of another robot.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("planner", **node_options)

    def _build(self) -> None:
        values = self._options = NodeParameters(self, PLANNER, _check_settings, self._parameters_changed)
        skill = load_skill(self, values)
        self._worker = Worker()
        self._goals = ThreadPoolExecutor(1, thread_name_prefix="goals")
        scene = declared_scene(values["scene"], skill)
        try:
            self.planner = ReactivePlanner(skill, planner_settings(values.values), detours=self._worker, scene=scene)
        except RobotError as error:
            raise SkillError(f"{values['skill']}: {error}") from error
        load_kernels(self.planner)
        if caution := _caution(self.planner, scene_is_recorded=values["scene"] == ""):
            self.get_logger().info(caution)
        self._sends_trajectories = values["output"] == "joint_trajectory"
        self.cycle = PlannerCycle(
            self.planner, values["state_timeout"], values["resume_timeout"], values["tracking_tolerance_joint"],
            values["horizon"], values["output"], background=self._goals, tool_tolerance=tool_tolerance(values.values),
        )  # fmt: skip
        self.cycle.paused = why_paused(values.values)
        self.cycle.commands = values["trajectory_action"] or values["output"]
        self.cycle.state_topic = self.resolve_topic_name("joint_states")
        self.face = PlannerFace(
            self, values, Subject.of_skill(skill, self.planner.robot), self.planner.robot, values["output"],
            self.planner.settings.avoid, self._tick, self._died, self._tool_poses, self._plan, self._obstacles_changed,
        )  # fmt: skip
        self._action = self._goal_action(values["block_timeout"])
        self.inputs, self.outputs, self.loop = self.face.inputs, self.face.outputs, self.face.loop
        self.inputs.obstacles.clouds.declared = self.planner.scene.solids
        self.face.draw_path(self._draw_markers)
        self.face.draw_latent(lambda size: latent_view(self.planner, skill, size))

    def _goal_action(self, patience: float) -> GoalAction | None:
        """The action server of goals, where its interface is installed."""
        if lacks := lacking():
            self.get_logger().info(lacks)
        kind = extra("geodesic_motion_msgs/action/MoveToGoal")
        if kind is None:
            return None
        return GoalAction(
            self, kind, self.face.inputs, self.planner.robot, lambda: self.face.newest, patience, self._died
        )  # fmt: skip

    def _introduction(self) -> str:
        tool_alone = self.planner.settings.avoid != "arm"
        return self.face.introduction("the whole arm" + (", of which the tool avoids obstacles" if tool_alone else ""))

    def start(self) -> None:
        """Begin to plan and command."""
        self.face.start()
        if self._action is not None:
            self._action.start()

    def brake(self) -> None:
        """Have the arm brake on its path."""
        self.cycle.paused = "the planner ends"

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm stands, and is not about to move."""
        return self.face.is_at_rest

    def stop(self) -> None:
        """End the threads; harmless when they have ended or never began."""
        if self._action is not None:
            self._action.stop()
        self.face.stop()
        self._goals.shutdown(wait=True, cancel_futures=True)
        self._worker.close()

    def _tick(self, periods: int) -> None:
        self.inputs.obstacles.clouds.tracking_error = self.planner.tracking.error
        inputs, output = self.face.cycle(self.cycle.run, self.cycle.stop)
        if self._sends_trajectories:
            if output.trajectory is not None:
                self.outputs.publish_trajectory(*output.trajectory)
        elif output.configuration is not None:
            self.outputs.publish_target(*self.planner.robot.forward(output.configuration), output.configuration)
        self.face.tell(inputs, output, self.cycle.goal_number, self._margins(), self.planner.held)

    def _margins(self) -> dict[str, float | str]:
        """What the certificate counts, and how far the arm rests beside that."""
        settings, tracking, obstacles = self.planner.settings, self.planner.tracking, self.planner.obstacles
        errors = np.concatenate([obstacles.velocity_errors, obstacles.solid_velocity_errors])
        return {
            "obstacle_margin": settings.obstacle_margin,
            "tracking_error": tracking.error,
            "tracking_lag": tracking.lag,
            "obstacle_position_error": settings.obstacle_position_error,
            "obstacle_velocity_error": float(np.max(errors, initial=0.0)),
            "speed_override": 0.0 if self.cycle.paused else settings.speed_override,
            "round": self.planner.round,
            "takeover_delay": self.planner.latency - settings.latency,
            "withheld_trajectories": self.cycle.withheld,
            "trajectories_not_taken": self.cycle.not_taken,
            "steady_error_mrad": 1e3 * self.cycle.steady.size,
            "steady_error_joint": self.cycle.steady.joint,
        }

    def _obstacles_changed(self) -> None:
        # A trajectory says itself when it begins; a pose is to be followed at once, and waits for its time.
        if self._sends_trajectories:
            self.loop.hurry()

    def _tool_poses(self, reference: JointReference) -> PoseArrays:
        chain = self.planner.robot.chain
        positions, quaternions = end_effector_poses(np.ascontiguousarray(reference.positions), chain)
        return positions, continuous_signs(quaternions)

    def _plan(self, start: PoseArrays, goal: PoseArrays) -> tuple[PoseArrays | None, Verdict]:
        plan = self.planner.plan(*start, *goal)
        return None if plan.reference is None else self._tool_poses(plan.reference), plan.verdict

    def _draw_markers(self, inputs: CycleInputs, output: CycleOutput, path: np.ndarray) -> None:
        body, held, tool = np.zeros((0, 4)), (), TaskFrame.identity()
        if output.configuration is not None:
            held, tool = self.planner.held, TaskFrame(*self.planner.robot.forward(output.configuration))
            body = self._body(output.configuration)
        is_detour = output.verdict.figures.displacement > 0.0
        self.outputs.publish_markers(path, is_detour, inputs.obstacles, self.planner.scene, body, held, tool)

    def _body(self, configuration: np.ndarray) -> np.ndarray:
        """Spheres (K, 4) that obstacles are kept away from, where they are commanded to be: centre and radius [m]."""
        model = self.planner.collision
        centres = model.positions(self.planner.robot, configuration[None])[0]
        return np.concatenate([centres, model.radii[:, None]], axis=1)[model.moving]

    def _parameters_changed(self, values: Mapping[str, Value]) -> None:
        self.cycle.state_timeout = values["state_timeout"]
        self.cycle.resume_timeout = values["resume_timeout"]
        self.cycle.tracking_tolerance = values["tracking_tolerance_joint"]
        self.cycle.tool_tolerance = tool_tolerance(values)
        settings = planner_settings(values)
        self.cycle.changes = {name: getattr(settings, name) for name in CHANGEABLE}
        self.cycle.paused = why_paused(values)
        if self.planner.may_detour:
            self.planner.set_detour(values["detour"])


def latent_view(planner: ReactivePlanner, skill: Skill, size: int) -> LatentPicture | None:
    """Return what draws the latent space of a planner's skill; None where it cannot be drawn."""
    drawn = skill.space, skill.decoder.latent_dimension
    if drawn == ("task", 2):
        settings = planner.settings
        return LatentView(skill, planner.graph, np.array(settings.tool_points), np.array(settings.tool_radii), size)
    return ArmView(skill, planner.graph, planner.collision, size) if drawn == ("joint", 3) else None


def _caution(planner: ReactivePlanner, scene_is_recorded: bool) -> str:
    """What a person should know as it starts; "" for nothing."""
    if not planner.may_detour:
        return "no detours: declare what stands around the arm with the parameter scene, or that nothing does: none"
    cautions = []
    if scene_is_recorded:
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


def _check_settings(values: Mapping[str, Value]) -> None:
    refuse_no_rotation(values)
    if values["trajectory_action"] and values["output"] != "joint_trajectory":
        raise ParameterError("parameters do not go together: trajectory_action needs output joint_trajectory")
    try:
        planner_settings(values)
    except PlanningError as error:
        raise ParameterError(f"parameters do not go together: {error}") from error


def main(args: list[str] | None = None) -> int:
    """Run the planner until SIGINT or SIGTERM; returns the exit code."""
    return run_node(PROGRAMS["planner"], PlannerNode, args)


if __name__ == "__main__":
    sys.exit(main())
