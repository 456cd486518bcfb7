"""Solver: one query -> a certified joint reference and its verdict. Knows nothing of ROS.

Reweight, search, refine, smooth, decode, transport, time, certify: the work of a tick of `planner.ReactivePlanner` in
which the trajectory cannot stay.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice

import numpy as np

from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.geodesic_refinement import refined
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.arm_clearance import nearest_obstacle, obstacle_clearance
from geodesic_motion_ros.planning.arm_in_scene import ArmInScene
from geodesic_motion_ros.planning.certificate import ArmCertifier, Certificate
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.evasion_targets import displaced_paths, paths_to_targets
from geodesic_motion_ros.planning.output_space import OutputSpace
from geodesic_motion_ros.planning.path_timer import PathTimer, TimedPath, meeting
from geodesic_motion_ros.planning.plan import Approach, ArmQuery, MotionState, PathEnds, Plan
from geodesic_motion_ros.planning.requirement import Requirement, Requirements
from geodesic_motion_ros.planning.retry import Workings
from geodesic_motion_ros.planning.search import (
    NO_NODE_REMOVED,
    BegunSearch,
    KnownPaths,
    LatentPath,
    MarginSearch,
    cheapest_path,
    path_verdict,
)
from geodesic_motion_ros.planning.seen_volume import SeenVolume
from geodesic_motion_ros.planning.settings import Attempt, PlannerSettings
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.trajectory.trajectory import JointReference, joined
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: The largest distance that an attempt keeps from obstacles, as a multiple of the margin.
_LARGEST_MULTIPLE = max(attempt.multiple for attempt in constants.ATTEMPTS)


class Solver:
    """Plans single motions on one skill; any thread may call it, as no call changes it. What a search has worked out
    that the next one need not repeat is in the caller's `Workings`.

    Entry points, each of which times a path, certifies the motion and states a verdict:

    | method | motion |
    |---|---|
    | `solve` | to the goal, along the cheapest path of the graph |
    | `along` | to the goal, along a detour that was found |
    | `evade`, `evade_displaced` | away from where an obstacle comes: to a place on the graph, or beside it |
    | `approach` | towards a covered goal, as near as is free |

    `base_path` and `seen_beside` serve the search of detours.
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
        self.scene = scene or DeclaredScene.empty()
        self.skill, self.graph, self.settings, self.robot = skill, graph, settings, robot
        self.collision, self.limits = collision, limits
        self.space = OutputSpace.of(skill)
        self.tool = LimitedTool(robot, settings.tool_limits(self.space.tool_limits))
        self.requirements = Requirements.of(settings)
        self.attempts = constants.ATTEMPTS
        self.certifier = ArmCertifier(robot, collision, self.scene)
        self._timer = PathTimer(graph, self.space.smoothing, settings, limits, self.tool, self.certifier)

    @property
    def cautious(self) -> tuple[Attempt, ...]:
        """The attempts that are not optimistic. Where no obstacle moves, an optimistic one equals one of these."""
        return _alike(self.attempts, False)

    @property
    def optimistic(self) -> tuple[Attempt, ...]:
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
        refusal: Verdict | None = None,
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
        if isinstance(ends, Verdict):
            return Plan(None, state.time, ends)
        if self._stands_at_goal(query, state):
            return self._staying(query, state, obstacles, requirement, ends)
        swept = avoided.static_subset if optimistic else avoided.swept(requirement.horizon)
        search = self._search_among(query, state, swept, ends, deadline, workings)
        verdict = Verdict(VerdictCode.NO_FEASIBLE_PATH)
        tried: set[bytes] = set()
        first: LatentPath | None = None
        for number, attempt in enumerate(attempts):
            if number > 0 and deadline.passed:
                reason = f"out of time after {number} of {len(attempts)} attempts: {verdict.reason}"
                return Plan(None, state.time, replace(verdict, code=VerdictCode.DEADLINE_MISSED, reason=reason))
            path = search.path(attempt.multiple)
            if isinstance(path, Verdict):
                if search.begun.unfinished or path.code is VerdictCode.DEADLINE_MISSED:
                    workings.begun = replace(search.begun, unfinished=True)
                return Plan(None, state.time, verdict if verdict.reason else path)
            if known is not None and known.include(path):
                return Plan(None, state.time, Verdict(VerdictCode.OK, "the path being followed was found again"))
            nodes = path.nodes.tobytes()
            if nodes in tried:
                continue
            tried.add(nodes)
            curve = search.refined(path, attempt.multiple)
            timed = workings.timed(self._timer, query, state, curve, True, longest)
            plan = self._judged(query, state, curve, timed, obstacles, requirement, ends, longest)
            first = path if attempt == self.attempts[0] else first
            if plan.trajectory is not None:
                return replace(plan, path=path) if attempt == self.attempts[0] else plan
            verdict = plan.verdict
        return Plan(None, state.time, verdict, first)

    def _stands_at_goal(self, query: ArmQuery, state: MotionState) -> bool:
        """Whether the arm stands in the goal configuration; with a skill of tool poses, its tool in the goal pose."""
        moves = np.any(state.velocity) or np.any(state.acceleration)
        return not moves and self.space.is_there(self.robot, state.position, query)

    def _staying(
        self, query: ArmQuery, state: MotionState, obstacles: Obstacles, requirement: Requirement, ends: float
    ) -> Plan:
        """The plan of an arm that stands at its goal: a path around to the same place would be a needless motion."""
        latent = np.repeat(_latent_start(query, state)[None], 2, axis=0)
        timed = self._timer.timed_curve(state, np.repeat(state.position[None], 2, axis=0), latent, 0.0)
        path = LatentPath(np.empty(0, dtype=np.int64), latent, energy=0.0, gap=0.0)
        plan = self._judged(query, state, path, timed, obstacles, requirement, ends)
        return replace(plan, verdict=replace(plan.verdict, reason="at the goal")) if plan.verdict.ok else plan

    def _search_among(
        self,
        query: ArmQuery,
        state: MotionState,
        standing: Obstacles,
        ends: float,
        deadline: Deadline,
        workings: Workings,
    ) -> MarginSearch:
        """The searches among obstacles that stand; ends : clearance [m] of the end that is nearer to one."""
        begun = workings.take_begun(query.body, standing)
        begun = begun or BegunSearch(self._evaluation(query, standing), standing)
        start, largest = _latent_start(query, state), self.requirements.goal.searched.share * ends
        return MarginSearch(self.graph, query, start, begun, deadline, self.settings, largest)

    def along(
        self,
        query: PathEnds,
        state: MotionState,
        curve: np.ndarray,
        latent: np.ndarray,
        obstacles: Obstacles,
        seen: SeenVolume,
    ) -> Plan:
        """The certified motion along configurations (m, eta) from where the arm is to a query's goal; or why it is not
        certified.

        latent : (m, d) latent points beside the configurations. seen : the motion stays inside of this volume.
        """
        curve, correction = meeting(curve, state.position, query.goal)
        timed = self._timer.timed_curve(state, curve, latent, correction)
        if timed.reference is None:
            return Plan(None, state.time, Verdict(VerdictCode.NO_FEASIBLE_PATH, timed.objection, **query.misfits))
        certificate, objection = self.certifier.assess(timed.swept, obstacles, self.requirements.detour)
        objection = objection or self.certifier.unseen(timed.swept, seen)
        verdict = Verdict(
            VerdictCode.NO_FEASIBLE_PATH if objection else VerdictCode.OK, f"on the detour {objection}" if objection
            else "", clearance=float(np.min(certificate.clearance)), end_correction=correction, **query.misfits,
        )  # fmt: skip
        found = None if objection else self.certifier.judged(timed.reference, certificate)
        return Plan(found, state.time, verdict)

    def evade(
        self,
        query: ArmQuery,
        state: MotionState,
        obstacles: Obstacles,
        stop: JointReference,
        workings: Workings,
        deadline: Deadline = NEVER,
    ) -> Plan | None:
        """A certified motion to a place on the graph nearby, to which no obstacle is expected to come; None where none
        is found in time.

        An arm in motion stops first, as it can go back then, or else sets out as it moves.

        stop : the soonest stop from the state. workings : as of `solve`.
        """
        requirement = self.requirements.evasion
        evaluation = self._evaluation(query, obstacles.swept(requirement.horizon))
        apart = requirement.searched.of()
        for begin, first in self._evasion_begins(state, obstacles, stop):
            start = _latent_start(query, begin)
            for path in paths_to_targets(self.graph, query, start, evaluation, constants.EVASION_STEPS, apart):
                timed = workings.timed(self._timer, query, begin, path, False, math.inf)
                if timed.reference is not None:
                    whole = timed.reference if first is None else joined(first, 0.0, timed.reference, first.duration)
                    certificate, objection = self.certifier.assess(
                        self.certifier.swept(whole), obstacles, requirement
                    )
                    verdict = self._path_verdict(query, path, timed, certificate, objection)
                    if verdict.ok:
                        return Plan(self.certifier.judged(whole, certificate), state.time, verdict)
                if deadline.passed:
                    return None
        return None

    def _evasion_begins(
        self, state: MotionState, obstacles: Obstacles, stop: JointReference
    ) -> list[tuple[MotionState, JointReference | None]]:
        """The states in which an evasion may set out, in the order in which they are tried, each with the motion that
        is played until then: at rest after a stop, where no obstacle meets that; and in motion.
        """
        if not np.any(state.velocity):
            return [(state, None)]
        while_stopping = self.requirements.evasion.until(stop.duration)
        _, met = self.certifier.assess(self.certifier.swept(stop), obstacles, while_stopping)
        return [(state, None)] if met is not None else [(state.after(stop), stop), (state, None)]

    def evade_displaced(
        self,
        query: ArmQuery,
        state: MotionState,
        obstacles: Obstacles,
        reach: float,
        deadline: Deadline = NEVER,
    ) -> Plan | None:
        """A certified motion to a place beside the graph, to which no obstacle comes soon; None where none is found in
        time.

        reach : how far the tool may be from what was demonstrated [m].
        """
        latent = _latent_start(query, state)[None]
        progress, _ = self.graph.progress_map(latent)
        configurations, objection = query.configurations_along(latent, state.position)
        if objection:
            return None
        left = reach - query.displaced_at(progress)
        undisplaced, _ = self.robot.forward(configurations[0])
        seen = self.seen_beside(state.position[None])
        requirement = self.requirements.beside_graph
        swept = obstacles.swept(requirement.horizon).beside(self.scene.solids)
        arm, apart = ArmInScene.of(self.robot, self.collision, swept, seen), requirement.searched.of()
        targets = displaced_paths(self.robot, arm, state.position, undisplaced, left, apart)
        for curve in islice(targets, constants.EVASION_DISPLACED):
            if deadline.passed:
                return None
            timed = self._timer.timed_curve(state, curve, np.repeat(latent, len(curve), axis=0), 0.0)
            if timed.reference is None:
                continue
            certificate, met = self.certifier.assess(timed.swept, obstacles, requirement)
            if met is None and self.certifier.unseen(timed.swept, seen) is None:
                verdict = Verdict(VerdictCode.OK, clearance=float(np.min(certificate.clearance)))
                return Plan(self.certifier.judged(timed.reference, certificate), state.time, verdict)
        return None

    def approach(
        self,
        query: ArmQuery,
        state: MotionState,
        obstacles: Obstacles,
        refusal: Verdict,
        remaining: float = math.inf,
        deadline: Deadline = NEVER,
    ) -> Approach | None:
        """The certified motion along the path to a covered goal, as near to it as is free; None where that does not
        shorten the rest of the path by `APPROACH_GAIN`.

        The path is the one that the arm will follow when the goal clears: the obstacles that cover the goal are not
        counted in its search. None as well where no standing obstacle covers the goal: a moving one leaves it by
        itself, and would meet an arm that waits beside it.

        Parameters
        ----------
        refusal : states that the goal is covered; the plan's verdict states the same, and how near the motion leads.
        remaining : how much of the path the approach that is being played leaves [m]; inf: there is none.
        """
        if self._clearance(query.goal, obstacles.static_subset.beside(self.scene.solids)) > 0.0:
            return None
        requirement = self.requirements.approach
        swept = obstacles.swept(requirement.horizon).beside(self.scene.solids)
        here = min(self._clearance(state.position, there) for there in (obstacles, swept))
        path = self._path_to_covered(query, state, obstacles, here, deadline) if here > 0.0 else None
        if path is None:
            return None
        curve, latent, correction = path
        placed = self.collision.positions(self.robot, curve)
        free = self.certifier.between(placed, swept) >= requirement.searched.of(here)
        end, left = int(np.argmin(np.append(free, False))), _lengths_left(placed)
        for _ in range(1 + constants.APPROACH_CUTS):
            if end < 1 or left[end] > min(remaining, left[0]) - constants.APPROACH_GAIN:
                return None
            timed = self._timer.timed_curve(state, curve[: end + 1], latent[: end + 1], correction)
            if timed.reference is None:
                return None
            certificate, objection = self.certifier.assess(timed.swept, obstacles, requirement, here)
            if objection is None:
                plan = Plan(self.certifier.judged(timed.reference, certificate), state.time, refusal)
                to_goal = self._tool_distance(curve[end], query.goal)
                reason = f"{refusal.reason}; it goes as near as it can, to {1000 * to_goal:.0f} mm"
                verdict = replace(refusal, reason=reason, clearance=float(np.min(certificate.clearance)))
                return Approach(replace(plan, verdict=verdict), float(left[end]))
            met = self.certifier.first_objection(certificate, requirement.margin(obstacles, here))
            assert met is not None
            posture, _, _ = timed.reference.sample(met)
            end = int(np.argmin(np.linalg.norm(curve[: end + 1] - posture, axis=1))) - 1
        return None

    def _path_to_covered(
        self, query: ArmQuery, state: MotionState, obstacles: Obstacles, here: float, deadline: Deadline
    ) -> tuple[np.ndarray, np.ndarray, float] | None:
        """Configurations (m, eta) of the path to a goal among the obstacles that do not cover it, their latent points
        (m, d), and how far the ends were moved [rad]; here : clearance of the start [m].
        """
        moving, prediction = self.collision.moving, self.settings.prediction
        at_goal = self.collision.positions(self.robot, query.goal[None])[0, moving]
        others = obstacles.leaving_free(at_goal, self.collision.radii[moving], prediction)
        ends = min(here, self._clearance(query.goal, others.at(others.time + prediction, prediction)))
        search = self._search_among(query, state, others.swept(prediction), ends, deadline, Workings())
        multiple = 1.0
        path = search.path(multiple)
        if isinstance(path, Verdict):
            return None
        path = search.refined(path, multiple)
        latent, found = self._timer.joint_curve(query, state.position, path, True)
        if isinstance(found, str):
            return None
        curve, correction = found
        verdict = path_verdict(
            self.skill, self.graph, query, self.graph.sigma_at(latent), path, here, correction, objection=None
        )
        return (curve, latent, correction) if verdict.ok else None

    def _clearance(self, configuration: np.ndarray, obstacles: Obstacles) -> float:
        return obstacle_clearance(self.collision, self.robot, configuration, obstacles)[0]

    def _evaluation(self, query: ArmQuery, obstacles: Obstacles) -> NodeEvaluation:
        settings = self.settings
        return NodeEvaluation.of(
            query.body, obstacles, settings.ambient_strength, settings.ambient_width_ratio,
            _LARGEST_MULTIPLE * settings.obstacle_margin, settings.ambient_law,
        )  # fmt: skip

    def _end_clearance(
        self, query: ArmQuery, state: MotionState, obstacles: Obstacles, optimistic: bool
    ) -> float | Verdict:
        """Smaller clearance [m] of present and goal configuration, or the refusal where one of them is covered.

        The goal must be free of the places where obstacles are expected to halt; optimistic: of standing obstacles
        alone. A goal in which the arm touches itself is refused before.
        """
        itself, (one, other) = self_clearance(self.collision, self.robot, state.position)
        if not itself >= 0.0:
            names = f"'{self.collision.link_of(one)}' and '{self.collision.link_of(other)}'"
            reason = f"{names} overlap by {-1000 * itself:.1f} mm where the arm stands"
            return Verdict(VerdictCode.IN_COLLISION, reason, **query.misfits)
        prediction = self.settings.prediction
        later = obstacles.static_subset if optimistic else obstacles.at(obstacles.time + prediction, prediction)
        nearest = []
        for where, configuration, code, there in (
            ("stands", state.position, VerdictCode.IN_COLLISION, obstacles),
            ("is to go", query.goal, VerdictCode.NO_FEASIBLE_PATH, later),
        ):
            clearance, sphere = obstacle_clearance(self.collision, self.robot, configuration, there)
            reason = self._entered_scene(configuration)
            if not clearance > 0.0:
                name = nearest_obstacle(self.collision, self.robot, configuration, there)
                reason = f"'{self.collision.link_of(sphere)}' overlaps {name} by {-1000 * clearance:.0f} mm"
            if reason:
                verdict = Verdict(
                    code, f"{reason} where the arm {where}", clearance=clearance if clearance <= 0.0 else math.nan,
                    **query.misfits,
                )  # fmt: skip
                if configuration is query.goal:
                    to_goal = self._tool_distance(state.position, query.goal)
                    verdict = replace(verdict, goal_covered=True, goal_distance=to_goal)
                return verdict
            nearest.append(clearance)
        return min(nearest)

    def _tool_distance(self, one: np.ndarray, other: np.ndarray) -> float:
        """How far [m] the tool is in one configuration (eta,) from where it is in another one."""
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
        timed: TimedPath,
        obstacles: Obstacles,
        requirement: Requirement,
        ends: float,
        longest: float = math.inf,
    ) -> Plan:
        """The plan of a path that is timed: the very motion that will be played is certified.

        ends : clearance [m] of the end of the path that is nearer to an obstacle. longest : as of `solve`.
        """
        reference = timed.reference
        if reference is None:
            return Plan(None, state.time, Verdict(VerdictCode.NO_FEASIBLE_PATH, timed.objection, **query.misfits))
        if reference.duration >= longest:
            reason = f"the best path takes {reference.duration:.2f} s; only less than {longest:.2f} s would be a gain"
            return Plan(None, state.time, Verdict(VerdictCode.NO_FEASIBLE_PATH, reason, **query.misfits))
        certificate, objection = self.certifier.assess(timed.swept, obstacles, requirement, ends)
        objection = f"on the best path {objection}" if objection is not None and self.settings.avoidance else None
        verdict = self._path_verdict(query, path, timed, certificate, objection)
        found = self.certifier.judged(reference, certificate) if verdict.ok else None
        return Plan(found, state.time, verdict)

    def _path_verdict(
        self, query: ArmQuery, path: LatentPath, timed: TimedPath, certificate: Certificate, objection: str | None
    ) -> Verdict:
        sigma, clearance = self.graph.sigma_at(timed.latent), float(np.min(certificate.clearance))
        return path_verdict(self.skill, self.graph, query, sigma, path, clearance, timed.correction, objection)

    def seen_beside(self, base: np.ndarray) -> SeenVolume:
        """The volume in which an arm may be that leaves configurations (k, eta) of a base path (setting `unseen`)."""
        if self.settings.unseen == "free":
            return SeenVolume.unbounded()
        return SeenVolume.beside(base, self.scene.seen, self.robot, self.collision)

    def base_path(self, query: ArmQuery, obstacles: Obstacles) -> tuple[np.ndarray, np.ndarray] | str:
        """The geodesic of the metric that obstacles reshape, whether it is free of them or not: latent points (m, d)
        and configurations (m, eta); or why there is none, or why the arm cannot hold it.
        """
        reshaped = self._evaluation(query, obstacles.swept(self.requirements.detour.horizon))
        path = cheapest_path(self.graph, query, query.start_latent, reshaped, NO_NODE_REMOVED)
        if isinstance(path, Verdict):
            return path.reason
        if self.settings.refine:
            path = replace(path, polyline=refined(query.field, reshaped, NO_NODE_REMOVED, path.polyline))
        latent, found = self._timer.joint_curve(query, query.start, path, True)
        return found if isinstance(found, str) else (latent, found[0])


def _latent_start(query: ArmQuery, state: MotionState) -> np.ndarray:
    return query.start_latent if state.latent is None else state.latent


def _alike(attempts: tuple[Attempt, ...], optimistic: bool) -> tuple[Attempt, ...]:
    return tuple(attempt for attempt in attempts if attempt.optimistic is optimistic)


def _lengths_left(placed: np.ndarray) -> np.ndarray:
    """How far [m] an arm has still to go from each sample on (m,), with its spheres at (m, S, 3): between two samples
    the sphere that moves farthest counts.
    """
    steps = np.max(np.linalg.norm(np.diff(placed, axis=0), axis=2), axis=1)
    return np.append(np.cumsum(steps[::-1])[::-1], 0.0)
