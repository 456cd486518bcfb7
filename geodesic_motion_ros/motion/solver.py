"""Solver: one query -> a certified joint reference and its verdict. Knows nothing of ROS.

Reweight, search, refine, smooth, decode, transport, time, certify: the work of a tick of `planning.planner` in
which the trajectory cannot stay.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance, overlap
from geodesic_motion_ros.certification.certificate import Certificate
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.requirement import Requirement
from geodesic_motion_ros.contract.settings import Attempt, PlannerSettings
from geodesic_motion_ros.contract.status import Figures, Refusal, Verdict, VerdictCode
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.geodesic_refinement import refined
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.motion.motion_judge import MotionJudge
from geodesic_motion_ros.motion.path_timer import JointCurve, PathTimer, TimedPath
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.retry import Workings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.output_space import OutputSpace
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.queries.search import (
    NO_NODE_REMOVED,
    BegunSearch,
    KnownPaths,
    LatentPath,
    MarginSearch,
    cheapest_path,
    judge_path,
)
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import NEVER, Deadline
from geodesic_motion_ros.utils.errors import PlanningError

#: The largest distance that an attempt keeps from obstacles, as a multiple of the margin.
_LARGEST_MULTIPLE = max(attempt.multiple for attempt in constants.ATTEMPTS)


class Solver(MotionJudge):
    """A planner of single motions on one skill; any thread may call it, as no call changes it. What a search has worked
    out that the next one need not repeat is in the caller's `Workings`.

    Entry points, each of which times a path, certifies the motion and states a verdict:

    | method | motion |
    |---|---|
    | `solve` | to the goal, along the cheapest path of the graph |
    | `plan_along` | to the goal, along a detour that was found |

    The others are made of its parts: evasions (`evasion_motion.py`), approaches (`approach_motion.py`), and the search
    of detours (`detour.py`).
    """

    def __init__(
        self,
        skill: Skill,
        graph: ConfigurationGraph | PoseGraph,
        settings: PlannerSettings,
        robot: Robot,
        collision: CollisionModel,
        limits: JointLimits,
        scene: DeclaredScene | None = None,
    ) -> None:
        """PlanningError where the motion is to be periodic and the skill is not closed."""
        if settings.periodic and skill.period is None:
            raise PlanningError(
                "periodic: the skill leads from a start to another goal; round after round goes a closed skill alone, "
                "learned of demonstrations that end where they began"
            )
        self.skill, self.graph, self.space = skill, graph, OutputSpace.of(skill)
        super().__init__(robot, collision, settings, limits, self.space.tool_limits, scene)
        self.attempts = constants.ATTEMPTS
        pace = skill.pace if settings.timing == "demonstrated" else None
        self.timer = PathTimer(graph, self.space.smoothing, settings, limits, self.tool, self.certifier, pace)

    @property
    def cautious_attempts(self) -> tuple[Attempt, ...]:
        """The attempts that are not optimistic. Where no obstacle moves, an optimistic one equals one of these."""
        return _alike(self.attempts, False)

    @property
    def optimistic_attempts(self) -> tuple[Attempt, ...]:
        """The optimistic attempts."""
        return _alike(self.attempts, True)

    def solve(
        self,
        query: ArmQuery,
        state: MotionState,
        obstacles: Obstacles,
        attempts: tuple[Attempt, ...],
        deadline: Deadline = NEVER,
        known: KnownPaths | None = None,
        longest: float = math.inf,
        refusal: Refusal | None = None,
        workings: Workings | None = None,
    ) -> Plan:
        """Search, refine, smooth, decode, time, certify: until an attempt is certified, or the deadline has passed.

        known : paths that need no certificate: where the search finds one again, the answer is OK without a trajectory.
        longest : a motion that takes as long as this [s] or longer is no gain, and is not certified.
        refusal : the verdict of earlier attempts; it is the answer where none of `attempts` is cautious, and none comes
            to a path.
        workings : of searches before, and of this one; None: there are none.
        """
        workings = workings or Workings()
        cautious, optimistic = _alike(attempts, False), _alike(attempts, True)
        if cautious or refusal is None:
            plan = self._first_certified(query, state, obstacles, cautious, deadline, known, longest, workings)
        else:
            plan = Plan(None, state.time, refusal)
        blocked = plan.trajectory is None and plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        if blocked and optimistic and not obstacles.is_static and not deadline.passed:
            other = self._first_certified(query, state, obstacles, optimistic, deadline, None, longest, workings)
            if other.trajectory is not None:
                return replace(other, optimistic=True)
        return plan

    def _first_certified(
        self,
        query: ArmQuery,
        state: MotionState,
        obstacles: Obstacles,
        attempts: tuple[Attempt, ...],
        deadline: Deadline,
        known: KnownPaths | None,
        longest: float,
        workings: Workings,
    ) -> Plan:
        """`solve` with attempts that are all optimistic, or all cautious."""
        optimistic = attempts[0].optimistic
        requirement = self.requirements.optimistic if optimistic else self.requirements.goal
        avoided = obstacles if self.settings.avoidance else Obstacles.none()
        ends = self._end_clearance(query, state, avoided, optimistic)
        if isinstance(ends, Refusal):
            return Plan(None, state.time, ends)
        if self._stands_at_goal(query, state):
            return self._staying(query, state, obstacles, requirement, ends)
        swept = avoided.static_subset if optimistic else avoided.swept(requirement.horizon)
        search = self.search_among(query, state, swept, ends, deadline, workings)
        refusal = Refusal(VerdictCode.NO_FEASIBLE_PATH)
        tried: set[bytes] = set()
        first: LatentPath | None = None
        for number, attempt in enumerate(attempts):
            if number > 0 and deadline.passed:
                workings.begun = replace(search.begun, unfinished=True)
                reason = f"out of time after {number} of {len(attempts)} attempts: {refusal.reason}"
                return Plan(None, state.time, replace(refusal, code=VerdictCode.DEADLINE_MISSED, reason=reason))
            path = search.path(attempt.multiple)
            if isinstance(path, Refusal):
                if search.begun.unfinished or path.code is VerdictCode.DEADLINE_MISSED:
                    workings.begun = replace(search.begun, unfinished=True)
                return Plan(None, state.time, refusal if refusal.reason else path)
            if known is not None and known.include(path):
                return Plan(None, state.time, Verdict(reason="the path being followed was found again"))
            nodes = path.nodes.tobytes()
            if nodes in tried:
                continue
            tried.add(nodes)
            curve = search.refine(path, attempt.multiple)
            timed = workings.time_path(self.timer, query, state, curve, True, longest)
            plan = self._judged(query, state, curve, timed, obstacles, requirement, ends, longest)
            if plan.trajectory is None and self.timer.is_paced and not obstacles.is_static:
                # What moves leaves no time for a motion as slow as was shown.
                timed = workings.time_path(self.timer, query, state, curve, True, longest, paced=False)
                plan = self._judged(query, state, curve, timed, obstacles, requirement, ends, longest)
            first = path if attempt == self.attempts[0] else first
            if plan.trajectory is not None:
                return replace(plan, path=path) if attempt == self.attempts[0] else plan
            refusal = plan.refusal
        return Plan(None, state.time, refusal, first)

    def _stands_at_goal(self, query: ArmQuery, state: MotionState) -> bool:
        """Whether the arm stands in the goal configuration; with a skill of tool poses, its tool in the goal pose; of a
        closed skill, at the end of the round.
        """
        moves = np.any(state.velocity) or np.any(state.acceleration)
        if moves or not self.space.is_there(self.robot, state.position, query):
            return False
        return abs(query.rounds_left(state.latent_on(query))) < 0.5

    def _staying(
        self, query: ArmQuery, state: MotionState, obstacles: Obstacles, requirement: Requirement, ends: float
    ) -> Plan:
        """The plan of an arm that stands at its goal: a path around to the same place would be a needless motion."""
        latent = np.repeat(state.latent_on(query)[None], 2, axis=0)
        standing = JointCurve(np.repeat(state.position[None], 2, axis=0), latent, 0.0)
        timed = self.timer.time_curve(state, standing)
        path = LatentPath(np.empty(0, dtype=np.int64), latent, energy=0.0, gap=0.0)
        plan = self._judged(query, state, path, timed, obstacles, requirement, ends)
        return replace(plan, verdict=plan.verdict.with_remark("at the goal")) if plan.verdict.ok else plan

    def search_among(
        self,
        query: ArmQuery,
        state: MotionState,
        standing: Obstacles,
        ends: float,
        deadline: Deadline,
        workings: Workings,
    ) -> MarginSearch:
        """Return the searches among obstacles that stand; ends : clearance [m] of the end that is nearer to one."""
        begun = workings.take_begun(query.body, standing)
        begun = begun or BegunSearch(self.evaluation(query, standing), standing)
        start, largest = state.latent_on(query), self.requirements.goal.searched.share * ends
        return MarginSearch(self.graph, query, start, begun, deadline, self.settings, largest)

    def time_along(self, state: MotionState, curve: JointCurve) -> JointReference | Refusal:
        """Return the motion along a curve that begins where the arm is, no faster than was shown; or why there is none.
        """
        timed = self.timer.time_curve(state, curve)
        return timed if isinstance(timed, Refusal) else timed.reference

    def clearance(self, configuration: np.ndarray, obstacles: Obstacles) -> float:
        """Return the clearance [m] of the arm in a configuration (eta,) from obstacles."""
        return obstacle_clearance(self.collision, self.robot, configuration, obstacles)[0]

    def evaluation(self, query: ArmQuery, obstacles: Obstacles) -> NodeEvaluation:
        """Return the evaluation of a query's nodes among obstacles that stand."""
        settings = self.settings
        return NodeEvaluation.of(
            query.body, obstacles, settings.ambient_strength, settings.ambient_width_ratio,
            _LARGEST_MULTIPLE * settings.obstacle_margin, settings.ambient_law,
        )  # fmt: skip

    def _end_clearance(
        self, query: ArmQuery, state: MotionState, obstacles: Obstacles, optimistic: bool
    ) -> float | Refusal:
        """Smaller clearance [m] of present and goal configuration, or the refusal where one of them is covered.

        The goal must be free of the places where obstacles are expected to halt; optimistic: of standing obstacles
        alone. A goal in which the arm touches itself is refused before.
        """
        itself, (one, other) = self_clearance(self.collision, self.robot, state.position)
        if not itself >= 0.0:
            names = f"'{self.collision.link_of(one)}' and '{self.collision.link_of(other)}'"
            reason = f"{names} overlap by {-1000 * itself:.1f} mm where the arm stands"
            return Refusal(VerdictCode.IN_COLLISION, reason, query.misfits)
        prediction = self.settings.prediction
        later = obstacles.static_subset if optimistic else obstacles.at(obstacles.time + prediction, prediction)
        nearest = []
        for where, configuration, code, there in (
            ("stands", state.position, VerdictCode.IN_COLLISION, obstacles),
            ("is to go", query.goal, VerdictCode.NO_FEASIBLE_PATH, later),
        ):
            clearance, overlapping = overlap(self.collision, self.robot, configuration, there)
            reason = overlapping or self._entered_scene(configuration)
            if reason:
                figures = replace(query.misfits, clearance=clearance if clearance <= 0.0 else math.nan)
                if configuration is query.goal:
                    to_goal = self.tool_distance(state.position, query.goal)
                    figures = replace(figures, goal_covered=True, goal_distance=to_goal)
                return Refusal(code, f"{reason} where the arm {where}", figures)
            nearest.append(clearance)
        return min(nearest)

    def tool_distance(self, one: np.ndarray, other: np.ndarray) -> float:
        """Return how far [m] the tool is in one configuration (eta,) from where it is in another one."""
        return float(np.linalg.norm(self.robot.forward(one)[0] - self.robot.forward(other)[0]))

    def _entered_scene(self, configuration: np.ndarray) -> str:
        """Which link is inside which part of the declared scene in a configuration (eta,); "" where none is."""
        if not self.scene.names:
            return ""
        moving = np.flatnonzero(self.collision.moving)
        placed = self.collision.positions(self.robot, configuration[None])[0, moving]
        clearance, part, sphere = self.scene.nearest(placed, self.collision.radii[moving])
        link = self.collision.link_of(int(moving[sphere]))
        return f"'{link}' is {-1000 * clearance:.0f} mm inside '{part}' of the scene" if not clearance > 0.0 else ""

    def _judged(
        self,
        query: ArmQuery,
        state: MotionState,
        path: LatentPath,
        timed: TimedPath | Refusal,
        obstacles: Obstacles,
        requirement: Requirement,
        ends: float,
        longest: float = math.inf,
    ) -> Plan:
        """The plan of a path that is timed: the very motion that will be played is certified.

        ends : clearance [m] of the end of the path that is nearer to an obstacle. longest : as of `solve`.
        """
        if isinstance(timed, Refusal):
            return Plan(None, state.time, replace(timed, figures=query.misfits))
        reference = timed.reference
        if reference.duration >= longest:
            reason = f"the best path takes {reference.duration:.2f} s; only less than {longest:.2f} s would be a gain"
            return Plan(None, state.time, Refusal(VerdictCode.NO_FEASIBLE_PATH, reason, query.misfits))
        certificate, objection = self.certifier.assess(timed.swept, obstacles, requirement, ends)
        objection = f"on the best path {objection}" if objection and self.settings.avoidance else ""
        figures = self.judge(query, path, timed, certificate, objection)
        if isinstance(figures, Refusal):
            return Plan(None, state.time, figures)
        return Plan(self.certifier.judge(reference, certificate), state.time, Verdict(figures=figures))

    def judge(
        self, query: ArmQuery, path: LatentPath, timed: TimedPath, certificate: Certificate, objection: str
    ) -> Figures | Refusal:
        """Return the figures of a path that is timed, or why it is not followed (`search.judge_path`)."""
        sigma, clearance = self.graph.sigma_at(timed.latent), float(np.min(certificate.clearance))
        return judge_path(self.skill, self.graph, query, sigma, path, clearance, timed.correction, objection)

    def base_path(self, query: ArmQuery, obstacles: Obstacles) -> JointCurve | Refusal:
        """Return the geodesic of the metric that obstacles reshape, whether it is free of them or not; or why there is
        none, or why the arm cannot hold it.
        """
        reshaped = self.evaluation(query, obstacles.swept(self.requirements.detour.horizon))
        path = cheapest_path(self.graph, query, query.start_latent, reshaped, NO_NODE_REMOVED)
        if isinstance(path, Refusal):
            return path
        if self.settings.refine:
            path = replace(path, polyline=refined(query.field, reshaped, NO_NODE_REMOVED, path.polyline))
        return self.timer.joint_curve(query, query.start, path, True)


def _alike(attempts: tuple[Attempt, ...], optimistic: bool) -> tuple[Attempt, ...]:
    return tuple(attempt for attempt in attempts if attempt.optimistic is optimistic)
