"""Situation: all that one tick may know, worked out once. Its methods assess, and change nothing.

What is being played, and therefore the state of motion in which another trajectory takes over, a moment (`latency`)
from now; obstacles as of then; the soonest stop. Whether the present path is still free, whether another one is a gain,
whether it leaves the arm a stop: each answer is a value. What a tick comes to is a `Step`, which `Stream.take` plays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.certificate import (
    ArmCertifier,
    Certificate,
    JudgedTrajectory,
    SweptArm,
    SweptSpheres,
)
from geodesic_motion_ros.planning.mode import Mode
from geodesic_motion_ros.planning.plan import ArmQuery, MotionState, Plan
from geodesic_motion_ros.planning.search import KnownPaths, LatentPath
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.stopping import stopping_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: Knots are no nearer to each other [s].
_SHORTEST_INTERVAL = 1e-3
#: Of times [s].
TIME_ROUNDING = 1e-6


@dataclass(frozen=True)
class PlayedTrajectory:
    """A trajectory and when it begins [s]."""

    trajectory: JudgedTrajectory
    begin: float
    certifier: ArmCertifier

    @property
    def reference(self) -> JointReference:
        """The motion of the joints."""
        return self.trajectory.reference

    @property
    def end(self) -> float:
        """When the arm comes to rest [s]."""
        return self.begin + self.reference.duration

    @cached_property
    def swept(self) -> SweptArm:
        """Where it takes the arm."""
        return self.certifier.swept(self.reference)

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
    """What the trajectory being played was planned for, its verdict, and when a path was last searched [s].

    The verdict states the present clearance. `path` and `optimistic` as of `Plan`. `evading`: it leads to where nothing
    is expected to come.
    `remaining`: it is an approach, which leaves so much of the path to a covered goal [m]; inf: it is none.
    `rejected`: the last path that was no gain over this one.
    `obstacles`: those among which it was last judged; None: it is to be judged anew.
    """

    query: ArmQuery
    verdict: Verdict
    obstacles: Obstacles | None
    searched: float
    path: LatentPath | None = None
    optimistic: bool = False
    evading: bool = False
    remaining: float = math.inf
    rejected: LatentPath | None = None

    @classmethod
    def begun(
        cls,
        query: ArmQuery,
        plan: Plan,
        situation: Situation,
        evading: bool = False,
        remaining: float = math.inf,
    ) -> Followed:
        """A plan's path, taken in a situation."""
        return cls(
            query, plan.verdict, situation.obstacles, situation.now, plan.path, plan.optimistic, evading, remaining
        )

    @property
    def approaching(self) -> bool:
        """Whether it leads as near to a covered goal as the arm can go."""
        return math.isfinite(self.remaining)

    @property
    def is_stop(self) -> bool:
        """Whether it leads nowhere but to rest."""
        return not (self.verdict.ok or self.evading or self.approaching)

    @property
    def known(self) -> KnownPaths | None:
        """Paths that are no gain where the search finds them again."""
        return None if self.path is None else KnownPaths(self.path, self.rejected)

    def is_due(self, now: float) -> bool:
        """Whether a better path is to be searched at a time [s]."""
        return now >= self.searched + constants.SEARCH_PERIOD - TIME_ROUNDING


@dataclass(frozen=True)
class Step:
    """What a tick comes to: its answer, and what is followed from then on."""

    plan: Plan
    followed: Followed | None


@dataclass(frozen=True)
class Stop:
    """The soonest stop of an arm, where it takes the arm until it stands, and its certificate, which counts what comes
    to where it then stands.
    """

    reference: JointReference
    swept: SweptArm
    certificate: Certificate


