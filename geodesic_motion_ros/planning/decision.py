"""Decider: decides what an arm does in one tick, by its situation, its mission and the outcomes of earlier attempts. It
changes nothing.

`Decider.decide` comes to the seven stages (doc/reactions.md) in this order; each branch below repeats the number of its
stage.

1. Keep: the path that is followed is free, and no better one is due, or found.
2. Another path: one that is a gain over it.
3. Detour: one that was found is free; or a search of one is begun, by an arm that has had no path for long enough.
4. Search: there is no path, and an attempt finds one.
5. Evade: an obstacle comes to where the arm stands or stops. An approach that is still free goes on before this.
6. Approach: the goal is covered, and the arm can come nearer to it.
7. Stop: none of these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.planning.approach import approached, still_approaching
from geodesic_motion_ros.planning.attempt_memory import AttemptMemory, Blocked
from geodesic_motion_ros.planning.detour import DetourRequest, without_detour
from geodesic_motion_ros.planning.evasion import evaded, still_evading
from geodesic_motion_ros.planning.guarded_arm import GuardedArm
from geodesic_motion_ros.planning.mission import Goal, Mission, Query
from geodesic_motion_ros.planning.mode import Purpose
from geodesic_motion_ros.planning.plan import Plan
from geodesic_motion_ros.planning.played import Followed, Step
from geodesic_motion_ros.planning.retry import TIME_ROUNDING, Asked, Question
from geodesic_motion_ros.planning.search import KnownPaths
from geodesic_motion_ros.planning.settings import Attempt
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.planning.status import Verdict, VerdictCode


@dataclass(frozen=True, eq=False)
class Decision:
    """The outcome of a tick: what is played from now on, and what the planner remembers.

    Attributes
    ----------
    step : for the stream. memory : for the next tick.
    query : the query to the active goal; None: the goal has none yet.
    detour : the request of a detour that is to be searched from now on; None: no search is begun.
    """

    step: Step
    query: Query | None
    memory: AttemptMemory
    detour: DetourRequest | None = None


@dataclass(frozen=True, eq=False)
class Decider:
    """Decides what an arm does in one tick: `Decider(...).decide()`, without changing anything."""

    arm: GuardedArm
    situation: Situation
    mission: Mission
    memory: AttemptMemory

    def decide(self) -> Decision:
        """The decision of this tick, stage by stage (see the module): 1 and 2 with a path, 3 to 7 without one."""
        memory = replace(self.memory, workings=self.memory.workings.copied())
        return replace(self, memory=memory)._decided()

    def _decided(self) -> Decision:
        """The decision, with workings that are this tick's own."""
        situation, memory, query = self.situation, self.memory, self.mission.query
        if self.mission.active is None:
            stop = situation.stopped(Verdict(VerdictCode.NO_GOAL, "no goal has been given"))
            return Decision(stop, None, replace(memory, blocked_since=math.inf))
        if situation.exceeds_limits and (slowed := self._slowed(situation)) is not None:
            return Decision(slowed, query, memory)
        following = situation.following(query)
        if following is not None and self._needs_no_check(following):
            # Stage 1, keep: nothing has changed since the path was certified.
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
        if not followed.is_due(situation.obstacles, situation.now):
            # Stage 1, keep: the rest of the path is free, and so is a stop a moment later.
            return Decision(situation.answered(followed.verdict, followed), query, memory)
        return self._improved(query, followed)

    @staticmethod
    def _slowed(situation: Situation) -> Step | None:
        """The step in which an arm that moves too fast slows down on its path, or stops where that is not free; None
        where it does so already, or evades: then it is met if it is slower.
        """
        followed = situation.followed
        if followed is None or followed.purpose not in (Purpose.GOAL, Purpose.APPROACH):
            return None
        if followed.slowed is situation.limits:
            return None
        reason = "the arm is to be slower, and slowed down on its path it would meet what moves"
        return situation.slowed() or situation.stopped(Verdict(VerdictCode.NO_FEASIBLE_PATH, reason))

    # ------------------------------------------------------------ with a path

    def _needs_no_check(self, followed: Followed) -> bool:
        """Whether the path that is followed needs neither a new certificate nor a new search: the settings are those of
        its search, the obstacles stand, and are those among which it was certified.
        """
        if followed.outdated:
            return False
        if not self.situation.settings.avoidance:
            return True
        return followed.is_certified_among(self.situation.obstacles)

    def _improved(self, query: Query, followed: Followed) -> Decision:
        """Stage 2, another path, where the search finds one that is a gain; else stage 1, keep."""
        situation, attempts = self.situation, self.arm.solver.attempts[:1]
        plan = self._solved(query, attempts, followed.known, situation.longest_worthwhile(followed))
        if not situation.handover_deadline.passed and situation.gains(plan, followed):
            return self._taken(query, plan, self.memory.after(plan, query, None, attempts, situation))
        in_time = plan.verdict.code is not VerdictCode.DEADLINE_MISSED
        asked = Asked(Question(query, situation.obstacles), situation.now, in_time)
        updated = replace(followed, asked=asked)
        if plan.trajectory is not None or not plan.verdict.ok:
            updated = replace(updated, rejected=plan.path)
        return Decision(situation.answered(updated.verdict, updated), query, self.memory)

    def _taken(self, query: Query, plan: Plan, memory: AttemptMemory) -> Decision:
        """A new path is followed. Where it was found too late, an arm that evades goes on evading as long as that is
        free.
        """
        situation = self.situation
        step = still_evading(situation) if situation.handover_deadline.passed else None
        begun = Followed.begun(query, plan, situation.obstacles, situation.now)
        return Decision(step or situation.handed_out(plan, begun), query, memory)

    # --------------------------------------------------------- without a path

    def _without_path(self, query: Query, goal: Goal) -> Decision:
        """Stages 3 to 7, of an arm without a path; the verdict says why there is no detour, where one was searched."""
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
        """Stages 4 to 7 with the query whose turn it is; stage 7, stop, where every query was attempted in full."""
        blocked = self.memory.still_blocked(query, self.situation.obstacles)
        chosen, tried = self._query_to_try(query, blocked, goal)
        if chosen is None:
            assert blocked is not None
            return Decision(self.situation.stopped(blocked.verdict), query, self.memory)
        return self._searched(chosen, tried)

    def _query_to_try(self, query: Query, blocked: Blocked | None, goal: Goal) -> tuple[Query | None, Blocked | None]:
        """The query that is searched next, and the attempts that were made with it already.

        The order, for an arm among obstacles that stand:

        1. the query on which the arm stopped (`Blocked.origin`);
        2. a query to the same goal from where the arm stands, if it stands elsewhere than that one begins;
        3. the same in each other posture in which the arm can hold it;
        4. once more from 1 on, if one of these attempts was out of time (`Blocked.unfinished`);
        5. None: all was attempted, and nothing has changed since.

        Each query is searched until all cautious attempts were made with it. Where obstacles have changed, or move, 1
        is searched again: the other queries were for obstacles that stood.
        """
        queries = self.arm.queries
        if blocked is None:
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
        """Stages 4 to 7 with one query; blocked : the attempts that were made with it already."""
        situation, solver = self.situation, self.arm.solver
        attempts, memory = self.memory.chosen_attempts(solver, query, situation)
        plan = self._solved(query, attempts, refusal=memory.refusal)
        memory = memory.after(plan, query, blocked, attempts, situation)
        if plan.trajectory is not None:
            # Stage 4, search: there is a path.
            return self._taken(query, plan, memory)
        # An approach that is still free goes on before stage 5.
        step = still_approaching(query, plan.verdict, situation)
        if step is None and (situation.deadline.passed or situation.handover_deadline.passed):
            # Stage 5, evade: there is no time to search another evasion path.
            step = still_evading(situation)
            if step is not None or situation.deadline.passed:
                return Decision(step or situation.stopped(plan.verdict), query, memory.interrupted(plan.verdict))
        if step is None:
            # Stage 5, evade.
            step, asked = evaded(solver, query, plan.verdict, situation, memory.asked, memory.workings)
            memory = replace(memory, asked=asked)
        if (step is None or step.plan.trajectory is None) and memory.origin(query) is query:
            # Stage 6, approach.
            nearer, asked = approached(solver, query, plan.verdict, situation, memory.asked)
            if asked is memory.asked and (situation.deadline.passed or situation.handover_deadline.passed):
                memory = memory.interrupted(plan.verdict)
            memory = memory.after_approach(asked, nearer is not None)
            step = nearer or step
        # Stage 7, stop, where no stage before has a step.
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
            query, situation.state, situation.expected, attempts, situation.deadline, known, longest, refusal,
            self.memory.workings,
        )  # fmt: skip
        return situation.require_a_stop(plan)

    # ---------------------------------------------------------------- detours

    def _detoured(self, query: Query, goal: Goal) -> Decision | None:
        """Stage 3, detour: the decision of an arm at rest that follows a detour, or begins to search one; None: it does
        neither, and goes on with stage 4.

        A detour that was found is certified among the present obstacles. A search is begun again where these are others
        than those that it was begun with.
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
        if search is not None and search.request.question.holds_for(request.question):
            return replace(searching, memory=replace(searching.memory, detour=search))
        since = min(memory.blocked_since, situation.unchanged_since)
        if now < since + situation.settings.patience - TIME_ROUNDING:
            return searching
        return replace(searching, detour=request)

    def _detour_request(self, query: Query, goal: Goal) -> DetourRequest:
        situation, origin = self.situation, self.memory.origin(query)
        return DetourRequest(origin, goal, situation.obstacles, situation.reach, situation.state.position)
