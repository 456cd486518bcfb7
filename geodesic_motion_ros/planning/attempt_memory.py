"""AttemptMemory: what earlier attempts of an arm without a path came to, and therefore which of them come next."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.approach import ApproachSearch
from geodesic_motion_ros.planning.detour import Detour
from geodesic_motion_ros.planning.detour_worker import DetourJob
from geodesic_motion_ros.planning.evasion import FailedEvasion, is_searched
from geodesic_motion_ros.planning.mission import Goal, Query
from geodesic_motion_ros.planning.plan import Plan
from geodesic_motion_ros.planning.settings import Attempt
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.planning.solver import Solver
from geodesic_motion_ros.planning.status import Verdict, VerdictCode


@dataclass(frozen=True)
class Blocked:
    """What was tried for an arm at rest among obstacles that stand, and found no path: it need not be tried again.

    origin : the query that the arm stopped on, in the place of which others are tried.
    unfinished : one of the attempts, with this query or one before, was out of time.
    """

    query: Query
    origin: Query
    obstacles: Obstacles
    attempts: frozenset[Attempt]
    verdict: Verdict
    unfinished: bool = False


@dataclass(frozen=True, eq=False)
class DetourRequest:
    """What a detour is searched for: a goal, obstacles, how far it may lead [m], where the arm stands (eta,) [rad].

    query : the one that the arm stopped on.
    """

    query: Query
    goal: Goal
    obstacles: Obstacles
    reach: float
    position: np.ndarray

    def is_same(self, other: DetourRequest) -> bool:
        """Whether it has the same answer."""
        unchanged = self.is_between_same(other) and self.obstacles.is_unchanged(other.obstacles)
        return unchanged and self.reach == other.reach

    def is_between_same(self, other: DetourRequest) -> bool:
        """Whether it is to lead from the same place to the same goal."""
        return self.goal is other.goal and np.array_equal(self.position, other.position)


@dataclass(frozen=True, eq=False)
class DetourSearch:
    """A search of a detour that was begun, and for what.

    refusal : why the detour that it found is not followed, where it found one.
    """

    job: DetourJob
    request: DetourRequest
    refusal: str = ""

    def found(self, request: DetourRequest) -> Detour | None:
        """The detour of a job that is done, where it is one for a request, no farther off than that may lead."""
        detour = self.job.result
        if not isinstance(detour, Detour) or not self.request.is_between_same(request):
            return None
        return detour if self.request.reach <= request.reach or detour.displacement <= request.reach else None

    def reason(self, request: DetourRequest, now: float) -> str:
        """Why nothing meets a request at a time [s]; "" where that is not known."""
        if not self.request.is_same(request) or not self.job.done(now):
            return ""
        return self.refusal if isinstance(self.job.result, Detour) else self.job.result


@dataclass(frozen=True, eq=False)
class AttemptMemory:
    """What earlier attempts, detours, evasions and approaches came to; each tick that searches makes the next one.

    Attributes
    ----------
    without_path : the query for which there was no path the last time; refusal : why; attempted : the number of the
        last attempt.
    blocked : what was tried where obstacles stand; None: they have moved since, or the arm follows a path.
    last_failed_evasion : the last search of an evasion path that found none.
    blocked_since : since when the arm has had no path [s].
    detour, approach : the last ones that were searched.
    """

    without_path: Query | None = None
    refusal: Verdict | None = None
    attempted: int = 0
    blocked: Blocked | None = None
    last_failed_evasion: FailedEvasion = field(default_factory=FailedEvasion)
    blocked_since: float = math.inf
    detour: DetourSearch | None = None
    approach: ApproachSearch | None = None

    def still_blocked(self, query: Query, obstacles: Obstacles) -> Blocked | None:
        """What was tried and found no path, where nothing has changed since."""
        blocked = self.blocked
        if blocked is None or blocked.query is not query or not blocked.obstacles.is_unchanged(obstacles):
            return None
        return blocked

    def origin(self, query: Query) -> Query:
        """The query in the place of which another one was tried."""
        return self.blocked.origin if self.blocked is not None and self.blocked.query is query else query

    def chosen_attempts(
        self, solver: Solver, query: Query, situation: Situation
    ) -> tuple[tuple[Attempt, ...], AttemptMemory]:
        """What is tried by an arm that follows no path to a query's goal, and the memory of that.

        All where a path has just been lost, or was not searched yet; where there was none the last time, another one in
        every tick, and none where an evasion path is searched. Those that are optimistic are for what moves.
        """
        if query is not self.without_path:
            return solver.attempts, replace(self, attempted=len(solver.attempts) - 1)
        if self.refusal is not None and is_searched(self.refusal, situation, self.last_failed_evasion):
            return (), self
        blocked = self.refusal is not None and self.refusal.code is VerdictCode.NO_FEASIBLE_PATH
        tried = solver.attempts if blocked and not situation.expected.is_static else solver.cautious
        number = (self.attempted + 1) % len(tried)
        return tried[number : number + 1], replace(self, attempted=number)

    def after(
        self, plan: Plan, query: Query, blocked: Blocked | None, attempts: tuple[Attempt, ...], situation: Situation
    ) -> AttemptMemory:
        """With what a search came to; blocked : what was tried before in the same situation."""
        still, out_of_time = None, plan.verdict.code is VerdictCode.DEADLINE_MISSED
        without = out_of_time or plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        if without and situation.expected.is_static and situation.at_rest:
            before = blocked or Blocked(query, query, situation.obstacles, frozenset(), plan.verdict)
            # The first time all attempts share a tick, also with what holds a posture; later each has one of its own.
            shared = out_of_time and query is not self.without_path
            tried = before.attempts if shared else before.attempts.union(attempts)
            unfinished = before.unfinished or (out_of_time and not shared)
            still = Blocked(query, before.origin, situation.obstacles, tried, plan.verdict, unfinished)
        if plan.trajectory is not None:
            return replace(self, without_path=None, blocked=still, blocked_since=math.inf, detour=None)
        since = min(self.blocked_since, situation.now)
        return replace(self, without_path=query, refusal=plan.verdict, blocked=still, blocked_since=since)

    def interrupted(self, verdict: Verdict) -> AttemptMemory:
        """Where there was no time for an approach that a verdict asks for: all is tried once more."""
        if self.blocked is None or not verdict.goal_covered:
            return self
        return replace(self, blocked=replace(self.blocked, unfinished=True))

    def after_approach(self, search: ApproachSearch | None, found: bool) -> AttemptMemory:
        """With the last approach that was searched; found : the arm leaves where it was blocked."""
        if not found:
            return replace(self, approach=search)
        return replace(self, approach=search, blocked=None, detour=None)
