"""PoseQuery: a start and a goal pose, with the latent graph transported to them.

Decoded nodes are transported by the offsets of both ends, so paths begin and end where it was requested, and obstacles
are met where the robot will really be. Which latent points are transported onto start and goal:

- on a canonical sheet, learned from endpoint-normalised demonstrations, where all of these start and where all end, as
  long as the requested poses lie within the starts and goals that were demonstrated, or not further beyond them than
  the limits allow;
- otherwise, and always on the raw sheet, the nearest trusted poses of the manifold.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geodesic_motion_ros.geometry.quaternions import angle_between, normalise, rotation_vector_between
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.manifold.transport import Offsets, corrections_at
from geodesic_motion_ros.planning.search import demonstrated_cost
from geodesic_motion_ros.planning.settings import SAME_TASK_POSE, PlannerSettings
from geodesic_motion_ros.planning.status import Figures, Refusal, VerdictCode
from geodesic_motion_ros.planning.transported_query import (
    AlongMeanPaths,
    End,
    TransportedQuery,
    TransportedQueryBuilder,
)
from geodesic_motion_ros.skill.sheet import POSE_SCALE, beyond_demonstrated
from geodesic_motion_ros.skill.skill import ENDPOINT_MULTIPLE, Skill
from geodesic_motion_ros.utils.checked_numbers import LARGEST_NUMBER, real_array
from geodesic_motion_ros.utils.errors import PlanningError


@dataclass(frozen=True)
class Pose:
    """Tool pose in the base frame: position (3,) [m], unit quaternion (4,)."""

    position: np.ndarray
    quaternion: np.ndarray

    def is_within(self, other: Pose, limits: tuple[float, float]) -> bool:
        """Whether another pose is no farther away than limits [m], [rad]."""
        near = np.linalg.norm(self.position - other.position) <= limits[0]
        return bool(near) and bool(angle_between(self.quaternion, other.quaternion) <= limits[1])


def checked_pose(end: str, position: np.ndarray, quaternion: np.ndarray) -> Pose | Refusal:
    """Return a pose with a unit quaternion, or what is wrong with it: numbers up to LARGEST_NUMBER are expected."""
    try:
        position = real_array(f"{end} position", position, (3,))
        quaternion = real_array(f"{end} quaternion", quaternion, (4,))
    except PlanningError as error:
        return Refusal(VerdictCode.BAD_INPUT, str(error))
    if not np.all(np.abs(np.append(position, quaternion)) <= LARGEST_NUMBER):
        numbers = f"{end} position {position.tolist()}, quaternion {quaternion.tolist()}"
        return Refusal(VerdictCode.BAD_INPUT, f"{numbers}: must be finite, at most {LARGEST_NUMBER:g}")
    if np.linalg.norm(quaternion) < 1e-6:
        reason = f"{end} quaternion {quaternion.tolist()} is zero: expected a unit quaternion (w, x, y, z)"
        return Refusal(VerdictCode.BAD_INPUT, reason)
    return Pose(position, normalise(quaternion))


@dataclass(frozen=True)
class _End:
    """A start or goal and the latent point that is transported onto it.

    Attributes
    ----------
    node : the graph's node at, or nearest to, the latent point (d,).
    displacement : (6,) from the decoded latent point to the pose: translation [m], rotation vector [rad].
    beyond : (6,) what of the displacement no demonstration has.
    task_offset : (6,) from the demonstrations' mean start or goal; zeros where the latent point is another one.
    """

    latent: np.ndarray
    node: int
    displacement: np.ndarray
    beyond: np.ndarray
    task_offset: np.ndarray

    @property
    def sizes(self) -> tuple[float, float, float, float]:
        """Lengths of displacement [m], [rad] and of what of it was not demonstrated [m], [rad]."""
        return (*_lengths(self.displacement), *_lengths(self.beyond))


@dataclass(frozen=True)
class PoseQuery(TransportedQuery):
    """A start and a goal pose of the tool with the graph of poses transported to them, without an arm that holds it.

    task_start, task_goal : (6,).
    """


class PoseQueryBuilder(TransportedQueryBuilder):
    """Finds where on the manifold a start and a goal pose lie, and transports the graph of poses to them."""

    def __init__(self, skill: Skill, graph: PoseGraph, settings: PlannerSettings) -> None:
        """graph : decoded from the skill."""
        super().__init__(skill, graph, settings, 6)
        self._points = np.array(settings.tool_points, dtype=float)
        self._tensors = graph.tensors(self._points)
        self._poles: dict[str, tuple[np.ndarray, int]] = {}
        if skill.canonical is not None:
            means = {"start": skill.codes[:, 0].mean(axis=0), "goal": skill.codes[:, -1].mean(axis=0)}
            self._poles = {end: (latent, self._pole_node(latent)) for end, latent in means.items()}
        unmoved = graph.transported(Offsets.none(graph.mean_path_count), self._points, self._unconditioned[1])
        self._demonstrated_cost = demonstrated_cost(graph, unmoved.base, skill.codes)

    # ------------------------------------------------------------------ ends

    def goal_refusal(self, goal: Pose) -> Refusal | None:
        """Refuse a goal that is too far from what was demonstrated, and from every trusted part of the manifold."""
        pieces = self._graph.pieces_with_demonstrations()
        ends = [end for component in pieces if (end := self._end("goal", goal, component)) is not None]
        if not ends:
            return Refusal(VerdictCode.GOAL_OUT_OF_SUPPORT, "the skill has no supported latent point at all")
        return self._offset_refusal("goal", min(ends, key=self._misfit))

    def _offset_refusal(self, name: End, end: _End) -> Refusal | None:
        *_, beyond, beyond_angle = end.sizes
        limit, limit_angle = self._settings.maximum_offset, self._settings.maximum_offset_angle
        if self._allowed(end):
            return None
        what = "the nearest pose the skill can reach" if self._skill.canonical is None else "what was demonstrated"
        x, y, z = 1000 * end.beyond[:3]
        reason = (
            f"the {name} is {1000 * beyond:.0f} mm ({x:+.0f}, {y:+.0f}, {z:+.0f}) and "
            f"{math.degrees(beyond_angle):.0f} deg from {what}; allowed are {1000 * limit:.0f} mm and "
            f"{math.degrees(limit_angle):.0f} deg (settings maximum_offset, maximum_offset_angle)"
        )
        return Refusal(self._out_of_support(name), reason, Figures(**_misfits(name, end)))

    def _end(self, name: End, pose: Pose, component: int) -> _End | None:
        """Where a connected piece meets a pose; None where none of it is trusted."""
        pole = self._at_pole(name, pose, component)
        if pole is not None and self._allowed(pole):
            return pole
        limit = ENDPOINT_MULTIPLE * self._skill.sigma_support
        found = self._graph.nearest_node(pose.position, pose.quaternion, component, limit)
        if found is None:
            return pole
        node = found[0]
        displacement = self._displacement(self._graph.latent[node], pose)
        nearest = _End(self._graph.latent[node], node, displacement, displacement, np.zeros(6))
        return nearest if pole is None else min(nearest, pole, key=self._misfit)

    def _at_pole(self, name: End, pose: Pose, component: int) -> _End | None:
        """The latent point where all demonstrations start or end, on a canonical sheet."""
        sheet = self._skill.canonical
        if sheet is None or self._graph.component[self._poles[name][1]] != component:
            return None
        latent, node = self._poles[name]
        if name == "start":
            mean, demonstrated = self._skill.start_pose, sheet.start_offsets
        else:
            # A path ends at a node.
            latent = self._graph.latent[node]
            mean, demonstrated = self._skill.goal_pose, sheet.goal_offsets
        turn = rotation_vector_between(mean[3:], pose.quaternion)
        offset = np.concatenate([pose.position - mean[:3], turn])
        return _End(latent, node, self._displacement(latent, pose), beyond_demonstrated(offset, demonstrated), offset)

    def _allowed(self, end: _End) -> bool:
        *_, beyond, beyond_angle = end.sizes
        return beyond <= self._settings.maximum_offset and beyond_angle <= self._settings.maximum_offset_angle

    def _displacement(self, latent: np.ndarray, pose: Pose) -> np.ndarray:
        decoded = self._graph.decoder.decode(latent[None])
        turn = rotation_vector_between(decoded.quaternions[0], pose.quaternion)
        return np.concatenate([pose.position - decoded.positions[0], turn])

    # ----------------------------------------------------------------- query

    def build(self, start: Pose, goal: Pose) -> PoseQuery | Refusal:
        """Choose both ends on one connected piece of the manifold and transport the graph to the query."""
        pairs = []
        for component in self._graph.pieces_with_demonstrations():
            here, there = self._end("start", start, component), self._end("goal", goal, component)
            if here is not None and there is not None:
                pairs.append((here, there))
        if not pairs:
            return Refusal(VerdictCode.START_OUT_OF_SUPPORT, "no supported latent point near start and goal")
        here, there = min(pairs, key=lambda pair: self._misfit(pair[0]) + self._misfit(pair[1]))
        along_mean_paths = self._chosen_mean_paths(here.task_offset, there.task_offset)
        return self._between(start, here, goal, there, here.task_offset, along_mean_paths)

    def redirected(self, query: PoseQuery, start: Pose, latent: np.ndarray, goal: Pose) -> PoseQuery | Refusal | None:
        """The query that goes on from a pose on the path of an older one, at its latent point (d,), to a new goal.

        None where the latent point is not connected to any node: then the query has to be built anew.
        """
        node = self._graph.node_near(latent, self._graph.component == self._graph.component[query.goal_node], 1)
        if node is None:
            return None
        here = _End(latent, node, self._displacement(latent, start), np.zeros(6), query.task_start)
        there = self._end("goal", goal, int(self._graph.component[node]))
        if there is None:
            return None
        along_mean_paths = query.along_mean_paths
        if np.linalg.norm(POSE_SCALE * (there.task_offset - query.task_goal)) > SAME_TASK_POSE:
            along_mean_paths = self._chosen_mean_paths(query.task_start, there.task_offset)
        found = self._between(start, here, goal, there, query.task_start, along_mean_paths)
        if isinstance(found, Refusal):
            return found
        progress, shares = self._graph.progress_map(latent[None])
        positions, quaternions = self._graph.decoder.poses(latent[None])
        along, _ = carried(positions, quaternions, query.offsets.displacements(progress, shares))
        moved = float(np.linalg.norm(start.position - along[0]))
        return replace(found, displaced=moved + query.displaced_at(progress))

    def _between(
        self, start: Pose, here: _End, goal: Pose, there: _End, task_start: np.ndarray, along_mean_paths: AlongMeanPaths
    ) -> PoseQuery | Refusal:
        refusal = self._offset_refusal("start", here) or self._offset_refusal("goal", there)
        if refusal is not None:
            return refusal
        corrections, conformal, mean_paths = along_mean_paths
        offsets = self._offsets(here, there, corrections)
        graph = self._graph.transported(offsets, self._points, conformal)
        return PoseQuery(
            start=start,
            goal=goal,
            start_latent=here.latent,
            goal_node=there.node,
            body=NodeBody.of_tool(graph.body_points, np.array(self._settings.tool_radii, dtype=float)),
            offsets=offsets,
            graph=graph,
            field=self._graph.field(self._tensors, mean_paths, self._settings.ridge_strength),
            **self._costs(graph, here.node, there.node),
            misfits=Figures(**_misfits("start", here), **_misfits("goal", there)),
            task_start=task_start,
            task_goal=there.task_offset,
            along_mean_paths=along_mean_paths,
        )

    def _offsets(self, here: _End, there: _End, corrections: np.ndarray) -> Offsets:
        progress, shares = self._graph.progress_map(np.stack([here.latent, there.latent]))
        corrected = corrections_at(corrections, progress, shares)
        return Offsets(
            here.displacement - corrected[0], there.displacement - corrected[1],
            float(progress[0]), float(progress[1]), corrections, self._skill.fade,
        )  # fmt: skip


def _lengths(offset: np.ndarray) -> tuple[float, float]:
    """Length of the translation [m] and of the rotation vector [rad] of an offset (6,)."""
    return float(np.linalg.norm(offset[:3])), float(np.linalg.norm(offset[3:]))


def _misfits(name: str, end: _End) -> dict[str, Any]:
    names = (f"{name}_offset", f"{name}_offset_angle", f"{name}_beyond", f"{name}_beyond_angle")
    return dict(zip(names, end.sizes, strict=True))
