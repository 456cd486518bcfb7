"""The motion of an arm: the trajectory that it plays (`PlayedTrajectory`), the plan behind that (`FollowedPlan`), and
the outcome of one tick for both (`Step`). The `Stream` owns them; a `Situation` assesses them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geodesic_motion_ros.certification.certificate import ArmCertifier, JudgedTrajectory, SweptArm
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.contract.status import Verdict
from geodesic_motion_ros.motion.plan import Aim, MotionState, Plan
from geodesic_motion_ros.motion.retry import TIME_ROUNDING, PastSearch, Question, is_due
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.search import KnownPaths, LatentPath
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.trajectory import SAME_TIME, JointReference

#: Two knots are no nearer to each other than this [s].
_SHORTEST_INTERVAL = 1e-3


@dataclass(frozen=True)
class PlayedTrajectory:
    """A trajectory on the clock: what the arm passes from `begin` [s] on, until another trajectory takes over."""

    trajectory: JudgedTrajectory
    begin: float
    certifier: ArmCertifier

    @property
    def reference(self) -> JointReference:
        """The motion of the joints."""
        return self.trajectory.reference

    @property
    def end(self) -> float:
        """The time at which the arm comes to rest [s]."""
        return self.begin + self.reference.duration

    @cached_property
    def swept(self) -> SweptArm:
        """The places to which it takes the arm."""
        return self.certifier.sweep(self.reference)

    @cached_property
    def _knots(self) -> np.ndarray:
        """The times (n,) of the knots [s].

        A time near 1.8e9 s, as of today's clock, is a multiple of 0.24 us: the first of them that is not before the
        knot.
        """
        knots = self.begin + self.reference.times
        early = knots - self.begin < self.reference.times - SAME_TIME
        return np.where(early, np.nextafter(knots, np.inf), knots)

    def switch_time(self, earliest: float) -> float:
        """Return when another trajectory takes over, at or after a time [s]: no nearer to the knot before than may be,
        and at a knot that would follow at once.
        """
        if earliest >= self.end:
            return earliest
        time = max(earliest, self.knot_before(earliest) + _SHORTEST_INTERVAL)
        following = min(self.end, self.knot_before(time + TIME_ROUNDING))
        return following if following > time + SAME_TIME else time

    def knot_before(self, time: float) -> float:
        """Return the last knot at or before a time [s]; that time itself where the arm stands by then."""
        if time >= self.end:
            return time
        return float(self._knots[max(0, int(np.searchsorted(self._knots, time, side="right")) - 1)])

    def state_at_switch(self, earliest: float, followed: FollowedPlan | None) -> MotionState:
        """Return in what state another trajectory takes over, at or after a time [s]; with a latent point where it is
        followed.
        """
        time = self.switch_time(earliest)
        local = time - self.begin
        latent = None if followed is None else self.reference.latent_at(local)
        query = None if followed is None else followed.query
        return MotionState(time, *self.reference.sample(local), latent, query)


@dataclass(frozen=True)
class FollowedPlan:
    """The plan behind the trajectory that is being played: its purpose, query and path, and when a better one was last
    searched.

    Attributes
    ----------
    purpose : what the motion is for.
    verdict : that of the plan, with the present clearance.
    last_search : the last search of a path, among the obstacles for which the motion is certified; None: it has to be
        searched, and certified, anew.
    path, optimistic : as of `Plan`.
    remaining : how much of the path to a covered goal an approach leaves [m]; inf with every other purpose.
    rejected : the last path that was no gain over this one.
    outdated : whether settings have been changed since: any path that is found takes the place of this one.
    slowed : the limits that the motion was slowed down to, where these have been lowered; None: it was not.
    """

    query: Aim
    purpose: Purpose
    verdict: Verdict
    last_search: PastSearch | None
    path: LatentPath | None = None
    optimistic: bool = False
    remaining: float = math.inf
    rejected: LatentPath | None = None
    outdated: bool = False
    slowed: JointLimits | None = None

    @classmethod
    def of(
        cls,
        query: Aim,
        plan: Plan,
        obstacles: Obstacles,
        now: float,
        purpose: Purpose = Purpose.GOAL,
        remaining: float = math.inf,
    ) -> FollowedPlan:
        """Return the record of a plan that was made among obstacles at `now` [s], and is followed from now on."""
        search = PastSearch(Question(query, obstacles), now)
        return cls(query, purpose, plan.verdict, search, plan.path, plan.optimistic, remaining)

    @property
    def known_paths(self) -> KnownPaths | None:
        """Paths that are no gain where the search finds them again."""
        return None if self.path is None else KnownPaths(self.path, self.rejected)

    def is_settled_among(self, obstacles: Obstacles) -> bool:
        """Whether the motion needs neither a new certificate nor another search: obstacles stand, and are those for
        which it was certified, and a better path was searched among them to the end.
        """
        search = self.last_search
        return search is not None and search.is_answered and search.question.holds_for(Question(self.query, obstacles))

    def is_due(self, obstacles: Obstacles, now: float) -> bool:
        """Whether a better path is to be searched among obstacles at a time [s]."""
        return is_due(self.last_search, Question(self.query, obstacles), now, constants.SEARCH_PERIOD)


@dataclass(frozen=True)
class Step:
    """The outcome of one tick for the stream: the plan that is answered, and the plan that is followed from then on."""

    plan: Plan
    followed: FollowedPlan | None
