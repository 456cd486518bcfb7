"""PoseSolver: one query on a task-space skill -> a certified reference and its verdict, in the task frame.

Reweight, search, smooth, decode, transport, certify, time: what a tick of `planner.ReactivePlanner` does when its
reference cannot stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.certificate import curve_allowance, motion_clearances
from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.graph.ambient import obstacle_clearances
from geodesic_motion_ros.graph.pose_graph import PoseGraph
from geodesic_motion_ros.graph.tool_points import tool_points
from geodesic_motion_ros.latent_way import LatentWay, cheapest_way, way_verdict
from geodesic_motion_ros.motion_curve import MotionCurve, distinct
from geodesic_motion_ros.obstacles import Obstacles, nearness
from geodesic_motion_ros.planner_settings import MOVING_MULTIPLE, PlannerSettings
from geodesic_motion_ros.planning.path_clearance import curve_clearances
from geodesic_motion_ros.planning.path_smoothing import correct_ends
from geodesic_motion_ros.planning.pose_path import (
    MARGIN_MULTIPLES,
    SMOOTHING_WIDTHS,
    decoded_path,
    reshaping_of,
    smoothed_path,
)
from geodesic_motion_ros.pose_smoothing import corners_cut
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.query import Pose, Query
from geodesic_motion_ros.reference import TaskSpaceReference, bent_to, timed_reference
from geodesic_motion_ros.refuge import ways_aside
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.sidestep import places_beside
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.task_frame import TaskFrame
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: A new way may need so much more than the accelerations allowed because it is entered in motion.
MOST_STRAIN = 1.11
#: No times are looked at that are nearer to each other [s].
_SHORTEST_INTERVAL = 0.01
#: Where to give way to is looked for so many grid steps around.
_REFUGE_STEPS = 40
#: So many sidesteps are tried, the best first, with so many samples each.
_MOST_SIDESTEPS, _SIDESTEP_SAMPLES = 4, 9


@dataclass(frozen=True)
class Plan:
    """Answer of one planning step.

    With an OK verdict the reference leads to the goal. With any other it is a ramped, certified stop along the
    reference followed so far, or leads aside, or is None: then the commanded pose must stay where it is.

    turning : there is a way to the goal, but not one that the present motion can be bent into: this is the stop before
        it. The verdict says so, and becomes OK by itself.
    trusting : what moves will have left the way by the time that the tool comes there: it is not counted beyond the
        prediction.
    """

    reference: TaskSpaceReference | None
    verdict: Verdict
    turning: bool = False
    trusting: bool = False

    @property
    def blocked(self) -> bool:
        """Whether the obstacles leave no way."""
        return self.reference is None and not self.turning and self.verdict.code is VerdictCode.NO_FEASIBLE_PATH

    def in_base(self, frame: TaskFrame) -> Plan:
        """The same plan, its reference brought from the task frame into the base frame."""
        if self.reference is None or frame.is_identity:
            return self
        return replace(self, reference=self.reference.moved(frame.to_base))


@dataclass(frozen=True)
class Scene:
    """The task frame, and the obstacles in the base frame and seen from it: replaced as a whole."""

    frame: TaskFrame
    in_base: Obstacles
    in_task: Obstacles

    @classmethod
    def of(cls, frame: TaskFrame, in_base: Obstacles) -> Scene:
        return cls(frame, in_base, frame.obstacles_to_task(in_base))


@dataclass(frozen=True)
class Motion:
    """How the stream moves as a tick begins.

    Attributes
    ----------
    speed : over full speed.
    velocity : (6,) [m/s], [rad/s], None at rest and where the pose is not near the reference followed.
    rest : what is left of that reference, where pose and speed are those it has there.
    """

    speed: float
    velocity: np.ndarray | None = None
    rest: TaskSpaceReference | None = None


AT_REST = Motion(0.0)


class PoseSolver:
    """Plans single ways on one task-space skill; holds no state of its own."""

    def __init__(self, skill: Skill, graph: PoseGraph, settings: PlannerSettings, robot: Robot) -> None:
        self.skill, self.graph, self.settings, self.robot = skill, graph, settings, robot
        self._points = np.array(settings.tool_points, dtype=float)
        self._point_radii = np.array(settings.tool_radii, dtype=float)
        self._levers = np.linalg.norm(self._points, axis=1)

    def beyond_reach(self, positions: np.ndarray, frame: TaskFrame) -> str:
        """How far tool positions (n, 3) of the task frame lie from the shoulder where the arm cannot reach, or ''."""
        distance = float(np.linalg.norm(frame.points_to_base(positions) - self.robot.shoulder, axis=1).max())
        if distance <= self.robot.reach:
            return ""
        reach = self.robot.reach
        return f"{distance:.2f} m from the shoulder; the tool of the {self.skill.robot} reaches {reach:.2f} m"

    # --------------------------------------------------------------- solve

    def solve(
        self,
        query: Query,
        start: Pose,
        start_latent: np.ndarray,
        scene: Scene,
        motion: Motion,
        deadline: Deadline = NEVER,
        trusting: bool = False,
    ) -> Plan:
        """Search, smooth, decode, certify and time until an attempt is certified, or the deadline has passed.

        trusting : as of `Plan`.
        """
        settings, obstacles = self.settings, scene.in_task
        avoided = obstacles if settings.avoidance else Obstacles.none()
        ends = self._end_clearance(query, start, avoided, trusting)
        if isinstance(ends, Plan):
            return ends
        seen = avoided.at_rest() if trusting else avoided.swept(settings.prediction)
        reshaping = reshaping_of(query, seen, settings)
        # Ends may stay closer here too.
        needed = 0.0 if avoided.stand else min(MOVING_MULTIPLE * settings.obstacle_margin, 0.5 * ends)
        multiples, smoothing = MARGIN_MULTIPLES, SMOOTHING_WIDTHS
        if trusting:
            # Neither margins nor smoothing are of any use against what such a search does not see.
            multiples, smoothing = multiples[:1], smoothing[:1]
        plan: Plan | None = None
        for multiple in multiples:
            # Ends closer to an obstacle than the margin may stay so, but the path must not come closer than they are.
            margin = min(multiple * settings.obstacle_margin, 0.5 * ends)
            found = cheapest_way(self.graph, query, start_latent, reshaping, margin, deadline)
            if isinstance(found, Verdict):
                return Plan(None, found)
            for widths in smoothing:
                if plan is not None and deadline.passed:
                    reason = f"out of time: {plan.verdict.reason}"
                    return Plan(None, replace(plan.verdict, code=VerdictCode.DEADLINE_MISSED, reason=reason))
                horizon = settings.prediction
                plan = self._certified(query, start, found, scene, widths, motion, needed, horizon, trusting)
                if plan.reference is not None or plan.turning:
                    return replace(plan, trusting=trusting)
        assert plan is not None
        return plan

    def aside(
        self,
        query: Query,
        start: Pose,
        start_latent: np.ndarray,
        scene: Scene,
        motion: Motion,
        horizon: float,
        stoppable: Callable[[TaskSpaceReference], bool],
        deadline: Deadline = NEVER,
    ) -> Plan | None:
        """A certified way to a place nearby that nothing is expected to come to, or None where none is found in time.

        horizon : obstacles are expected to move on for so long [s]. stoppable : whether a way may be gone.
        """
        obstacles, apart = scene.in_task, MOVING_MULTIPLE * self.settings.obstacle_margin
        here = float(obstacle_clearances(self._body(start), self._point_radii, obstacles, math.inf)[0])
        if here <= 0.0:
            return None
        # As of every way: a start closer to an obstacle than the margin may stay so.
        needed = min(apart, 0.5 * here)
        reshaping = reshaping_of(query, obstacles.swept(horizon), self.settings)
        for way in ways_aside(self.graph, query, start_latent, reshaping, _REFUGE_STEPS, apart):
            widths = SMOOTHING_WIDTHS[0]
            plan = self._certified(query, start, way, scene, widths, motion, needed, horizon, True, aside=True)
            found = plan.reference
            if found is not None and found.strain <= MOST_STRAIN and stoppable(found):
                return plan
            if deadline.passed:
                break
        return None

    def sidestep(
        self,
        start: Pose,
        start_latent: np.ndarray,
        scene: Scene,
        horizon: float,
        may_start: Callable[[Pose], bool],
        stoppable: Callable[[TaskSpaceReference], bool],
        deadline: Deadline = NEVER,
    ) -> Plan | None:
        """A certified straight motion from rest to a place beside the sheet that keeps off where obstacles come to
        within a horizon [s]; None where none is found in time.

        may_start : whether a motion may start at a pose. stoppable : whether a way may be gone.
        """
        places = places_beside(start.position)
        bodies = tool_points(places, np.tile(start.quaternion, (len(places), 1)), self._points)
        later = obstacle_clearances(bodies, self._point_radii, scene.in_task.swept(horizon), math.inf)
        # To come nearer on the way is what counts: of places that are no nearer than the tool is now the nearest do.
        here = obstacle_clearances(self._body(start), self._point_radii, scene.in_task, math.inf)
        best = np.argsort(-np.minimum(later, here), kind="stable")[:_MOST_SIDESTEPS]
        for place in places[best]:
            if not may_start(Pose(place, start.quaternion)):
                continue
            positions = np.linspace(start.position, place, _SIDESTEP_SAMPLES)
            if self.beyond_reach(positions, scene.frame):
                continue
            quaternions = np.tile(start.quaternion, (_SIDESTEP_SAMPLES, 1))
            latent = np.tile(start_latent, (_SIDESTEP_SAMPLES, 1))
            curve = MotionCurve.through(positions, quaternions, self.settings.limits)
            timed = timed_reference(curve, latent, self.settings.limits, 0.0)
            reference = self.certified(timed, scene.in_task, max(horizon, timed.duration), trusting=True)
            nearest = float(np.min(reference.clearance))
            if nearest > 0.0 and stoppable(reference):
                return Plan(reference, Verdict(VerdictCode.OK, clearance=nearest))
            if deadline.passed:
                break
        return None

    def _end_clearance(self, query: Query, start: Pose, obstacles: Obstacles, trusting: bool) -> float | Plan:
        """Smaller clearance [m] of start and goal, or the refusal where one of them is covered.

        The goal is to be free of where obstacles are expected to come to a stand; trusting: of those alone that stand.
        """
        prediction = self.settings.prediction
        later = obstacles.at_rest() if trusting else obstacles.at(obstacles.time + prediction, prediction)
        here, there = (
            float(obstacle_clearances(body, self._point_radii, found, math.inf)[0])
            for body, found in ((self._body(start), obstacles), (self._body(query.goal), later))
        )
        if here <= 0.0:
            reason = f"the tool overlaps an obstacle by {-1000 * here:.0f} mm where it stands"
            return refusal(VerdictCode.IN_COLLISION, reason, query, clearance=float(here))
        if there <= 0.0:
            reason = f"an obstacle covers the goal by {-1000 * there:.0f} mm"
            return refusal(VerdictCode.NO_FEASIBLE_PATH, reason, query)
        return min(here, there)

    def _body(self, pose: Pose) -> np.ndarray:
        """Tool points (1, K, 3) [m] at a pose."""
        return tool_points(pose.position[None], pose.quaternion[None], self._points)

    def clearance_until(
        self, reference: TaskSpaceReference | None, start: Pose, obstacles: Obstacles, horizon: float
    ) -> float:
        """Least clearance [m] of a reference that begins now, or of a tool that stands at a pose, from what stands, and
        from what moves on for a horizon [s]: until then it stays where it comes to rest.
        """
        if reference is not None:
            return float(np.min(self.certified(reference, obstacles, horizon, trusting=True).clearance))
        body, still = np.repeat(self._body(start), 2, axis=0), np.zeros(2)
        allowance = np.zeros((1, len(self._point_radii)))
        clearance = motion_clearances(
            body, self._point_radii, allowance, still, still, obstacles, horizon, beyond=False
        )
        return float(np.min(clearance))

    def clearance_wherever_they_stop(
        self, reference: TaskSpaceReference, later: float, end: float, obstacles: Obstacles, count: int
    ) -> float:
        """Least clearance [m] of a reference that begins so much later [s] from what moves on as it did when it was
        last seen, and comes to a stand at whatever time since.

        end : so long after its beginning [s]; until then it stays where it comes to rest. count : its poses at so many
            times are looked at, and what moves is enlarged so that nothing is left out between two of them.
        """
        standing = float(np.min(self.certified(reference, obstacles.at_rest()).clearance))
        begins, times = obstacles.age + later, np.linspace(0.0, end, count)
        positions, quaternions = map(np.array, zip(*map(reference.sample, times), strict=True))
        # Obstacles come to a stand at one of the knots: within an interval they would be known less exactly.
        apart = max(float(times[1]), _SHORTEST_INTERVAL)
        before = np.linspace(0.0, begins, 1 + math.ceil(begins / apart))[:-1]
        seen, limits = obstacles.in_motion().as_seen(apart), reference.limits
        turning = reference.strain * limits.angular_acceleration + limits.angular_speed**2
        bulges = (reference.strain * limits.acceleration + self._levers * turning) * apart**2 / 8.0
        bulges += corners_cut(limits, reference.strain, self._levers)
        motion = (
            tool_points(positions, quaternions, self._points), self._point_radii, np.tile(bulges, (count - 1, 1)),
            begins + times, np.ones(count), seen,
        )  # fmt: skip
        stands = np.concatenate([before, begins + times])
        return min(standing, *(float(np.min(motion_clearances(*motion, time))) for time in stands))

    def certified(
        self,
        reference: TaskSpaceReference,
        obstacles: Obstacles,
        horizon: float | None = None,
        trusting: bool = False,
    ) -> TaskSpaceReference:
        """A reference that begins now with its clearance among obstacles where they are now, and will be.

        horizon : they move on for so long [s]; None: for the prediction. trusting : as of `Plan`.
        """
        curve = reference.curve
        points = tool_points(curve.positions, curve.quaternions, self._points)
        # What is commanded is a mean over the reference.
        allowance = curve_allowance(curve, self._points) + corners_cut(reference.limits, reference.strain, self._levers)
        if obstacles.stand:
            return replace(reference, clearance=curve_clearances(points, self._point_radii, allowance, obstacles))
        clearance = motion_clearances(
            points, self._point_radii, allowance, reference.times, reference.rates, obstacles,
            self.settings.prediction if horizon is None else horizon, beyond=not trusting,
        )  # fmt: skip
        return replace(reference, clearance=clearance)

    def _certified(
        self,
        query: Query,
        start: Pose,
        way: LatentWay,
        scene: Scene,
        widths: tuple[float, float],
        motion: Motion,
        needed: float,
        horizon: float,
        trusting: bool,
        aside: bool = False,
    ) -> Plan:
        """Smooth, decode, transport, meet the ends exactly, time, and judge the very motion that will be commanded.

        needed : clearance [m] that it must exceed. horizon : obstacles move on for so long [s].
        aside : the way does not lead to the goal, but ends where it ends.
        """
        settings = self.settings
        path = smoothed_path(self.graph, query, way.polyline, widths)
        positions, quaternions = path.positions, path.quaternions
        if quaternions[0] @ start.quaternion < 0.0:
            quaternions = -quaternions
        goal = Pose(positions[-1], quaternions[-1]) if aside else query.goal
        ends = np.stack([start.position, goal.position])
        correction = float(np.linalg.norm(positions[[0, -1]] - ends, axis=1).max())
        positions, quaternions = correct_ends(
            positions, quaternions, (start.position, start.quaternion), (goal.position, goal.quaternion)
        )
        positions, quaternions, latent = self._drawn(positions, quaternions, path.latent)
        if motion.velocity is not None:
            bent = bent_to(positions, quaternions, motion.velocity, settings.limits)
            if bent is None:
                reason = "stopping first: the way to the goal turns off the present motion"
                return replace(refusal(VerdictCode.NO_FEASIBLE_PATH, reason, query), turning=True)
            positions, quaternions, latent = self._drawn(*bent, latent)
        beyond = self.beyond_reach(positions, scene.frame)
        if beyond:
            return refusal(VerdictCode.NO_FEASIBLE_PATH, f"the way leads {beyond}", query)
        curve = MotionCurve.through(positions, quaternions, settings.limits, motion.velocity)
        timed = timed_reference(curve, latent, settings.limits, motion.speed)
        reference = self.certified(timed, scene.in_task, horizon, trusting)
        nearest = float(np.min(reference.clearance))
        objection = None
        if settings.avoidance and nearest <= needed:
            objection = f"the best path {nearness(nearest)}; {needed:.3f} m are to be kept"
        verdict = way_verdict(self.skill, self.graph, query, path.sigma, way, nearest, correction, objection)
        if not verdict.ok:
            return Plan(None, verdict)
        return Plan(reference, verdict)

    def off_the_sheet(self, query: Query, latent: np.ndarray, pose: Pose) -> tuple[float, float]:
        """Distance [m] and angle [rad] of a pose from what a latent point (d,) stands for."""
        shown = decoded_path(self.graph, query, latent[None])
        turn = angle_between(pose.quaternion, shown.quaternions[0])
        return float(np.linalg.norm(pose.position - shown.positions[0])), float(turn)

    def _drawn(
        self, positions: np.ndarray, quaternions: np.ndarray, latent: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The distinct poses of a curve."""
        kept = distinct(positions, quaternions, self.settings.limits)
        return positions[kept], quaternions[kept], latent[kept]


def refusal(code: VerdictCode, reason: str, query: Query | None = None, clearance: float = math.nan) -> Plan:
    """No reference, and why; what is known of the query's ends goes with it."""
    return Plan(None, Verdict(code, reason, clearance=clearance, **(query.misfits if query else {})))
