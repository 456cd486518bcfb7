"""The node with the paper's planner, which takes the place of `planner`: the same name, topics and services."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import TOOL_LIMITS
from geodesic_motion_ros.contract.status import Verdict
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput, PoseArrays
from geodesic_motion_ros.nodes.parameters import NodeParameters, Value
from geodesic_motion_ros.nodes.planner_face import PlannerFace, Subject
from geodesic_motion_ros.nodes.planner_parameters import load_skill, refuse_no_rotation, tool_tolerance
from geodesic_motion_ros.nodes.running import LoopingNode, run_node
from geodesic_motion_ros.paper.paper_cycle import PaperCycle
from geodesic_motion_ros.paper.paper_parameters import PAPER, PROGRAM
from geodesic_motion_ros.paper.paper_planner import CAUTION, PaperPlanner, PaperSettings
from geodesic_motion_ros.paper.streams import PoseStream, TrajectoryStream
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.visualization.latent_view import LatentPicture, LatentView


class PaperNode(LoopingNode):
    """The paper's planner as a ROS 2 node, for skills of either space.

    Raises
    ------
    ParameterError : a parameter does not exist or does not fit.
    SkillError : the skill is missing, damaged or of another robot.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("planner", **node_options)

    def _build(self) -> None:
        options = NodeParameters(self, PAPER, _check_settings, self._parameters_changed)
        skill, values = load_skill(self, options), options.values
        self._of_joints = skill.space == "joint"
        self.planner = PaperPlanner(skill, _planner_settings(values))
        self._goals = ThreadPoolExecutor(1, thread_name_prefix="goals")
        stream = (
            TrajectoryStream(self.planner, values["tracking_tolerance_joint"], values["latency"])
            if self._of_joints
            else PoseStream(self.planner, tool_tolerance(values))
        )
        offsets = values["maximum_offset"], values["maximum_offset_angle"]
        self.cycle = PaperCycle(
            self.planner, stream, values["state_timeout"], values["resume_timeout"], offsets, background=self._goals
        )
        self.cycle.state_topic = self.resolve_topic_name("joint_states")
        self.face = PlannerFace(
            self, options, Subject.of_skill(skill, self.planner.robot), self.planner.robot, stream.topic, "nothing",
            self._tick, self._died, self.planner.tool_poses, self._plan,
        )  # fmt: skip
        self.inputs, self.outputs, self.loop = self.face.inputs, self.face.outputs, self.face.loop
        self.face.draw_path(self._draw_markers)
        self.face.draw_latent(self._latent_view)

    def _introduction(self) -> str:
        return self.face.introduction(f"{'the whole arm' if self._of_joints else 'the tool'}, by the paper's planner")

    def start(self) -> None:
        """Begin to plan and command."""
        self.face.start()

    def stop(self) -> None:
        """End the threads; harmless when they have ended or never began."""
        self.face.stop()
        self._goals.shutdown(wait=True, cancel_futures=True)

    def _tick(self, periods: int) -> None:
        inputs, output = self.face.cycle(self.cycle.run, self.cycle.stop)
        if output.trajectory is not None:
            self.outputs.publish_trajectory(*output.trajectory)
        if output.commanded is not None:
            self.outputs.publish_target(*output.commanded)
        self.face.tell(inputs, output, self.cycle.goal_number, {}, self.planner.held)

    def _plan(self, start: PoseArrays, goal: PoseArrays) -> tuple[PoseArrays | None, Verdict]:
        return self.planner.tool_poses(self.planner.plan(start, goal)), Verdict(reason=CAUTION)

    def _draw_markers(self, inputs: CycleInputs, output: CycleOutput, path: np.ndarray) -> None:
        # The paper's metric sees points: no spheres are kept away from obstacles.
        none = DeclaredScene.empty(), np.zeros((0, 4)), (), TaskFrame.identity()
        self.outputs.publish_markers(path, False, inputs.obstacles, *none)

    def _latent_view(self, size: int) -> LatentPicture | None:
        skill = self.planner.skill
        if self._of_joints or skill.decoder.latent_dimension != 2:
            return None
        return LatentView(skill, self.planner.graph, np.zeros((1, 3)), np.zeros(1), size)

    def _parameters_changed(self, values: Mapping[str, Value]) -> None:
        self.cycle.state_timeout, self.cycle.resume_timeout = values["state_timeout"], values["resume_timeout"]
        tolerance = values["tracking_tolerance_joint"] if self._of_joints else tool_tolerance(values)
        self.cycle.stream.tolerance = tolerance


def _planner_settings(values: Mapping[str, Value]) -> PaperSettings:
    strength = values["ambient_strength"] if values["avoidance"] else 0.0
    speed, angular_speed = (
        values[name] if values[name] >= 0.0 else getattr(TOOL_LIMITS, name) for name in ("speed", "angular_speed")
    )
    return PaperSettings(strength, speed, angular_speed, values["speed_scale"])


def _check_settings(values: Mapping[str, Value]) -> None:
    refuse_no_rotation(values)
    if not values["simulation_only"]:
        raise ParameterError(
            "the paper's planner certifies nothing and may lead through obstacles: set simulation_only to true where "
            "no real arm hears the commands, or run planner instead"
        )


def main(args: list[str] | None = None) -> int:
    """Run the paper's planner until SIGINT or SIGTERM; returns the exit code."""
    return run_node(PROGRAM, PaperNode, args)


if __name__ == "__main__":
    sys.exit(main())
