"""Stream: the references that an arm plays, each of which takes over from the one before. Searches no ways.

The stream knows the reference that is being played, and therefore the state of motion in which a new one takes over, a
moment (`latency`) from now. A new reference repeats the old one until there, and is continuous with it in position,
velocity and acceleration; every reference ends at rest. Whether what is being played is still free, whether another way
is a gain, and how the arm stops soonest is told here too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geodesic_motion_ros.arm_certificate import ArmCertifier, Certificate, SweptArm
from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_reference import JointReference, joined
from geodesic_motion_ros.joint_stop import stopping_reference
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import (
    LOOKED_AT_AGAIN,
    MOVING_MULTIPLE,
    STOPPING_PLACES,
    PlannerSettings,
)
from geodesic_motion_ros.planning.mode import Mode
from geodesic_motion_ros.planning.solver import HeldQuery, MotionState, Plan
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: A new way must take so much less time than the one being followed.
_WORTHWHILE = 1.05
#: Obstacles nearer than this to the way being followed make every bit of clearance a gain [m].
_CLOSE = 0.03
#: An obstacle has come nearer when it has by so much [m].
_NEARER = 1e-3
#: Knots are no nearer to each other [s].
_SHORTEST_INTERVAL = 1e-3
#: No less than this share of what a way promised, or of the margin among obstacles that move, must be left.
_LEFT_OF_PROMISE = 0.5


class Moment(NamedTuple):
    """When a step of the stream is made [s], among which obstacles, and when what it finds comes too late."""

    now: float
    obstacles: Obstacles
    late: Deadline = NEVER


@dataclass(frozen=True)
class Played:
    """A reference and when it begins [s]."""

    reference: JointReference
    begin: float

    @property
    def end(self) -> float:
        return self.begin + self.reference.duration

    def switch(self, earliest: float) -> float:
        """When another one takes over, at or after a time [s]: no nearer to the knot before than may be."""
        return earliest if earliest >= self.end else max(earliest, self.knot_before(earliest) + _SHORTEST_INTERVAL)

    def knot_before(self, time: float) -> float:
        """The last knot at or before a time [s]; that time itself where the arm stands by then."""
        if time >= self.end:
            return time
        knots = self.begin + self.reference.times
        return float(knots[max(0, int(np.searchsorted(knots, time, side="right")) - 1)])

    def state_at_switch(self, earliest: float, followed: Followed | None) -> MotionState:
        """In what state another one takes over, at or after a time [s]; with a latent point where it is followed."""
        time = self.switch(earliest)
        local = time - self.begin
        latent = None if followed is None else self.reference.latent_at(local)
        return MotionState(time, *self.reference.sample(local), latent)


@dataclass(frozen=True)
class Followed:
    """What the reference being played was planned for, its verdict, and when another was last looked for [s].

    The verdict tells the present clearance; `promised` was that of the plan, `looked` that when another curve was last
    drawn [m]. `nodes` and `trusting` as of `Plan`. `gives_way`: it leads aside, from where something is coming.
    """

    query: HeldQuery
    verdict: Verdict
    obstacles: Obstacles
    searched: float
    promised: float
    looked: float
    nodes: np.ndarray | None = None
    trusting: bool = False
    gives_way: bool = False

    @classmethod
    def begun(cls, query: HeldQuery, plan: Plan, moment: Moment) -> Followed:
        """A plan's way, taken at a moment."""
        nearest = plan.verdict.clearance
        return cls(query, plan.verdict, moment.obstacles, moment.now, nearest, nearest, plan.nodes, plan.trusting)

    @property
    def close(self) -> bool:
        """Whether an obstacle is so near that every bit of clearance is a gain."""
        return self.verdict.clearance <= _CLOSE

    @property
    def keeps_off(self) -> bool:
        """Whether no obstacle is near, or has come nearer: then the same way again is no gain."""
        return self.verdict.clearance > min(_CLOSE, self.looked - _NEARER)


