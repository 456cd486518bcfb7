"""Situation: all that one tick may know, worked out once. Its methods assess, and change nothing.

A situation knows the trajectory that is being played, and therefore the state of motion in which another trajectory
takes over, a moment (`latency`) from now; the obstacles as they are expected then; the soonest stop. It assesses
whether the present path is still free, whether another path is a gain, and whether that leaves the arm a stop. The
outcome of a tick is a `Step`, which `Stream.commit` plays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geodesic_motion_ros.certification.certificate import ArmCertifier, Certificate, SweptArm, SweptSpheres
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.mode import Mode, Purpose
from geodesic_motion_ros.contract.requirement import Requirement, Requirements
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.played import FollowedPlan, PlayedTrajectory, Step
from geodesic_motion_ros.motion.retry import Question
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.trajectory.stopping import keeps_all, leaving_stop, slowed_reference, stopping_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import NEVER, Deadline


@dataclass(frozen=True)
class Stop:
    """A stop of an arm from the trajectory that it plays.

    swept : where the stop takes the arm, until it stands. certificate : of the stop, and of the arm that stands at its
        end for the prediction.
    """

    reference: JointReference
    swept: SweptArm
    certificate: Certificate


@dataclass(frozen=True, eq=False)
class Situation:
    """All that a tick at `now` [s] may know: the motion, the obstacles, the time that is left.

    Attributes
    ----------
    obstacles : as they were received, enlarged by all that may be wrong with their positions
        (`Inputs.enlarged_obstacles`).
    played, followed : as of `Stream`.
    deadline : nothing new is begun after it. handover_deadline : a trajectory that is found after it would take over in
        the past.
    reach : how far the tool may leave what was demonstrated [m].
    unchanged_since : since when the obstacles have been the same, at the same places [s].
    earlier_limits : limits that what is being played keeps, where `limits` or those of the tool have been changed
        since; None: it keeps these. tool : with its limits; None: it has none.
    late : another trajectory takes over so much later than the setting `latency` says [s], as messages are late.
    """

    settings: PlannerSettings
    limits: JointLimits
    certifier: ArmCertifier
    played: PlayedTrajectory
    followed: FollowedPlan | None
    now: float
    obstacles: Obstacles
    deadline: Deadline = NEVER
    handover_deadline: Deadline = NEVER
    reach: float = 0.0
    unchanged_since: float = 0.0
    earlier_limits: JointLimits | None = None
    tool: LimitedTool | None = None
    late: float = 0.0

    @property
    def is_late(self) -> bool:
        """Whether a deadline has passed: nothing long is begun any more."""
        return self.deadline.passed or self.handover_deadline.passed

    @property
    def at_rest(self) -> bool:
        """Whether what is being played is over."""
        return self.now >= self.played.end

    @cached_property
    def requirements(self) -> Requirements:
        """The requirements that motions must satisfy."""
        return Requirements.of(self.settings)

    @cached_property
    def state(self) -> MotionState:
        """The state of motion in which another trajectory takes over."""
        return self.played.state_at_switch(self.now + self.settings.latency + self.late, self.followed)

    @cached_property
    def expected_obstacles(self) -> Obstacles:
        """Obstacles where they are expected to be by then."""
        return self.obstacles.at(self.state.time, self.settings.prediction)

    @cached_property
    def remaining_sweep(self) -> SweptArm:
        """The places to which what is being played takes the arm from then on."""
        return self.played.swept.since(self.state.time - self.played.begin)

    @cached_property
    def stop(self) -> Stop:
        """The soonest stop along what is being played from then on."""
        return self._certified_stop(self._stopping(self.played, self.state.time, self._played_limits))

    @cached_property
    def widest_stop(self) -> Stop:
        """The soonest stop along what is being played, or off it where that is safer.

        A stop off the path is over sooner. It is taken where an obstacle meets the arm before the stop along the path
        is over, and the other one keeps more clearance until then; it must be free of the scene and of the arm itself.
        """
        along = self.stop
        if not self.settings.avoidance:
            return along
        clearance = self._clearance_while_stopping(along.swept)
        if clearance >= 0.0:
            return along
        reference = leaving_stop(self.played.reference, self.state.time - self.played.begin, self._played_limits)
        if reference is None:
            return along
        leaving = self._certified_stop(reference)
        wider = self._clearance_while_stopping(leaving.swept) > clearance
        return leaving if wider and not self.certifier.objection(leaving.certificate, -math.inf) else along

    def _clearance_while_stopping(self, swept: SweptArm) -> float:
        """Least clearance [m] of a stop until the one along the path would be over."""
        over = self.stop.reference.duration
        required = self.requirements.stop.until(over)
        certificate, _ = self.certifier.assess(swept.stand_until(over), self.expected_obstacles, required)
        return float(np.min(certificate.clearance))

    def _certified_stop(self, reference: JointReference) -> Stop:
        swept, required = self.certifier.sweep(reference), self.requirements.stop
        certificate, _ = self.certifier.assess(swept.stand_until(required.horizon), self.expected_obstacles, required)
        return Stop(reference, swept, certificate)

    @property
    def _played_limits(self) -> JointLimits:
        """The limits that what is being played keeps, and so a stop on it."""
        return self.earlier_limits or self.limits

    @property
    def exceeds_limits(self) -> bool:
        """Whether what is left of what is being played exceeds the limits, which have been lowered since."""
        if self.earlier_limits is None or self.at_rest:
            return False
        return not keeps_all(self.played.reference.rest(self.state.time - self.played.begin), self.limits, self.tool)

    @staticmethod
    def _stopping(played: PlayedTrajectory, time: float, limits: JointLimits) -> JointReference:
        """The soonest stop from a time [s] of what is played, or may be, within limits that it keeps."""
        return stopping_reference(played.reference, min(time - played.begin, played.reference.duration), limits)

    # ------------------------------------------------------------- assessments

    def satisfies_without_evasion(self, required: Requirement) -> bool:
        """Whether an arm that does not evade satisfies the requirement of an evasion: one that stops on a path to the
        goal or to near it, or else plays what it plays.
        """
        # A tick asks this when it chooses its attempts, and again where it evades.
        if required not in self._met_without_evasion:
            followed = self.followed
            on_path = followed is not None and followed.purpose in (Purpose.GOAL, Purpose.APPROACH)
            if on_path and not self.at_rest:
                objection = self.certifier.assess(self.stop.swept, self.expected_obstacles, required)[1]
            else:
                objection = self._assess_rest(required)[1]
            self._met_without_evasion[required] = not objection
        return self._met_without_evasion[required]

    @property
    def is_evading(self) -> bool:
        """Whether the arm evades."""
        return self.followed is not None and self.followed.purpose is Purpose.EVASION

    @property
    def evades_for_now(self) -> bool:
        """Whether an arm that evades is not met soon where it goes, and later than if it stopped: there is time yet to
        search a better evasion.
        """
        if not self.is_evading:
            return False
        required, soon = self.requirements.evasion, self.requirements.beside_graph.horizon
        going, stopping = (
            self.certifier.first_objection(self.certifier.assess(swept, self.expected_obstacles, required)[0])
            for swept in (self.remaining_sweep, self.stop.swept)
        )
        return going is None or (going >= soon and stopping is not None and stopping < going)

    @cached_property
    def _met_without_evasion(self) -> dict[Requirement, bool]:
        return {}

    def followed_to(self, query: ArmQuery | None) -> FollowedPlan | None:
        """Return the plan that is being followed, where it leads to the goal of a query; None elsewhere."""
        followed = self.followed
        if followed is None or followed.query is not query:
            return None
        return followed if followed.purpose is Purpose.GOAL else None

    def free_path(self, query: ArmQuery) -> FollowedPlan | None:
        """Return the plan that is being followed to the goal of a query, with its present clearance, where the rest of
        its path is free and the arm can stop on it; None elsewhere.
        """
        followed = self.followed_to(query)
        if followed is None:
            return None
        clearance = self.remaining_clearance()
        if clearance is None:
            return None
        return replace(followed, verdict=followed.verdict.with_figures(clearance=clearance))

    def remaining_clearance(self) -> float | None:
        """Return the least clearance [m] of the rest of the trajectory that is being played; None where it does not
        meet what is required to go on, or may not be followed (`may_follow`).
        """
        certificate, objection = self._assess_rest(self._required_to_go_on)
        if self.settings.avoidance and objection:
            return None
        standing, left = self.played.swept.since(math.inf), self.played.end - self.state.time
        if not (self.at_rest or self.is_evading) and self._is_met_at_end(standing, left):
            return None
        return float(np.min(certificate.clearance)) if self.may_follow(self.played) else None

    def _assess_rest(self, required: Requirement) -> tuple[Certificate, str]:
        """Assess the rest of what is being played; an evasion may leave what touches the arm already."""
        swept, obstacles = self.remaining_sweep, self.expected_obstacles
        if not self.is_evading or self.at_rest:
            return self.certifier.assess(swept, obstacles, required)
        return self.certifier.assess_leaving(swept, obstacles, required, self.stop.reference)

    @property
    def _required_to_go_on(self) -> Requirement:
        """The requirement of what is being followed, and of it slowed down; an arm that has arrived makes room for what
        comes.
        """
        assert self.followed is not None
        if self.at_rest:
            return self.requirements.evasion
        return self.requirements.to_go_on(self.followed.purpose, self.followed.optimistic)

    def require_a_stop(self, plan: Plan) -> Plan:
        """Return a plan, or its refusal where it may not be followed (`may_follow`), or where an arm that makes room
        would be met at its end (`_is_met_at_end`).
        """
        if plan.trajectory is None:
            return plan
        reference = plan.trajectory.reference
        standing = JointReference.standing(reference.positions[-1], reference.latent[-1])
        if self._is_met_at_end(self.certifier.sweep(standing), reference.duration):
            reason = "where the motion ends an obstacle would soon meet the arm"
        elif not self._may_follow_plan(plan, self.limits):
            reason = "on the motion the arm could not stop any more where what moves may come to a stand"
        else:
            return plan
        return Plan(None, plan.begin, Refusal(VerdictCode.NO_FEASIBLE_PATH, reason, plan.verdict.figures))

    def _is_met_at_end(self, standing: SweptArm, duration: float) -> bool:
        """Whether an obstacle would meet the arm where a motion of a duration [s] ends: within the prediction, where
        the arm makes room, or has arrived, and would have to leave again. Another arm goes there all the same, and
        loses no time, unless it is met within `ROOM_WITHIN`: it makes room at once.

        standing : the arm where the motion ends.
        """
        followed = self.followed
        arrived = self.at_rest and followed is not None and followed.purpose is Purpose.GOAL
        counted = self.settings.prediction if arrived or self.is_evading else constants.ROOM_WITHIN
        left = min(counted, self.settings.prediction) - duration
        if left <= 0.0 or self.expected_obstacles.is_static or not self.settings.avoidance:
            return False
        obstacles = self.expected_obstacles.at(self.state.time + duration, self.settings.prediction)
        return bool(self.certifier.assess(standing, obstacles, self.requirements.evasion.until(left))[1])

    def _may_follow_plan(self, plan: Plan, limits: JointLimits) -> bool:
        assert plan.trajectory is not None
        return self.may_follow(PlayedTrajectory(plan.trajectory, plan.begin, self.certifier), limits)

    def may_follow(self, candidate: PlayedTrajectory, limits: JointLimits | None = None) -> bool:
        """Whether the arm may follow a trajectory for another `REPLAN_DELAY`, as stopping then is safe, or stopping now
        is no safer. A certificate expects every obstacle to move on; an obstacle that halts before it has passed must
        not be met either.

        True if one of these holds:

        1. the stop that begins `REPLAN_DELAY` later keeps the margin among what moves from every place on its predicted
           line where an obstacle may halt by the end of that stop;
        2. the stop that begins now is not free of these places itself;
        3. an obstacle that moves on would meet the arm on that stop, or standing at its end.

        limits : that the candidate keeps; None: those that what is being played keeps.
        """
        if self.expected_obstacles.is_static or not self.settings.avoidance:
            return True
        margin = self.requirements.later_stop.of()
        begin = self.state.time + constants.REPLAN_DELAY
        stopping = self._stopping(candidate, begin, limits or self._played_limits)
        later = self.certifier.sweep_spheres(stopping)
        if self._room_of(later, constants.REPLAN_DELAY) > margin or self._room_of(self.stop.swept, 0.0) <= 0.0:
            return True
        return bool(np.min(self.stop.certificate.clearance) <= 0.0)

    def _room_of(self, stop: SweptSpheres, later: float) -> float:
        """Least distance [m] of a stop, which begins `later` [s] than now, from where obstacles may halt by its end."""
        places = self.expected_obstacles.stopping_places(later + stop.times[-1], constants.STOP_POSITION_SAMPLES)
        return self.certifier.room(stop, places)

    def is_gain(self, plan: Plan, followed: FollowedPlan) -> bool:
        """Whether a new plan takes clearly less time than what is being followed, or is not optimistic, as that is, or
        that is outdated.
        """
        if plan.reference is None:
            return False
        replaces = followed.outdated or (followed.optimistic and not plan.optimistic)
        return replaces or plan.reference.duration < self._worthwhile

    @property
    def _worthwhile(self) -> float:
        """Duration [s] below which another path leads to the goal clearly sooner than what is being played."""
        return (self.played.end - self.state.time) / constants.WORTHWHILE_RATIO

    def longest_worthwhile(self, followed: FollowedPlan) -> float:
        """Return the duration [s] from which on a new path is no gain over what is being followed; inf over an
        optimistic one, or one that is outdated.
        """
        return math.inf if followed.optimistic or followed.outdated else self._worthwhile

    def mode(self, step: Step) -> Mode:
        """Return the mode of the arm after a step."""
        followed, verdict = step.followed, step.plan.verdict
        moves = step.plan.trajectory is not None or not self.at_rest
        if followed is not None and moves:
            return Mode.from_purpose(followed.purpose)
        return Mode.from_verdict(verdict)

    # ------------------------------------------------------------------- steps

    def go_on(self, verdict: Verdict, followed: FollowedPlan | None = None) -> Step:
        """Return the step in which the arm goes on playing what it plays.

        followed : the present plan with its present clearance; None: that was not worked out, and the plan stays as it
            is.
        """
        return Step(Plan(None, self.now, verdict), followed or self.followed)

    def hand_out(self, plan: Plan, followed: FollowedPlan, before: FollowedPlan | None = None) -> Step:
        """Return the step in which a plan's trajectory takes over from what is being played; too late for that, the
        verdict DEADLINE_MISSED alone.

        followed : the new plan. before : the present one, as of `go_on`.
        """
        if not self.handover_deadline.passed:
            return Step(plan, followed)
        reason = (
            "what was found would take over in the past: the tick took longer than the setting latency, "
            f"{self.settings.latency:g} s, leaves; more latency, or a less busy machine, would do"
        )
        return self.go_on(Refusal(VerdictCode.DEADLINE_MISSED, reason), before)

    def go_on_evading(self) -> Step | None:
        """Return the step in which an arm goes on evading, where there is no time to search another path: as long as
        the rest of the evasion path is free, or is for now (`evades_for_now`), and the arm can still stop on it. None
        where that is not so, where no obstacle moves any more, or where the arm does not evade.
        """
        followed = self.followed
        if followed is None or not self.is_evading or self.obstacles.is_static or not self.may_follow(self.played):
            return None
        certificate, objection = self._assess_rest(self.requirements.evasion)
        if objection and not self.evades_for_now:
            return None
        return self.go_on(followed.verdict.with_figures(clearance=float(np.min(certificate.clearance))))

    def go_on_approaching(self, query: ArmQuery, verdict: Verdict) -> Step | None:
        """Return the step in which an arm goes on with its approach to a query's goal, as long as the rest of it is
        free and the arm can stop on it; None where that is not so, or the arm does not approach.

        verdict : why there is no path for the query; the plan's verdict states the same.
        """
        followed = self.followed
        if followed is None or followed.purpose is not Purpose.APPROACH or followed.query is not query or self.at_rest:
            return None
        clearance = self.remaining_clearance()
        if clearance is None:
            return None
        verdict = verdict.with_figures(clearance=clearance)
        return self.go_on(verdict, replace(followed, verdict=verdict))

    def slow_down(self) -> Step | None:
        """Return the step in which the arm slows down on its path until it keeps the limits, which have been lowered;
        None where it follows none, where that is begun already, or would meet an obstacle.
        """
        followed = self.followed
        if followed is None or followed.purpose is Purpose.STOP or followed.slowed is self.limits:
            return None
        since = self.state.time - self.played.begin
        slower = slowed_reference(self.played.reference, since, self.limits, self._played_limits, self.tool)
        if slower is None:
            return None
        certificate, objection = self.certifier.assess(
            self.certifier.sweep(slower), self.expected_obstacles, self._required_to_go_on
        )
        if self.settings.avoidance and objection:
            return None
        verdict = followed.verdict.with_figures(clearance=float(np.min(certificate.clearance)))
        plan = Plan(self.certifier.judge(slower, certificate), self.state.time, verdict)
        if not self._may_follow_plan(plan, self._played_limits):
            return None
        search = followed.last_search
        if search is not None:
            search = replace(search, question=Question(followed.query, self.obstacles))
        return self.hand_out(plan, replace(followed, verdict=verdict, last_search=search, slowed=self.limits), followed)

    def slowed(self) -> Step | None:
        """Return the step in which an arm that moves too fast slows down on its path, or stops where that is not free;
        None where it does so already, or evades: then it is met if it is slower.
        """
        followed = self.followed
        if followed is None or followed.purpose not in (Purpose.GOAL, Purpose.APPROACH):
            return None
        if followed.slowed is self.limits:
            return None
        reason = "the arm is to be slower, and slowed down on its path it would meet what moves"
        return self.slow_down() or self.begin_stop(Refusal(VerdictCode.NO_FEASIBLE_PATH, reason))

    def begin_stop(self, verdict: Verdict, followed: FollowedPlan | None = None) -> Step:
        """Return the step in which the arm begins the soonest stop; an arm that stops already, or rests, goes on doing
        so.

        followed : as of `go_on`.
        """
        followed = followed or self.followed
        if followed is None or followed.purpose is Purpose.STOP or self.at_rest:
            return self.go_on(verdict, followed)
        stop = self.widest_stop
        certificate = stop.certificate
        objection = self.certifier.objection(certificate)
        verdict = verdict.with_figures(clearance=float(np.min(certificate.clearance)))
        if objection and self.settings.avoidance:
            verdict = verdict.with_remark(f"while stopping, {objection}")
        plan = Plan(self.certifier.judge(stop.reference, certificate), self.state.time, verdict)
        begun = FollowedPlan.of(followed.query, plan, self.obstacles, self.now, Purpose.STOP)
        return self.hand_out(plan, begun, followed)
