"""FoundDetour and WantedDetour: an arm at rest without a path follows a detour that was found, or has one searched."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from geodesic_motion_ros.motion.retry import TIME_ROUNDING
from geodesic_motion_ros.planning.proposers.turn import Proposer, Turn
from geodesic_motion_ros.queries.query import ArmQuery


class FoundDetour(Proposer):
    """A proposer of the detour that was found, where it is certified among the present obstacles."""

    def propose(self, turn: Turn) -> Turn:
        """Propose to follow it; where it is not certified any more, remember why."""
        situation, memory, search = turn.situation, turn.memory, turn.memory.detour
        if search is None or not may_leave(turn):
            return turn
        request = turn.detour_request
        if not search.job.is_done(situation.now) or search.refusal_for(request, situation.now):
            return turn
        detour = search.detour_for(request)
        if detour is None:
            return turn
        plan = situation.require_a_stop(turn.arm.detours.plan(detour, situation.state, situation.expected_obstacles))
        if plan.trajectory is not None:
            query = cast(ArmQuery, detour.query)  # those that an arm's own search finds are of its queries
            return turn.take_path(query, plan, memory.after(plan, query, None, (), situation))
        return replace(turn, memory=replace(memory, detour=replace(search, refusal=plan.refusal)))


class WantedDetour(Proposer):
    """A proposer that requests the search of a detour, in a thread of its own, for an arm that has had no path for long
    enough.
    """

    def propose(self, turn: Turn) -> Turn:
        """Request it, where none is searched, and the obstacles are others than those of the last search."""
        situation, search = turn.situation, turn.memory.detour
        if not may_leave(turn) or (search is not None and not search.job.is_done(situation.now)):
            return turn
        request = turn.detour_request
        if search is not None and search.request.question.holds_for(request.question):
            return turn
        since = min(turn.memory.blocked_since, situation.unchanged_since)
        patient = situation.now < since + situation.settings.patience - TIME_ROUNDING
        return turn if patient else replace(turn, detour=request)


def may_leave(turn: Turn) -> bool:
    """Whether the arm rests, had no path in an earlier tick either, and may leave what was demonstrated."""
    situation = turn.situation
    return situation.reach > 0.0 and situation.at_rest and turn.memory.blocked_since < situation.now
