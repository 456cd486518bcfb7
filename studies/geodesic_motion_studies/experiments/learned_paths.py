"""Shortest paths through a skill's latent space as it was learned, walls and all: what the planner's graph leaves out.

The planner's graph ends where the support does, so it says only that no path leads out of a tube or into the other
cluster. How high the walls are follows from a graph of the whole latent box, from which nothing was removed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph, build_configuration_graph
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.manifold.pose_graph import PoseGraph, build_pose_graph
from geodesic_motion_ros.manifold.shortest_path import shortest_free_path
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

#: Nodes along each side of the whole box, by its dimension.
WHOLE_BOX = {2: (100, 100), 3: (40, 40, 40)}


@dataclass(frozen=True)
class LearnedPath:
    """A shortest path; without one `nodes` are empty and the length is infinite.

    Attributes
    ----------
    nodes : (p,) of the graph.
    length : Riemannian length of the whole.
    energy : squared length in the metric: the integral of |c'|^2 over unit time for the curve that spends the same time
        on each of its m edges, m sum_e w_e^2.
    dearest : largest squared length of one edge, what the planner's verdict compares with the skill's threshold.
    """

    nodes: np.ndarray
    length: float
    energy: float
    dearest: float


class LearnedPaths:
    """Shortest paths on a graph as it was learned, carried nowhere, between the nodes nearest to latent points."""

    def __init__(self, graph: PoseGraph | ConfigurationGraph) -> None:
        self.graph, self._tree = graph, cKDTree(graph.latent)
        if isinstance(graph, ConfigurationGraph):
            carried = graph.transported(JointOffsets.none(graph.robot, graph.mean_path_count))
        else:
            carried = graph.transported(Offsets.none(graph.mean_path_count), np.zeros((1, 3)))
        self._energies = carried.energies()

    def shortest(self, start: np.ndarray, goal: np.ndarray) -> LearnedPath:
        """From a latent point (d,) to another."""
        graph = self.graph
        _, (source, target) = self._tree.query(np.stack([start, goal]))
        nodes, edges, length = shortest_free_path(
            graph.adjacency, np.sqrt(self._energies), np.zeros(len(graph.latent)), int(source), int(target)
        )
        squared = self._energies[edges]
        dearest = float(np.max(squared, initial=0.0))
        return LearnedPath(nodes, length, len(edges) * float(squared.sum()), dearest)


def supported_box(skill: Skill) -> PoseGraph:
    """The support of a skill of task space as the planner has it, with no edge left out of it for what it joins or for
    what it costs.
    """
    return build_pose_graph(
        skill.decoder, skill.codes, skill.latent_lower, skill.latent_upper, skill.metric, skill.sigma_limit,
        one_sheet=False, mean_paths=skill.mean_paths,
    )  # fmt: skip


def whole_box(skill: Skill, shape: tuple[int, ...] | None = None) -> PoseGraph | ConfigurationGraph:
    """The graph of a skill's whole latent box, nothing pruned or forbidden; `shape` without one as in `WHOLE_BOX`."""
    shape = shape or WHOLE_BOX[len(skill.latent_lower)]
    box = skill.decoder, skill.codes, skill.latent_lower, skill.latent_upper, skill.metric
    if skill.space == "joint":
        robot = Robot.named(skill.robot)
        body = skill.metric.body_points(robot)
        return build_configuration_graph(*box, robot, body, math.inf, shape, mean_paths=skill.mean_paths)
    return build_pose_graph(*box, math.inf, shape, one_sheet=False, mean_paths=skill.mean_paths)
