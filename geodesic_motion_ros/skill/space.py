"""The output spaces of skills, R^3 x S^3 (poses of the tool) and R^eta (configurations): the parts that differ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph, JointMetricSettings
from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder
from geodesic_motion_ros.manifold.encoder import JointSpaceEncoder, TaskSpaceEncoder
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.manifold.pose_graph import MetricSettings, PoseGraph, build_pose_graph
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.sheet import CanonicalSheet, JointSheet
from geodesic_motion_ros.utils.checked_numbers import ARM_REACH, LARGEST_TURN

_ENDS = ("start_offsets", "goal_offsets", "modes")


@dataclass(frozen=True)
class SkillSpace:
    """The types of which a skill of one output space is made.

    Attributes
    ----------
    decoder, encoder, metric, sheet : of its parts.
    canonical_arrays : of the sheet, which a skill folder holds.
    coordinates : that the decoder makes, as it names them; coordinate, farthest : one of them in messages, and how far
        an arm goes in it.
    has_joints : whether these are the robot's joints, as many as it has.
    build_graph : called with a model, what the builders of both kinds of graphs are given, by name, and the builder of
        an arm's.
    """

    decoder: Any
    encoder: Any
    metric: Any
    sheet: Any
    canonical_arrays: tuple[str, ...]
    coordinates: str
    coordinate: str
    farthest: float
    has_joints: bool
    build_graph: Callable[..., PoseGraph | ConfigurationGraph]


def _build_pose_graph(model: Any, recipe: dict[str, Any], build_arm: Callable[..., Any]) -> PoseGraph:
    return build_pose_graph(**recipe, clusters=2 if model.orientation_model == "two_cluster" else 1)


def _build_arm_graph(
    model: Any, recipe: dict[str, Any], build_arm: Callable[..., ConfigurationGraph]
) -> ConfigurationGraph:
    robot = Robot.named(model.robot)
    return build_arm(**recipe, robot=robot, body=model.metric.body_points(robot))


#: By the name that a skill has of its space.
SPACES = {
    "task": SkillSpace(
        TaskSpaceDecoder, TaskSpaceEncoder, MetricSettings, CanonicalSheet, (*_ENDS, "positions", "quaternions"),
        "positions", "tool position [m]", ARM_REACH, False, _build_pose_graph,
    ),
    "joint": SkillSpace(
        JointSpaceDecoder, JointSpaceEncoder, JointMetricSettings, JointSheet,
        (*_ENDS, "configurations", "start_groups", "goal_groups", "start_poles", "goal_poles"),
        "configurations", "joint angle [rad]", LARGEST_TURN, True, _build_arm_graph,
    ),
}  # fmt: skip
