"""OutputSpace: what a skill's space means to the planner of an arm. There are two, R^3 x S^3, the poses of its tool,
and R^eta, its configurations; nothing else in planning asks which of them a skill is of.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.quaternions import inverse, rotate
from geodesic_motion_ros.queries.configuration_query import ConfigurationQueryBuilder
from geodesic_motion_ros.queries.pose_query import PoseQueryBuilder
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.queries.query_builder import QueryBuilder
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot, check_takes_poses, contiguous
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.tool_limits import ToolLimits


@dataclass(frozen=True)
class OutputSpace:
    """The parts of planning that differ between the two spaces.

    Attributes
    ----------
    check_robot : raises RobotError for an arm that cannot follow a skill of the space.
    tool_limits : of the tool, where the settings name none.
    smoothing : widths by which the configurations of a path are smoothed, over those of its latent points.
    queries : the builder of queries of a skill, its graph, settings, robot, spheres and scene.
    is_there : whether an arm that stands in one configuration (eta,) is at a query's goal.
    tool_positions : (n, 3) [m] of decoded latent points (n, d).
    spheres : centres (n, S, 3) and radii (S,) [m] of the spheres that decoded latent points (n, d) tell of.
    """

    check_robot: Callable[[Robot], None]
    tool_limits: ToolLimits
    smoothing: float
    queries: Callable[[Skill, Any, PlannerSettings, Robot, CollisionModel, DeclaredScene], QueryBuilder[Any]]
    is_there: Callable[[Robot, np.ndarray, ArmQuery], bool]
    tool_positions: Callable[[Any, np.ndarray, Robot], np.ndarray]
    spheres: Callable[[Any, np.ndarray, Robot, CollisionModel], tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, skill: Skill) -> OutputSpace:
        """The space of a skill."""
        return _SPACES[skill.space]

    def demonstrated_spheres(
        self, skill: Skill, robot: Robot, collision: CollisionModel
    ) -> tuple[np.ndarray, np.ndarray]:
        """Centres (n, S, 3) and radii (S,) [m] along all demonstrations of the spheres that they tell of: of
        configurations the whole arm's, of tool poses those that are fixed behind the last joint.
        """
        return self.spheres(skill.decoder, skill.codes.reshape(-1, skill.codes.shape[-1]), robot, collision)


def _tool_is_there(robot: Robot, standing: np.ndarray, query: ArmQuery) -> bool:
    here, goal = (Pose(*robot.forward(configuration)) for configuration in (standing, query.goal))
    return here.is_within(goal, constants.SAME_GOAL)


def _arm_is_there(robot: Robot, standing: np.ndarray, query: ArmQuery) -> bool:
    return bool(np.max(np.abs(query.goal - standing)) <= constants.SAME_CONFIGURATION)


def _hand_spheres(
    decoder: Any, codes: np.ndarray, robot: Robot, collision: CollisionModel
) -> tuple[np.ndarray, np.ndarray]:
    """Those that are fixed behind the last joint."""
    hand = collision.moving & (collision.points.frames > np.flatnonzero(robot.chain[3] >= 0)[-1])
    position, quaternion = robot.forward(robot.ready)
    offsets = rotate(inverse(quaternion), collision.positions(robot, robot.ready[None])[0, hand] - position)
    positions, quaternions = decoder.poses(codes)
    turned = np.stack([rotate(quaternion, offsets) for quaternion in quaternions])
    return positions[:, None] + turned, collision.radii[hand]


def _arm_spheres(
    decoder: Any, codes: np.ndarray, robot: Robot, collision: CollisionModel
) -> tuple[np.ndarray, np.ndarray]:
    """Those of the whole arm that move."""
    placed = collision.positions(robot, decoder.configurations(codes))
    return placed[:, collision.moving], collision.radii[collision.moving]


_SPACES = {
    "task": OutputSpace(
        check_robot=check_takes_poses,
        tool_limits=constants.TOOL_LIMITS,
        smoothing=constants.TOOL_SMOOTHING_FACTOR,
        queries=PoseQueryBuilder,
        is_there=_tool_is_there,
        tool_positions=lambda decoder, codes, robot: decoder.poses(codes)[0],
        spheres=_hand_spheres,
    ),
    "joint": OutputSpace(
        check_robot=lambda robot: None,
        tool_limits=ToolLimits(),
        smoothing=1.0,
        queries=ConfigurationQueryBuilder,
        is_there=_arm_is_there,
        tool_positions=lambda decoder, codes, robot: end_effector_poses(
            contiguous(decoder.configurations(codes)), robot.chain
        )[0],
        spheres=_arm_spheres,
    ),
}