@dataclass(frozen=True, eq=False)
class Situation:
    """What a tick at `now` [s] begins with.

    Attributes
    ----------
    obstacles : as they were received, enlarged by what is not known of them.
    played, followed : as of `Stream`.
    deadline : begin nothing new after it. handover_deadline : what is found after it would take over in the past.
    reach : how far the tool may leave what was demonstrated [m].
    unchanged_since : since when the obstacles have been the same, at the same places [s].
    """

    settings: PlannerSettings
    limits: JointLimits
    certifier: ArmCertifier
    played: PlayedTrajectory
    followed: Followed | None
    now: float
    obstacles: Obstacles
    deadline: Deadline = NEVER
    handover_deadline: Deadline = NEVER
    reach: float = 0.0
    unchanged_since: float = 0.0

    @property
    def at_rest(self) -> bool:
        """Whether what is being played is over."""
        return self.now >= self.played.end

    @cached_property
    def state(self) -> MotionState:
        """The state of motion in which another trajectory takes over."""
        return self.played.state_at_switch(self.now + self.settings.latency, self.followed)

    @cached_property
    def expected(self) -> Obstacles:
        """Obstacles where they are expected to be by then."""
        return self.obstacles.at(self.state.time, self.settings.prediction)

    @cached_property
    def left(self) -> SweptArm:
        """Where what is being played takes the arm from then on."""
        return self.played.swept.since(self.state.time - self.played.begin)

    @cached_property
    def stop(self) -> Stop:
        """The soonest stop along what is being played from then on."""
        reference = self._stopping(self.played, self.state.time)
        swept = self.certifier.swept(reference)
        prediction = self.settings.prediction
        certificate = self.certifier.certify_swept(swept.lasting(prediction), self.expected, prediction)
        return Stop(reference, swept, certificate)

    def _stopping(self, played: PlayedTrajectory, time: float) -> JointReference:
        """The soonest stop from a time [s] of what is played, or may be."""
        return stopping_reference(played.reference, min(time - played.begin, played.reference.duration), self.limits)

    # ------------------------------------------------------------- assessments

    def following(self, query: ArmQuery | None) -> Followed | None:
        """What is being followed, where that leads to the goal of a query."""
        followed = self.followed
        return followed if followed is not None and followed.query is query and followed.verdict.ok else None

    def free_path(self, query: ArmQuery) -> Followed | None:
        """The same with its present clearance, where what is left of it is free and can be stopped on."""
        followed = self.following(query)
        if followed is None:
            return None
        clearance = self.clearance_left(beyond=not followed.optimistic)
        return None if clearance is None else replace(followed, verdict=replace(followed.verdict, clearance=clearance))

    def clearance_left(self, beyond: bool) -> float | None:
        """Least clearance [m] of what is left of what is being played, where that is free and can be stopped on.

        beyond : what moves is expected to stand where it is after the prediction, and counted there.
        """
        certificate = self.certifier.certify_swept(self.left, self.expected, self.settings.prediction, beyond)
        if self.settings.avoidance and self.certifier.objection(certificate) is not None:
            return None
        return float(np.min(certificate.clearance)) if self.leaves_a_stop(self.played) else None

    def require_a_stop(self, plan: Plan) -> Plan:
        """A plan, or its refusal where it does not leave a stop (`leaves_a_stop`)."""
        if plan.trajectory is None or self.leaves_a_stop(PlayedTrajectory(plan.trajectory, plan.begin, self.certifier)):
            return plan
        reason = "on the best path the arm could not stop any more where what moves may come to a stand"
        return Plan(None, plan.begin, replace(plan.verdict, code=VerdictCode.NO_FEASIBLE_PATH, reason=reason))

    def leaves_a_stop(self, candidate: PlayedTrajectory) -> bool:
        """Whether an arm that follows a trajectory for `REPLAN_DELAY` is left a stop that is free wherever on their
        lines obstacles halt meanwhile. True as well where it has none now, or would be met by what moves on where it
        stood: to go on is no worse then.

        A certificate takes for granted that they move on; one that stops before it has passed must not be met either.
        """
        if self.expected.is_static or not self.settings.avoidance:
            return True
        margin = constants.DYNAMIC_MARGIN_FACTOR * self.settings.obstacle_margin
        stopping = self._stopping(candidate, self.state.time + constants.REPLAN_DELAY)
        later = self.certifier.swept_spheres(stopping)
        if self._room_of(later, constants.REPLAN_DELAY) > margin or self._room_of(self.stop.swept, 0.0) <= 0.0:
            return True
        return bool(np.min(self.stop.certificate.clearance) <= 0.0)

    def _room_of(self, stop: SweptSpheres, later: float) -> float:
        """Least distance [m] of a stop that begins so much later [s] from where obstacles may halt by its end."""
        places = self.expected.stopping_places(later + stop.times[-1], constants.STOP_POSITION_SAMPLES)
        return self.certifier.room(stop, places)

    def gains(self, plan: Plan, followed: Followed) -> bool:
        """Whether a new plan is not optimistic, as what is being followed is, or takes clearly less time."""
        if plan.reference is None:
            return False
        return (followed.optimistic and not plan.optimistic) or plan.reference.duration < self._worthwhile

    @property
    def _worthwhile(self) -> float:
        """Duration [s] below which another path leads to the goal clearly sooner than what is being played."""
        return (self.played.end - self.state.time) / constants.WORTHWHILE_RATIO

    def longest_worthwhile(self, followed: Followed) -> float:
        """Duration [s] from which on a new path is no gain over what is being followed; inf over an optimistic one."""
        return math.inf if followed.optimistic else self._worthwhile

    def mode(self, step: Step) -> Mode:
        """What the arm does after a step."""
        followed, verdict = step.followed, step.plan.verdict
        moves = step.plan.trajectory is not None or not self.at_rest
        if followed is not None and moves:
            return Mode.moving(followed.verdict.ok, followed.approaching, followed.evading)
        return Mode.standing(verdict)

    # ------------------------------------------------------------------- steps

    def answered(self, verdict: Verdict, followed: Followed | None = None) -> Step:
        """What is being played stays; followed : that with its present clearance, where it was worked out."""
        return Step(Plan(None, self.now, verdict), followed or self.followed)

    def handed_out(self, plan: Plan, followed: Followed, before: Followed | None = None) -> Step:
        """What is being played until a plan's trajectory begins, and that from there on; nothing if it is too late.

        followed : what is followed then; before : until then, as of `answered`.
        """
        if not self.handover_deadline.passed:
            return Step(plan, followed)
        reason = (
            "what was found would take over in the past: the tick took longer than the setting latency, "
            f"{self.settings.latency:g} s, leaves; more latency, or a less busy machine, would do"
        )
        return self.answered(Verdict(VerdictCode.DEADLINE_MISSED, reason), before)

    def stopped(self, verdict: Verdict, followed: Followed | None = None) -> Step:
        """A stop along the path being followed, or what is being played where that is one already.

        followed : as of `answered`.
        """
        followed = followed or self.followed
        if followed is None or followed.is_stop or self.at_rest:
            return self.answered(verdict, followed)
        certificate = self.stop.certificate
        objection = self.certifier.objection(certificate)
        verdict = replace(verdict, clearance=float(np.min(certificate.clearance)))
        if objection is not None and self.settings.avoidance:
            verdict = replace(verdict, reason=f"{verdict.reason}; while stopping, {objection}")
        plan = Plan(self.certifier.judged(self.stop.reference, certificate), self.state.time, verdict)
        return self.handed_out(plan, Followed.begun(followed.query, plan, self), followed)
