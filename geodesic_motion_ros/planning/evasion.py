"""Evasion: an arm that has no path to its goal makes room for what is coming to where it stands or stops.

Where to is searched by `Solver.evade`, on the graph, and `Solver.evade_displaced`, beside it; here is decided when, and
how long it goes on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.certificate import SweptArm
from geodesic_motion_ros.planning.plan import ArmQuery, Plan
from geodesic_motion_ros.planning.situation import TIME_ROUNDING, Followed, Situation, Step
from geodesic_motion_ros.planning.solver import Solver
from geodesic_motion_ros.planning.status import Verdict, VerdictCode


@dataclass(frozen=True)
class FailedEvasion:
    """When no evasion path was found last [s], with obstacles expected to move on for how long [s], at least."""

    time: float = -math.inf
    horizon: float = math.inf

    def is_due_again(self, now: float, horizon: float) -> bool:
        """Whether a search at a time [s] may come to something else: after a while, or where less is to be evaded."""
        return horizon < self.horizon or now >= self.time + constants.SEARCH_PERIOD - TIME_ROUNDING


def evaded(
    solver: Solver, query: ArmQuery, verdict: Verdict, situation: Situation, last_failed: FailedEvasion
) -> tuple[Step | None, FailedEvasion]:
    """An evasion path where something comes to where the arm stops or stands, and it has no path to the goal; and the
    last search that found none.

    None where there is none, or nothing comes: then to stop along the path being followed is the answer.

    Parameters
    ----------
    verdict : why there is no path for a query; the plan's states the same, and that the arm evades.
    last_failed : the search that found no evasion path before.
    """
    free, horizon = _assessed(verdict, situation, last_failed)
    while horizon is not None:
        state, obstacles, deadline = situation.state, situation.expected, situation.deadline
        if horizon < situation.settings.prediction:
            plan = solver.evade_displaced(query, state, obstacles, horizon, situation.reach, deadline)
        else:
            plan = solver.evade(query, state, obstacles, situation.stop.reference, deadline)
        if plan is not None:
            return _taken(query, plan, verdict, situation), last_failed
        if deadline.passed:
            # What was not found for want of time is searched again in the next tick.
            return None, last_failed
        last_failed = FailedEvasion(situation.now, horizon)
        free, horizon = _assessed(verdict, situation, last_failed)
    evading = situation.followed is not None and situation.followed.evading
    return situation.answered(verdict) if free and evading else None, last_failed


def is_searched(verdict: Verdict, situation: Situation, last_failed: FailedEvasion) -> bool:
    """Whether an evasion path is searched in this tick, which takes about as long as an attempt at a path to the goal:
    not by an arm that approaches, as long as it can go on, nor where there is no time left.
    """
    approaching = situation.followed is not None and situation.followed.approaching
    if approaching or situation.deadline.passed or situation.handover_deadline.passed:
        return False
    return _assessed(verdict, situation, last_failed)[1] is not None


def _assessed(verdict: Verdict, situation: Situation, last_failed: FailedEvasion) -> tuple[bool, float | None]:
    """Whether nothing comes to where an arm without a path goes or stands; and for what horizon [s] an evasion path is
    searched: the prediction, along the graph; where that has failed a shorter one, to a place beside it; then none for
    a while.
    """
    settings = situation.settings
    blocked = verdict.code is VerdictCode.NO_FEASIBLE_PATH
    if not (blocked and settings.avoidance) or situation.obstacles.is_static:
        return False, None
    horizons = [settings.prediction]
    if situation.reach > 0.0:
        horizons.append(min(constants.EVASION_DISPLACED_WITHIN, 0.5 * settings.prediction))
    for horizon in horizons:
        if _is_free(situation, horizon):
            return True, None
        if last_failed.is_due_again(situation.now, horizon):
            return False, horizon
    return False, None


def _taken(query: ArmQuery, plan: Plan, verdict: Verdict, situation: Situation) -> Step:
    """A new evasion path."""
    reason = f"{verdict.reason}; evading what is coming"
    plan = replace(plan, verdict=replace(verdict, clearance=plan.verdict.clearance, reason=reason))
    return situation.handed_out(plan, Followed.begun(query, plan, situation, evading=True))


def still_evading(situation: Situation) -> Step | None:
    """The evasion path being played, where there was no time to search for another: as long as that is free, and the
    arm can still stop on it. None where it is not, or nothing moves any more, or the arm does not evade.
    """
    followed = situation.followed
    if followed is None or not followed.evading or situation.obstacles.is_static:
        return None
    clearance = situation.clearance_left(beyond=False)
    return None if clearance is None else situation.answered(replace(followed.verdict, clearance=clearance))


def _left(situation: Situation) -> SweptArm:
    """Where the arm goes if it does not evade: it stops on a path to the goal, or plays what it plays."""
    followed = situation.followed
    on_path = followed is not None and (followed.verdict.ok or followed.approaching) and not situation.at_rest
    return situation.stop.swept if on_path else situation.left


# A tick asks this of its situation when it chooses its attempts, and again where it evades.
@lru_cache(maxsize=4)
def _is_free(situation: Situation, horizon: float) -> bool:
    """Whether nothing that moves on for a horizon [s] meets an arm that does not evade."""
    certificate = situation.certifier.certify_swept(_left(situation), situation.expected, horizon, beyond=False)
    return situation.certifier.objection(certificate) is None
