"""PosePathPlanner: start pose, goal pose and obstacles -> path of tool poses with its figures, without a robot.

The latent graph is transported to start and goal (`query`), reshaped by the obstacles, searched, and the path found is
smoothed, decoded and certified. A path has no time: obstacles stand where they are. All poses and obstacles are in the
frame that the skill was demonstrated in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.certification.path_clearance import curve_clearances, rotation_allowance
from geodesic_motion_ros.contract.settings import MARGIN_MULTIPLES, SMOOTHING_WIDTHS, PlannerSettings
from geodesic_motion_ros.contract.status import Figures, Refusal, Verdict, VerdictCode
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.quaternions import angle_between, continuous_signs
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.manifold.ambient_metric import obstacle_clearances
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.obstacles.obstacles import Obstacles, nearness
from geodesic_motion_ros.queries.path_smoothing import correct_ends, resample_latent, smooth_latent, smooth_poses
from geodesic_motion_ros.queries.pose_query import PoseQueryBuilder, checked_pose
from geodesic_motion_ros.queries.query import PoseQuery
from geodesic_motion_ros.queries.search import LatentPath, cheapest_path, judge_path
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill


@dataclass(frozen=True)
class PosePath(PoseCurve):
    """A certified path of m tool poses from the requested start to the requested goal.

    Between samples positions are interpolated linearly and orientations on great circles, as `PoseCurve` does.

    Attributes
    ----------
    latent : (m, d) latent points that the poses were decoded from.
    figures : the clearance is that of the tool's spheres along the path.
    """

    latent: np.ndarray
    figures: Figures


@dataclass(frozen=True)
class DecodedPath(PoseCurve):
    """Tool poses decoded from latent points (m, d) and transported to a query; sigma : (m, D) of the decoder."""

    latent: np.ndarray
    sigma: np.ndarray


class PosePathPlanner:
    """A planner of paths of tool poses on one task-space skill among the obstacles set last."""

    def __init__(self, skill: Skill, settings: PlannerSettings | None = None) -> None:
        self.skill = skill
        self.settings = settings or PlannerSettings()
        graph = skill.graph(self.settings.grid_shape, self.settings.neighbours)
        assert isinstance(graph, PoseGraph)
        self.graph = graph
        arm = Robot.named(skill.robot), CollisionModel.named(skill.robot)
        self._queries = PoseQueryBuilder(skill, self.graph, self.settings, *arm)
        self._points = np.array(self.settings.tool_points, dtype=float)
        self._point_radii = np.array(self.settings.tool_radii, dtype=float)
        self._obstacles = Obstacles.none()

    def set_obstacles(self, centres: np.ndarray, radii: np.ndarray) -> Verdict:
        """Replace all obstacles by spheres, centres (o, 3) and radii (o,) [m].

        BAD_INPUT names the first obstacle that is not finite or has no positive radius; then the old ones stay.
        """
        spheres = checked_spheres(centres, radii)
        return spheres if isinstance(spheres, Refusal) else self.take_obstacles(spheres)

    def take_obstacles(self, obstacles: Obstacles) -> Verdict:
        """Replace all obstacles by others of every kind, at the places where they are now: velocities are ignored.

        BAD_INPUT names the first that is invalid; then the old ones stay.
        """
        objection = obstacles.objection()
        if objection:
            return Refusal(VerdictCode.BAD_INPUT, objection)
        self._obstacles = obstacles.swept(0.0, count=1).distinct()
        return Verdict()

    def plan(
        self,
        start_position: np.ndarray,
        start_quaternion: np.ndarray,
        goal_position: np.ndarray,
        goal_quaternion: np.ndarray,
    ) -> PosePath | Refusal:
        """Plan the path between two poses, (3,) [m] and (4,) each, or why there is none.

        BAD_INPUT, START_OUT_OF_SUPPORT, GOAL_OUT_OF_SUPPORT: as of `query`. IN_COLLISION: the tool overlaps an obstacle
        at the start. NO_FEASIBLE_PATH: an obstacle covers the goal, or no path is certified.
        """
        query = self.query(start_position, start_quaternion, goal_position, goal_quaternion)
        if isinstance(query, Refusal):
            return query
        obstacles = self._obstacles if self.settings.avoidance else Obstacles.none()
        here, there = (self._clearance_at(pose, obstacles) for pose in (query.start, query.goal))
        if not here > 0.0:
            reason = f"the tool overlaps an obstacle by {-1000 * here:.0f} mm where it stands"
            return Refusal(VerdictCode.IN_COLLISION, reason, replace(query.misfits, clearance=here))
        if not there > 0.0:
            reason = f"an obstacle covers the goal by {-1000 * there:.0f} mm"
            return Refusal(VerdictCode.NO_FEASIBLE_PATH, reason, query.misfits)
        return self._searched(query, evaluation_of(query, obstacles, self.settings), min(here, there))

    def query(
        self,
        start_position: np.ndarray,
        start_quaternion: np.ndarray,
        goal_position: np.ndarray,
        goal_quaternion: np.ndarray,
    ) -> PoseQuery | Refusal:
        """Return the graph transported to a start and a goal, as of `plan`, or why it cannot be.

        BAD_INPUT: numbers that are not finite, or not of a pose. START_OUT_OF_SUPPORT, GOAL_OUT_OF_SUPPORT: a pose too
        far from what was demonstrated.
        """
        start = checked_pose("start", start_position, start_quaternion)
        if isinstance(start, Refusal):
            return start
        goal = checked_pose("goal", goal_position, goal_quaternion)
        if isinstance(goal, Refusal):
            return goal
        return self._queries.goal_refusal([goal]) or self._queries.transport(start, [goal])

    def _clearance_at(self, pose: Pose, obstacles: Obstacles) -> float:
        """Clearance [m] of the tool's spheres at a pose."""
        body = tool_points(pose.position[None], pose.quaternion[None], self._points)
        return float(obstacle_clearances(body, self._point_radii, obstacles, np.inf)[0])

    def _searched(self, query: PoseQuery, evaluation: NodeEvaluation, at_ends: float) -> PosePath | Refusal:
        """Search and smooth until an attempt is certified; at_ends : smaller clearance [m] of start and goal."""
        refused: Refusal | None = None
        for multiple in MARGIN_MULTIPLES:
            # Ends closer to an obstacle than the margin may stay so, but the path must not come closer than they are.
            margin = min(multiple * self.settings.obstacle_margin, 0.5 * at_ends)
            found = cheapest_path(self.graph, query, query.start_latent, evaluation, margin)
            if isinstance(found, Refusal):
                return found
            for widths in SMOOTHING_WIDTHS:
                path = self._certified(query, found, widths)
                if isinstance(path, PosePath):
                    return path
                refused = path
        assert refused is not None
        return refused

    def _certified(self, query: PoseQuery, found: LatentPath, widths: tuple[float, float]) -> PosePath | Refusal:
        """Smooth and decode a latent path, meet both ends exactly, and judge the poses."""
        path = smooth_path(self.graph, query, found.polyline, widths)
        start, goal = ((pose.position, pose.quaternion) for pose in (query.start, query.goal))
        correction = max(float(np.linalg.norm(path.positions[at] - end[0])) for at, end in ((0, start), (-1, goal)))
        curve = PoseCurve(*correct_ends(path.positions, path.quaternions, start, goal))
        nearest = self._clearance_along(curve)
        objection = ""
        if self.settings.avoidance and not nearest > 0.0:
            objection = f"the best path {nearness(nearest)}"
        figures = judge_path(self.skill, self.graph, query, path.sigma, found, nearest, correction, objection)
        if isinstance(figures, Refusal):
            return figures
        return PosePath(curve.positions, continuous_signs(curve.quaternions), path.latent, figures)

    def _clearance_along(self, curve: PoseCurve) -> float:
        """Guaranteed clearance [m] of the tool's spheres along a curve, between its samples too; inf without any."""
        points = tool_points(curve.positions, curve.quaternions, self._points)
        turned = angle_between(curve.quaternions[1:], curve.quaternions[:-1])
        allowances = rotation_allowance(turned, self._points)
        return float(np.min(curve_clearances(points, self._point_radii, allowances, self._obstacles)))


