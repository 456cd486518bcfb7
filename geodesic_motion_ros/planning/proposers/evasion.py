"""Evasion: an arm that has no path to its goal makes room for an obstacle that comes to where it stands or stops, or
that touches it already.

A place on the graph is searched first, then one beside it (`evasion_motion.py`). This module decides when, and how long
the arm goes on evading.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.contract.requirement import Requirement
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.motion.evasion_motion import EVADING, evasion_beside_graph, evasion_on_graph
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.played import FollowedPlan
from geodesic_motion_ros.motion.retry import PastSearch, Question, is_due
from geodesic_motion_ros.planning.proposers.turn import Proposer, Turn

#: The names of the requirements of evasions, to a place on the graph and to one beside it.
ON_GRAPH, BESIDE_GRAPH = "evasion", "beside_graph"


class KeptEvasion(Proposer):
    """A proposer of going on to evade in a tick that has no time to search a path, as long as that is free."""

    def propose(self, turn: Turn) -> Turn:
        """Propose to go on."""
        if turn.step is not None or not turn.situation.is_late:
            return turn
        return replace(turn, step=turn.situation.go_on_evading())


@dataclass(frozen=True)
class Evasion(Proposer):
    """A proposer of making room, where an obstacle would meet an arm that does not evade.

    on_graph, beside_graph : what finds the motions there.
    """

    on_graph: Callable[..., Plan | None] = evasion_on_graph
    beside_graph: Callable[..., Plan | None] = evasion_beside_graph

    def takes_the_tick(self, turn: Turn) -> bool:
        """Whether an evasion is to be searched: that takes about as long as an attempt. An arm that approaches makes
        its attempts first: as long as its approach is free it does not evade.
        """
        followed = turn.situation.followed
        approaching = followed is not None and followed.purpose is Purpose.APPROACH
        if approaching or turn.situation.is_late:
            return False
        return _assessed(turn, turn.memory.past_searches)[1] is not None

    def propose(self, turn: Turn) -> Turn:
        """Begin an evasion path; the plan's verdict states why there is no path, and that the arm evades.

        Where none is found, or none is needed, the arm stops along its path. An arm that evades already goes on, where
        that leads it free, or where a search was out of time and there is some left (`Situation.evades_for_now`).
        """
        situation, solver, searches = turn.situation, turn.arm.solver, turn.memory.past_searches
        if turn.step is not None or situation.deadline.passed:
            return turn
        free, required = _assessed(turn, searches)
        while required is not None:
            deadline, workings = situation.deadline, turn.memory.workings
            given = solver, turn.query, situation.state, situation.expected_obstacles, situation.stop.reference
            if required == BESIDE_GRAPH:
                plan = self.beside_graph(*given, situation.reach, workings, deadline)
            else:
                plan = self.on_graph(*given, workings, deadline)
            if plan is not None:
                return _begun(replace(turn, memory=replace(turn.memory, past_searches=searches)), plan)
            # The next tick resumes a search that was out of time.
            if getattr(situation.requirements, required) not in workings.evasions:
                searches = {**searches, required: PastSearch(Question(turn.query, situation.obstacles), situation.now)}
            if deadline.passed:
                break
            free, required = _assessed(turn, searches)
        # Where a search came to its end and found nothing, the arm stops in time.
        goes_on = situation.evades_for_now if situation.deadline.passed else free and situation.is_evading
        step = situation.go_on(turn.verdict.with_remark(EVADING)) if goes_on else None
        return replace(turn, memory=replace(turn.memory, past_searches=searches), step=step)


def _assessed(turn: Turn, searches: Mapping[str, PastSearch]) -> tuple[bool, str | None]:
    """Whether an arm without a path needs no evasion, and the name of the requirement of one that is searched now.

    | answer | meaning |
    |---|---|
    | True, None | no obstacle meets the arm where it stops or stands, or none so soon that it would leave the graph |
    | False, ON_GRAPH | search a place on the graph |
    | False, BESIDE_GRAPH | that failed less than `SEARCH_PERIOD` ago: search one beside it, if the arm may leave it |
    | False, None | both failed then, or evasion is no answer to this verdict, or all obstacles stand: search nothing |

    searches : those that were made and found nothing, by the names of their requirements.
    """
    situation = turn.situation
    blocked = turn.verdict.code in (VerdictCode.NO_FEASIBLE_PATH, VerdictCode.IN_COLLISION)
    if not (blocked and situation.settings.avoidance) or situation.obstacles.is_static:
        return False, None
    question = Question(turn.query, situation.obstacles)
    for name in (ON_GRAPH, BESIDE_GRAPH) if situation.reach > 0.0 else (ON_GRAPH,):
        required: Requirement = getattr(situation.requirements, name)
        if situation.satisfies_without_evasion(required):
            return True, None
        if is_due(searches.get(name), question, situation.now, constants.SEARCH_PERIOD):
            return False, name
    return False, None


def _begun(turn: Turn, plan: Plan) -> Turn:
    """The last turn, in which the arm begins an evasion path."""
    situation, verdict = turn.situation, turn.verdict
    verdict = verdict.with_figures(clearance=plan.verdict.figures.clearance)
    plan = replace(plan, verdict=verdict.with_remark(EVADING))
    begun = FollowedPlan.of(turn.query, plan, situation.obstacles, situation.now, Purpose.EVASION)
    return replace(turn, step=situation.hand_out(plan, begun), decided=True)
