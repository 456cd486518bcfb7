"""Approach: an arm whose goal is covered goes along its path as near to it as it can, and stands there.

`Solver.approach` works out how near that is. This module decides when it is searched, and how long the arm goes on. An
arm that stands there sets out again where that gains `APPROACH_GAIN`, or where the goal is free: then a path is
searched as for every blocked arm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.mode import Purpose
from geodesic_motion_ros.planning.plan import ArmQuery
from geodesic_motion_ros.planning.played import Followed, Step
from geodesic_motion_ros.planning.retry import Asked, Question, is_due
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.planning.solver import Solver
from geodesic_motion_ros.planning.status import Verdict

#: The name of the requirement of an approach.
APPROACH = "approach"


def still_approaching(query: ArmQuery, verdict: Verdict, situation: Situation) -> Step | None:
    """The step in which an arm goes on with its approach, as long as the rest of it is free and the arm can stop on it;
    None where that is not so, or the arm does not approach.

    verdict : why there is no path for the query; the plan's verdict states the same.
    """
    followed = situation.followed
    if followed is None or followed.purpose is not Purpose.APPROACH or followed.query is not query or situation.at_rest:
        return None
    clearance = situation.clearance_left()
    if clearance is None:
        return None
    verdict = replace(verdict, clearance=clearance)
    return situation.answered(verdict, replace(followed, verdict=verdict))


def approached(
    solver: Solver, query: ArmQuery, verdict: Verdict, situation: Situation, asked: Mapping[str, Asked]
) -> tuple[Step | None, Mapping[str, Asked]]:
    """The step in which an arm whose goal is covered begins an approach, and the searches that were made.

    The step is None where no approach leads nearer to the goal than the arm is, or is going already.

    Parameters
    ----------
    verdict : why there is no path for the query; the plan's verdict states the same, and how near the arm goes.
    asked : the searches that were made before this tick, by the names of their requirements.
    """
    settings, followed = situation.settings, situation.followed
    if not (verdict.goal_covered and settings.approach_covered_goal and settings.avoidance):
        return None, asked
    resting = situation.at_rest
    evading = followed is not None and followed.purpose is Purpose.EVASION and not resting
    question = Question(query, situation.obstacles, situation.state.position if resting else None)
    if evading or not is_due(asked.get(APPROACH), question, situation.now, 0.0 if resting else constants.SEARCH_PERIOD):
        return None, asked
    remaining = followed.remaining if followed is not None and followed.query is query else math.inf
    found = solver.approach(query, situation.state, situation.expected, verdict, remaining, situation.deadline)
    if situation.handover_deadline.passed or (found is None and situation.deadline.passed):
        # An approach that was not found for want of time, or too late, is searched again.
        return None, asked
    asked = {**asked, APPROACH: Asked(question, situation.now)}
    plan = None if found is None else situation.require_a_stop(found.plan)
    if found is None or plan is None or plan.trajectory is None:
        return None, asked
    begun = Followed.begun(query, plan, situation.obstacles, situation.now, Purpose.APPROACH, found.remaining)
    return situation.handed_out(plan, begun), asked
