"""GraphPath: an arm without a path searches one through the graph, in the posture in which it stands and in others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.planning.memory import FailedAttempts
from geodesic_motion_ros.planning.proposers.turn import Proposer, Turn
from geodesic_motion_ros.queries.query import ArmQuery


class GraphPath(Proposer):
    """A proposer of the path to the goal that an attempt finds; where none does, the verdict says why."""

    def propose(self, turn: Turn) -> Turn:
        """Search with the query whose turn it is; nothing where every query was attempted in full."""
        situation, solver = turn.situation, turn.arm.solver
        blocked = turn.memory.failed_for(turn.query, situation.obstacles)
        query, tried = _query_to_try(turn, blocked)
        if query is None:
            assert blocked is not None
            return replace(turn, verdict=blocked.verdict)
        attempts, memory = turn.memory.choose_attempts(solver, query, situation, replace(turn, query=query).is_taken)
        plan = turn.solve(query, attempts, refusal=memory.refusal)
        memory = memory.after(plan, query, tried, attempts, situation)
        if plan.trajectory is not None:
            return turn.take_path(query, plan, memory)
        return replace(turn, query=query, verdict=plan.refusal, memory=memory)


def _query_to_try(turn: Turn, blocked: FailedAttempts | None) -> tuple[ArmQuery | None, FailedAttempts | None]:
    """The query that is searched next, and the attempts that were made with it already.

    The order, for an arm among obstacles that stand:

    1. the query on which the arm stopped (`FailedAttempts.origin`);
    2. a query to the same goal from where the arm stands, if it stands elsewhere than that one begins;
    3. the same in each other posture in which the arm can hold it;
    4. once more from 1 on, if one of these attempts was out of time (`FailedAttempts.unfinished`);
    5. None: all was attempted, and nothing has changed since.

    Each query is searched until all cautious attempts were made with it. Where obstacles have changed, or move, 1 is
    searched again: the other queries were for obstacles that stood.
    """
    queries, query, situation = turn.arm.queries, turn.query, turn.situation
    if blocked is None:
        return (queries.first_posture(turn.origin) if situation.at_rest else turn.origin), None
    if not blocked.attempts.issuperset(turn.arm.solver.cautious_attempts):
        return query, blocked
    other, position = None, situation.state.position
    if query is blocked.origin and not np.array_equal(query.start, position):
        anew = queries.build_beside(query, position, situation.state.latent_on(query), turn.goal)
        other = None if isinstance(anew, Refusal) else anew
    other = other or queries.other_posture(query)
    if other is None and blocked.unfinished:
        return queries.first_posture(blocked.origin), None
    return other, replace(blocked, attempts=frozenset())
