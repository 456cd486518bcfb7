"""ToolQuery: a start configuration and a goal pose, with a skill of tool poses' graph in configurations of the arm.

The decoded poses are transported to the query (`pose_query.PoseQueryBuilder`). The arm holds the poses along the
cheapest path without obstacles, its base path, from the configuration in which it stands; and it holds every other node
in the posture of the base path at the same progress (`posture.py`). The metric stays the one that the skill learned, of
the tool's motion.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.metric_field import MetricField
from geodesic_motion_ros.manifold.node_body import LinkBounds, NodeBody
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.manifold.shortest_path import cost_field, shortest_free_path
from geodesic_motion_ros.manifold.transport import blended
from geodesic_motion_ros.manifold.transported_graph import TransportedGraph
from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.path_smoothing import correct_ends, resample_latent, smooth_latent
from geodesic_motion_ros.planning.pose_query import Pose, PoseQuery, PoseQueryBuilder
from geodesic_motion_ros.planning.posture import Posture, solve_beside, solve_nodes, solve_path, swivel_steps
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.planning.status import Figures, Refusal, VerdictCode
from geodesic_motion_ros.planning.transported_query import edges_in_scene
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import RobotError


@dataclass(frozen=True)
class ToolQuery:
    """The query of a skill of tool poses for an arm: the transported graph, with a configuration at every node.

    Attributes
    ----------
    poses : the query of poses that it was made of, in the task frame. frame : where that frame stands.
    posture : that of the base path. swivel : the number of the one of `SWIVELS` that it was made with.
    start, goal : (eta,) configurations [rad].
    graph : the costs of edges; an edge that the arm cannot follow costs infinitely much.
    body : the arm at every node. to_goal, from_start : (n,) as of `TransportedQuery`.
    """

    poses: PoseQuery
    frame: TaskFrame
    posture: Posture
    swivel: int
    start: np.ndarray
    goal: np.ndarray
    graph: TransportedGraph
    body: NodeBody
    to_goal: np.ndarray
    from_start: np.ndarray
    robot: Robot
    decoded: PoseGraph

    @property
    def start_latent(self) -> np.ndarray:
        """(d,) latent point that is transported onto the start."""
        return self.poses.start_latent

    @property
    def goal_node(self) -> int:
        """The node that is transported onto the goal."""
        return self.poses.goal_node

    def displaced_at(self, progress: np.ndarray) -> float:
        """As of `TransportedQuery`."""
        return self.poses.displaced_at(progress)

    @property
    def cost_limit(self) -> float:
        """Paths that cost more count as blocked."""
        return self.poses.cost_limit

    @property
    def misfits(self) -> Figures:
        """How far both ends are transported, under their names in `Figures`."""
        return self.poses.misfits

    def turned_to_base(self, covariances: np.ndarray) -> np.ndarray:
        """Covariances (m, 3, 3) of positions in the task frame, in the base frame."""
        return self.frame.covariances_to_base(covariances)

    def configurations_along(self, latent: np.ndarray, start: np.ndarray) -> np.ndarray | Refusal:
        """Configurations (m, eta) that hold a latent curve (m, d), the first of them near a configuration (eta,); or
        where and why the arm cannot hold it.
        """
        positions, quaternions, progress = _poses_along(self.decoded, self.poses, self.frame, latent)
        path = solve_beside(self.robot, positions, quaternions, start, self.posture, _tau(self.poses, progress))
        return path.refusal(self.robot) or path.configurations

    @property
    def field(self) -> MetricField:
        """The metric between the nodes."""
        return self.poses.field


def _poses_along(
    graph: PoseGraph, query: PoseQuery, frame: TaskFrame, latent: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses (m, 3), (m, 4) of the base frame that a latent curve (m, d) stands for, and its progress (m,)."""
    progress, shares = graph.progress_map(latent)
    displacements = query.offsets.displacements(progress, shares)
    positions, quaternions = carried(*graph.decoder.poses(latent), displacements)
    return *frame.to_base(positions, continuous_signs(quaternions)), progress


def _tau(query: PoseQuery, progress: np.ndarray) -> np.ndarray:
    """0 at the query's start and 1 at its goal, at progress (n,) of the skill."""
    return blended(progress, query.offsets.start_progress, query.offsets.goal_progress)


