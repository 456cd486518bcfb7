"""The answers of a solver, and the states of motion that it plans from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from geodesic_motion_ros.certification.certificate import JudgedTrajectory
from geodesic_motion_ros.contract.mode import Mode
from geodesic_motion_ros.contract.status import Refusal, Verdict
from geodesic_motion_ros.queries.round_frame import RoundFrame
from geodesic_motion_ros.queries.search import LatentPath
from geodesic_motion_ros.trajectory.trajectory import JointReference


class Aim(Protocol):
    """What a motion leads to, as the stream knows it: a query to a goal, or a trajectory that was offered."""

    @property
    def start_latent(self) -> np.ndarray:
        """The latent point (d,) where it begins."""

    @property
    def round_frame(self) -> RoundFrame | None:
        """The frame of its rounds; None: it is not closed."""


@dataclass(frozen=True)
class Plan:
    """The motion that the arm is to play from `begin` on, and why: the answer of `tick`, `stop`, `plan` and of every
    search.

    Attributes
    ----------
    trajectory : it replaces everything that is played from `begin` on. None, of a tick: no change, the arm plays on, or
        stands. None, of a search or of `plan`: none was found, and the verdict states why.
    begin : time of the trajectory's first knot [s].
    verdict : OK: the arm has a certified path to the goal. With every other verdict a trajectory is a stop, an evasion
        or an approach.
    path : the path through the graph, where the first attempt found it.
    optimistic : as of `Attempt`.
    mode : what the arm does after the tick.
    """

    trajectory: JudgedTrajectory | None
    begin: float
    verdict: Verdict
    path: LatentPath | None = None
    optimistic: bool = False
    mode: Mode = Mode.IDLE

    @property
    def refusal(self) -> Refusal:
        """The verdict of a plan that comes to no path."""
        assert isinstance(self.verdict, Refusal)
        return self.verdict

    @property
    def reference(self) -> JointReference | None:
        """The motion of the joints along the trajectory."""
        return None if self.trajectory is None else self.trajectory.reference

    @property
    def tool_poses(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Positions (n, 3) [m] and quaternions (n, 4) of the tool at the knots of the trajectory."""
        return None if self.trajectory is None else self.trajectory.tool_poses


@dataclass(frozen=True)
class MotionState:
    """The state of motion (eta,) in which a new trajectory takes over at `time` [s], and its latent point (d,).

    query : on the graph of which that is; None: not known.
    """

    time: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    latent: np.ndarray | None
    query: Aim | None = None

    def latent_on(self, query: Aim) -> np.ndarray:
        """Return the latent point (d,) on the graph of a query; where there is none, that of the query's start.

        On the path of another query of a closed skill, which may be rounds away, it is the one nearest to the start.
        """
        if self.latent is None:
            return query.start_latent
        if query.round_frame is None or self.query is query:
            return self.latent
        return query.round_frame.nearest(self.latent, query.start_latent)

    def after(self, stop: JointReference) -> MotionState:
        """Return the state of rest where a stop from this state ends."""
        still = np.zeros_like(self.position)
        latent = None if self.latent is None else stop.latent_at(stop.duration)
        return MotionState(self.time + stop.duration, stop.positions[-1], still, still, latent, self.query)


@dataclass(frozen=True)
class ApproachPlan:
    """A plan that leads towards a covered goal, and how much of the path there it leaves [m].

    remaining : a length of the path of the arm's sphere that moves farthest.
    """

    plan: Plan
    remaining: float
