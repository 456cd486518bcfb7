"""Approach: an arm whose goal is covered goes along its path as near to it as it can, and stands there.

`approach_motion.py` works out how near that is. This module decides when it is searched, and how long the arm goes on.
An arm that stands there sets out again where that gains `APPROACH_GAIN`, or where the goal is free: then a path is
searched as for every blocked arm.
"""

from __future__ import annotations

import math
from dataclasses import replace

from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.motion.approach_motion import approach_to_covered
from geodesic_motion_ros.motion.played import FollowedPlan
from geodesic_motion_ros.motion.retry import PastSearch, Question, is_due
from geodesic_motion_ros.planning.proposers.turn import Proposer, Turn

#: The name of the requirement of an approach.
APPROACH = "approach"


class KeptApproach(Proposer):
    """A proposer of going on with the approach that the arm follows, as long as that is free."""

    def propose(self, turn: Turn) -> Turn:
        """Propose to go on."""
        return replace(turn, step=turn.situation.go_on_approaching(turn.query, turn.verdict))


class Approach(Proposer):
    """A proposer of going as near to a covered goal as is free, nearer than the arm is, or is going already.

    It does not take the tick: few goals are covered, and the attempts at a path come first.
    """

    def propose(self, turn: Turn) -> Turn:
        """Begin an approach: the plan's verdict states why there is no path, and how near the arm goes."""
        situation, memory, query = turn.situation, turn.memory, turn.query
        if not self._serves(turn) or not is_due(memory.past_searches.get(APPROACH), *self._asking(turn)):
            return turn
        if situation.deadline.passed:
            return replace(turn, memory=memory.repeat_all(turn.verdict))
        followed = situation.followed
        remaining = followed.remaining if followed is not None and followed.query is query else math.inf
        found = approach_to_covered(
            turn.arm.solver, query, situation.state, situation.expected_obstacles, turn.verdict, remaining,
            situation.deadline,
        )  # fmt: skip
        if situation.handover_deadline.passed or (found is None and situation.deadline.passed):
            # An approach that was not found for want of time, or too late, is searched again.
            return replace(turn, memory=memory.repeat_all(turn.verdict))
        question, now, _ = self._asking(turn)
        plan = None if found is None else situation.require_a_stop(found.plan)
        memory = replace(memory, past_searches={**memory.past_searches, APPROACH: PastSearch(question, now)})
        if found is None or plan is None or plan.trajectory is None:
            return replace(turn, memory=memory)
        begun = FollowedPlan.of(query, plan, situation.obstacles, now, Purpose.APPROACH, found.remaining)
        # The arm leaves where it was blocked.
        memory = replace(memory, blocked=None, detour=None)
        return replace(turn, memory=memory, step=situation.hand_out(plan, begun), decided=True)

    @staticmethod
    def _serves(turn: Turn) -> bool:
        """Whether an approach is an answer: the goal of the query on which the arm stopped is covered."""
        situation, settings = turn.situation, turn.situation.settings
        if turn.memory.origin(turn.query) is not turn.query:
            return False
        if not (turn.verdict.figures.goal_covered and settings.approach_covered_goal and settings.avoidance):
            return False
        followed = situation.followed
        return followed is None or followed.purpose is not Purpose.EVASION or situation.at_rest

    @staticmethod
    def _asking(turn: Turn) -> tuple[Question, float, float]:
        """What is asked, when, and how often: at rest as often as something changes."""
        situation, resting = turn.situation, turn.situation.at_rest
        question = Question(turn.query, situation.obstacles, situation.state.position if resting else None)
        return question, situation.now, 0.0 if resting else constants.SEARCH_PERIOD
