"""Evasion: an arm that has no path to its goal makes room for an obstacle that comes to where it stands or stops.

`Solver.evade` searches a place on the graph, `Solver.evade_displaced` one beside it. This module decides when one of
them is searched, and how long the arm goes on evading.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.mode import Purpose
from geodesic_motion_ros.planning.plan import ArmQuery, Plan
from geodesic_motion_ros.planning.played import Followed, Step
from geodesic_motion_ros.planning.requirement import Requirement
from geodesic_motion_ros.planning.retry import Asked, Question, Workings, is_due
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.planning.solver import Solver
from geodesic_motion_ros.planning.status import Verdict, VerdictCode

#: The names of the requirements of evasions, to a place on the graph and to one beside it.
ON_GRAPH, BESIDE_GRAPH = "evasion", "beside_graph"


def evaded(
    solver: Solver,
    query: ArmQuery,
    verdict: Verdict,
    situation: Situation,
    asked: Mapping[str, Asked],
    workings: Workings,
) -> tuple[Step | None, Mapping[str, Asked]]:
    """The step in which an arm without a path to its goal evades, and the searches that were made.

    The step is None where no evasion path is found, or none is needed: then the arm stops along its path. An arm that
    evades already, and is free where it leads, goes on.

    Parameters
    ----------
    verdict : why there is no path for the query; the plan's verdict states the same, and that the arm evades.
    asked : the searches that were made before this tick and found nothing, by the names of their requirements.
    """
    free, required = _assessed(query, verdict, situation, asked)
    while required is not None:
        state, obstacles, deadline = situation.state, situation.expected, situation.deadline
        if required == BESIDE_GRAPH:
            plan = solver.evade_displaced(query, state, obstacles, situation.reach, deadline)
        else:
            plan = solver.evade(query, state, obstacles, situation.stop.reference, workings, deadline)
        if plan is not None:
            return _taken(query, plan, verdict, situation), asked
        if deadline.passed:
            # A path that was not found for want of time is searched again in the next tick.
            return None, asked
        asked = {**asked, required: Asked(Question(query, situation.obstacles), situation.now)}
        free, required = _assessed(query, verdict, situation, asked)
    evading = situation.followed is not None and situation.followed.purpose is Purpose.EVASION
    return situation.answered(verdict) if free and evading else None, asked


def is_searched(query: ArmQuery, verdict: Verdict, situation: Situation, asked: Mapping[str, Asked]) -> bool:
    """Whether an evasion path is searched in this tick: not by an arm that approaches, as long as it can go on, nor
    where no time is left. The search takes about as long as an attempt at a path to the goal.
    """
    approaching = situation.followed is not None and situation.followed.purpose is Purpose.APPROACH
    if approaching or situation.deadline.passed or situation.handover_deadline.passed:
        return False
    return _assessed(query, verdict, situation, asked)[1] is not None


def _assessed(
    query: ArmQuery, verdict: Verdict, situation: Situation, asked: Mapping[str, Asked]
) -> tuple[bool, str | None]:
    """Whether an arm without a path needs no evasion, and the name of the requirement of one that is searched now.

    | answer | meaning |
    |---|---|
    | True, None | no obstacle meets the arm where it stops or stands |
    | False, ON_GRAPH | search a place on the graph |
    | False, BESIDE_GRAPH | that has just failed: search a place beside the graph, if the arm may leave it |
    | False, None | both have just failed, or evasion is no answer to this verdict: search nothing now |
    """
    settings = situation.settings
    blocked = verdict.code is VerdictCode.NO_FEASIBLE_PATH
    if not (blocked and settings.avoidance) or situation.obstacles.is_static:
        return False, None
    question = Question(query, situation.obstacles)
    for name in (ON_GRAPH, BESIDE_GRAPH) if situation.reach > 0.0 else (ON_GRAPH,):
        required: Requirement = getattr(situation.requirements, name)
        if situation.meets_without_evasion(required):
            return True, None
        if is_due(asked.get(name), question, situation.now, constants.SEARCH_PERIOD):
            return False, name
    return False, None


def _taken(query: ArmQuery, plan: Plan, verdict: Verdict, situation: Situation) -> Step:
    """The step in which the arm begins an evasion path."""
    reason = f"{verdict.reason}; evading what is coming"
    plan = replace(plan, verdict=replace(verdict, clearance=plan.verdict.clearance, reason=reason))
    begun = Followed.begun(query, plan, situation.obstacles, situation.now, Purpose.EVASION)
    return situation.handed_out(plan, begun)


def still_evading(situation: Situation) -> Step | None:
    """The step in which an arm goes on evading, where there was no time to search another path: as long as the rest of
    the evasion path is free, and the arm can still stop on it. None where that is not so, where no obstacle moves any
    more, or where the arm does not evade.
    """
    followed = situation.followed
    if followed is None or followed.purpose is not Purpose.EVASION or situation.obstacles.is_static:
        return None
    clearance = situation.clearance_left()
    return None if clearance is None else situation.answered(replace(followed.verdict, clearance=clearance))
