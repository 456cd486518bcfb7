"""Solver: one query -> a certified joint reference and its verdict. Knows nothing of ROS.

Reweight, search, refine, smooth, decode, transport, time, certify: what a tick of `planner.ReactivePlanner`
does when its reference cannot stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from geodesic_motion_ros.arm_certificate import ArmCertifier, SweptArm
from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.demonstrations.curves import arc_length_fractions
from geodesic_motion_ros.graph.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.graph.metric_field import MetricField
from geodesic_motion_ros.graph.pose_graph import PoseGraph
from geodesic_motion_ros.graph.refinement import refined
from geodesic_motion_ros.graph.reshaping import Reshaping
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_reference import JointReference
from geodesic_motion_ros.joint_timing import timed_joint_reference
from geodesic_motion_ros.latent_way import LatentWay, WayQuery, cheapest_way, same_way, way_verdict
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import MOVING_MULTIPLE, PlannerSettings
from geodesic_motion_ros.planning.mode import Mode
from geodesic_motion_ros.planning.path_smoothing import resample_latent, smooth_latent
from geodesic_motion_ros.refuge import ways_aside
from geodesic_motion_ros.robot.collision_model import CollisionModel, obstacle_clearance
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.verdict import Verdict, VerdictCode


class Attempt(NamedTuple):
    """A multiple of the obstacle margin, whether the way is refined, and the width in grid steps of the smoothing,
    first in the latent space, then decoded: refined ways have no corners of the grid.

    trusting : what moves will have left the way by the time that the arm comes there: it is not counted beyond the
        prediction.
    """

    multiple: float
    refine: bool
    width: float
    trusting: bool = False


#: What is tried until a curve is certified. Keeping further off helps more often than cutting less.
_ATTEMPTS = (
    Attempt(1.0, True, 1.0), Attempt(1.0, False, 2.0), Attempt(4.0, True, 1.0), Attempt(4.0, False, 2.0),
    Attempt(4.0, False, 1.0), Attempt(1.0, True, 1.0, trusting=True), Attempt(1.0, False, 2.0, trusting=True),
)  # fmt: skip
_LARGEST_MULTIPLE = max(attempt.multiple for attempt in _ATTEMPTS)
#: Where to give way to is looked for so many grid steps around.
_REFUGE_STEPS = 15
#: So many motions from one state are remembered.
_MOST_REMEMBERED = 32
#: Samples of the curve per grid step.
_SAMPLES_PER_STEP = 1.0


class HeldQuery(WayQuery, Protocol):
    """A `WayQuery` whose nodes are configurations of an arm of eta joints.

    Attributes
    ----------
    start, goal : (eta,) configurations [rad]; start_latent : (d,) latent point that is carried onto the start.
    field : the metric between the nodes.
    """

    start: np.ndarray
    goal: np.ndarray
    start_latent: np.ndarray
    field: MetricField

    def configurations_along(self, latent: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, str]:
        """Configurations (m, eta) of a latent curve (m, d), the first of them near a configuration (eta,), and where
        and why the arm cannot hold it, "" where it can.
        """
        ...


@dataclass(frozen=True)
class Plan:
    """Answer of one planning step.

    Attributes
    ----------
    reference : what is to be played from `begin` on, in the place of everything before; None: what is being played
        stays, or the arm stands.
    begin : time of the reference's first knot [s].
    verdict : OK comes with a way to the goal. With any other verdict the reference is a stop, or leads aside.
    nodes : of the graph that the way was found along, where the first attempt found it.
    trusting : as of `Attempt`.
    mode : what the arm does after the tick.
    """

    reference: JointReference | None
    begin: float
    verdict: Verdict
    nodes: np.ndarray | None = None
    trusting: bool = False
    mode: Mode = Mode.IDLE


@dataclass(frozen=True)
class MotionState:
    """State of motion in which a new reference takes over, at `time` [s]: (eta,) each, and its latent point (d,)."""

    time: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    latent: np.ndarray | None


@dataclass(frozen=True)
class _Timed:
    """A way smoothed into a latent curve (m, d), held and timed; or why it is not, without a reference.

    correction : how far its ends were moved [rad]. swept : where the reference takes the arm.
    """

    latent: np.ndarray
    objection: str = ""
    correction: float = 0.0
    reference: JointReference | None = None
    swept: SweptArm | None = None


class _Memory(NamedTuple):
    """What was timed of one query from one state of motion: an arm that waits finds the same ways again and again."""

    query: HeldQuery
    state: MotionState
    timed: dict[tuple[bytes, float, bool], _Timed]

    def is_of(self, query: HeldQuery, state: MotionState) -> bool:
        names = ("position", "velocity", "acceleration")
        return self.query is query and all(
            np.array_equal(getattr(self.state, name), getattr(state, name)) for name in names
        )


class Solver:
    """Plans single paths on one skill; holds no state that an answer depends on."""

    def __init__(
        self,
        skill: Skill,
        graph: ConfigurationGraph | PoseGraph,
        settings: PlannerSettings,
        robot: Robot,
        collision: CollisionModel,
        limits: JointLimits,
    ) -> None:
        self.skill, self.graph, self.settings, self.robot = skill, graph, settings, robot
        self.collision, self.limits = collision, limits
        self.tool = LimitedTool(robot, settings.tool_limits(isinstance(graph, PoseGraph)))
        self.attempts = tuple(attempt for attempt in _ATTEMPTS if settings.refine or not attempt.refine)
        self.certifier = ArmCertifier(robot, collision)
        self._memory: _Memory | None = None

    @property
    def cautious(self) -> tuple[Attempt, ...]:
        """The attempts that are not trusting."""
        return _alike(self.attempts, False)

    @property
    def trusting(self) -> tuple[Attempt, ...]:
        """Those that are."""
        return _alike(self.attempts, True)

    def solve(
        self,
        query: HeldQuery,
        state: MotionState,
        obstacles: Obstacles,
        attempts: tuple[Attempt, ...],
        deadline: Deadline = NEVER,
        known: np.ndarray | None = None,
    ) -> Plan:
        """Search, refine, smooth, decode, time, certify: until an attempt is certified, or the deadline has passed.

        known : nodes of a way that needs no second look: where the search finds it again, that is the answer, OK.
        """
        plan = self._first_certified(query, state, obstacles, _alike(attempts, False), deadline, known)
        trusting = _alike(attempts, True)
        blocked = plan.reference is None and plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        if blocked and trusting and not obstacles.stand and not deadline.passed:
            other = self._first_certified(query, state, obstacles, trusting, deadline)
            if other.reference is not None:
                return replace(other, trusting=True)
        return plan

    def _first_certified(
        self,
        query: HeldQuery,
        state: MotionState,
        obstacles: Obstacles,
        attempts: tuple[Attempt, ...],
        deadline: Deadline,
        known: np.ndarray | None = None,
    ) -> Plan:
        """`solve` with attempts of which all are trusting, or none."""
        settings = self.settings
        avoided = obstacles if settings.avoidance else Obstacles.none()
        ends = self._end_clearance(query, state, avoided, attempts[0].trusting)
        if isinstance(ends, Verdict):
            return Plan(None, state.time, ends)
        swept = avoided.at_rest() if attempts[0].trusting else avoided.swept(settings.prediction)
        reshaping = self._reshaping(query, swept)
        start = query.start_latent if state.latent is None else state.latent
        # Ends closer to an obstacle than a margin may stay so, but the path must not come closer than they are.
        margin = 0.0 if obstacles.stand else min(MOVING_MULTIPLE * settings.obstacle_margin, 0.5 * ends)
        verdict = Verdict(VerdictCode.NO_FEASIBLE_PATH)
        ways: dict[float, LatentWay | Verdict] = {}
        tried: set[tuple[bytes, bool, float]] = set()
        for number, attempt in enumerate(attempts):
            multiple, refine, width, trusting = attempt
            if number > 0 and deadline.passed:
                reason = f"out of time after {number} of {len(attempts)} attempts: {verdict.reason}"
                return Plan(None, state.time, replace(verdict, code=VerdictCode.DEADLINE_MISSED, reason=reason))
            kept_off = min(multiple * settings.obstacle_margin, 0.5 * ends)
            if kept_off not in ways:
                ways[kept_off] = cheapest_way(self.graph, query, start, reshaping, kept_off, deadline)
            way = ways[kept_off]
            if isinstance(way, Verdict):
                return Plan(None, state.time, verdict if verdict.reason else way)
            if known is not None and same_way(way.nodes, known):
                return Plan(None, state.time, Verdict(VerdictCode.OK, "the way being gone was found again"))
            this = way.nodes.tobytes(), refine, width
            if this in tried:
                continue
            tried.add(this)
            if refine:
                way = replace(way, polyline=refined(query.field, reshaping, kept_off, way.polyline))
            plan = self._certified(query, state, way, obstacles, margin, width, trusting)
            if plan.reference is not None:
                return replace(plan, nodes=way.nodes) if attempt == self.attempts[0] else plan
            verdict = plan.verdict
        return Plan(None, state.time, verdict)

    def aside(
        self, query: HeldQuery, state: MotionState, obstacles: Obstacles, horizon: float, deadline: Deadline = NEVER
    ) -> Plan | None:
        """A certified way to a place nearby that nothing is expected to come to, or None where none is found in time.

        horizon : obstacles are expected to move on for so long [s].
        """
        start = query.start_latent if state.latent is None else state.latent
        reshaping = self._reshaping(query, obstacles.swept(horizon))
        # As of every way: a start closer to an obstacle than the margin may stay so.
        here, _ = obstacle_clearance(self.collision, self.robot, state.position, obstacles)
        apart = MOVING_MULTIPLE * self.settings.obstacle_margin
        margin = min(apart, 0.5 * here)
        for way in ways_aside(self.graph, query, start, reshaping, _REFUGE_STEPS, apart):
            plan = self._certified(query, state, way, obstacles, margin, 1.0, True, horizon)
            if plan.reference is not None:
                return plan
            if deadline.passed:
                return None
        return None

    def _reshaping(self, query: HeldQuery, obstacles: Obstacles) -> Reshaping:
        settings = self.settings
        return Reshaping.of(
            query.body, obstacles, settings.ambient_strength, settings.ambient_width_ratio,
            _LARGEST_MULTIPLE * settings.obstacle_margin, settings.ambient_law,
        )  # fmt: skip

    def _end_clearance(
        self, query: HeldQuery, state: MotionState, obstacles: Obstacles, trusting: bool
    ) -> float | Verdict:
        """Smaller clearance [m] of present and goal configuration, or the refusal where one of them is covered.

        The goal is to be free of where obstacles are expected to come to a stand; trusting: of those alone that stand.
        """
        prediction = self.settings.prediction
        later = obstacles.at_rest() if trusting else obstacles.at(obstacles.time + prediction, prediction)
        nearest = []
        for where, configuration, code, there in (
            ("stands", state.position, VerdictCode.IN_COLLISION, obstacles),
            ("is to go", query.goal, VerdictCode.NO_FEASIBLE_PATH, later),
        ):
            clearance, sphere = obstacle_clearance(self.collision, self.robot, configuration, there)
            if clearance <= 0.0:
                link = self.collision.link_of(sphere)
                reason = f"'{link}' overlaps an obstacle by {-1000 * clearance:.0f} mm where the arm {where}"
                return Verdict(code, reason, clearance=clearance, **query.misfits)
            nearest.append(clearance)
        return min(nearest)

    def _certified(
        self,
        query: HeldQuery,
        state: MotionState,
        way: LatentWay,
        obstacles: Obstacles,
        margin: float,
        width: float,
        trusting: bool,
        aside: float | None = None,
    ) -> Plan:
        """Time a way (`_timed`), and judge the very motion that will be played.

        aside : the way does not lead to the goal, but ends where it ends; obstacles move on for so long [s].
        """
        timed = self._timed(query, state, way, width, aside is None)
        latent, reference = timed.latent, timed.reference
        if reference is None or timed.swept is None:
            return Plan(None, state.time, Verdict(VerdictCode.NO_FEASIBLE_PATH, timed.objection, **query.misfits))
        horizon = self.settings.prediction if aside is None else aside
        certificate = self.certifier.certify_swept(timed.swept, obstacles, horizon, beyond=not trusting)
        objection = self.certifier.objection(certificate, margin) if self.settings.avoidance else None
        verdict = way_verdict(
            self.skill, self.graph, query, self.graph.sigma_at(latent), way,
            float(np.min(certificate.clearance)), timed.correction,
            None if objection is None else f"on the best way {objection}",
        )  # fmt: skip
        found = replace(reference, clearance=certificate.clearance) if verdict.ok else None
        return Plan(found, state.time, verdict)


    def _timed(self, query: HeldQuery, state: MotionState, way: LatentWay, width: float, to_goal: bool) -> _Timed:
        """A way's motion, from memory where nothing that it depends on has changed."""
        memory = self._memory
        if memory is None or not memory.is_of(query, state) or len(memory.timed) >= _MOST_REMEMBERED:
            memory = self._memory = _Memory(query, state, {})
        key = (way.polyline.tobytes(), width, to_goal)
        if key not in memory.timed:
            memory.timed[key] = self._timed_anew(query, state, way, width, to_goal)
        return memory.timed[key]

    def _timed_anew(self, query: HeldQuery, state: MotionState, way: LatentWay, width: float, to_goal: bool) -> _Timed:
        """Smooth, decode, transport, meet the ends exactly, time."""
        step = float(np.min(self.graph.grid.spacing)) / _SAMPLES_PER_STEP
        latent = smooth_latent(resample_latent(way.polyline, step), width * _SAMPLES_PER_STEP)
        held, objection = query.configurations_along(latent, state.position)
        if objection:
            return _Timed(latent, objection)
        path = smooth_latent(held, width * _SAMPLES_PER_STEP)
        path, correction = _meeting(path, state.position, query.goal if to_goal else path[-1])
        reference = timed_joint_reference(path, latent, self.limits, state.velocity, state.acceleration, tool=self.tool)
        if reference is None:
            reason = "stopping first: the way to the goal turns off the present motion, or leaves the joints' limits"
            return _Timed(latent, reason)
        return _Timed(latent, "", correction, reference, self.certifier.swept(reference))


def _alike(attempts: tuple[Attempt, ...], trusting: bool) -> tuple[Attempt, ...]:
    return tuple(attempt for attempt in attempts if attempt.trusting is trusting)


def _meeting(path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, float]:
    """A path (m, eta) moved linearly along its arc so that it begins and ends at two configurations.

    Also how far [rad] its ends were moved.
    """
    share = arc_length_fractions(path)[:, None]
    at_start, at_goal = start - path[0], goal - path[-1]
    moved = float(max(np.linalg.norm(at_start), np.linalg.norm(at_goal)))
    return path + (1.0 - share) * at_start + share * at_goal, moved
