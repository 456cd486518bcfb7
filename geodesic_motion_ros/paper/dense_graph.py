"""The whole latent box of a skill as a graph: every node decoded, none removed, its weights those of the metric."""

from __future__ import annotations

import math

import numpy as np

from geodesic_motion_ros.manifold.configuration_graph import build_configuration_graph
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.manifold.latent_graph import LatentGraph
from geodesic_motion_ros.manifold.pose_graph import build_pose_graph
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import GRID_SHAPES, Skill
from geodesic_motion_ros.utils.errors import PlanningError

#: Directions per node by the latent dimension: all neighbours of a cell.
NEIGHBOURS = {2: 8, 3: 26}


def dense_graph(skill: Skill, shape: tuple[int, ...] | None = None) -> tuple[LatentGraph, WeightedGraph]:
    """Nodes and edges of a grid over the skill's whole box, and what the edges cost without obstacles.

    An edge from z to z' costs the chord of what the metric sees, sqrt(|f(z') - f(z)|^2). Body points of a skill of
    poses are the tool's origin alone, those of a skill of configurations are of the whole arm.

    Parameters
    ----------
    shape : nodes along each latent axis; None: 100 x 100 or 50 x 50 x 50.

    Raises
    ------
    PlanningError : the latent space has neither two nor three dimensions, as those of the paper.
    """
    if len(skill.latent_lower) not in NEIGHBOURS:
        raise PlanningError(
            f"skill {skill.name} has {len(skill.latent_lower)} latent dimensions: a dense grid is of 2 or 3"
        )
    shape = shape or GRID_SHAPES[len(skill.latent_lower)]
    dense = {
        "sigma_limit": math.inf, "shape": shape, "neighbours": NEIGHBOURS[len(shape)], "pieces": 1,
    }  # fmt: skip
    # Of the codes only progress along them is made, which nothing asks for here: two are enough.
    box = skill.decoder, skill.codes[:1, [0, -1]], skill.latent_lower, skill.latent_upper, skill.metric
    if skill.space == "joint":
        robot = Robot.named(skill.robot)
        arm = build_configuration_graph(*box, robot, skill.metric.body_points(robot), **dense)
        return arm, arm.transported(JointOffsets.none(robot))
    tool = build_pose_graph(*box, **dense, one_sheet=False)
    return tool, tool.transported(Offsets.none(), np.zeros((1, 3)))
