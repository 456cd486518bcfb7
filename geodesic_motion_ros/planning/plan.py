"""The inputs and the answers of a solver: queries of an arm, states of motion, plans.

A query is a start, a goal, and the latent graph transported to them. Which type stands where:

    skill learned from         built by                     query in a tick        module
    joint configurations       ConfigurationQueryBuilder    ConfigurationQuery     configuration_query.py
    tool poses                 ToolQueryBuilder             ToolQuery              tool_query.py
      `- made of               PoseQueryBuilder             PoseQuery              pose_query.py

`ConfigurationQuery` and `PoseQuery` share the fields of `TransportedQuery` (transported_query.py). The other names are
protocols, which say what a function requires of a query:
`SearchQuery` a graph with costs, `RefinedQuery` also the metric between its nodes (search.py), `PathEnds` two
configurations, `ArmQuery` all of these, with nodes that are configurations. Without an arm, `PoseQuery` is used alone
(pose_path.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from geodesic_motion_ros.planning.certificate import JudgedTrajectory
from geodesic_motion_ros.planning.mode import Mode
from geodesic_motion_ros.planning.search import LatentPath, RefinedQuery
from geodesic_motion_ros.planning.status import Figures, Refusal, Verdict
from geodesic_motion_ros.trajectory.trajectory import JointReference


class PathEnds(Protocol):
    """The configurations (eta,) [rad] between which a path leads.

    misfits : the endpoint errors, how far both are from what the skill demonstrates, by their names in `Figures`.
    """

    @property
    def start(self) -> np.ndarray: ...
    @property
    def goal(self) -> np.ndarray: ...
    @property
    def misfits(self) -> Figures: ...


class ArmGoal(Protocol):
    """A goal that was accepted; each output space has goals of its own, which are compared among themselves.

    stated : how it was found, for a person.
    """

    @property
    def stated(self) -> str: ...

    def is_same(self, other: Any) -> bool:
        """Whether the same is meant, received again."""
        ...

    def is_near(self, other: Any) -> bool:
        """Whether it is hardly elsewhere, and may wait until the arm rests."""
        ...


class ArmQuery(RefinedQuery, PathEnds, Protocol):
    """The query that a solver plans for: a graph whose nodes are configurations of an arm of eta joints.

    Attributes
    ----------
    start_latent : (d,) latent point that is transported onto the start.
    """

    @property
    def start_latent(self) -> np.ndarray: ...

    def turned_to_base(self, covariances: np.ndarray) -> np.ndarray:
        """Return covariances (m, 3, 3) of positions in the frame of the skill, in the base frame."""
        ...

    def displaced_at(self, progress: np.ndarray) -> float:
        """Return how far the graph itself holds the tool from what was demonstrated [m], as it was displaced when the
        query began, at a progress (1,) of the skill.
        """
        ...

    def configurations_along(self, latent: np.ndarray, start: np.ndarray) -> np.ndarray | Refusal:
        """Return configurations (m, eta) of a latent curve (m, d), the first of them near a configuration (eta,); or
        where and why the arm cannot hold it.
        """
        ...


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
    """The state of motion (eta,) in which a new trajectory takes over at `time` [s], and its latent point (d,)."""

    time: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    latent: np.ndarray | None

    def after(self, stop: JointReference) -> MotionState:
        """Return the state of rest where a stop from this state ends."""
        still = np.zeros_like(self.position)
        latent = None if self.latent is None else stop.latent_at(stop.duration)
        return MotionState(self.time + stop.duration, stop.positions[-1], still, still, latent)


@dataclass(frozen=True)
class ApproachPlan:
    """A plan that leads towards a covered goal, and how much of the path there it leaves [m].

    remaining : a length of the path of the arm's sphere that moves farthest.
    """

    plan: Plan
    remaining: float