@dataclass(frozen=True, eq=False)
class ToolGoal:
    """An accepted goal pose of the tool, which moves with the task frame where it was requested in that.

    Attributes
    ----------
    pose : in the base frame. frame : where the frame that the skill was demonstrated in stands.
    stated : how it was found, for a person.
    """

    pose: Pose
    frame: TaskFrame
    stated: str = "the requested pose"

    @property
    def in_task(self) -> Pose:
        """The goal in the task frame."""
        return _in_task(self.frame, self.pose)

    def is_same(self, other: ToolGoal) -> bool:
        """Whether the same is meant, received again."""
        return self._within(other, constants.SAME_GOAL)

    def is_near(self, other: ToolGoal) -> bool:
        """Whether it is hardly elsewhere, in the base frame and in the task frame, and may wait until the arm rests.

        What tracks an object tells where it is at its rate, moved or not, and each time a little elsewhere: a path that
        is searched anew for that may turn off the present motion, and the tool would stop.
        """
        return self._within(other, constants.NEAR_GOAL)

    def _within(self, other: ToolGoal, limits: tuple[float, float]) -> bool:
        return self.pose.is_within(other.pose, limits) and self.in_task.is_within(other.in_task, limits)


def _in_task(frame: TaskFrame, pose: Pose) -> Pose:
    return Pose(*frame.to_task(pose.position, pose.quaternion))


