"""Arbiter, which decides what an arm does in one tick, by its situation, its mission and the outcomes of earlier
attempts. It changes nothing.

An arm that has a path keeps it, as long as that meets what is required to go on, or takes a better one. Without a path
the proposers are asked by their ranks, `PROPOSERS`, until one of them decides, that is begins a motion: the stages of
doc/reactions.md. A step that only keeps a motion is left to those after it. Where there is no step, the arm stops.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.contract.settings import JOIN_LASTS, LAST_JOIN, SEARCH_PERIOD
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.motion.detour import DetourRequest, without_detour
from geodesic_motion_ros.motion.played import FollowedPlan, Step
from geodesic_motion_ros.motion.retry import PastSearch, Question, is_due
from geodesic_motion_ros.planning.guarded_arm import GuardedArm
from geodesic_motion_ros.planning.memory import AttemptMemory
from geodesic_motion_ros.planning.mission import Mission
from geodesic_motion_ros.planning.proposers.approach import Approach, KeptApproach
from geodesic_motion_ros.planning.proposers.evasion import Evasion, KeptEvasion
from geodesic_motion_ros.planning.proposers.found_detour import FoundDetour, WantedDetour
from geodesic_motion_ros.planning.proposers.graph import GraphPath
from geodesic_motion_ros.planning.proposers.turn import Proposer, Turn
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.trajectory.trajectory import JointReference

#: Who is asked what an arm without a path does, in this order.
PROPOSERS: tuple[Proposer, ...] = (
    FoundDetour(), GraphPath(), KeptApproach(), KeptEvasion(), Evasion(), Approach(), WantedDetour(),
)  # fmt: skip


def _begins_smoothly(reference: JointReference) -> bool:
    """Whether a motion begins with no more jerk than it has later on, at most and in the mean square, until half of it:
    to come to rest takes more.
    """
    begin, later = reference.jerks(0.0, JOIN_LASTS), reference.jerks(JOIN_LASTS, 0.5 * reference.duration)
    return bool(begin.max() <= later.max() and np.mean(begin**2) <= np.mean(later**2))


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
    query: ArmQuery | None
    memory: AttemptMemory
    detour: DetourRequest | None = None


@dataclass(frozen=True, eq=False)
class Arbiter:
    """A decision on what an arm does in one tick: `Arbiter(...).decide()`, without changing anything."""

    arm: GuardedArm
    situation: Situation
    mission: Mission
    memory: AttemptMemory
    proposers: tuple[Proposer, ...] = PROPOSERS

    def decide(self) -> Decision:
        """Decide what the arm does."""
        situation, memory, query = self.situation, self.memory, self.mission.query
        if self.mission.active is None:
            stop = situation.begin_stop(Refusal(VerdictCode.NO_GOAL, "no goal has been given"))
            return Decision(stop, None, replace(memory, blocked_since=math.inf))
        if situation.exceeds_limits and (slowed := situation.slowed()) is not None:
            return Decision(slowed, query, memory)
        coming = None if self.mission.next_round is None else self.mission.next_round.query(situation.now)
        if coming is not None and situation.at_rest:
            query, coming = coming, None
        following = situation.followed_to(query)
        if following is not None and coming is None and self._needs_no_check(following):
            # Nothing has changed since the path was certified.
            return Decision(situation.go_on(following.verdict), query, memory)
        goal = self.mission.active.goal
        if query is None:
            rounds = self.mission.rounds_to(self.mission.active.request, goal)
            found = self.arm.query_from(situation.state, situation.followed, goal, rounds)
            if isinstance(found, Refusal):
                return Decision(situation.begin_stop(found), None, memory)
            query = found
        followed = situation.free_path(query)
        if followed is not None and coming is not None:
            return self._joined(query, followed, coming)
        if followed is not None and not followed.is_due(situation.obstacles, situation.now):
            # The rest of the path is free, and so is a stop a moment later.
            return Decision(situation.go_on(followed.verdict, followed), query, memory)
        turn = self._turn(query)
        return self._without_path(turn) if followed is None else self._improved(turn, followed)

    def _turn(self, query: ArmQuery) -> Turn:
        """Make the first turn of a tick, with a query."""
        assert self.mission.active is not None
        # The workings change as the searches of this tick go on.
        memory = replace(self.memory, workings=self.memory.workings.copy())
        return Turn(self.arm, self.situation, self.mission.active.goal, memory.origin(query), query, memory)

    def _joined(self, query: ArmQuery, followed: FollowedPlan, coming: ArmQuery) -> Decision:
        """Join the next round to the present one in motion; go on with that, where there is no path yet, or one that
        begins with a jolt: without one by its end the arm comes to rest there.
        """
        situation, attempts = self.situation, self.arm.solver.attempts[:1]
        question = Question(coming, situation.obstacles)
        if not is_due(followed.last_search, question, situation.now, SEARCH_PERIOD):
            return Decision(situation.go_on(followed.verdict, followed), query, self.memory)
        turn = self._turn(coming)
        plan = turn.solve(coming, attempts)
        late = query.rounds_left(situation.state.latent_on(query)) <= LAST_JOIN
        joins = plan.reference is not None and (late or _begins_smoothly(plan.reference))
        if not joins or situation.handover_deadline.passed:
            # A little further on there may be one.
            searched = replace(followed, last_search=PastSearch(question, situation.now, is_answered=False))
            return Decision(situation.go_on(searched.verdict, searched), query, self.memory)
        return self._decision(turn.take_path(coming, plan, turn.memory.after(plan, coming, None, attempts, situation)))

    def _needs_no_check(self, followed: FollowedPlan) -> bool:
        """Whether the path that is followed needs neither a new certificate nor a new search: the settings are those of
        its search, the obstacles stand, and are those among which it was certified.
        """
        if followed.outdated:
            return False
        return not self.situation.settings.avoidance or followed.is_settled_among(self.situation.obstacles)

    def _improved(self, turn: Turn, followed: FollowedPlan) -> Decision:
        """Another path, where the search finds one that is a gain; else the present one."""
        situation, attempts, query = self.situation, self.arm.solver.attempts[:1], turn.query
        plan = turn.solve(query, attempts, followed.known_paths, situation.longest_worthwhile(followed))
        if not situation.handover_deadline.passed and situation.is_gain(plan, followed):
            taken = turn.take_path(query, plan, turn.memory.after(plan, query, None, attempts, situation))
            return self._decision(taken)
        # A motion that is outdated is replaced, as soon as the arm is slow enough for another one to join it.
        settled = plan.verdict.code is not VerdictCode.DEADLINE_MISSED and not followed.outdated
        search = PastSearch(Question(query, situation.obstacles), situation.now, settled)
        updated = replace(followed, last_search=search)
        if plan.trajectory is not None or not plan.verdict.ok:
            updated = replace(updated, rejected=plan.path)
        return Decision(situation.go_on(updated.verdict, updated), query, turn.memory)

    def _without_path(self, turn: Turn) -> Decision:
        """Ask the proposers, until one of them decides; else keep what one of them keeps, or stop."""
        for rank, proposer in enumerate(self.proposers):
            turn = proposer.propose(replace(turn, later=self.proposers[rank + 1 :]))
            if turn.decided:
                break
        return self._decision(turn)

    def _decision(self, turn: Turn) -> Decision:
        """The decision of the last turn; its verdict says why there is no detour, too, where one was searched."""
        step = turn.step or self.situation.begin_stop(turn.verdict)
        search, plan = turn.memory.detour, step.plan
        if search is not None and plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH:
            refusal = search.refusal_for(turn.detour_request, self.situation.now)
            if refusal is not None:
                step = replace(step, plan=without_detour(plan, self.situation.reach, refusal))
        return Decision(step, turn.query, turn.memory, turn.detour)
