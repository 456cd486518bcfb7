"""AttemptMemory: the outcomes of earlier attempts of an arm without a path, which decide what is attempted next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from geodesic_motion_ros.contract.settings import Attempt
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.motion.detour import Detour, DetourRequest
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.retry import PastSearch, Question, Workings
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.motion.worker import Job
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.queries.query import ArmQuery


@dataclass(frozen=True)
class FailedAttempts:
    """The attempts that found no path for an arm at rest among obstacles that stand: they need not be repeated.

    Attributes
    ----------
    question : about the query that was attempted last. origin : the query on which the arm stopped; other queries, for
        the same goal, are attempted in its place.
    attempts : those that were made with the question; verdict : of the last of them.
    unfinished : whether one of the attempts, with this query or one before it, was out of time.
    """

    question: Question
    origin: ArmQuery
    attempts: frozenset[Attempt]
    verdict: Refusal
    unfinished: bool = False


@dataclass(frozen=True, eq=False)
class DetourSearch:
    """The search of a detour that was begun last: its job, its request, and why its detour is not followed.

    refusal : None as long as no detour was found, or the one that was found is not refused.
    """

    job: Job[Detour | Refusal]
    request: DetourRequest
    refusal: Refusal | None = None

    def detour_for(self, request: DetourRequest) -> Detour | None:
        """Return the detour of the job, where it serves a request: from and to the same, no farther off than that
        allows.
        """
        detour = self.job.result
        if not isinstance(detour, Detour) or not self.request.question.holds_there(request.question):
            return None
        return detour if self.request.reach <= request.reach or detour.displacement <= request.reach else None

    def refusal_for(self, request: DetourRequest, now: float) -> Refusal | None:
        """Return why there is no detour for a request at `now` [s]; None where that is not known."""
        if not self.request.question.holds_for(request.question) or not self.job.is_done(now):
            return None
        result = self.job.result
        return result if isinstance(result, Refusal) else self.refusal


@dataclass(frozen=True, eq=False)
class AttemptMemory:
    """The outcomes of earlier attempts, detours, evasions and approaches, which decide what a tick attempts next.

    Attributes
    ----------
    without_path : the query for which the last search found no path; None: it found one. refusal : why it found none.
    attempted : the number of the last attempt with that query (`choose_attempts`).
    blocked : the attempts that need not be repeated; None: obstacles or the arm have moved since, or it follows a path.
    past_searches : the last of evasions that found none, and of approaches, by the names of their requirements.
    blocked_since : since when the arm has had no path [s].
    detour : the last one that was searched.
    workings : of all searches.
    """

    without_path: ArmQuery | None = None
    refusal: Refusal | None = None
    attempted: int = 0
    blocked: FailedAttempts | None = None
    past_searches: Mapping[str, PastSearch] = field(default_factory=dict)
    blocked_since: float = math.inf
    detour: DetourSearch | None = None
    workings: Workings = field(default_factory=Workings)

    def failed_for(self, query: ArmQuery, obstacles: Obstacles) -> FailedAttempts | None:
        """Return the attempts with a query that need not be repeated, where nothing has changed since; None elsewhere.
        """
        blocked = self.blocked
        return blocked if blocked is not None and blocked.question.holds_for(Question(query, obstacles)) else None

    def origin(self, query: ArmQuery) -> ArmQuery:
        """Return the query on which the arm stopped, where a query is attempted in its place; else the query itself."""
        blocked = self.blocked
        return blocked.origin if blocked is not None and blocked.question.about is query else query

    def choose_attempts(
        self, solver: Solver, query: ArmQuery, situation: Situation, is_taken: Callable[[Refusal], bool]
    ) -> tuple[tuple[Attempt, ...], AttemptMemory]:
        """Return the attempts of this tick, by an arm that follows no path to a query's goal, and the memory of them.

        is_taken : whether another long search takes this tick, where there is no path for a reason.

        | situation | attempts |
        |---|---|
        | the query is new, or its path has just been lost | all of `Solver.attempts` |
        | the last search found no path, and another long search takes this tick | none |
        | the last search found no path: obstacles block it, and one of them moves | the next one of `Solver.attempts` |
        | the last search found no path, otherwise | the next one of `Solver.cautious_attempts` |

        `attempted` counts on through whichever of both tuples the tick uses, modulo its length, so that every attempt
        comes again.
        """
        if query is not self.without_path:
            return solver.attempts, replace(self, attempted=len(solver.attempts) - 1)
        if self.refusal is not None and is_taken(self.refusal):
            return (), self
        blocked = self.refusal is not None and self.refusal.code is VerdictCode.NO_FEASIBLE_PATH
        tried = solver.attempts if blocked and not situation.expected_obstacles.is_static else solver.cautious_attempts
        number = (self.attempted + 1) % len(tried)
        return tried[number : number + 1], replace(self, attempted=number)

    def after(
        self,
        plan: Plan,
        query: ArmQuery,
        blocked: FailedAttempts | None,
        attempts: tuple[Attempt, ...],
        situation: Situation,
    ) -> AttemptMemory:
        """Return the memory after a search of a query with some attempts, which came to a plan.

        blocked : the attempts with the query, in the same situation, before this search; None: there were none.
        """
        still, out_of_time = None, plan.verdict.code is VerdictCode.DEADLINE_MISSED
        without = out_of_time or plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        if without and situation.expected_obstacles.is_static and situation.at_rest:
            question = Question(query, situation.obstacles)
            before = blocked or FailedAttempts(question, query, frozenset(), plan.refusal)
            # The first time all attempts share a tick, and its deadline; later each attempt has a tick of its own.
            shared = out_of_time and query is not self.without_path
            tried = before.attempts if shared else before.attempts.union(attempts)
            unfinished = before.unfinished or (out_of_time and not shared)
            still = FailedAttempts(question, before.origin, tried, plan.refusal, unfinished)
        if plan.trajectory is not None:
            return replace(self, without_path=None, blocked=still, blocked_since=math.inf, detour=None)
        since = min(self.blocked_since, situation.now)
        return replace(self, without_path=query, refusal=plan.refusal, blocked=still, blocked_since=since)

    def repeat_all(self, verdict: Refusal) -> AttemptMemory:
        """Return the memory after a tick that had no time for the approach that a verdict asks for: all is attempted
        again.
        """
        if self.blocked is None or not verdict.figures.goal_covered:
            return self
        return replace(self, blocked=replace(self.blocked, unfinished=True))
