"""Proposer, which proposes one kind of motion, and Turn: what it knows of a tick, and what those before it came to."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from geodesic_motion_ros.contract.settings import Attempt
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.motion.detour import DetourRequest
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.played import FollowedPlan, Step
from geodesic_motion_ros.planning.guarded_arm import GuardedArm
from geodesic_motion_ros.planning.memory import AttemptMemory
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.queries.query import ArmGoal, ArmQuery
from geodesic_motion_ros.queries.search import KnownPaths

_NO_PATH = Refusal(VerdictCode.NO_FEASIBLE_PATH)


class Proposer(ABC):
    """A proposer of what an arm without a path does, in a turn of its own."""

    @abstractmethod
    def propose(self, turn: Turn) -> Turn:
        """Return the turn of the next proposer: with a step, with a verdict, with another memory, or as it is."""

    def takes_the_tick(self, turn: Turn) -> bool:
        """Whether it begins a search in this tick, where there is no path for the reason of a turn, that takes so long
        that no attempt at a path is made before it. Most do not.
        """
        return False


@dataclass(frozen=True, eq=False)
class Turn:
    """The state of a tick that a proposer knows, and what the proposers before it came to.

    Attributes
    ----------
    origin : the query on which the arm stopped, where another is attempted in its place. query : the one that is.
    memory : for the next tick.
    later : the proposers after this one.
    verdict : why there is no path to the goal.
    step : what the arm does, so far; None: it stops. decided : no other proposer is asked.
    detour : the request of a detour that is to be searched from now on; None: no search is begun.
    """

    arm: GuardedArm
    situation: Situation
    goal: ArmGoal
    origin: ArmQuery
    query: ArmQuery
    memory: AttemptMemory
    later: tuple[Proposer, ...] = ()
    verdict: Refusal = _NO_PATH
    step: Step | None = None
    decided: bool = False
    detour: DetourRequest | None = None

    @property
    def detour_request(self) -> DetourRequest:
        """The request of a detour from where the arm stands."""
        situation = self.situation
        return DetourRequest(self.origin, self.goal, situation.obstacles, situation.reach, situation.state.position)

    def is_taken(self, refusal: Refusal) -> bool:
        """Whether a later proposer takes the tick, where there is no path for a reason."""
        return any(proposer.takes_the_tick(replace(self, verdict=refusal)) for proposer in self.later)

    def solve(
        self,
        query: ArmQuery,
        attempts: tuple[Attempt, ...],
        known: KnownPaths | None = None,
        longest: float = math.inf,
        refusal: Refusal | None = None,
    ) -> Plan:
        """Return the certified motion to the goal of a query; arguments as of `Solver.solve`."""
        situation = self.situation
        plan = self.arm.solver.solve(
            query, situation.state, situation.expected_obstacles, attempts, situation.deadline, known, longest, refusal,
            self.memory.workings,
        )  # fmt: skip
        return situation.require_a_stop(plan)

    def take_path(self, query: ArmQuery, plan: Plan, memory: AttemptMemory) -> Turn:
        """Return the last turn, in which a new path is followed. Where it was found too late, an arm that evades goes
        on evading as long as that is free.
        """
        situation = self.situation
        step = situation.go_on_evading() if situation.handover_deadline.passed else None
        begun = FollowedPlan.of(query, plan, situation.obstacles, situation.now)
        step = step or situation.hand_out(plan, begun)
        return replace(self, query=query, memory=memory, step=step, decided=True)
