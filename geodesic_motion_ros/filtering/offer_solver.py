"""OfferSolver: an offer and a state of motion -> the certified motion that plays the rest of it, or what is free of it.

The motion leads from where the arm is onto the offered points and ends at rest at the last one: at their times, where
the limits allow that (`trajectory.kept_times`), else nowhere faster (`trajectory.timing`). In the place of latent
points it has the progress [s]: the time of the offer that each knot has come to.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance, overlap
from geodesic_motion_ros.certification.arm_in_scene import ArmInScene
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Figures, Refusal, Verdict, VerdictCode
from geodesic_motion_ros.detours.detour_frame import DetourFrame
from geodesic_motion_ros.filtering.offer import Offer
from geodesic_motion_ros.motion.detour import Detour, DetourFinder
from geodesic_motion_ros.motion.motion_judge import MotionJudge, changed_limits
from geodesic_motion_ros.motion.path_timer import JointCurve
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.evasion_targets import displaced_paths
from geodesic_motion_ros.queries.path_smoothing import smooth_latent
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.kept_times import kept_times_reference
from geodesic_motion_ros.trajectory.stopping import stopping_reference
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.tool_limits import ToolLimits
from geodesic_motion_ros.trajectory.trajectory import JointReference, joined
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: Points that are nearer than this in time [s] are one.
_SHORTEST_STEP = 1e-3
#: An arm that is before the first point of an offer, or nearly on time, is led to it in no less than this time [s], or
#: to a later one.
_LEAD = 0.05
#: An arm that is beside an offer comes to it in this time [s], or this multiple of the time that full speed would take.
#: Much longer than chunks are apart: sooner, each of them would lead it farther beside.
_JOINING, _JOINING_SHARE = 0.2, 4.0
#: A detour leaves an offer as if it had been demonstrated this widely [m].
SPREAD = 0.05
#: A detour ends beyond a chunk where the arm is this far [m] from what it passes.
FREE_PLACE = 0.02
#: A motion that takes so many times as long as it was offered, and so much longer [s], is none: where points that are
#: nearly one are far apart in time, it would last for hours.
_LONGER, _LONGEST_DELAY = 4.0, 20.0
#: An arm is on time, or nearly, where it is nearer than this [rad] to where it is to be: many policies look at where an
#: arm is, not at how fast.
_ON_TIME, _NEARLY = 2e-3, 0.02
#: Points that jitter are smoothed over so many of them, as long as none is moved farther [rad].
_SMOOTHINGS, _JITTER = (1.0, 2.0), 0.01
#: The longest free part of a motion is found up to this time [s].
_FREE_PART = 0.03


class OfferSolver(MotionJudge):
    """A solver of the motions that play an offer; any thread may call it, as no call changes it."""

    def motion(self, offer: Offer, state: MotionState, progress: float) -> JointReference | None:
        """Return the motion from a state along the rest of an offer, from a time [s] of it on; None where the state
        cannot be led onto it within the limits.
        """
        first = float(offer.points[0][0])
        begun = state.velocity, state.acceleration
        # An arm that stands has not begun sooner.
        apart = state.position - offer.at(progress if state.velocity.any() else max(progress, first))
        farthest = float(np.max(np.abs(apart)))
        joining = max(_JOINING, _JOINING_SHARE * float(np.max(np.abs(apart) / self.limits.velocity)))

        def rest(one: Offer, lead: float, fades: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            passed, path, latent = _rest(one, state.position, progress, lead)
            if fades:
                left = np.maximum(0.0, 1.0 - passed / joining)[:, None]
                # A short offer is over before: its end is kept.
                left[-1] = 0.0
                path[1:] += left[1:] * apart
            return passed, path, latent

        is_begun = progress >= first
        exact = [(offer, False)] if is_begun and farthest < _ON_TIME else []
        led = _with_less_jitter(offer) if not is_begun or farthest < _NEARLY else ()
        for one, leads_in in chain(exact, ((one, True) for one in led)):
            points = rest(one, _LEAD if leads_in else _SHORTEST_STEP, is_begun)
            kept = kept_times_reference(*points, self.limits, *begun, self.tool, leads_in)
            if kept is not None:
                return kept
        passed, path, latent = rest(offer, _SHORTEST_STEP, first - progress < joining)
        longest = _LONGER * float(passed[-1]) + _LONGEST_DELAY
        return timed_joint_reference(
            path, latent, self.limits, *begun, tool=self.tool, shown=passed, longest=longest
        )  # fmt: skip

    def certified(
        self, reference: JointReference, state: MotionState, obstacles: Obstacles, stands: bool = False
    ) -> Plan:
        """Return the plan of a motion from a state, certified among obstacles; or what its certificate objects to.

        stands : the arm waits where it ends: as long as obstacles are predicted, that is certified too.
        """
        swept, required = self.certifier.sweep(reference), self.requirements.offer
        whole = swept.stand_until(required.horizon) if stands else swept
        certificate, _ = self.certifier.assess(whole, obstacles, required)
        margin = required.margin(obstacles, float(certificate.clearance[0]))
        objection = self.certifier.objection(certificate, margin)
        figures = Figures(clearance=float(np.min(certificate.clearance)), in_support=True)
        if objection and self.settings.avoidance:
            # No certificate counts more clearance than there is.
            touches = not certificate.clearance[0] > 0.0
            overlapping = overlap(self.collision, self.robot, state.position, obstacles)[1] if touches else ""
            code = VerdictCode.IN_COLLISION if overlapping else VerdictCode.NO_FEASIBLE_PATH
            reason = f"{overlapping} where the arm is" if overlapping else objection
            return Plan(None, state.time, Refusal(code, reason, figures))
        return Plan(self.certifier.judge(reference, certificate), state.time, Verdict(figures=figures))

    def longest_free(
        self,
        reference: JointReference,
        state: MotionState,
        obstacles: Obstacles,
        allowed: Callable[[Plan], Plan],
        deadline: Deadline = NEVER,
    ) -> Plan | None:
        """Return the certified motion that plays a motion as long as is free, or as was found in time, and brakes along
        it; None where not even a stop at once is free. It ends where nothing comes as long as is predicted, if there is
        such a place.

        allowed : returns a plan, or its refusal where it may not be followed.
        """
        given = reference, state, obstacles, allowed, deadline
        return self._longest_free(*given, stands=True) or self._longest_free(*given, stands=False)

    def _longest_free(
        self,
        reference: JointReference,
        state: MotionState,
        obstacles: Obstacles,
        allowed: Callable[[Plan], Plan],
        deadline: Deadline,
        stands: bool,
    ) -> Plan | None:
        """`longest_free`; stands : as of `certified`."""
        best: Plan | None = None
        free, blocked = 0.0, reference.duration
        while best is None or (blocked - free > _FREE_PART and not deadline.passed):
            begin = 0.5 * (free + blocked) if best is not None else 0.0
            stop = stopping_reference(reference, begin, self.limits)
            braked = stop if begin == 0.0 else joined(reference, 0.0, stop, begin)
            plan = allowed(self.certified(braked, state, obstacles, stands))
            if plan.trajectory is not None:
                best, free = plan, begin
            elif best is None:
                return None
            else:
                blocked = begin
        return best

    def time_along(self, state: MotionState, curve: JointCurve) -> JointReference | Refusal:
        """Return the motion along a curve beside an offer, as fast as can be; or why there is none."""
        reference = timed_joint_reference(
            curve.configurations, curve.latent, self.limits, state.velocity, state.acceleration, tool=self.tool
        )
        return reference or Refusal(VerdictCode.NO_FEASIBLE_PATH, "the detour exceeds the limits")

    def find_detour(
        self, offer: Offer, position: np.ndarray, progress: float, obstacles: Obstacles, reach: float
    ) -> Detour | Refusal:
        """Return the cheapest detour beside the rest of an offer, from where the arm rests to its end; or why there is
        none. It leaves the offer as if demonstrations of it differed by `SPREAD`.

        The end of a chunk may be covered: then to the first place beyond that is free, if the chunk goes on as it ends;
        or else to one beside its end.

        position : (eta,) of the arm [rad]. progress : the time [s] of the offer that it has come to. reach : how far
        the tool may leave it [m].
        """
        if offer.duration <= progress + _SHORTEST_STEP:
            return Refusal(VerdictCode.NO_FEASIBLE_PATH, "the trajectory is over")
        rest = self._until_free(offer, obstacles, reach)
        times, positions = rest.points
        ahead = times > progress + _SHORTEST_STEP
        path, at = np.concatenate([position[None], positions[ahead]]), np.append(progress, times[ahead])
        covariances = np.repeat(SPREAD**2 * np.eye(3)[None], len(path), axis=0)
        frame = DetourFrame.of_base_path(self.robot, path, at[:, None], covariances)
        return DetourFinder(self).find_beside(frame, RestOfOffer(position, path[-1], rest), obstacles, reach)

    def _until_free(self, offer: Offer, obstacles: Obstacles, reach: float) -> Offer:
        """An offer, and what follows a chunk up to the first place where the arm keeps `FREE_PLACE`, else a path to
        such a place beside its end, within a reach [m]; the offer alone where its end is such a place, or none is.
        """
        swept = obstacles.swept(self.requirements.detour.horizon).beside(self.scene.solids)
        continued = offer.continued(self.limits)
        for time, position in zip(*continued.points, strict=True):
            if time < offer.duration - _SHORTEST_STEP:
                continue
            clear = obstacle_clearance(self.collision, self.robot, position, swept)[0] >= FREE_PLACE
            if clear and self_clearance(self.collision, self.robot, position)[0] > 0.0:
                return offer if time <= offer.duration else continued.until(time)
        if not offer.ends_in_motion:
            return offer
        end = offer.positions[-1]
        arm = ArmInScene.of(self.robot, self.collision, swept, self.seen_volume_beside(offer.positions))
        for beside in displaced_paths(self.robot, arm, end, self.robot.forward(end)[0], reach, FREE_PLACE):
            return offer.followed_by(beside[1:], self.limits)
        return offer


def _with_less_jitter(offer: Offer) -> Iterator[Offer]:
    """An offer, and then the same without what jitters, as the points of networks do: through these the limits of
    acceleration allow no motion at their times.
    """
    yield offer
    times, positions = offer.points
    for width in _SMOOTHINGS if len(times) > 2 else ():
        smoothed = smooth_latent(positions, width)
        if np.max(np.abs(smoothed - positions)) <= _JITTER:
            yield Offer(times, smoothed, begin=offer.begin)


def _rest(
    offer: Offer, position: np.ndarray, progress: float, shortest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (m,) [s] from a time of an offer on, and configurations (m, eta) [rad]: a position, and then the points
    that come more than a time [s] later; with the times of the offer as latent points (m, 1).
    """
    times, positions = offer.points
    ahead = times > progress + shortest
    ahead[-1] = True
    at = np.append(min(progress, times[-1] - _SHORTEST_STEP), times[ahead])
    return at - at[0], np.concatenate([position[None], positions[ahead]]), at[:, None]


