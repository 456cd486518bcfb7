"""Node `filter`: plays the trajectories and targets that others offer, certified, and brakes where they are not free.

It hears `~/joint_trajectory`, chunks or whole ones, and `~/joint_target`, a stream of places; and sends
`joint_trajectory`. No skill is needed: robot, scene and obstacles are. `planner_face` has what else it hears and shows,
`planner_cycle` one round of its loop.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from geodesic_motion_ros.contract.settings import CHANGEABLE
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.kernels.loading import load_filter_kernels
from geodesic_motion_ros.motion.worker import Worker
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput, PoseArrays
from geodesic_motion_ros.nodes.filter_inputs import TARGET, TRAJECTORY, FilterInputs
from geodesic_motion_ros.nodes.parameter_tables import FILTER
from geodesic_motion_ros.nodes.parameters import NodeParameters, Value
from geodesic_motion_ros.nodes.planner_cycle import PlannerCycle
from geodesic_motion_ros.nodes.planner_face import PlannerFace, Subject
from geodesic_motion_ros.nodes.planner_parameters import planner_settings, why_paused
from geodesic_motion_ros.nodes.running import LoopingNode, run_node
from geodesic_motion_ros.nodes.scene_parameter import declared_scene
from geodesic_motion_ros.nodes.usage import PROGRAMS
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError, PlanningError, RobotError

#: Stands for the robot's own.
_DEFAULT_FRAME = next(parameter.default for parameter in FILTER if parameter.name == "base_frame")


class FilterNode(LoopingNode):
    """The motion filter as a ROS 2 node.

    Raises
    ------
    ParameterError : a parameter does not exist or does not fit.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("filter", **node_options)

    def _build(self) -> None:
        values = self._options = NodeParameters(self, FILTER, _check_settings, self._parameters_changed)
        name = values["robot"]
        try:
            base = values["joint_prefix"] + RobotDescription.named(name).base_link
            values.stand_in({"base_frame": base} if values["base_frame"] == _DEFAULT_FRAME else {})
            self._worker = Worker()
            self.filter = MotionFilter(
                name, declared_scene(values["scene"], None), planner_settings(values.values),
                recover=values["recover"], detours=self._worker,
            )  # fmt: skip
        except RobotError as error:
            raise ParameterError(f"parameter robot: {error}") from error
        load_filter_kernels(self.filter)
        self.cycle = PlannerCycle(
            self.filter, values["state_timeout"], values["resume_timeout"], values["tracking_tolerance_joint"],
            values["horizon"],
        )  # fmt: skip
        self.cycle.paused = why_paused(values.values)
        self.cycle.commands = values["trajectory_action"] or self.cycle.commands
        self.cycle.state_topic = self.resolve_topic_name("joint_states")
        awaited = {TRAJECTORY: "a trajectory", TARGET: "a target"}
        subject = Subject("a filter of the motions", name, awaited, FilterInputs, "the end of the trajectory")
        self.face = PlannerFace(
            self, values, subject, self.filter.robot, "joint_trajectory", "arm", self._tick, self._died,
            self._tool_poses, None, lambda: self.loop.hurry(),
        )  # fmt: skip
        self.inputs, self.outputs, self.loop = self.face.inputs, self.face.outputs, self.face.loop
        self.inputs.obstacles.clouds.declared = self.filter.scene.solids
        self.face.draw_path(self._draw_markers)

    def _introduction(self) -> str:
        return self.face.introduction(self._options["robot"])

    def start(self) -> None:
        """Begin to filter and command."""
        self.face.start()

    def brake(self) -> None:
        """Have the arm brake on its path."""
        self.cycle.paused = "the filter ends"

    @property
    def is_at_rest(self) -> bool:
        """Whether the arm stands, and is not about to move."""
        return self.face.is_at_rest

    def stop(self) -> None:
        """End the threads; harmless when they have ended or never began."""
        self.face.stop()
        self._worker.close()

    def _tick(self, periods: int) -> None:
        self.inputs.obstacles.clouds.tracking_error = self.filter.tracking.error
        inputs, output = self.face.cycle(self.cycle.run, self.cycle.stop)
        if output.trajectory is not None:
            self.outputs.publish_trajectory(*output.trajectory)
        self.face.tell(inputs, output, self.cycle.goal_number, self._margins(), self.filter.held)

    def _margins(self) -> dict[str, float | str]:
        """What the certificate counts."""
        settings, tracking = self.filter.settings, self.filter.tracking
        return {
            "obstacle_margin": settings.obstacle_margin,
            "tracking_error": tracking.error,
            "tracking_lag": tracking.lag,
            "speed_override": 0.0 if self.cycle.paused else settings.speed_override,
            "takeover_delay": self.filter.latency - settings.latency,
            "withheld_trajectories": self.cycle.withheld,
            "trajectories_not_taken": self.cycle.not_taken,
        }

    def _tool_poses(self, reference: JointReference) -> PoseArrays:
        chain = self.filter.robot.chain
        positions, quaternions = end_effector_poses(np.ascontiguousarray(reference.positions), chain)
        return positions, continuous_signs(quaternions)

    def _draw_markers(self, inputs: CycleInputs, output: CycleOutput, path: np.ndarray) -> None:
        body, held, tool = np.zeros((0, 4)), (), TaskFrame.identity()
        if output.configuration is not None:
            held, tool = self.filter.held, TaskFrame(*self.filter.robot.forward(output.configuration))
            model = self.filter.collision
            centres = model.positions(self.filter.robot, output.configuration[None])[0]
            body = np.concatenate([centres, model.radii[:, None]], axis=1)[model.moving]
        is_detour = output.verdict.figures.displacement > 0.0
        self.outputs.publish_markers(path, is_detour, inputs.obstacles, self.filter.scene, body, held, tool)

    def _parameters_changed(self, values: Mapping[str, Value]) -> None:
        self.cycle.state_timeout = values["state_timeout"]
        self.cycle.resume_timeout = values["resume_timeout"]
        self.cycle.tracking_tolerance = values["tracking_tolerance_joint"]
        settings = planner_settings(values)
        self.cycle.changes = {name: getattr(settings, name) for name in CHANGEABLE}
        self.cycle.paused = why_paused(values)
        if self.filter.may_detour:
            self.filter.set_detour(values["detour"])


def _check_settings(values: Mapping[str, Value]) -> None:
    try:
        planner_settings(values)
    except PlanningError as error:
        raise ParameterError(f"parameters do not go together: {error}") from error


def main(args: list[str] | None = None) -> int:
    """Run the filter until SIGINT or SIGTERM; returns the exit code."""
    return run_node(PROGRAMS["filter"], FilterNode, args)


if __name__ == "__main__":
    sys.exit(main())
