"""Query: a start and a goal pose, with the latent graph transported to them.

Decoded nodes are carried by the offsets of both ends, so paths begin and end where they were asked to, and obstacles
are met where the robot will really be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.graph.latent_graph import EdgeEnergies, LatentGraph, Offsets
from geodesic_motion_ros.graph.shortest_path import base_weights, cost_field
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.quaternions import angle_between, normalise, rotation_vector_between
from geodesic_motion_ros.skill import ENDPOINT_MULTIPLE
from geodesic_motion_ros.verdict import Verdict, VerdictCode


@dataclass(frozen=True)
class Pose:
    """Tool pose in the base frame: position (3,) [m], unit quaternion (4,)."""

    position: np.ndarray
    quaternion: np.ndarray


def checked_pose(end: str, position: np.ndarray, quaternion: np.ndarray) -> tuple[Pose | None, str]:
    """A pose with a unit quaternion, or None and what is wrong with it."""
    position, quaternion = np.array(position, dtype=float), np.array(quaternion, dtype=float)
    if position.shape != (3,) or quaternion.shape != (4,):
        return None, (
            f"{end} has position of shape {position.shape} and quaternion of shape {quaternion.shape}: "
            "expected (3,) and (4,)"
        )
    if not (np.all(np.isfinite(position)) and np.all(np.isfinite(quaternion))):
        return None, f"{end} position {position.tolist()}, quaternion {quaternion.tolist()}: must be finite"
    if np.linalg.norm(quaternion) < 1e-6:
        return None, f"{end} quaternion {quaternion.tolist()} is zero: expected a unit quaternion (w, x, y, z)"
    return Pose(position, normalise(quaternion)), ""


@dataclass(frozen=True)
class Query:
    """A start and goal with the graph transported to them.

    Attributes
    ----------
    start, goal : the asked poses; start_latent : (d,) latent point that is carried onto the start.
    goal_node : the node that is carried onto the goal.
    members, body_points : (c,) nodes of the connected piece that holds both ends, and (c, K, 3) [m] their body points.
    offsets, energies : how the graph was carried there, and its edge energies after that.
    base : (m,) obstacle-free lengths of the edges.
    to_goal : (n,) obstacle-free cost to the goal, the exact heuristic.
    body_box : lower and upper corner (3,) [m] of all body points.
    misfits : distances of the asked poses from the manifold, under their names in a Verdict.
    """

    goal: Pose
    offsets: Offsets
    goal_node: int
    members: np.ndarray
    body_points: np.ndarray
    energies: EdgeEnergies
    base: np.ndarray
    to_goal: np.ndarray
    body_box: tuple[np.ndarray, np.ndarray]
    misfits: dict[str, float]
    start: Pose
    start_latent: np.ndarray


class QueryBuilder:
    """Finds where on the manifold start and goal lie, and transports the graph to them."""

    def __init__(self, graph: LatentGraph, sigma_support: float, settings: PlannerSettings) -> None:
        """sigma_support [m]: the skill's; ends are chosen within ENDPOINT_MULTIPLE of it."""
        self._graph = graph
        self._sigma_support = sigma_support
        self._settings = settings
        self._points = np.array(settings.tool_points, dtype=float)

    def goal_verdict(self, goal: Pose) -> Verdict:
        """Whether some trusted part of the manifold lies within the allowed offset of a goal."""
        ends = [self._nearest(goal, component) for component in self._components()]
        distances = [self._misfit(goal, node) for node in ends if node is not None]
        if not distances:
            return Verdict(VerdictCode.GOAL_OUT_OF_SUPPORT, "the skill has no supported latent point at all")
        return self._offset_verdict("goal", min(distances), VerdictCode.GOAL_OUT_OF_SUPPORT)

    def _offset_verdict(self, end: str, misfit: tuple[float, float], code: VerdictCode) -> Verdict:
        distance, angle = misfit
        offsets = {f"{end}_offset": distance, f"{end}_offset_angle": angle}
        limit, limit_angle = self._settings.maximum_offset, self._settings.maximum_offset_angle
        if distance <= limit and angle <= limit_angle:
            return Verdict(VerdictCode.OK, in_support=True, **offsets)
        reason = (
            f"the {end} is {1000 * distance:.0f} mm and {math.degrees(angle):.0f} deg from the nearest pose the "
            f"skill can reach; allowed are {1000 * limit:.0f} mm and {math.degrees(limit_angle):.0f} deg "
            "(settings maximum_offset, maximum_offset_angle)"
        )
        return Verdict(code, reason, **offsets)

    def _components(self) -> np.ndarray:
        """Connected pieces of the graph large enough to hold a path: those that hold demonstrations."""
        counts = np.bincount(self._graph.component)
        return np.flatnonzero(counts >= max(2, 0.05 * counts.max()))

    def _nearest(self, pose: Pose, component: int) -> int | None:
        limit = ENDPOINT_MULTIPLE * self._sigma_support
        found = self._graph.nearest_node(pose.position, pose.quaternion, component, limit)
        return None if found is None else found[0]

    def _misfit(self, pose: Pose, node: int) -> tuple[float, float]:
        """Distance [m] and angle [rad] between a pose and a decoded node."""
        decoded = self._graph.decoded
        distance = float(np.linalg.norm(decoded.positions[node] - pose.position))
        return distance, float(angle_between(decoded.quaternions[node], pose.quaternion))

    def build(self, start: Pose, goal: Pose) -> Query | Verdict:
        """Choose both ends on one connected piece of the manifold and transport the graph to the query."""
        pairs = []
        for component in self._components():
            start_node, goal_node = self._nearest(start, component), self._nearest(goal, component)
            if start_node is None or goal_node is None:
                continue
            misfits = self._misfit(start, start_node), self._misfit(goal, goal_node)
            pairs.append((np.hypot(*misfits[0]) + np.hypot(*misfits[1]), component, start_node, goal_node, *misfits))
        if not pairs:
            return Verdict(VerdictCode.START_OUT_OF_SUPPORT, "no supported latent point near start and goal")
        _, component, start_node, goal_node, start_misfit, goal_misfit = min(pairs, key=lambda pair: pair[0])
        for end, misfit, code in (
            ("start", start_misfit, VerdictCode.START_OUT_OF_SUPPORT),
            ("goal", goal_misfit, VerdictCode.GOAL_OUT_OF_SUPPORT),
        ):
            verdict = self._offset_verdict(end, misfit, code)
            if not verdict.ok:
                return verdict
        offsets = self._offsets(start, start_node, goal, goal_node)
        energies = self._graph.transported(offsets, self._points)
        base = base_weights(energies.fixed, energies.shares)
        members = np.flatnonzero(self._graph.component == component)
        body_points = energies.body_points[members]
        return Query(
            goal=goal,
            offsets=offsets,
            goal_node=goal_node,
            members=members,
            body_points=body_points,
            energies=energies,
            base=base,
            to_goal=cost_field(self._graph.adjacency, base, energies.fixed, energies.shares, goal_node),
            body_box=(body_points.min(axis=(0, 1)), body_points.max(axis=(0, 1))),
            misfits={
                "start_offset": start_misfit[0], "start_offset_angle": start_misfit[1],
                "goal_offset": goal_misfit[0], "goal_offset_angle": goal_misfit[1],
            },
            start=start,
            start_latent=self._graph.latent[start_node],
        )  # fmt: skip

    def _offsets(self, start: Pose, start_node: int, goal: Pose, goal_node: int) -> Offsets:
        decoded, progress = self._graph.decoded, self._graph.progress
        return Offsets(
            start.position - decoded.positions[start_node],
            goal.position - decoded.positions[goal_node],
            rotation_vector_between(decoded.quaternions[start_node], start.quaternion),
            rotation_vector_between(decoded.quaternions[goal_node], goal.quaternion),
            float(progress[start_node]),
            float(progress[goal_node]),
        )
