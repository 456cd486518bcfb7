"""Queries of skills of tool poses, R^3 x S^3: their graph of poses, and the posture in which an arm holds it.

The arm holds the poses along the cheapest path without obstacles, its base path, from the configuration in which it
stands; and it holds every other node in the posture of the base path at the same progress (`posture.py`). The metric
stays the one that the skill learned, of the tool's motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.quaternions import continuous_signs, normalise, rotation_vector_between
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.metric_field import MetricField
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.manifold.shortest_path import cost_field, shortest_free_path
from geodesic_motion_ros.manifold.transport import Offsets, blended
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.queries.path_smoothing import correct_ends, resample_latent, smooth_latent
from geodesic_motion_ros.queries.posture import Posture, lost_edges, solve_beside, solve_nodes, solve_path, swivel_steps
from geodesic_motion_ros.queries.query import AlongMeanPaths, ArmQuery, End, EndName, Goal, Query, edges_in_scene
from geodesic_motion_ros.queries.query_builder import QueryBuilder
from geodesic_motion_ros.robot.body_points import NO_POINTS
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.sheet import POSE_SCALE
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.checked_numbers import LARGEST_NUMBER, real_array
from geodesic_motion_ros.utils.errors import PlanningError, RobotError


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


@dataclass(frozen=True, eq=False)
class PoseGoal(Goal[Pose]):
    """An accepted goal pose of the tool, which moves with the task frame where it was requested in that.

    pose : in the base frame.
    """

    pose: Pose
    frame: TaskFrame
    stated: str = "the requested pose"

    @property
    def in_task(self) -> Pose:
        """The goal in the task frame."""
        return _in_task(self.frame, self.pose)

    @property
    def outputs(self) -> Sequence[Pose]:
        return (self.in_task,)

    def is_same(self, other: PoseGoal) -> bool:
        return self._is_within(other, constants.SAME_GOAL)

    def is_near(self, other: PoseGoal) -> bool:
        """Whether it is hardly elsewhere, in the base frame and in the task frame, and may wait until the arm rests.

        What tracks an object tells where it is at its rate, moved or not, and each time a little elsewhere: a path that
        is searched anew for that may turn off the present motion, and the tool would stop.
        """
        return self._is_within(other, constants.NEAR_GOAL)

    def _is_within(self, other: PoseGoal, limits: tuple[float, float]) -> bool:
        return self.pose.is_within(other.pose, limits) and self.in_task.is_within(other.in_task, limits)


def _in_task(frame: TaskFrame, pose: Pose) -> Pose:
    return Pose(*frame.to_task(pose.position, pose.quaternion))


@dataclass(frozen=True)
class PostureLift:
    """An arm that holds poses in a posture.

    Attributes
    ----------
    frame : where the task frame stands. posture : that of the base path. swivel : the number of the one of `SWIVELS`
        that it was made with. first : the number of the first with which the arm can hold the base path.
    """

    robot: Robot
    frame: TaskFrame
    posture: Posture
    swivel: int
    first: int

    def configurations_along(self, query: ArmQuery, latent: np.ndarray, start: np.ndarray) -> np.ndarray | Refusal:
        positions, quaternions, progress = _poses_along(query, self.frame, latent)
        path = solve_beside(self.robot, positions, quaternions, start, self.posture, _tau(query, progress))
        return path.refusal(self.robot) or path.configurations

    def turn_to_base(self, covariances: np.ndarray) -> np.ndarray:
        return self.frame.covariances_to_base(covariances)


def _lift_of(query: ArmQuery) -> PostureLift:
    assert isinstance(query.lift, PostureLift)
    return query.lift


def _poses_along(query: Query[Any], frame: TaskFrame, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses (m, 3), (m, 4) of the base frame that a latent curve (m, d) stands for, and its progress (m,)."""
    progress, shares = query.decoded.progress_map(latent)
    displacements = query.offsets.displacements(progress, shares)
    positions, quaternions = query.decoded.decoder.poses(latent)
    positions, quaternions = carried(positions, quaternions, displacements)
    return *frame.to_base(positions, continuous_signs(quaternions)), progress


