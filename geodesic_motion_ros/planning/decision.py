"""Decider: what an arm does in one tick, by its situation, its mission and what was tried before. Changes nothing.

While nothing changes the trajectory stays. Otherwise the search is repeated, and the new path taken where it is a gain.
Where no path is left that can be certified the arm stops along the one that it follows; where something is then coming
to where it stands, it evades (`evasion`). Where its goal is covered it goes as near as it can (`approach`). Where it
has had no path for long enough, a detour is searched for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.planning.approach import approached, still_approaching
from geodesic_motion_ros.planning.attempt_memory import AttemptMemory, Blocked, DetourRequest
from geodesic_motion_ros.planning.detour import without_detour
from geodesic_motion_ros.planning.evasion import evaded, still_evading
from geodesic_motion_ros.planning.guarded_arm import GuardedArm
from geodesic_motion_ros.planning.mission import Goal, Mission, Query
from geodesic_motion_ros.planning.plan import Plan
from geodesic_motion_ros.planning.search import KnownPaths
from geodesic_motion_ros.planning.settings import Attempt
from geodesic_motion_ros.planning.situation import TIME_ROUNDING, Followed, Situation, Step
from geodesic_motion_ros.planning.status import Verdict, VerdictCode


@dataclass(frozen=True, eq=False)
class Decision:
    """What a tick comes to, and what is remembered of it.

    query : the graph carried to the active goal; None: none is.
    detour : what one is to be searched for from now on; None: that is left as it is.
    """

    step: Step
    query: Query | None
    memory: AttemptMemory
    detour: DetourRequest | None = None


@dataclass(frozen=True, eq=False)
class Decider:
    """Decides for an arm in a situation, with what earlier attempts came to."""

    arm: GuardedArm
    situation: Situation
    mission: Mission
    memory: AttemptMemory

    def decide(self) -> Decision:
        """What is to be done, without doing it."""
        situation, memory, query = self.situation, self.memory, self.mission.query
        if self.mission.active is None:
            stop = situation.stopped(Verdict(VerdictCode.NO_GOAL, "no goal has been given"))
            return Decision(stop, None, replace(memory, blocked_since=math.inf))
        following = situation.following(query)
        if following is not None and self._is_unchanged(following):
            return Decision(situation.answered(following.verdict), query, memory)
        goal = self.mission.active.goal
        if query is None:
            found = self.arm.query_from(situation.state, situation.followed, goal)
            if isinstance(found, Verdict):
                return Decision(situation.stopped(found), None, memory)
            query = found
        followed = situation.free_path(query)
        if followed is None:
            return self._without_path(query, goal)
        if not followed.is_due(situation.now):
            return Decision(situation.answered(followed.verdict, followed), query, memory)
        return self._improved(query, followed)

    # ------------------------------------------------------------ with a path

    def _is_unchanged(self, followed: Followed) -> bool:
        """Whether what is followed is still the best path, as nothing has changed."""
        if not self.situation.settings.avoidance:
            return True
        return followed.obstacles is not None and followed.obstacles.is_unchanged(self.situation.obstacles)

    def _improved(self, query: Query, followed: Followed) -> Decision:
        """What is followed and free, or a new path where that is a gain."""
        situation, attempts = self.situation, self.arm.solver.attempts[:1]
        plan = self._solved(query, attempts, followed.known, situation.longest_worthwhile(followed))
        if not situation.handover_deadline.passed and situation.gains(plan, followed):
            return self._taken(query, plan, self.memory.after(plan, query, None, attempts, situation))
        updated = replace(followed, obstacles=situation.obstacles, searched=situation.now)
        if plan.trajectory is not None or not plan.verdict.ok:
            updated = replace(updated, rejected=plan.path)
        return Decision(situation.answered(updated.verdict, updated), query, self.memory)

    def _taken(self, query: Query, plan: Plan, memory: AttemptMemory) -> Decision:
        """A new path; found too late, the evasion path being played stays where it is free."""
        situation = self.situation
        step = still_evading(situation) if situation.handover_deadline.passed else None
        return Decision(step or situation.handed_out(plan, Followed.begun(query, plan, situation)), query, memory)

    # --------------------------------------------------------- without a path

    def _without_path(self, query: Query, goal: Goal) -> Decision:
        """A detour, or a path, or what an arm without either does, whose verdict says why no detour was found."""
        decision = self._detoured(query, goal) or self._searched_again(query, goal)
        search, plan = decision.memory.detour, decision.step.plan
        if search is None or plan.verdict.code is not VerdictCode.NO_FEASIBLE_PATH:
            return decision
        reason = search.reason(self._detour_request(query, goal), self.situation.now)
        if not reason:
            return decision
        explained = without_detour(plan, self.situation.reach, reason)
        return replace(decision, step=replace(decision.step, plan=explained))

    def _searched_again(self, query: Query, goal: Goal) -> Decision:
        """What an arm without a path does: it goes on searching."""
        blocked = self.memory.still_blocked(query, self.situation.obstacles)
        chosen, tried = self._query_to_try(query, blocked, goal)
        if chosen is None:
            assert blocked is not None
            return Decision(self.situation.stopped(blocked.verdict), query, self.memory)
        return self._searched(chosen, tried)

    def _query_to_try(self, query: Query, blocked: Blocked | None, goal: Goal) -> tuple[Query | None, Blocked | None]:
        """The query that is searched next, and what was tried with that; None where everything was tried in full.

        The first is the one that the arm stopped on; then the same goal from where it stands, in each posture.
        """
        queries = self.arm.queries
        if blocked is None:
            # Another query was for obstacles that stood.
            origin = self.memory.origin(query)
            return (queries.first_posture(origin) if self.situation.at_rest else origin), None
        if not blocked.attempts.issuperset(self.arm.solver.cautious):
            return query, blocked
        other, position = None, self.situation.state.position
        if query is blocked.origin and not np.array_equal(query.start, position):
            anew = queries.build(position, goal)
            other = None if isinstance(anew, Verdict) else anew
        other = other or queries.other_posture(query)
        if other is None and blocked.unfinished:
            return queries.first_posture(blocked.origin), None
        return other, replace(blocked, attempts=frozenset())

    def _searched(self, query: Query, blocked: Blocked | None) -> Decision:
        """A new path, or what an arm without one does; blocked : what was tried already."""
        situation, solver = self.situation, self.arm.solver
        attempts, memory = self.memory.chosen_attempts(solver, query, situation)
        plan = self._solved(query, attempts, refusal=memory.refusal)
        memory = memory.after(plan, query, blocked, attempts, situation)
        if plan.trajectory is not None:
            return self._taken(query, plan, memory)
        step = still_approaching(query, plan.verdict, situation)
        if step is None and (situation.deadline.passed or situation.handover_deadline.passed):
            step = still_evading(situation)
            if step is not None or situation.deadline.passed:
                return Decision(step or situation.stopped(plan.verdict), query, memory.interrupted(plan.verdict))
        if step is None:
            step, failed = evaded(solver, query, plan.verdict, situation, memory.last_failed_evasion)
            memory = replace(memory, last_failed_evasion=failed)
        if (step is None or step.plan.trajectory is None) and memory.origin(query) is query:
            nearer, search = approached(solver, query, plan.verdict, situation, memory.approach)
            if search is memory.approach and (situation.deadline.passed or situation.handover_deadline.passed):
                memory = memory.interrupted(plan.verdict)
            memory = memory.after_approach(search, nearer is not None)
            step = nearer or step
        return Decision(step or situation.stopped(plan.verdict), query, memory)

    def _solved(
        self,
        query: Query,
        attempts: tuple[Attempt, ...],
        known: KnownPaths | None = None,
        longest: float = math.inf,
        refusal: Verdict | None = None,
    ) -> Plan:
        situation, solve = self.situation, self.arm.solver.solve
        plan = solve(
            query, situation.state, situation.expected, attempts, situation.deadline, known, longest, refusal
        )  # fmt: skip
        return situation.require_a_stop(plan)

    # ---------------------------------------------------------------- detours

    def _detoured(self, query: Query, goal: Goal) -> Decision | None:
        """A detour of an arm at rest that has had no path for long enough, or the search of one; None: neither.

        What was found is judged among the obstacles that are there by now; a search is begun again where they are
        others than it was begun with.
        """
        situation, memory, search, now = self.situation, self.memory, self.memory.detour, self.situation.now
        if situation.reach == 0.0 or not situation.at_rest or math.isinf(memory.blocked_since):
            return None
        request = self._detour_request(query, goal)
        if search is not None and (not search.job.done(now) or search.reason(request, now)):
            return None
        detour = None if search is None else search.found(request)
        if search is not None and detour is not None:
            plan = situation.require_a_stop(self.arm.detours.plan(detour, situation.state, situation.expected))
            if plan.trajectory is not None:
                return self._taken(detour.query, plan, memory.after(plan, detour.query, None, (), situation))
            search = replace(search, refusal=plan.verdict.reason)
        searching = self._searched_again(query, goal)
        if searching.step.plan.trajectory is not None:
            return searching
        if search is not None and search.request.is_same(request):
            return replace(searching, memory=replace(searching.memory, detour=search))
        since = min(memory.blocked_since, situation.unchanged_since)
        if now < since + situation.settings.patience - TIME_ROUNDING:
            return searching
        return replace(searching, detour=request)

    def _detour_request(self, query: Query, goal: Goal) -> DetourRequest:
        situation, origin = self.situation, self.memory.origin(query)
        return DetourRequest(origin, goal, situation.obstacles, situation.reach, situation.state.position)
