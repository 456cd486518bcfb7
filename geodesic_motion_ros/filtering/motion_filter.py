"""MotionFilter: trajectories that others offer, obstacles and the time -> what the arm plays, certified, once per tick.

A policy sends chunks, a planner whole trajectories, a joystick targets. Each is joined to what is played, timed no
faster than offered, and certified for the whole arm by the requirements of every motion of the planner. Where it is not
free the longest part that is is played, and the arm brakes along its path; it goes on once that clears.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.contract.requirement import Requirement
from geodesic_motion_ros.contract.settings import SEARCH_PERIOD, PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.filtering.offer import (
    LATEST_BEGIN,
    Offer,
    OfferRequest,
    checked_offer,
    joining_objection,
)
from geodesic_motion_ros.filtering.offer_solver import FilteredArm, RestOfOffer
from geodesic_motion_ros.motion.detour import Detour, DetourFinder
from geodesic_motion_ros.motion.evasion_motion import EVADING, evasion_beside
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.played import FollowedPlan, Step
from geodesic_motion_ros.motion.retry import TIME_ROUNDING, PastSearch, Question, Workings, is_due
from geodesic_motion_ros.motion.worker import DETOUR_DELAY, Job, Worker
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.planning.streaming_planner import PreparedArm, StreamingPlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError

#: What an arm does that was stopped by what stands on its path.
Recovery = Literal["wait", "detour"]
#: A longer part of an offer that is free is played where it is longer by this [s].
_GAIN = 0.05
#: The progress of a motion has this many numbers: its time.
_PROGRESS = 1


class MotionFilter(StreamingPlanner[FilteredArm]):
    """A filter of the motions that others want an arm to make, as a stream: observe, offer, tick.

    One thread calls all its methods. Times are of one clock, the caller's; obstacles are of the base frame.

    Example
    -------
    >>> motion_filter = MotionFilter("panda", DeclaredScene.empty())
    >>> motion_filter.stand_at(q, now=0.0)
    >>> motion_filter.observe(Obstacles.of_spheres(centres, radii, velocities, time=0.0))
    >>> verdict = motion_filter.offer(times, positions, begin=0.1)
    >>> plan = motion_filter.tick(now=0.0)  # plan.reference is played from plan.begin on; plan.verdict: why it brakes
    """

    noun = "trajectory"

    def __init__(
        self,
        robot: str,
        scene: DeclaredScene | None = None,
        settings: PlannerSettings | None = None,
        collision: CollisionModel | None = None,
        recover: Recovery = "wait",
        detours: Worker | None = None,
    ) -> None:
        """robot : the name of an arm, or its folder. scene : what always stands around it; None: that is not known.

        settings : of the planner; None: its defaults, and all of the speed and acceleration that the arm has.
        collision : the spheres that obstacles are kept away from; None: those of the arm. recover : what an arm does
        that has come to rest before what stands on its path: it waits for that to leave, or after `patience` passes
        around it, and makes room for what comes to it meanwhile. detours : what searches how; None: one whose results
        take `DETOUR_DELAY`.

        Raises
        ------
        ParameterError : an arm is to pass around, and no scene is known.
        """
        if recover not in get_args(Recovery):
            raise ParameterError(f"recover = {recover!r}: expected one of {', '.join(get_args(Recovery))}")
        if not (scene is None or isinstance(scene, DeclaredScene)):
            raise ParameterError(f"scene = {scene!r}: a DeclaredScene is needed, as DeclaredScene.from_name finds it")
        if recover == "detour" and scene is None:
            raise ParameterError(
                "recover = detour: declare what stands around the arm as its scene, an empty one where nothing does"
            )
        named = Robot.named(robot)
        if settings is None:
            settings = PlannerSettings(speed_scale=named.largest_speed_scale, acceleration_scale=1.0)
        model, known = collision or CollisionModel.named(robot), scene or DeclaredScene.empty()
        super().__init__(FilteredArm.of(named, model, settings, known), named, scene, _PROGRESS)
        # The offer that is played, None: there is none; and those that have not begun, in the order in which they do.
        self._active: Offer | None = None
        self._waiting: tuple[Offer, ...] = ()
        self._recovers = recover == "detour"
        self._worker = detours or Worker(DETOUR_DELAY)
        # The last attempt to play the active offer, and why it failed.
        self._attempted: tuple[PastSearch, Refusal] | None = None
        # Since when the arm has had no free motion [s], the detour that was searched last, and the offer that the arm
        # passes around.
        self._blocked_since = math.inf
        self._passed: Offer | None = None
        # The last searches of a place to make room that came to their end and found none, by what is required there;
        # and what one that was out of time has tried.
        self._not_evaded: dict[Requirement, PastSearch] = {}
        self._workings = Workings()
        self._detour: tuple[Question, Job[Detour | Refusal]] | None = None

    # ---------------------------------------------------------------- inputs

    def observe(self, obstacles: Obstacles) -> Verdict:
        """Replace all obstacles by others; BAD_INPUT names the first that is not valid, and the old ones stay."""
        return self.take_obstacles(obstacles)

    def offer(
        self, times: object, positions: object, velocities: object = None, begin: float | None = None
    ) -> Verdict:
        """Offer a trajectory, which takes the place of the one before from the next tick on: points at `times` (m,)
        [s], increasing, with positions (m, eta) [rad] and, where they are known, velocities [rad/s].

        begin : when time 0 is [s]; None: at once. BAD_INPUT names what is wrong: then the one before stays.
        """
        return self.take_goal(self.prepare(OfferRequest(times, positions, velocities, begin)))

    def prepare(self, request: OfferRequest) -> Offer | Refusal:
        """Check an offered trajectory: any thread may do it while another one ticks. BAD_INPUT names what is wrong."""
        return checked_offer(self.robot, self.limits, request)

    def take_goal(self, offer: Offer | Refusal) -> Verdict:
        """Play a trajectory that was checked from the next tick on. BAD_INPUT where the arm cannot join it now, or it
        was refused: then the one before stays.
        """
        if isinstance(offer, Refusal):
            return offer
        state = self.commanded_state(self._soonest(offer))
        if state is None:
            return Refusal(VerdictCode.BAD_INPUT, "where the arm stands is not known yet")
        objection = self._joining_objection(offer, *state[:2])
        if objection and self.robot.is_continuous.any():
            # Who counts turns otherwise means the same places.
            offer = offer.in_turn(self.robot, state[0])
            objection = self._joining_objection(offer, *state[:2])
        if objection:
            return Refusal(VerdictCode.BAD_INPUT, objection)
        before = () if offer.begin is None else (one for one in self._waiting if _begins_before(one, offer.begin))
        self._waiting = (*before, offer)
        return Verdict(reason=f"a trajectory of {offer.duration:.2f} s" if offer.duration else "a target")

    def _soonest(self, offer: Offer) -> float:
        """When an offer can be joined [s]."""
        soonest = self._ticked + self.latency
        return soonest if offer.begin is None else max(soonest, offer.begin)

    def _joining_objection(self, offer: Offer, position: np.ndarray, velocity: np.ndarray) -> str:
        """Why an arm cannot join an offer at the soonest; "" where it can. position, velocity : (eta,) [rad], [rad/s]
        then.
        """
        if offer.begin is not None:
            if offer.begin + offer.duration <= self._ticked + self.latency:
                late = self._ticked - offer.begin - offer.duration
                over = f"was over {late:.2f} s ago" if late > 0.0 else "is over before the arm could join it"
                return f"the trajectory {over}"
            if offer.begin > self._ticked + LATEST_BEGIN:
                wait = offer.begin - self._ticked
                return f"the trajectory begins in {wait:.0f} s, at most {LATEST_BEGIN:g} s may be"
        at = self._soonest(offer)
        progress = 0.0 if at == offer.begin else self._joined_at(offer, position, velocity, at)
        return joining_objection(self.robot, self.limits, offer, position, progress)

    def _joined_at(self, offer: Offer, position: np.ndarray, velocity: np.ndarray, time: float) -> float:
        """The time [s] of an offer at which an arm at a position [rad] with a velocity (eta,) [rad/s] at `time` [s]
        joins it: the one that is due, where the arm is near its place; else that of the nearest place.
        """
        due = 0.0 if offer.begin is None else time - offer.begin
        scheduled = float(np.clip(due, 0.0, offer.times[-1]))
        if offer.begin is not None and not joining_objection(self.robot, self.limits, offer, position, scheduled):
            return scheduled
        nearest = offer.nearest(position, self.limits)
        if nearest > offer.times[0]:
            return nearest
        return min(scheduled, offer.before_first(position, velocity, self.limits))

    def clear_goal(self) -> None:
        """Forget the trajectory that is played: the arm comes to rest along it."""
        self._active, self._waiting = None, ()

    # ------------------------------------------------------------------ ticks

    def _decide(self, situation: Situation) -> Plan:
        before, time = (self._active, self._attempted, self._waiting), situation.state.time
        begun = [offer for offer in self._waiting if _begins_before(offer, time + TIME_ROUNDING)]
        if begun:
            newest, later = begun[-1], self._waiting[len(begun) :]
            waits = _evades(situation) or (newest.ends_in_motion and self._passes_around(situation))
            self._active, self._waiting = (self._active, (newest, *later)) if waits else (newest, later)
        step = self._step(situation)
        free = step.plan.verdict.ok or step.plan.verdict.code is VerdictCode.NO_GOAL
        self._blocked_since = math.inf if free else min(self._blocked_since, situation.now)
        return self._commit_step(situation, step, before)

    def _passes_around(self, situation: Situation) -> bool:
        """Whether the arm follows a detour: chunks of a stream, which may know nothing of what it passes, wait."""
        followed = situation.followed
        if self._passed is None or followed is None or situation.at_rest:
            return False
        return followed.query is self._passed and followed.purpose is Purpose.GOAL

    def _step(self, situation: Situation) -> Step:
        """What is played from now on."""
        offer, followed = self._active, situation.followed
        if offer is None and self._waiting and self._waiting[0].begin is not None:
            wait = self._waiting[0].begin - situation.state.time
            return situation.begin_stop(Refusal(VerdictCode.NO_GOAL, f"the trajectory begins in {wait:.1f} s"))
        if offer is None:
            return situation.begin_stop(Refusal(VerdictCode.NO_GOAL, "no trajectory has been given"))
        if situation.exceeds_limits and (slowed := situation.slowed()) is not None:
            return slowed
        if followed is not None and _evades(situation) and _is_free_for_now(situation):
            assert situation.state.latent is not None
            progress, tried = float(situation.state.latent[0]), self._attempted
            farther = None if tried is None else self._evade(situation, offer, progress, tried[1])
            return farther or situation.go_on(followed.verdict)
        follows = followed is not None and followed.query is offer
        stops = followed is None or followed.purpose is Purpose.STOP
        clearance = situation.remaining_clearance() if follows and not stops else None
        if follows and followed is not None:
            assert situation.state.latent is not None
            progress = float(situation.state.latent[0])
            verdict = followed.verdict if clearance is None else followed.verdict.with_figures(clearance=clearance)
            if situation.at_rest and progress >= offer.duration - 1e-6:
                played = Verdict(reason="the trajectory has been played", figures=verdict.figures)
                return situation.go_on(played, replace(followed, purpose=Purpose.GOAL))
            if clearance is not None and followed.purpose is Purpose.GOAL:
                return situation.go_on(verdict)
        else:
            state = situation.state
            progress = self._joined_at(offer, state.position, state.velocity, state.time)
        around = self._around(situation, offer, progress)
        if around is not None:
            return around
        question = Question(offer, situation.obstacles, situation.state.position if situation.at_rest else None)
        tried, safe = self._attempted, clearance is not None or stops or situation.at_rest
        if tried is not None and safe and not is_due(tried[0], question, situation.now, SEARCH_PERIOD):
            return self._evade(situation, offer, progress, tried[1]) or situation.go_on(tried[1])
        step = self._attempt(situation, offer, progress, goes_on=clearance is not None)
        verdict = step.plan.verdict
        if not isinstance(verdict, Refusal):
            self._attempted = None
            return step
        self._attempted = PastSearch(question, situation.now), verdict
        begun = None if step.plan.trajectory is None else step.followed
        if begun is not None and begun.purpose is not Purpose.STOP:
            return step
        return self._evade(situation, offer, progress, verdict) or step

    def _attempt(self, situation: Situation, offer: Offer, progress: float, goes_on: bool = False) -> Step:
        """Play the rest of an offer from a time [s] of it on, or the longest part that is free.

        goes_on : what is being played, of the same offer, is free.
        """
        solver = self._arm.solver
        reference = solver.motion(offer, situation.state, progress)
        if reference is None:
            reason = "stopping first: the trajectory turns off the present motion, or leaves the limits"
            refusal = Refusal(VerdictCode.NO_FEASIBLE_PATH, reason)
        else:
            plan = solver.certified(reference, situation.state, situation.expected_obstacles)
            plan = situation.require_a_stop(plan)
            if plan.trajectory is not None:
                return situation.hand_out(plan, FollowedPlan.of(offer, plan, situation.obstacles, situation.now))
            refusal = plan.refusal
            reached = progress
            if goes_on:
                reached = _end(situation.played.reference)
            part = self._free_part(situation, offer, reference, refusal)
            # An arm in motion brakes along it at least.
            brakes = not (goes_on or situation.at_rest)
            if part is not None and part.reference is not None and (brakes or _end(part.reference) > reached + _GAIN):
                begun = FollowedPlan.of(offer, part, situation.obstacles, situation.now, Purpose.APPROACH)
                return situation.hand_out(part, begun)
        if goes_on:
            return situation.go_on(refusal)
        return situation.begin_stop(refusal)

    def _free_part(
        self, situation: Situation, offer: Offer, reference: JointReference, refusal: Refusal
    ) -> Plan | None:
        """The longest part of a motion along an offer that is free, with the reason why it is no longer; None where not
        even a stop at once is.
        """
        part = self._arm.solver.longest_free(
            reference, situation.state, situation.expected_obstacles, situation.require_a_stop, situation.deadline
        )
        if part is None or part.reference is None:
            return None
        played = _end(part.reference) - float(part.reference.latent[0, 0])
        verdict = refusal.with_figures(clearance=part.verdict.figures.clearance)
        share = f"plays {played:.2f} s of the trajectory and " if played >= 0.005 else ""
        return replace(part, verdict=verdict.with_remark(f"it {share}brakes"))

    def _evade(self, situation: Situation, offer: Offer, progress: float, refusal: Refusal) -> Step | None:
        """Make room for what comes to where a blocked arm rests, or evades to; None: it need not, or cannot.

        A place is searched to which nothing comes as long as is predicted; where there is none, and the arm is met
        soon, one to which nothing comes soon.
        """
        may_leave = self._recovers and (situation.at_rest or situation.is_evading) and situation.settings.avoidance
        blocked = refusal.code in (VerdictCode.NO_FEASIBLE_PATH, VerdictCode.IN_COLLISION)
        if not (may_leave and blocked) or situation.obstacles.is_static:
            return None
        question = Question(offer, situation.obstacles)
        for required in (situation.requirements.evasion, situation.requirements.beside_graph):
            if situation.satisfies_without_evasion(required):
                return None
            if not is_due(self._not_evaded.get(required), question, situation.now, SEARCH_PERIOD):
                continue
            undisplaced, _ = self.robot.forward(offer.at(progress))
            plan = evasion_beside(
                self._arm.solver, required, np.array([progress]), situation.state, situation.expected_obstacles,
                situation.stop.reference, undisplaced, self._reach, self._workings, situation.deadline,
            )  # fmt: skip
            if plan is not None:
                self._not_evaded.clear()
                refusal = refusal.with_figures(clearance=plan.verdict.figures.clearance)
                plan = replace(plan, verdict=refusal.with_remark(EVADING))
                begun = FollowedPlan.of(offer, plan, situation.obstacles, situation.now, Purpose.EVASION)
                return situation.hand_out(plan, begun)
            # The next tick resumes a search that was out of time.
            if required not in self._workings.evasions:
                self._not_evaded[required] = PastSearch(question, situation.now)
            if situation.deadline.passed:
                return None
        return None

    def _around(self, situation: Situation, offer: Offer, progress: float) -> Step | None:
        """Follow the detour that was found for an arm at rest, or have one searched, once it has been blocked for long
        enough: since it last was free to play on, however it has crept or made room meanwhile. None: there is none to
        follow yet.
        """
        if not (self._recovers and situation.at_rest):
            return None
        state, now = situation.state, situation.now
        # From one place a stream offers the same again and again.
        searched = None if self._detour is None else self._detour[0].about
        about = searched if isinstance(searched, Offer) and searched.ends_like(offer) else offer
        question = Question(about, situation.obstacles, state.position, self._reach)
        if self._detour is not None and self._detour[0].holds_there(question):
            asked, job = self._detour
            if not job.is_done(now):
                return None
            if isinstance(job.result, Detour):
                plan = DetourFinder(self._arm.solver).plan(job.result, state, situation.expected_obstacles)
                plan = situation.require_a_stop(plan)
                if plan.trajectory is not None and isinstance(job.result.query, RestOfOffer):
                    self._detour, self._active = None, job.result.query.offer
                    self._passed = self._active
                    return situation.hand_out(plan, FollowedPlan.of(self._active, plan, situation.obstacles, now))
            if asked.holds_for(question):
                return None
        since = min(self._blocked_since, situation.unchanged_since)
        if now >= since + situation.settings.patience - TIME_ROUNDING:
            search = partial(
                self._arm.solver.find_detour, offer, state.position, progress, situation.expected_obstacles, self._reach
            )
            self._detour = question, self._worker.start(search, now)
        return None

    def _stop(self, situation: Situation, verdict: Refusal) -> Plan:
        return self._commit_step(
            situation, situation.begin_stop(verdict), (self._active, self._attempted, self._waiting)
        )

    # ------------------------------------------------- what depends on where the arm is

    def _take_aim_back(self, aim: Any) -> None:
        self._active, self._attempted, self._waiting = aim

    def _stands_anew(self) -> None:
        self.clear_goal()
        self._blocked_since = math.inf

    def _prepared_arm(self, arm: FilteredArm, holds_others: bool) -> PreparedArm[FilteredArm]:
        return PreparedArm(arm, None, None)

    def _arm_taken(self, prepared: PreparedArm[FilteredArm]) -> None:
        self._attempted = None
        self._not_evaded.clear()


def _begins_before(offer: Offer, time: float) -> bool:
    """Whether an offer begins at once, or before a time [s]."""
    return offer.begin is None or offer.begin < time


def _is_free_for_now(situation: Situation) -> bool:
    """Whether no obstacle soon meets the arm where it makes room."""
    return situation.satisfies_without_evasion(situation.requirements.beside_graph)


def _evades(situation: Situation) -> bool:
    """Whether the arm moves to where it makes room."""
    return situation.is_evading and not situation.at_rest


def _end(reference: JointReference) -> float:
    """The time [s] of an offer at which a motion along it comes to rest."""
    return float(reference.latent[-1, 0])