def _tau(query: Query[Any], progress: np.ndarray) -> np.ndarray:
    """0 at the query's start and 1 at its goal, at progress (n,) of the skill."""
    return blended(progress, query.offsets.start_progress, query.offsets.goal_progress)


class PoseQueryBuilder(QueryBuilder[Pose]):
    """Makes the queries of a skill of tool poses."""

    follows_task_frame = True
    _same_task = constants.SAME_TASK_POSE

    def __init__(
        self,
        skill: Skill,
        graph: PoseGraph,
        settings: PlannerSettings,
        robot: Robot,
        collision: CollisionModel,
        scene: DeclaredScene | None = None,
    ) -> None:
        """As of `QueryBuilder`."""
        self._points = np.array(settings.tool_points, dtype=float)
        self._radii = np.array(settings.tool_radii, dtype=float)
        self._tensors = graph.tensors(self._points)
        super().__init__(skill, graph, settings, robot, collision, scene, POSE_SCALE)

    # ------------------------------------------------------ ends of an arm

    def goal_by_pose(self, pose: Pose, frame: TaskFrame) -> PoseGoal | Refusal:
        goal = PoseGoal(pose, frame)
        return self.goal_refusal(goal.outputs) or goal

    def goal_by_configuration(self, configuration: np.ndarray, frame: TaskFrame) -> PoseGoal | Refusal:
        """The pose of the tool in a configuration (eta,) [rad]; the posture at the goal follows from the start."""
        return self.goal_by_pose(self._pose(configuration), frame)

    def goal_in_place(self, pose: Pose, frame: TaskFrame, standing: np.ndarray) -> PoseGoal | None:
        """None: the posture at the goal follows from the start anyway."""

    def start_by_pose(self, pose: Pose, commanded: np.ndarray | None = None) -> np.ndarray | Refusal:
        """The configuration (eta,) that holds the tool in a pose: the commanded one, where that does; else the one
        nearest to `ready`.
        """
        if commanded is not None and self._pose(commanded).is_within(pose, constants.SAME_START):
            return commanded
        try:
            return solve(self._robot, pose.position, pose.quaternion)
        except RobotError as error:
            return Refusal(VerdictCode.START_OUT_OF_SUPPORT, str(error))

    def in_turn(self, configuration: np.ndarray) -> np.ndarray:
        """The configuration (eta,) itself: nodes are held from where the arm is."""
        return configuration

    def _pose(self, configuration: np.ndarray) -> Pose:
        return Pose(*self._robot.forward(configuration))

    # -------------------------------------------------------------- postures

    def rebuild(self, query: ArmQuery) -> ArmQuery | Refusal:
        lift = _lift_of(query)
        return self._in_posture(self._as_poses(query), lift.frame, query.start, lift.swivel, lift.first)

    def other_posture(self, query: ArmQuery) -> ArmQuery | None:
        lift = _lift_of(query)
        found = self._held(self._as_poses(query), lift.frame, query.start, after=lift)
        return None if isinstance(found, Refusal) else found

    def first_posture(self, query: ArmQuery) -> ArmQuery:
        """Return the query in the posture that follows from the start by steps of least norm, or in the next that
        serves; itself, where it is in that.
        """
        lift = _lift_of(query)
        if lift.swivel == lift.first:
            # What has been tried on a query is known of that one alone.
            return query
        found = self._held(self._as_poses(query), lift.frame, query.start)
        assert not isinstance(found, Refusal)
        return found

    def _as_poses(self, query: ArmQuery) -> Query[Pose]:
        """The query as it was before the arm held it."""
        transported = self._between(*query.ends, query.task_start, query.along_mean_paths)
        return replace(transported, displaced=query.displaced)

    def _held(
        self, query: Query[Pose], frame: TaskFrame, start: np.ndarray, after: PostureLift | None = None
    ) -> ArmQuery | Refusal:
        """A query of poses for the arm in a configuration (eta,) at its start, with the first swivel, or the first
        after that of a posture, with which it can hold the base path; or why it cannot with the first of them.
        """
        refusal: Refusal | None = None
        for swivel in range(0 if after is None else after.swivel + 1, len(constants.SWIVELS)):
            found = self._in_posture(query, frame, start, swivel, swivel if after is None else after.first)
            if not isinstance(found, Refusal):
                return found
            refusal = refusal or found
        return refusal or Refusal(VerdictCode.NO_FEASIBLE_PATH, "no other posture is left", query.misfits)

    def _in_posture(
        self, query: Query[Pose], frame: TaskFrame, start: np.ndarray, swivel: int, first: int
    ) -> ArmQuery | Refusal:
        """A query of poses with the arm in the posture that follows from a configuration (eta,) and a swivel."""
        source = self._graph.node_near(query.start_latent, np.isfinite(query.to_goal), 3)
        if source is None:
            reason = "the start is connected to no part of what was demonstrated"
            return Refusal(VerdictCode.START_OUT_OF_SUPPORT, reason, query.misfits)
        adjacency = self._graph.adjacency
        nodes, _, _ = shortest_free_path(adjacency, query.graph.base, query.to_goal, source, query.goal_node)
        posture = self._posture(query, frame, nodes, start, swivel)
        if isinstance(posture, Refusal):
            return replace(posture, figures=query.misfits)
        graph: Any = query.graph
        tau = _tau(query, self._graph.progress)
        positions, quaternions = frame.to_base(graph.positions, graph.quaternions)
        configurations, reached = solve_nodes(
            self._robot, positions, quaternions, posture, tau, nodes, adjacency.first, adjacency.node
        )
        lost = lost_edges(graph.edges, configurations, reached, constants.LARGEST_JOINT_STEP)
        points = frame.points_to_base(graph.body_points)
        body = NodeBody.of_arm(configurations, NO_POINTS, np.empty(0), self._collision, self._links, self._robot)
        body = body.felt_at(points, self._radii)
        lost |= edges_in_scene(self._scene, graph, body, source, query.goal_node, self._settings.obstacle_margin)
        to_goal, from_start = query.to_goal, query.from_start
        if np.any(lost):
            graph = graph.without(lost)
            to_goal = cost_field(adjacency, graph.base, query.goal_node)
            from_start = cost_field(adjacency, graph.base, source)
        held: Query[Any] = replace(query, graph=graph, body=body, to_goal=to_goal, from_start=from_start)
        lift = PostureLift(self._robot, frame, posture, swivel, first)
        return replace(held, start=start, goal=posture.configurations[-1], lift=lift)

    def _posture(
        self, query: Query[Pose], frame: TaskFrame, nodes: np.ndarray, start: np.ndarray, swivel: int
    ) -> Posture | Refusal:
        """The posture along the base path, or where and why the arm cannot hold it."""
        polyline = np.concatenate([query.start_latent[None], self._graph.latent[nodes[1:]]])
        latent = smooth_latent(resample_latent(polyline, self._graph.grid.step), constants.BASE_PATH_SMOOTHING)
        positions, quaternions, progress = _poses_along(query, frame, latent)
        goal = frame.to_base(query.goal.position, query.goal.quaternion)
        positions, quaternions = correct_ends(positions, quaternions, self._robot.forward(start), goal)
        tau = np.maximum.accumulate(_tau(query, progress))
        steps = swivel_steps(constants.SWIVELS[swivel], len(tau))
        path = solve_path(self._robot, positions, quaternions, start, steps)
        return path.refusal(self._robot) or Posture(tau, path.configurations, path.nulls)

    # ------------------------------------------------------------- the space

    def _output(self, configuration: np.ndarray, frame: TaskFrame) -> Pose:
        return _in_task(frame, self._pose(configuration))

    def _groups(self, name: EndName) -> list[tuple[np.ndarray, Pose]]:
        if self._skill.canonical is None:
            return []
        mean = self._skill.start_pose if name == "start" else self._skill.goal_pose
        return [(np.ones(len(self._skill.codes), dtype=bool), Pose(mean[:3], mean[3:]))]

    def _decoded(self, latent: np.ndarray) -> Pose:
        positions, quaternions = self._graph.decoder.poses(latent[None])
        return Pose(positions[0], quaternions[0])

    def _nearest_node(self, requested: Pose, piece: int, sigma_limit: float) -> int | None:
        found = self._graph.nearest_node(requested.position, requested.quaternion, piece, sigma_limit)
        return None if found is None else found[0]

    def _difference(self, start: Pose, end: Pose) -> np.ndarray:
        """Translation [m] and rotation vector [rad]."""
        turn = rotation_vector_between(start.quaternion, end.quaternion)
        return np.concatenate([end.position - start.position, turn])

    def _is_same_each_round(self, query: ArmQuery) -> bool:
        """Never: the posture follows from where the arm is, and need not come round."""
        return False

    def _shown(self, values: Sequence[np.ndarray]) -> Pose:
        return Pose(*values)

    def _values(self, output: Pose) -> Sequence[np.ndarray]:
        return output.position, output.quaternion

    def _offsets_of(self, start: Pose, ends: Sequence[np.ndarray]) -> np.ndarray:
        positions, quaternions = ends
        turns = rotation_vector_between(np.broadcast_to(start.quaternion, quaternions.shape), quaternions)
        return np.concatenate([positions - start.position, turns], axis=1)

    def _lengths(self, offset: np.ndarray) -> tuple[float, ...]:
        return float(np.linalg.norm(offset[:3])), float(np.linalg.norm(offset[3:]))

    def _limits(self) -> tuple[float, ...]:
        return self._settings.maximum_offset, self._settings.maximum_offset_angle

    def _stated_misfit(self, end: End[Pose]) -> str:
        (beyond, angle), (limit, limit_angle) = self._lengths(end.beyond), self._limits()
        what = "the nearest pose the skill can reach" if self._skill.canonical is None else "what was demonstrated"
        x, y, z = 1000 * end.beyond[:3]
        return (
            f"{1000 * beyond:.0f} mm ({x:+.0f}, {y:+.0f}, {z:+.0f}) and "
            f"{math.degrees(angle):.0f} deg from {what}; allowed are {1000 * limit:.0f} mm and "
            f"{math.degrees(limit_angle):.0f} deg (settings maximum_offset, maximum_offset_angle)"
        )

    def _preference(self, here: End[Pose], there: End[Pose]) -> float:
        return here.misfit + there.misfit

    def _unmoved_lengths(self, conformal: np.ndarray | None) -> np.ndarray:
        none = Offsets.none(self._graph.mean_path_count)
        lengths: np.ndarray = self._graph.transported(none, self._points, conformal).base
        return lengths

    def _offsets(
        self,
        here: End[Pose],
        there: End[Pose],
        progress: tuple[float, float],
        corrected: np.ndarray,
        corrections: np.ndarray,
    ) -> Offsets:
        start, goal = here.offset - corrected[0], there.offset - corrected[1]
        return Offsets(start, goal, *progress, corrections, self._skill.fade)

    def _carried(
        self, offsets: Offsets, ends: tuple[int, int], along_mean_paths: AlongMeanPaths
    ) -> tuple[WeightedGraph, MetricField, NodeBody]:
        graph = self._graph.transported(offsets, self._points, along_mean_paths.conformal)
        field = self._graph.field(self._tensors, along_mean_paths.mean_paths, self._ridge_strength)
        return graph, field, NodeBody.of_tool(graph.body_points, self._radii)

    def _tool_moved(self, query: ArmQuery, latent: np.ndarray, start: Pose) -> float:
        along, _, _ = _poses_along(query, TaskFrame.identity(), latent[None])
        return float(np.linalg.norm(start.position - along[0]))