def checked_spheres(centres: np.ndarray, radii: np.ndarray) -> Obstacles | Refusal:
    """Return spheres, centres (o, 3) and radii (o,) [m], as obstacles; BAD_INPUT where the shapes are others."""
    centres, radii = np.array(centres, dtype=float), np.array(radii, dtype=float)
    if centres.size == radii.size == 0:
        return Obstacles.none()
    if radii.ndim != 1 or centres.shape != (len(radii), 3):
        reason = f"obstacle centres have shape {centres.shape} and radii {radii.shape}: expected (o, 3) and (o,)"
        return Refusal(VerdictCode.BAD_INPUT, reason)
    return Obstacles.of_spheres(centres, radii)


def evaluation_of(query: PoseQuery, obstacles: Obstacles, settings: PlannerSettings) -> NodeEvaluation:
    """Return the query's graph among obstacles, for searches with any of the margins of `MARGIN_MULTIPLES`."""
    return NodeEvaluation.of(
        query.body, obstacles, settings.ambient_strength, settings.ambient_width_ratio,
        max(MARGIN_MULTIPLES) * settings.obstacle_margin, settings.ambient_law,
    )  # fmt: skip


def decode_path(graph: PoseGraph, query: PoseQuery, latent: np.ndarray) -> DecodedPath:
    """Return the poses that latent points (m, d) stand for between the query's ends."""
    decoded = graph.decoder.decode(latent)
    displacements = query.offsets.displacements(*graph.progress_map(latent))
    positions, quaternions = carried(decoded.positions, decoded.quaternions, displacements)
    return DecodedPath(positions, continuous_signs(quaternions), latent, decoded.sigma)


def smooth_path(graph: PoseGraph, query: PoseQuery, polyline: np.ndarray, widths: tuple[float, float]) -> DecodedPath:
    """Smooth a latent polyline (p, d), decode it, and smooth it again; it begins in the hemisphere of the query's
    start.

    widths : of both smoothings, in grid steps; the path has a sample for each step.
    """
    step = graph.grid.step
    path = decode_path(graph, query, smooth_latent(resample_latent(polyline, step), widths[0]))
    positions, quaternions = smooth_poses(path.positions, path.quaternions, widths[1])
    if quaternions[0] @ query.start.quaternion < 0.0:
        quaternions = -quaternions
    return DecodedPath(positions, quaternions, path.latent, path.sigma)
