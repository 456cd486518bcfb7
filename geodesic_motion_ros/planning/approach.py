"""Approach: an arm whose goal is covered goes along its path as near to it as it can, and stands there.

`Solver.approach` works out how near that is. This module decides when it is searched, and how long the arm goes on. An
arm that stands there sets out again where that gains `APPROACH_GAIN`, or where the goal is free: then a path is
searched as for every blocked arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.mode import Purpose
from geodesic_motion_ros.planning.plan import ArmQuery
from geodesic_motion_ros.planning.played import TIME_ROUNDING, Followed, Step
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.planning.solver import Solver
from geodesic_motion_ros.planning.status import Verdict


@dataclass(frozen=True, eq=False)
class ApproachSearch:
    """An approach that was searched: for what query, from where (eta,) [rad], among what obstacles, and when [s]."""

    query: ArmQuery
    position: np.ndarray
    obstacles: Obstacles
    time: float

    def is_due_again(self, query: ArmQuery, situation: Situation) -> bool:
        """Whether another search may find another approach: in motion only where obstacles have changed."""
        if query is not self.query:
            return True
        unchanged = self.obstacles.is_static_and_unchanged(situation.obstacles)
        if situation.at_rest:
            return not (unchanged and np.array_equal(self.position, situation.state.position))
        return not unchanged and situation.now >= self.time + constants.SEARCH_PERIOD - TIME_ROUNDING


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
    solver: Solver, query: ArmQuery, verdict: Verdict, situation: Situation, last: ApproachSearch | None
) -> tuple[Step | None, ApproachSearch | None]:
    """The step in which an arm whose goal is covered begins an approach, and the last approach that was searched.

    The step is None where no approach leads nearer to the goal than the arm is, or is going already.

    Parameters
    ----------
    verdict : why there is no path for the query; the plan's verdict states the same, and how near the arm goes.
    last : the approach that was searched before this tick.
    """
    settings, followed = situation.settings, situation.followed
    if not (verdict.goal_covered and settings.approach_covered_goal and settings.avoidance):
        return None, last
    evading = followed is not None and followed.purpose is Purpose.EVASION and not situation.at_rest
    if evading or not (last is None or last.is_due_again(query, situation)):
        return None, last
    remaining = followed.remaining if followed is not None and followed.query is query else math.inf
    found = solver.approach(query, situation.state, situation.expected, verdict, remaining, situation.deadline)
    if situation.handover_deadline.passed or (found is None and situation.deadline.passed):
        # An approach that was not found for want of time, or too late, is searched again.
        return None, last
    searched = ApproachSearch(query, situation.state.position, situation.obstacles, situation.now)
    plan = None if found is None else situation.require_a_stop(found.plan)
    if found is None or plan is None or plan.trajectory is None:
        return None, searched
    begun = Followed.begun(query, plan, situation.obstacles, situation.now, Purpose.APPROACH, found.remaining)
    return situation.handed_out(plan, begun), searched
