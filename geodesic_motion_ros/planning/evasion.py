"""Evasion: an arm that has no path to its goal makes room for what is coming to where it stands or stops.

Where to is searched by `solver.Solver.evade`; here is decided when, and how long it goes on.
"""

from __future__ import annotations

from dataclasses import replace

from geodesic_motion_ros.arm_certificate import SweptArm
from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.situation import TIME_ROUNDING, Followed, Situation, Step
from geodesic_motion_ros.planning.solver import HeldQuery, Plan, Solver
from geodesic_motion_ros.verdict import Verdict, VerdictCode


def evaded(
    solver: Solver, query: HeldQuery, verdict: Verdict, situation: Situation, last_failed: float, reach: float
) -> tuple[Step | None, float]:
    """An evasion path where something comes to where the arm stops or stands, and it has no path to the goal; and when
    none was found last [s].

    None where there is none, or nothing comes: then to stop along the path being followed is the answer.

    Parameters
    ----------
    verdict : why there is no path for a query; the plan's states the same, and that the arm evades.
    last_failed : when no evasion path was found last [s].
    reach : how far the tool may leave what was demonstrated [m].
    """
    settings, followed = situation.settings, situation.followed
    blocked = verdict.code is VerdictCode.NO_FEASIBLE_PATH
    if not (blocked and settings.avoidance) or situation.obstacles.stand:
        return None, last_failed
    left, evading = _left(situation), followed is not None and followed.evading
    due = situation.now >= last_failed + constants.EVASION_PERIOD - TIME_ROUNDING
    for horizon in (constants.EVASION_LOOKAHEAD * settings.prediction, settings.prediction):
        if _is_free(situation, left, horizon):
            return situation.answered(verdict) if evading else None, last_failed
        plan = None
        if due:
            plan = solver.evade(query, situation.state, situation.expected, horizon, situation.deadline)
        if plan is not None:
            return _taken(query, plan, verdict, situation), last_failed
    soon = min(constants.EVASION_DISPLACED_WITHIN, settings.prediction)
    failed = situation.now if due else last_failed
    if reach == 0.0:
        return None, failed
    if _is_free(situation, left, soon):
        return situation.answered(verdict) if evading else None, failed
    plan = solver.evade_displaced(query, situation.state, situation.expected, soon, reach) if due else None
    return (None, failed) if plan is None else (_taken(query, plan, verdict, situation), last_failed)


def _taken(query: HeldQuery, plan: Plan, verdict: Verdict, situation: Situation) -> Step:
    """A new evasion path; found too late, the one being played stays where it is free."""
    current = still_evading(situation) if situation.late.passed else None
    if current is not None:
        return current
    reason = f"{verdict.reason}; evading what is coming"
    plan = replace(plan, verdict=replace(verdict, clearance=plan.verdict.clearance, reason=reason))
    return situation.handed_out(plan, Followed.begun(query, plan, situation, evading=True))


def still_evading(situation: Situation) -> Step | None:
    """The evasion path being played, where there was no time to search for another: as long as that is free, and the
    arm can still stop on it. None where it is not, or nothing moves any more, or the arm does not evade.
    """
    followed = situation.followed
    if followed is None or not followed.evading or situation.obstacles.stand:
        return None
    clearance = situation.clearance_left(beyond=False)
    return None if clearance is None else situation.answered(replace(followed.verdict, clearance=clearance))


def _left(situation: Situation) -> SweptArm:
    """Where the arm goes if it does not evade: it stops on a path to the goal, or plays what it plays."""
    followed = situation.followed
    on_path = followed is not None and (followed.verdict.ok or followed.approaching) and not situation.at_rest
    return situation.stop.swept if on_path else situation.left


def _is_free(situation: Situation, left: SweptArm, horizon: float) -> bool:
    """Whether nothing that moves on for a horizon [s] meets what is left of a motion."""
    certificate = situation.certifier.certify_swept(left, situation.expected, horizon, beyond=False)
    return situation.certifier.objection(certificate) is None