class Stream:
    """What one arm plays, one reference after the other, and what that is played for.

    Attributes
    ----------
    played : the newest reference handed out; None where it is not known where the arm stands.
    followed : what it was planned for; None where the arm was said to stand.
    """

    def __init__(self, settings: PlannerSettings, limits: JointLimits, certifier: ArmCertifier) -> None:
        self._settings, self._limits, self._certifier = settings, limits, certifier
        self.played: Played | None = None
        self.followed: Followed | None = None
        # Where that takes the arm; None where nobody has asked yet.
        self._swept: SweptArm | None = None
        # What was played until this began: the arm's newest state may be older than that.
        self._played_before: Played | None = None

    def forget(self) -> None:
        """Where the arm is is not known any more."""
        self.played = self.followed = self._swept = self._played_before = None

    def stand(self, reference: JointReference, now: float) -> None:
        """The arm stands where a reference does from `now` [s] on."""
        self.played, self.followed = Played(reference, now), None
        self._swept = self._played_before = None

    def commanded(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Position, velocity and acceleration (eta,) played at `time` [s]; None where nothing is."""
        played = self.played
        if played is None:
            return None
        if time < played.begin and self._played_before is not None:
            played = self._played_before
        return played.reference.sample(time - played.begin)

    def playing(self, now: float) -> tuple[JointReference, float] | None:
        """What is being played from its last knot at or before `now` [s] on, and the time of that; None where that is
        not known, or over.
        """
        played = self.played
        if played is None or not played.begin <= now < played.end:
            return None
        knot = played.knot_before(now)
        return played.reference.rest(knot - played.begin), knot

    def braked(self, reference: JointReference, begin: float, verdict: Verdict) -> None:
        """The arm does not play what it was to play, but a reference that begins at a time [s] and is a stop: why."""
        self._replace(Played(reference, begin))
        if self.followed is not None:
            self.followed = replace(self.followed, verdict=verdict, nodes=None)

    def mode(self, now: float, verdict: Verdict) -> Mode:
        """What the arm does after a tick with this verdict at a time [s]."""
        followed = self.followed
        if self.played is not None and followed is not None and now < self.played.end:
            if followed.verdict.ok:
                return Mode.FOLLOWING
            return Mode.EVADING if followed.gives_way else Mode.STOPPING
        if verdict.ok:
            return Mode.FOLLOWING
        return {VerdictCode.NO_GOAL: Mode.IDLE}.get(verdict.code, Mode.WAITING if verdict.planned else Mode.HOLDING)

    def way(self) -> tuple[JointReference, float] | None:
        """What is being played and the time of its first knot [s], where it leads to the goal."""
        if self.played is None or self.followed is None or not self.followed.verdict.ok:
            return None
        return self.played.reference, self.played.begin

    def following(self, query: HeldQuery | None) -> Followed | None:
        """What is being followed, where that leads to the goal of a query."""
        followed = self.followed
        return followed if followed is not None and followed.query is query and followed.verdict.ok else None

    def free_way(self, query: HeldQuery, time: float, obstacles: Obstacles) -> Followed | None:
        """The same with its clearance from a time [s] on, where it is free of obstacles as of that time."""
        followed = self.following(query)
        if followed is None:
            return None
        left, prediction = self.left(time), self._settings.prediction
        certificate = self._certifier.certify_swept(left, obstacles, prediction, beyond=not followed.trusting)
        if self._settings.avoidance and self._certifier.objection(certificate) is not None:
            return None
        if not self.can_still_stop(self.played, time, obstacles):
            return None
        return replace(followed, verdict=replace(followed.verdict, clearance=float(np.min(certificate.clearance))))

    def stoppable(self, plan: Plan, obstacles: Obstacles) -> Plan:
        """A plan, or that there is none where `can_still_stop` does not hold of it; obstacles as of its beginning."""
        if plan.reference is None or self.can_still_stop(Played(plan.reference, plan.begin), plan.begin, obstacles):
            return plan
        reason = "on the best way the arm could not stop any more where what moves may come to a stand"
        return Plan(None, plan.begin, replace(plan.verdict, code=VerdictCode.NO_FEASIBLE_PATH, reason=reason))

    def can_still_stop(self, going: Played, time: float, obstacles: Obstacles) -> bool:
        """Whether an arm that goes on along a reference from a time [s] on is left a stop that is free wherever on
        their lines obstacles come to a stand meanwhile. True as well where it has none now, or would be met by what
        moves on where it stood: going on is no worse then.

        A certificate takes for granted that they move on; one that stops before it has passed must not be met either.
        obstacles : as of that time.
        """
        if obstacles.stand or not self._settings.avoidance:
            return True
        margin = MOVING_MULTIPLE * self._settings.obstacle_margin
        if self._room_of(self._stop(going, time + LOOKED_AT_AGAIN), LOOKED_AT_AGAIN, obstacles) > margin:
            return True
        assert self.played is not None
        stop = self._stop(self.played, time)
        if self._room_of(stop, 0.0, obstacles) <= 0.0:
            return True
        prediction = self._settings.prediction
        standing = self._certifier.certify_swept(stop.lasting(prediction), obstacles, prediction)
        return bool(np.min(standing.clearance) <= 0.0)

    def _stop(self, going: Played, time: float) -> SweptArm:
        """Where the soonest stop from a time [s] of a reference on takes the arm."""
        local = min(time - going.begin, going.reference.duration)
        return self._certifier.swept(stopping_reference(going.reference, local, self._limits))

    def _room_of(self, stop: SweptArm, later: float, obstacles: Obstacles) -> float:
        """Least distance [m] of a stop that begins so much later [s] from where obstacles come to by its end."""
        places = obstacles.stopping_places(later + stop.times[-1], STOPPING_PLACES)
        return float(np.min(self._certifier.certify_swept(stop, places, 0.0).clearance))

    def left(self, time: float) -> SweptArm:
        """Where what is being played takes the arm from a time [s] on."""
        assert self.played is not None
        if self._swept is None:
            self._swept = self._certifier.swept(self.played.reference)
        return self._swept.since(time - self.played.begin)

    def gains(self, plan: Plan, followed: Followed, time: float) -> bool:
        """Whether a new plan is safer than what is being followed from a time [s] on, or takes clearly less time."""
        assert self.played is not None
        if plan.reference is None:
            return False
        if followed.trusting and not plan.trusting:
            return True
        safer = self._settings.avoidance and followed.close and plan.verdict.clearance > followed.verdict.clearance
        return safer or self.played.end - time > _WORTHWHILE * plan.reference.duration

    def continued(self, followed: Followed, moment: Moment) -> Plan:
        """What is being played, or a stop where obstacles have come nearer than expected and it keeps further off."""
        self.followed = followed
        nearest = followed.verdict.clearance
        kept = min(followed.promised, MOVING_MULTIPLE * self._settings.obstacle_margin)
        if self._settings.avoidance and not moment.obstacles.stand and nearest < _LEFT_OF_PROMISE * kept:
            _, _, certificate = self.soonest_stop(moment)
            if np.min(certificate.clearance) > nearest:
                reason = f"an obstacle has come within {nearest:.3f} m of the way being gone"
                return self.stopped(Verdict(VerdictCode.NO_FEASIBLE_PATH, reason), moment)
        return Plan(None, moment.now, followed.verdict)

    def soonest_stop(self, moment: Moment) -> tuple[JointReference, float, Certificate]:
        """The soonest stop along what is being played, when it takes over [s], and its certificate, which counts what
        comes to where the arm then stands.
        """
        assert self.played is not None
        prediction = self._settings.prediction
        switch = self.played.switch(moment.now + self._settings.latency)
        stop = stopping_reference(self.played.reference, switch - self.played.begin, self._limits)
        swept = self._certifier.swept(stop).lasting(prediction)
        obstacles = moment.obstacles.at(switch, prediction)
        return stop, switch, self._certifier.certify_swept(swept, obstacles, prediction)

    def stopped(self, verdict: Verdict, moment: Moment) -> Plan:
        """A stop along the way being gone, or what is being played where that is one already."""
        assert self.played is not None
        followed = self.followed
        if followed is None or not (followed.verdict.ok or followed.gives_way) or moment.now >= self.played.end:
            return Plan(None, moment.now, verdict)
        stop, switch, certificate = self.soonest_stop(moment)
        objection = self._certifier.objection(certificate)
        verdict = replace(verdict, clearance=float(np.min(certificate.clearance)))
        if objection is not None and self._settings.avoidance:
            verdict = replace(verdict, reason=f"{verdict.reason}; while stopping, {objection}")
        plan = Plan(stop, switch, verdict)
        return self.play(plan, Followed.begun(followed.query, plan, moment), moment)

    def play(self, plan: Plan, followed: Followed, moment: Moment) -> Plan:
        """Hand out what is being played until a plan's reference begins, and that from there on; nothing if it is too
        late for that.
        """
        assert self.played is not None
        assert plan.reference is not None
        if moment.late.passed:
            reason = (
                "what was found would take over in the past: the tick took longer than the setting latency, "
                f"{self._settings.latency:g} s, leaves; more latency, or a less busy machine, would do"
            )
            return Plan(None, moment.now, Verdict(VerdictCode.DEADLINE_MISSED, reason))
        self.followed = followed
        begin = self.played.knot_before(moment.now)
        old = self.played.reference
        if not np.any(old.latent):
            # Where the arm stood before its first way had no latent point yet.
            old = replace(old, latent=np.repeat(plan.reference.latent[:1], len(old.times), axis=0))
        whole = joined(old, begin - self.played.begin, plan.reference, plan.begin - self.played.begin)
        self._replace(Played(whole, begin))
        return Plan(whole, begin, followed.verdict)

    def _replace(self, played: Played) -> None:
        self._played_before, self.played, self._swept = self.played, played, None