@dataclass(frozen=True)
class RestOfOffer:
    """The configurations (eta,) [rad] between which the rest of an offer leads, which may be continued."""

    start: np.ndarray
    goal: np.ndarray
    offer: Offer

    @property
    def misfits(self) -> Figures:
        """It ends where it was offered to."""
        return Figures()


@dataclass(frozen=True, eq=False)
class FilteredArm:
    """An arm with what it holds, as the motions of a filter count it.

    Attributes
    ----------
    empty : the spheres of the arm alone. objects : what its hand holds.
    """

    empty: CollisionModel
    objects: tuple[HeldObject, ...]
    solver: OfferSolver

    @property
    def collision(self) -> CollisionModel:
        """The spheres of the arm and of what it holds."""
        return self.solver.collision

    @classmethod
    def of(
        cls, robot: Robot, collision: CollisionModel, settings: PlannerSettings, scene: DeclaredScene
    ) -> FilteredArm:
        """Return an arm that holds nothing."""
        limits = JointLimits.of(robot, settings.joint_speed_scale, settings.acceleration_scale)
        return cls(collision, (), OfferSolver(robot, collision, settings, limits, ToolLimits(), scene))

    def with_changes(self, objects: Sequence[HeldObject], settings: PlannerSettings) -> FilteredArm:
        """Return the arm with these objects in the place of those that it holds, and with other settings.

        Raises
        ------
        RobotError : a scale of the settings is not in (0, 1].
        """
        old = self.solver
        collision, limits = self.empty.holding(old.robot, objects), changed_limits(old, settings)
        solver = OfferSolver(old.robot, collision, settings, limits, ToolLimits(), old.scene)
        return FilteredArm(self.empty, tuple(objects), solver)
