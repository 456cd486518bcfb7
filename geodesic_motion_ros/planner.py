"""ReactivePlanner: goal, obstacles and the present pose -> reference and verdict, once per tick. Knows nothing of ROS.

A *query* is a pair of start and goal poses with the latent graph transported to it: decoded nodes are carried by the
offsets of both ends, so paths begin and end where they were asked to, and obstacles are met where the robot will
really be. While the start moves along its own reference the query stays; only the search is repeated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from geodesic_motion_ros.certificate import curve_clearances, rotation_allowance
from geodesic_motion_ros.errors import PlanningError
from geodesic_motion_ros.graph.ambient import ambient_factors, clearances
from geodesic_motion_ros.graph.decoder import rms_sigma
from geodesic_motion_ros.graph.latent_graph import EdgeEnergies, LatentGraph, Offsets, tool_points
from geodesic_motion_ros.graph.shortest_path import cost_field, shortest_path
from geodesic_motion_ros.quaternions import (
    angle_between,
    continuous_signs,
    normalise,
    rotation_vector_between,
)
from geodesic_motion_ros.reference import (
    TaskSpaceReference,
    correct_ends,
    resample_latent,
    smooth_latent,
    timed_reference,
)
from geodesic_motion_ros.skill import ENDPOINT_MULTIPLE, Skill
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: The smoothed curve may leave the pruned nodes by this factor of sigma before it counts as unsupported.
_CURVE_SIGMA_MULTIPLE = 1.2
#: What is tried in one tick until a curve is certified: multiples of the obstacle margin, and for each of them
#: smoothing widths in grid steps.
_MARGIN_MULTIPLES = (1.0, 2.5)
_SMOOTHING_WIDTHS = (1.5, 0.7, 0.0)
#: A path may enter the graph this many grid steps from the start.
_ENTRY_STEPS = 3
#: A stream's pose is looked for on the first seconds of its reference only: a task may pass the same place again.
_LOCATE_WITHIN = 0.5
#: How far a rotation counts against a distance when a pose is looked for on a curve.
_METRES_PER_RADIAN = 0.1
#: Dense samples of the published curve per grid step.
_SAMPLES_PER_STEP = 1.5


@dataclass(frozen=True)
class PlannerSettings:
    """What a user may choose. Lengths in metres, angles in radians.

    Attributes
    ----------
    tool_points, tool_radii : spheres (K, 3), (K,) fixed in the tool frame that obstacles are kept away from.
    obstacle_margin : clearance the search keeps from obstacles; the certificate asks for more than 0.
    ambient_strength, ambient_width_ratio : zeta, and Gaussian width over (obstacle + tool radius), of the soft metric.
    maximum_offset, maximum_offset_angle : largest distance of start and goal from the manifold.
    reanchor_distance, reanchor_angle : a start further than this from the current reference begins a new query.
    speed, angular_speed, acceleration : limits of the reference [m/s, rad/s, m/s^2].
    avoidance : False ignores obstacles altogether; for control experiments only.
    grid_shape, neighbours : of the latent graph.
    """

    tool_points: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),)
    tool_radii: tuple[float, ...] = (0.04,)
    obstacle_margin: float = 0.005
    ambient_strength: float = 1000.0
    ambient_width_ratio: float = 0.5
    maximum_offset: float = 0.05
    maximum_offset_angle: float = 0.5
    reanchor_distance: float = 0.02
    reanchor_angle: float = 0.1
    speed: float = 0.2
    angular_speed: float = 0.8
    acceleration: float = 0.5
    avoidance: bool = True
    grid_shape: tuple[int, ...] = (100, 100)
    neighbours: int = 16

    def __post_init__(self) -> None:
        if len(self.tool_points) != len(self.tool_radii) or not self.tool_points:
            raise PlanningError(
                f"{len(self.tool_points)} tool points and {len(self.tool_radii)} tool radii: "
                "give one radius per point, and at least one"
            )
        if np.shape(self.tool_points)[1:] != (3,) or not np.all(np.isfinite(self.tool_points)):
            raise PlanningError("tool_points must be finite (x, y, z) triples in the tool frame [m]")
        if min(self.tool_radii) < 0.0:
            raise PlanningError(f"tool radii {self.tool_radii} must not be negative [m]")
        may_be_zero = ("obstacle_margin", "ambient_strength", "reanchor_distance", "reanchor_angle")
        for setting in fields(self):
            value = getattr(self, setting.name)
            if not isinstance(value, float):
                continue
            allowed = value >= 0.0 if setting.name in may_be_zero else value > 0.0
            if not (allowed and math.isfinite(value)):
                raise PlanningError(f"setting {setting.name} is {value}, must be finite and positive")


@dataclass(frozen=True)
class Plan:
    """Answer of one planning step: a reference only with an OK verdict."""

    reference: TaskSpaceReference | None
    verdict: Verdict


@dataclass(frozen=True)
class Pose:
    """Tool pose in the base frame: position (3,) [m], unit quaternion (4,)."""

    position: np.ndarray
    quaternion: np.ndarray


@dataclass(frozen=True)
class Obstacles:
    """Spheres in the base frame: centres (o, 3), radii (o,) [m]."""

    centres: np.ndarray
    radii: np.ndarray

    @classmethod
    def none(cls) -> Obstacles:
        return cls(np.empty((0, 3)), np.empty(0))


@dataclass(frozen=True)
class _Query:
    """A start and goal with the graph transported to them."""

    goal: Pose
    offsets: Offsets
    goal_node: int
    component: int
    energies: EdgeEnergies
    to_goal: np.ndarray
    misfits: dict[str, float]
    start: Pose
    start_latent: np.ndarray


class ReactivePlanner:
    """Plans on one skill: set a goal, set obstacles, tick.

    `tick` serves one stream of poses and is called by one thread; `plan` answers on its own, from any thread.
    Obstacles are replaced as a whole, so every step sees one consistent set.
    """

    def __init__(self, skill: Skill, settings: PlannerSettings | None = None) -> None:
        self.skill = skill
        self.settings = settings or PlannerSettings()
        self.graph: LatentGraph = skill.graph(self.settings.grid_shape, self.settings.neighbours)
        self._points = np.array(self.settings.tool_points, dtype=float)
        self._point_radii = np.array(self.settings.tool_radii, dtype=float)
        self._obstacles = Obstacles.none()
        self._goal: Pose | None = None
        self._query: _Query | None = None
        self._previous: TaskSpaceReference | None = None

    # ---------------------------------------------------------------- inputs

    def set_goal(self, position: np.ndarray, quaternion: np.ndarray) -> Verdict:
        """Ask for a goal pose, (3,) [m] and (4,) in the skill's base frame.

        The verdict is BAD_INPUT or GOAL_OUT_OF_SUPPORT where the goal is refused; then the old goal stays.
        """
        pose, reason = _checked_pose("goal", position, quaternion)
        if pose is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        verdict = self._goal_verdict(pose)
        if verdict.ok:
            self._goal, self._query, self._previous = pose, None, None
        return verdict

    def clear_goal(self) -> None:
        """Forget the goal; ticks answer NO_GOAL until the next."""
        self._goal = self._query = self._previous = None

    def set_obstacles(self, centres: np.ndarray, radii: np.ndarray) -> Verdict:
        """Replace all obstacles by spheres, centres (o, 3) and radii (o,) [m] in the skill's base frame.

        BAD_INPUT names the first obstacle that is not finite or has no positive radius; then the old ones stay.
        """
        centres = np.array(centres, dtype=float).reshape(-1, 3)
        radii = np.array(radii, dtype=float).reshape(-1)
        if len(centres) != len(radii):
            return Verdict(
                VerdictCode.BAD_INPUT, f"{len(centres)} obstacle centres and {len(radii)} radii: one radius each"
            )
        good = np.all(np.isfinite(centres), axis=1) & np.isfinite(radii) & (radii > 0.0)
        if not np.all(good):
            i = int(np.argmin(good))
            return Verdict(
                VerdictCode.BAD_INPUT,
                f"obstacle {i} has centre {centres[i].tolist()} and radius {radii[i]}: "
                "both must be finite and the radius positive",
            )
        self._obstacles = Obstacles(centres, radii)
        return Verdict(VerdictCode.OK)

    # ------------------------------------------------------------- planning

    def tick(self, position: np.ndarray, quaternion: np.ndarray, speed: float = 0.0) -> Plan:
        """One step of the stream: reference from the present commanded pose to the goal, and the verdict.

        Parameters
        ----------
        position, quaternion : (3,) [m] and (4,) commanded tool pose now; speed : its speed now [m/s].
        """
        start, reason = _checked_pose("state", position, quaternion)
        if start is None:
            return _refusal(VerdictCode.BAD_INPUT, reason)
        if self._goal is None:
            return _refusal(VerdictCode.NO_GOAL, "no goal has been given")
        latent = self._locate(start)
        if latent is None:
            query = self._anchor(start, self._goal)
            if isinstance(query, Verdict):
                return Plan(None, query)
            self._query, self._previous, latent = query, None, query.start_latent
        assert self._query is not None
        plan = self._solve(self._query, start, latent, self._obstacles, speed)
        if plan.reference is not None:
            self._previous = plan.reference
        return plan

    def plan(
        self,
        start_position: np.ndarray,
        start_quaternion: np.ndarray,
        goal_position: np.ndarray,
        goal_quaternion: np.ndarray,
    ) -> Plan:
        """A reference between two poses under the present obstacles; the stream of `tick` is not disturbed."""
        start, start_reason = _checked_pose("start", start_position, start_quaternion)
        goal, goal_reason = _checked_pose("goal", goal_position, goal_quaternion)
        if start is None or goal is None:
            return _refusal(VerdictCode.BAD_INPUT, start_reason or goal_reason)
        verdict = self._goal_verdict(goal)
        if not verdict.ok:
            return Plan(None, verdict)
        query = self._anchor(start, goal)
        if isinstance(query, Verdict):
            return Plan(None, query)
        return self._solve(query, start, query.start_latent, self._obstacles, 0.0)

    # --------------------------------------------------------------- query

    def _goal_verdict(self, goal: Pose) -> Verdict:
        """Whether some trusted part of the manifold lies within the allowed offset of a goal."""
        ends = [self._nearest(goal, component) for component in self._components()]
        distances = [self._misfit(goal, node) for node in ends if node is not None]
        if not distances:
            return Verdict(VerdictCode.GOAL_OUT_OF_SUPPORT, "the skill has no supported latent point at all")
        return self._offset_verdict("goal", min(distances), VerdictCode.GOAL_OUT_OF_SUPPORT)

    def _offset_verdict(self, end: str, misfit: tuple[float, float], code: VerdictCode) -> Verdict:
        distance, angle = misfit
        offsets = {f"{end}_offset": distance, f"{end}_offset_angle": angle}
        limit, limit_angle = self.settings.maximum_offset, self.settings.maximum_offset_angle
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
        counts = np.bincount(self.graph.component)
        return np.flatnonzero(counts >= max(2, 0.05 * counts.max()))

    def _nearest(self, pose: Pose, component: int) -> int | None:
        limit = ENDPOINT_MULTIPLE * self.skill.sigma_support
        found = self.graph.nearest_node(pose.position, pose.quaternion, component, limit)
        return None if found is None else found[0]

    def _misfit(self, pose: Pose, node: int) -> tuple[float, float]:
        """Distance [m] and angle [rad] between a pose and a decoded node."""
        decoded = self.graph.decoded
        distance = float(np.linalg.norm(decoded.positions[node] - pose.position))
        return distance, float(angle_between(decoded.quaternions[node], pose.quaternion))

    def _anchor(self, start: Pose, goal: Pose) -> _Query | Verdict:
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
        energies = self.graph.transported(offsets, self._points)
        return _Query(
            goal=goal,
            offsets=offsets,
            goal_node=goal_node,
            component=int(component),
            energies=energies,
            to_goal=cost_field(self.graph.adjacency, energies.fixed, energies.shares, goal_node),
            misfits={
                "start_offset": start_misfit[0], "start_offset_angle": start_misfit[1],
                "goal_offset": goal_misfit[0], "goal_offset_angle": goal_misfit[1],
            },
            start=start,
            start_latent=self.graph.latent[start_node],
        )  # fmt: skip

    def _offsets(self, start: Pose, start_node: int, goal: Pose, goal_node: int) -> Offsets:
        decoded, progress = self.graph.decoded, self.graph.progress
        return Offsets(
            start.position - decoded.positions[start_node],
            goal.position - decoded.positions[goal_node],
            rotation_vector_between(decoded.quaternions[start_node], start.quaternion),
            rotation_vector_between(decoded.quaternions[goal_node], goal.quaternion),
            float(progress[start_node]),
            float(progress[goal_node]),
        )

    def _locate(self, pose: Pose) -> np.ndarray | None:
        """Latent point of a pose on the reference being followed; None where a new query must begin."""
        if self._query is None:
            return None
        reference = self._previous
        if reference is None:
            anchor = self._query.start
            moved = np.linalg.norm(pose.position - anchor.position)
            turned = angle_between(pose.quaternion, anchor.quaternion)
            return self._query.start_latent if self._near(float(moved), float(turned)) else None
        near = min(len(reference.times), int(np.searchsorted(reference.times, _LOCATE_WITHIN)) + 2)
        begin, step = reference.positions[: near - 1], np.diff(reference.positions[:near], axis=0)
        along = np.sum((pose.position - begin) * step, axis=1)
        share = np.clip(along / np.maximum(np.sum(step**2, axis=1), 1e-18), 0.0, 1.0)
        distance = np.linalg.norm(begin + share[:, None] * step - pose.position, axis=1)
        angle = angle_between(reference.quaternions[: near - 1], pose.quaternion)
        i = int(np.argmin(distance + _METRES_PER_RADIAN * angle))
        if not self._near(float(distance[i]), float(angle[i])):
            return None
        return reference.latent[i] + share[i] * (reference.latent[i + 1] - reference.latent[i])

    def _near(self, distance: float, angle: float) -> bool:
        return distance <= self.settings.reanchor_distance and angle <= self.settings.reanchor_angle

    # --------------------------------------------------------------- solve

    def _solve(self, query: _Query, start: Pose, start_latent: np.ndarray, obstacles: Obstacles, speed: float) -> Plan:
        """Reweight once; then search, smooth, decode, certify and time until an attempt is certified."""
        settings, energies = self.settings, query.energies
        avoided = obstacles if settings.avoidance else Obstacles.none()
        ends = self._end_clearance(query, start, avoided)
        if isinstance(ends, Plan):
            return ends
        factors = ambient_factors(
            energies.body_points, self._point_radii, avoided.centres, avoided.radii,
            settings.ambient_strength, settings.ambient_width_ratio,
        )  # fmt: skip
        free = clearances(energies.body_points, self._point_radii, avoided.centres, avoided.radii)
        # The goal itself was found free; its node lies under it but for rounding.
        free[query.goal_node] = math.inf
        for multiple in _MARGIN_MULTIPLES:
            # Ends closer to an obstacle than the margin may stay so, but the path must not come closer than they are.
            margin = min(multiple * settings.obstacle_margin, 0.5 * ends)
            found = self._search(query, start_latent, factors, free < margin)
            if isinstance(found, Plan):
                return found
            for width in _SMOOTHING_WIDTHS:
                plan = self._certified(query, start, *found, obstacles, width, speed)
                if plan.reference is not None:
                    return plan
        return plan

    def _end_clearance(self, query: _Query, start: Pose, obstacles: Obstacles) -> float | Plan:
        """Smaller clearance [m] of start and goal, or the refusal where one of them is covered."""
        positions = np.stack([start.position, query.goal.position])
        quaternions = np.stack([start.quaternion, query.goal.quaternion])
        body = tool_points(positions, quaternions, self._points)
        here, there = clearances(body, self._point_radii, obstacles.centres, obstacles.radii)
        if here <= 0.0:
            reason = f"the tool overlaps an obstacle by {-1000 * here:.0f} mm where it stands"
            return _refusal(VerdictCode.IN_COLLISION, reason, query, clearance=float(here))
        if there <= 0.0:
            reason = f"an obstacle covers the goal by {-1000 * there:.0f} mm"
            return _refusal(VerdictCode.NO_FEASIBLE_PATH, reason, query)
        return float(min(here, there))

    def _search(
        self, query: _Query, start_latent: np.ndarray, factors: np.ndarray, blocked: np.ndarray
    ) -> tuple[np.ndarray, float] | Plan:
        """Latent polyline (m, d) of the cheapest path and its largest energy per edge, or the refusal."""
        allowed = ~blocked & (self.graph.component == query.component)
        source = self.graph.node_near(start_latent, allowed, _ENTRY_STEPS)
        if source is None:
            return _refusal(VerdictCode.NO_FEASIBLE_PATH, "obstacles leave no free node near the start", query)
        energies = query.energies
        nodes, edges, cost = shortest_path(
            self.graph.adjacency, energies.fixed, energies.shares, factors, blocked,
            query.to_goal, source, query.goal_node,
        )  # fmt: skip
        if not math.isfinite(cost):
            reason = "obstacles block every way to the goal that was demonstrated"
            return _refusal(VerdictCode.NO_FEASIBLE_PATH, reason, query)
        energy = float(np.max(energies.without_obstacles[edges], initial=0.0))
        return self._polyline(start_latent, nodes), energy

    def _polyline(self, start: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Latent start followed by the path's nodes, less the first node where it lies behind the start."""
        points = self.graph.latent[nodes]
        if len(points) > 1 and (points[1] - points[0]) @ (start - points[0]) > 0.0:
            points = points[1:]
        return np.concatenate([start[None], points])

    def _certified(
        self,
        query: _Query,
        start: Pose,
        polyline: np.ndarray,
        energy: float,
        obstacles: Obstacles,
        width: float,
        speed: float,
    ) -> Plan:
        """Smooth, decode, transport, meet the ends exactly, judge the very curve that will be published, time it."""
        settings = self.settings
        step = float(np.min(self.graph.grid.spacing)) / _SAMPLES_PER_STEP
        latent = smooth_latent(resample_latent(polyline, step), width * _SAMPLES_PER_STEP)
        decoded = self.graph.decoder.decode(latent)
        positions, quaternions = query.offsets.apply(
            decoded.positions, decoded.quaternions, self.graph.progress_map(latent)
        )
        quaternions = continuous_signs(quaternions)
        if quaternions[0] @ start.quaternion < 0.0:
            quaternions = -quaternions
        positions, quaternions = correct_ends(
            positions, quaternions, (start.position, start.quaternion), (query.goal.position, query.goal.quaternion)
        )
        clearance = curve_clearances(
            tool_points(positions, quaternions, self._points), self._point_radii,
            rotation_allowance(angle_between(quaternions[1:], quaternions[:-1]), self._points),
            obstacles.centres, obstacles.radii,
        )  # fmt: skip
        verdict = self._path_verdict(query, float(np.max(rms_sigma(decoded.sigma))), energy, float(np.min(clearance)))
        if not verdict.ok:
            return Plan(None, verdict)
        reference = timed_reference(
            positions, quaternions, latent, clearance,
            settings.speed, settings.angular_speed, settings.acceleration, speed,
        )  # fmt: skip
        return Plan(reference, verdict)

    def _path_verdict(self, query: _Query, sigma: float, energy: float, clearance: float) -> Verdict:
        """Judge a path by its largest rms sigma [m], its largest energy of one edge and its clearance [m]."""
        in_support = sigma <= _CURVE_SIGMA_MULTIPLE * self.skill.sigma_limit
        found = dict(clearance=clearance, energy_per_edge=energy, in_support=in_support, **query.misfits)
        if self.settings.avoidance and clearance <= 0.0:
            reason = f"the best path would touch an obstacle (clearance {1000 * clearance:.1f} mm)"
        elif not in_support:
            reason = "the best path leaves the part of the latent space that demonstrations support"
        elif energy > self.skill.energy_per_edge:
            reason = (
                f"the best path has an edge of energy {energy:.3g}, demonstrations stay below "
                f"{self.skill.energy_per_edge:.3g}: it crosses where nobody moved"
            )
        else:
            return Verdict(VerdictCode.OK, **found)
        return Verdict(VerdictCode.NO_FEASIBLE_PATH, reason, **found)


def _refusal(code: VerdictCode, reason: str, query: _Query | None = None, clearance: float = math.nan) -> Plan:
    """No reference, and why; what is known of the query's ends goes with it."""
    return Plan(None, Verdict(code, reason, clearance=clearance, **(query.misfits if query else {})))


def _checked_pose(end: str, position: np.ndarray, quaternion: np.ndarray) -> tuple[Pose | None, str]:
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