class ToolQueryBuilder:
    """Finds where on the manifold start and goal lie, and holds the graph between them."""

    follows_task_frame = True

    def __init__(
        self,
        skill: Skill,
        graph: PoseGraph,
        settings: PlannerSettings,
        robot: Robot,
        collision: CollisionModel,
        scene: DeclaredScene | None = None,
    ) -> None:
        """graph : decoded from the skill; collision : the spheres that obstacles are kept away from; scene : what
        always stands around the arm.
        """
        self._settings, self._scene = settings, scene or DeclaredScene.empty()
        self._graph, self._robot, self._collision = graph, robot, collision
        self._links = LinkBounds.of(collision)
        self._radii = np.array(settings.tool_radii, dtype=float)
        self._poses = PoseQueryBuilder(skill, graph, settings)
        self._step = graph.grid.step

    def guarding(self, collision: CollisionModel, settings: PlannerSettings) -> ToolQueryBuilder:
        """The same where other spheres are kept away from obstacles, with another margin."""
        other = copy(self)
        other._collision, other._links, other._settings = collision, LinkBounds.of(collision), settings
        return other

    def rebuilt(self, query: ToolQuery) -> ToolQuery | Refusal:
        """The query of a builder that guards other spheres, with the spheres of this one."""
        return self._in_posture(query.poses, query.frame, query.start, query.swivel)

    def goal_by_pose(self, pose: Pose, frame: TaskFrame) -> ToolGoal | Refusal:
        """A goal pose of the base frame, refused where it is too far from what was demonstrated.

        frame : where the frame that the skill was demonstrated in stands.
        """
        goal = ToolGoal(pose, frame)
        return self._poses.goal_refusal(goal.in_task) or goal

    def goal_by_configuration(self, configuration: np.ndarray, frame: TaskFrame) -> ToolGoal | Refusal:
        """The pose of the tool in a configuration (eta,) [rad]; the posture at the goal follows from the start."""
        return self.goal_by_pose(self._pose(configuration), frame)

    def goal_in_place(self, pose: Pose, frame: TaskFrame, standing: np.ndarray) -> ToolGoal | None:
        """None: the posture at the goal follows from the start anyway."""

    def in_turn(self, configuration: np.ndarray) -> np.ndarray:
        """The configuration (eta,) itself: nodes are held from where the arm is."""
        return configuration

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

    def build(self, start: np.ndarray, goal: ToolGoal) -> ToolQuery | Refusal:
        """Carry the graph to a query that begins in a configuration (eta,), and hold it from there."""
        query = self._poses.build(_in_task(goal.frame, self._pose(start)), goal.in_task)
        return query if isinstance(query, Refusal) else self._for_arm(query, goal.frame, start)

    def redirected(
        self, query: ToolQuery, start: np.ndarray, latent: np.ndarray, goal: ToolGoal
    ) -> ToolQuery | Refusal | None:
        """As `PoseQueryBuilder.redirected`: on from a configuration on the path of an older query."""
        poses = self._poses.redirected(query.poses, _in_task(goal.frame, self._pose(start)), latent, goal.in_task)
        return poses if poses is None or isinstance(poses, Refusal) else self._for_arm(poses, goal.frame, start)

    def _pose(self, configuration: np.ndarray) -> Pose:
        return Pose(*self._robot.forward(configuration))

    def other_posture(self, query: ToolQuery) -> ToolQuery | None:
        """The same query in the next posture in which the arm can hold the base path; None where none is left."""
        found = self._for_arm(query.poses, query.frame, query.start, query.swivel + 1)
        return found if isinstance(found, ToolQuery) else None

    def first_posture(self, query: ToolQuery) -> ToolQuery:
        """The same query in the posture that follows from the start by steps of least norm, or the next that serves."""
        found = self._for_arm(query.poses, query.frame, query.start) if query.swivel else query
        assert isinstance(found, ToolQuery)
        return found

    def _for_arm(self, query: PoseQuery, frame: TaskFrame, start: np.ndarray, first: int = 0) -> ToolQuery | Refusal:
        """A query of poses for the arm in a configuration (eta,) at its start, with the first swivel from a number on
        with which it can hold the base path; or why it cannot with that one.
        """
        refusal: Refusal | None = None
        for swivel in range(first, len(constants.SWIVELS)):
            found = self._in_posture(query, frame, start, swivel)
            if isinstance(found, ToolQuery):
                return found
            refusal = refusal or found
        return refusal or Refusal(VerdictCode.NO_FEASIBLE_PATH, "no other posture is left", query.misfits)

    def _in_posture(self, query: PoseQuery, frame: TaskFrame, start: np.ndarray, swivel: int) -> ToolQuery | Refusal:
        """A query of poses with the arm in the posture that follows from a configuration (eta,) and a swivel."""
        source = self._graph.node_near(query.start_latent, np.isfinite(query.to_goal), 3)
        if source is None:
            reason = "the start is connected to no part of what was demonstrated"
            return Refusal(VerdictCode.START_OUT_OF_SUPPORT, reason, query.misfits)
        nodes, _, _ = shortest_free_path(
            self._graph.adjacency, query.graph.base, query.to_goal, source, query.goal_node
        )
        posture = self._posture(query, frame, nodes, start, swivel)
        if isinstance(posture, Refusal):
            return replace(posture, figures=query.misfits)
        graph = query.graph
        tau = _tau(query, self._graph.progress)
        positions, quaternions = frame.to_base(graph.positions, graph.quaternions)
        configurations, reached = solve_nodes(
            self._robot, positions, quaternions, posture, tau, nodes, self._graph.adjacency.first,
            self._graph.adjacency.node,
        )  # fmt: skip
        first, second = graph.edges.T
        turned = np.max(np.abs(configurations[first] - configurations[second]), axis=1)
        lost = ~(reached[first] & reached[second]) | (turned > constants.LARGEST_JOINT_STEP)
        points = frame.points_to_base(graph.body_points)
        body = NodeBody.of_arm(configurations, points, self._radii, self._collision, self._links, self._robot)
        lost |= edges_in_scene(self._scene, graph, body, source, query.goal_node, self._settings.obstacle_margin)
        to_goal, from_start = query.to_goal, query.from_start
        if np.any(lost):
            graph = graph.without(lost)
            to_goal = cost_field(self._graph.adjacency, graph.base, query.goal_node)
            from_start = cost_field(self._graph.adjacency, graph.base, source)
        return ToolQuery(
            query, frame, posture, swivel, start, posture.configurations[-1], graph, body, to_goal, from_start,
            self._robot, self._graph,
        )  # fmt: skip

    def _posture(
        self, query: PoseQuery, frame: TaskFrame, nodes: np.ndarray, start: np.ndarray, swivel: int
    ) -> Posture | Refusal:
        """The posture along the base path, or where and why the arm cannot hold it."""
        polyline = np.concatenate([query.start_latent[None], self._graph.latent[nodes[1:]]])
        latent = smooth_latent(resample_latent(polyline, self._step), constants.BASE_PATH_SMOOTHING)
        positions, quaternions, progress = _poses_along(self._graph, query, frame, latent)
        goal = frame.to_base(query.goal.position, query.goal.quaternion)
        positions, quaternions = correct_ends(positions, quaternions, self._robot.forward(start), goal)
        tau = np.maximum.accumulate(_tau(query, progress))
        steps = swivel_steps(constants.SWIVELS[swivel], len(tau))
        path = solve_path(self._robot, positions, quaternions, start, steps)
        return path.refusal(self._robot) or Posture(tau, path.configurations, path.nulls)
