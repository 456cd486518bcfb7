"""PoseStream: the references that a tool follows, each of which takes over from the one before. Searches no ways.

A new reference begins at the commanded pose with the velocity that the tool has there; every reference ends at rest.
Whether what is being followed is still the best, whether the tool could still stop on it, and how it comes to rest is
told here. All is in the task frame. `joint_stream` is the same for a whole arm, but that an arm never waits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.motion_curve import MotionCurve
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import LOOKED_AT_AGAIN, MOVING_MULTIPLE, STOPPING_PLACES, PlannerSettings
from geodesic_motion_ros.pose_smoothing import LAG
from geodesic_motion_ros.pose_solver import MARGIN_MULTIPLES, MOST_STRAIN, Motion, Plan, PoseSolver, Scene
from geodesic_motion_ros.quaternions import continuous_signs
from geodesic_motion_ros.query import Pose, Query
from geodesic_motion_ros.reference import TaskSpaceReference, initial_rate, timed_reference
from geodesic_motion_ros.refuge import AHEAD
from geodesic_motion_ros.sidestep import SOON, STOP_SHARE
from geodesic_motion_ros.task_frame import TaskFrame
from geodesic_motion_ros.time_law import braking_law
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: A stream's pose is looked for on the first seconds of its reference only, or as many as a stop takes: a task may pass
#: the same place again.
_LOCATE_WITHIN = 0.5
#: How far a rotation counts against a distance when a pose is looked for on a curve.
_METRES_PER_RADIAN = 0.1
#: A pose and a speed (over full speed) are those of a reference up to these [m], [rad], [].
_SAME_PLACE, _SAME_ANGLE, _SAME_SPEED = 1e-6, 1e-6, 1e-3
#: A new way must take so much less time than the one being followed, or keep so much further [m] from obstacles.
_WORTHWHILE, _SAFER = 1.03, 1e-3
#: While a trusting way keeps off what moves, others are looked for after so long [s].
_SEARCHED_AGAIN = 0.05 - 1e-6
#: A tool that stops and sets out again is late by this or twice as much [s].
LATE = (0.15, 0.3)
#: It waits no longer [s]: where something comes all the time it would wait for ever.
PATIENCE = 3.0
#: Where something comes to where a tool would stop, it goes on where its way is free for so long [s]: it is past by
#: then, or stops as well a little later.
PASSING = 0.4


@dataclass(frozen=True)
class Followed:
    """The reference of the stream, the query and the scene it was planned in, and its verdict; trusting as of `Plan`.

    An older query than the planner's own right after a new goal. searched : when another was last looked for [s].
    gives_way : it leads aside, from where something is coming.
    """

    query: Query
    reference: TaskSpaceReference
    verdict: Verdict
    scene: Scene
    searched: float
    trusting: bool = False
    gives_way: bool = False

    def leads_to(self, query: Query | None) -> bool:
        """Whether it leads to the goal of a query."""
        return self.query is query and not self.gives_way


class PoseStream:
    """What one tool follows, one reference after the other.

    Attributes
    ----------
    followed : None before the first reference.
    """

    def __init__(self, settings: PlannerSettings, solver: PoseSolver) -> None:
        self._settings, self._solver = settings, solver
        self.forget()

    def forget(self) -> None:
        """Nothing has been followed yet."""
        self.followed: Followed | None = None
        # Since when there has been no way that need not wait [s].
        self._waits_since: float | None = None

    @property
    def gives_way(self) -> bool:
        """Whether what is being followed leads aside, from where something is coming."""
        return self.followed is not None and self.followed.gives_way

    def begin(self, query: Query, plan: Plan, scene: Scene, gives_way: bool = False) -> Plan:
        """A plan's reference is followed from now on."""
        assert plan.reference is not None
        now = scene.in_task.time
        self.followed = Followed(query, plan.reference, plan.verdict, scene, now, plan.trusting, gives_way)
        return plan

    def move_frame(self, before: TaskFrame, after: TaskFrame) -> None:
        """The task frame stands elsewhere; what is followed stays where it is in the base frame."""
        if self.followed is not None:
            moved = self.followed.reference.moved(lambda *poses: after.to_task(*before.to_base(*poses)))
            self.followed = replace(self.followed, reference=moved)

    # ---------------------------------------------------------------- where

    def motion(self, start: Pose, speed: float) -> Motion:
        """How the stream moves at a pose and a speed [m/s]."""
        share_of_speed = speed / self._settings.speed
        if self.followed is None:
            return Motion(share_of_speed)
        reference = self.followed.reference
        segment, share, distance, angle = self._foot(reference, start)
        if not self.near(distance, angle):
            return Motion(share_of_speed)
        direction = reference.curve.velocity(segment, share)
        full = float(reference.limits.fraction(direction[:3], direction[3:]))
        velocity = direction * share_of_speed / full if full > 0.0 and speed > 0.0 else None
        same = abs(reference.rate_at(segment, share) * full - share_of_speed) <= _SAME_SPEED
        same = same and distance <= _SAME_PLACE and angle <= _SAME_ANGLE
        return Motion(share_of_speed, velocity, reference.rest(segment, share) if same else None)

    def latent_on(self, reference: TaskSpaceReference, pose: Pose) -> np.ndarray | None:
        """Latent point (d,) of a pose on a reference; None where the pose is not near it."""
        i, share, distance, angle = self._foot(reference, pose)
        latent = reference.latent
        return latent[i] + share * (latent[i + 1] - latent[i]) if self.near(distance, angle) else None

    def near(self, distance: float, angle: float) -> bool:
        """Whether a pose so far off [m], [rad] counts as on a reference."""
        return distance <= self._settings.reanchor_distance and angle <= self._settings.reanchor_angle

    def _foot(self, reference: TaskSpaceReference, pose: Pose) -> tuple[int, float, float, float]:
        """Where a pose is closest to the beginning of a reference: segment, share of it, distance [m], angle [rad]."""
        # A stop from full speed takes speed / acceleration or, in a bend, somewhat more, all of it along one reference.
        within = max(_LOCATE_WITHIN, 1.5 * self._settings.speed / self._settings.acceleration)
        count = min(len(reference.times) - 1, int(np.searchsorted(reference.times, within)) + 1)
        return reference.curve.foot(pose.position, pose.quaternion, count, _METRES_PER_RADIAN)

    # ------------------------------------------------------------- going on

    def kept(self, query: Query | None, start: Pose, motion: Motion, scene: Scene) -> Plan | None:
        """The reference being followed, where nothing has changed: it is still the best way to a query's goal.

        So too a trusting one that keeps off what moves, where others were looked for a moment ago.
        """
        followed = self.followed
        if motion.rest is None or followed is None or not followed.leads_to(query):
            return None
        if followed.scene.in_task.unmoved_in(scene.in_task):
            return self._keep(motion.rest, scene, followed)
        if not followed.trusting or abs(scene.in_task.time - followed.searched) >= _SEARCHED_AGAIN:
            return None
        rest = self._solver.certified(motion.rest, scene.in_task, trusting=True)
        keeps_off = np.min(rest.clearance) > MOVING_MULTIPLE * self._settings.obstacle_margin
        if not keeps_off or self.objection(rest, start, motion, scene.in_task):
            return None
        return self._keep(rest, scene, followed)

    def chosen(self, plan: Plan, query: Query, start: Pose, motion: Motion, scene: Scene) -> Plan:
        """A new plan, or the reference being followed where that leads to the same goal and the new one is no gain.

        A gain is a safer way or one that takes clearly less time; a way that the present motion cannot be bent into is
        none as long as the old one is free.
        """
        followed, rest = self.followed, motion.rest
        if rest is None or followed is None or not followed.leads_to(query):
            return plan
        if not (plan.turning or plan.verdict.ok):
            return plan
        found = plan.reference is not None and plan.reference.strain <= MOST_STRAIN
        # Both are judged by one measure; a way that is not trusting is a gain over one that is.
        trusting = plan.trusting if found else followed.trusting
        rest = self._solver.certified(rest, scene.in_task, trusting=trusting)
        nearest = float(np.min(rest.clearance))
        if not found:
            keep = nearest > 0.0 or not self._settings.avoidance
        else:
            # Close to an obstacle every bit of clearance is a gain.
            close = nearest <= max(MARGIN_MULTIPLES) * self._settings.obstacle_margin
            gain = float(np.min(plan.reference.clearance)) - (0.0 if close else _SAFER)
            no_safer = gain <= nearest or not self._settings.avoidance
            keep = no_safer and rest.duration <= _WORTHWHILE * plan.reference.duration
        if not keep or self.objection(rest, start, motion, scene.in_task):
            return plan
        return self._keep(rest, scene, replace(followed, searched=scene.in_task.time, trusting=trusting))

    def gone_on(self, query: Query, start: Pose, motion: Motion, scene: Scene, turning: bool = False) -> Plan | None:
        """The way being followed where no way was found, or there was no time to, and what moves is less far from where
        the tool would stop than from that way; None where the stop is the better.

        Where something would come to where it stopped, to stand at the goal when something comes there is no worse.
        turning : there is another way, but the tool must stop for it; it does where nothing comes to where it stops.
        """
        obstacles, prediction = scene.in_task, self._settings.prediction
        if motion.rest is None or not self._leads_among_what_moves(query, obstacles):
            return None
        stop = self.braking(start, obstacles, motion.speed * self._settings.speed)
        stopped = self._solver.clearance_until(stop, start, obstacles, AHEAD * prediction)
        if turning and stopped > 0.0:
            return None
        horizon = prediction if stopped > 0.0 else min(prediction, motion.rest.duration + LAG)
        return self._trusted(motion.rest, start, motion, scene, horizon, max(stopped, 0.0))

    def gone_past(
        self, query: Query, start: Pose, motion: Motion, scene: Scene, stop: TaskSpaceReference | None
    ) -> Plan | None:
        """The way being followed where no other was found, and something is about to come to where the tool stops: as
        long as it is free for `PASSING`, and there is no `objection`. None elsewhere.

        stop : that stop; None: the tool stands.
        """
        if motion.rest is None or not self._leads_among_what_moves(query, scene.in_task):
            return None
        if not self._is_soon_touched(stop, start, scene.in_task):
            return None
        return self._trusted(motion.rest, start, motion, scene, min(PASSING, motion.rest.duration + LAG), 0.0)

    def _leads_among_what_moves(self, query: Query, obstacles: Obstacles) -> bool:
        return self.followed is not None and self.followed.leads_to(query) and not obstacles.stand

    def _trusted(
        self, rest: TaskSpaceReference, start: Pose, motion: Motion, scene: Scene, horizon: float, needed: float
    ) -> Plan | None:
        """What is left of the way being followed, where for a horizon [s] it keeps more than a clearance [m] from what
        moves, and there is no objection.
        """
        assert self.followed is not None
        rest = self._solver.certified(rest, scene.in_task, horizon, trusting=True)
        if np.min(rest.clearance) <= needed or self.objection(rest, start, motion, scene.in_task):
            return None
        return self._keep(rest, scene, replace(self.followed, searched=scene.in_task.time, trusting=True))

    def _keep(self, rest: TaskSpaceReference, scene: Scene, followed: Followed) -> Plan:
        verdict = replace(followed.verdict, clearance=float(np.min(rest.clearance)))
        self.followed = replace(followed, reference=rest, verdict=verdict, scene=scene)
        return Plan(rest, verdict, trusting=followed.trusting)

    # ------------------------------------------------------------- stopping

    def stoppable(self, plan: Plan, start: Pose, motion: Motion, scene: Scene) -> Plan:
        """A plan, or that there is none where there is an `objection` to it."""
        reason = "" if plan.reference is None else self.objection(plan.reference, start, motion, scene.in_task)
        if not reason:
            return plan
        return Plan(None, replace(plan.verdict, code=VerdictCode.NO_FEASIBLE_PATH, reason=reason))

    def objection(self, going: TaskSpaceReference, start: Pose, motion: Motion, obstacles: Obstacles) -> str:
        """Why a tool is not to go on along a reference which begins now and is free, or ''.

        It is to be left a stop that is free wherever on their lines obstacles come to a stand meanwhile, if it has one
        now: a certificate takes for granted that they move on as they did; one that stops or turns must not be met
        either. That it would come to where the tool then stood is a reason to go on where the way is free wherever it
        comes to a stand, as the stop is, and none elsewhere: what stands is touched less hard.
        And it waits, where nothing comes to it, rather than go where it must not be late (`LATE`), for `PATIENCE`.
        """
        if obstacles.stand or not self._settings.avoidance:
            self._waits_since = None
            return ""
        speed = motion.speed * self._settings.speed
        if not self.leaves_a_stop(going, start, obstacles):
            stop = self.braking(start, obstacles, speed)
            if self._room_of(stop, start, 0.0, obstacles) <= 0.0 or self._passes(going, stop, start, obstacles):
                return ""
            return "on the best way the tool could not stop any more where what moves may come to a stand"
        if all(self._is_free_later(going, obstacles, late) for late in LATE):
            self._waits_since = None
            return ""
        stop = self.braking(start, obstacles, speed)
        stopped = self._solver.clearance_until(stop, start, obstacles, AHEAD * self._settings.prediction)
        if stopped <= MOVING_MULTIPLE * self._settings.obstacle_margin:
            return ""
        if self._waits_since is None:
            self._waits_since = obstacles.time
        if abs(obstacles.time - self._waits_since) >= PATIENCE:
            return ""
        return "waiting: on the best way something comes soon after the tool"

    def _passes(
        self, going: TaskSpaceReference, stop: TaskSpaceReference | None, start: Pose, obstacles: Obstacles
    ) -> bool:
        """Whether something is about to come to where a tool in motion would stop, and going on for `PASSING` is free
        wherever on their lines obstacles come to a stand.
        """
        if stop is None or not self._is_soon_touched(stop, start, obstacles):
            return False
        end = min(PASSING, going.duration + LAG)
        room = self._solver.clearance_wherever_they_stop(going, 0.0, end, obstacles, STOPPING_PLACES)
        return room > STOP_SHARE * MOVING_MULTIPLE * self._settings.obstacle_margin

    def _is_soon_touched(self, stop: TaskSpaceReference | None, start: Pose, obstacles: Obstacles) -> bool:
        """Whether a tool that stops, or stands, is touched within `SOON`."""
        return self._solver.clearance_until(stop, start, obstacles, SOON) <= 0.0

    def _is_free_later(self, going: TaskSpaceReference, obstacles: Obstacles, late: float) -> bool:
        """Whether a reference that is free of what stands is free of what moves, so much further on [s]."""
        later = obstacles.in_motion().at(obstacles.time + late, self._settings.prediction)
        return float(np.min(self._solver.certified(going, later, trusting=True).clearance)) > 0.0

    def leaves_a_stop(self, going: TaskSpaceReference, start: Pose, obstacles: Obstacles, share: float = 1.0) -> bool:
        """Whether a tool that goes on along a reference has a free stop as of `objection`; share: of the margin that
        it keeps.
        """
        rest = going.rest(*going.locate(LOOKED_AT_AGAIN))
        stop = self._soonest_rest(rest.curve, rest.latent, float(rest.rates[0]), going.strain) or rest
        margin = share * MOVING_MULTIPLE * self._settings.obstacle_margin
        return self._room_of(stop, start, LOOKED_AT_AGAIN, obstacles) > margin

    def _room_of(self, stop: TaskSpaceReference | None, start: Pose, later: float, obstacles: Obstacles) -> float:
        """Least distance [m] of a stop that begins so much later [s], or of a tool that stands at a pose, from where
        obstacles come to until what is commanded rests.
        """
        if stop is None:
            standing = obstacles.stopping_places(later + LAG, STOPPING_PLACES)
            return self._solver.clearance_until(None, start, standing, 0.0)
        # The tool will have left where it is before what comes there late.
        end = stop.duration + LAG
        return self._solver.clearance_wherever_they_stop(stop, later, end, obstacles, STOPPING_PLACES)

    def braking(self, start: Pose, obstacles: Obstacles, speed: float) -> TaskSpaceReference | None:
        """Come to rest along the reference followed so far, whatever is in the way; None at rest.

        speed : now [m/s].
        """
        if self.followed is None or speed <= 0.0:
            return None
        previous = self.followed.reference
        segment, share, distance, angle = self._foot(previous, start)
        if not self.near(distance, angle):
            return None
        limits = self._settings.limits
        curve, at = previous.curve.from_share(segment, share)
        if distance > _SAME_PLACE or angle > _SAME_ANGLE:
            positions = np.concatenate([start.position[None], curve.positions[1:]])
            quaternions = continuous_signs(np.concatenate([start.quaternion[None], curve.quaternions[1:]]))
            curve = MotionCurve.through(positions, quaternions, limits)
        latent, pace = previous.latent[at:], speed / self._settings.speed
        stop = self._soonest_rest(curve, latent, initial_rate(curve, limits, pace), previous.strain)
        if stop is None:
            # On the way at its pace its own end is the soonest rest.
            stop = self.motion(start, speed).rest or timed_reference(curve, latent, limits, pace)
        return self._solver.certified(stop, obstacles)

    def free_braking(self, start: Pose, obstacles: Obstacles, speed: float) -> TaskSpaceReference | None:
        """`braking` where that touches nothing that stands; None else."""
        stop = self.braking(start, obstacles, speed)
        touches = stop is not None and obstacles.stand and np.min(stop.clearance) <= 0.0
        return None if touches and self._settings.avoidance else stop

    def _soonest_rest(
        self, curve: MotionCurve, latent: np.ndarray, rate: float, strain: float
    ) -> TaskSpaceReference | None:
        """The soonest rest along a curve from a rate u' on; None where it is too short for one.

        strain : of the law that is left, as of `TaskSpaceReference`.
        """
        braking = braking_law(curve, self._settings.limits, rate, min(strain, MOST_STRAIN))
        if braking is None:
            return None
        curve, times, rates = braking
        unknown = np.full(len(times) - 1, np.inf)
        return TaskSpaceReference(times, rates, curve, self._settings.limits, latent[: len(times)], unknown)
