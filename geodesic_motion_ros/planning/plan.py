"""What a solver is asked for, and what it answers: queries of an arm, states of motion, plans."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from geodesic_motion_ros.planning.certificate import JudgedTrajectory
from geodesic_motion_ros.planning.mode import Mode
from geodesic_motion_ros.planning.search import LatentPath, RefinedQuery
from geodesic_motion_ros.planning.status import Verdict
from geodesic_motion_ros.trajectory.trajectory import JointReference


class PathEnds(Protocol):
    """Configurations (eta,) [rad] between which a path leads; misfits : how far they are from those of the skill, by
    their names in a Verdict.
    """

    start: np.ndarray
    goal: np.ndarray
    misfits: dict[str, float]


class ArmQuery(RefinedQuery, PathEnds, Protocol):
    """A `RefinedQuery` whose nodes are configurations of an arm of eta joints.

    Attributes
    ----------
    start_latent : (d,) latent point that is carried onto the start.
    """

    start_latent: np.ndarray

    def turned_to_base(self, covariances: np.ndarray) -> np.ndarray:
        """Covariances (m, 3, 3) of positions in the frame of the skill, in the base frame."""
        ...

    def displaced_at(self, progress: np.ndarray) -> float:
        """How far the graph itself holds the tool from what was demonstrated [m], as it was displaced when the query
        began, at a progress (1,) of the skill.
        """
        ...

    def configurations_along(self, latent: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, str]:
        """Configurations (m, eta) of a latent curve (m, d), the first of them near a configuration (eta,), and where
        and why the arm cannot hold it, "" where it can.
        """
        ...


@dataclass(frozen=True)
class Plan:
    """Answer of one planning step.

    Attributes
    ----------
    trajectory : what is to be played from `begin` on, in the place of everything before; None: what is being played
        stays, or the arm stands.
    begin : time of its first knot [s].
    verdict : OK comes with a path to the goal. With any other verdict the trajectory is a stop, evades, or approaches.
    path : through the graph, where the first attempt found it.
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
    def reference(self) -> JointReference | None:
        """The motion of the joints along the trajectory."""
        return None if self.trajectory is None else self.trajectory.reference

    @property
    def tool_poses(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Positions (n, 3) [m] and quaternions (n, 4) of the tool at the knots of the trajectory."""
        return None if self.trajectory is None else self.trajectory.tool_poses


@dataclass(frozen=True)
class MotionState:
    """State of motion in which a new reference takes over, at `time` [s]: (eta,) each, and its latent point (d,)."""

    time: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    latent: np.ndarray | None

    def after(self, stop: JointReference) -> MotionState:
        """At rest, where a stop from here ends."""
        still = np.zeros_like(self.position)
        latent = None if self.latent is None else stop.latent_at(stop.duration)
        return MotionState(self.time + stop.duration, stop.positions[-1], still, still, latent)


@dataclass(frozen=True)
class Approach:
    """A plan that leads towards a covered goal, and what it leaves of the path there [m]: of the arm's spheres, of the
    one that moves farthest.
    """

    plan: Plan
    remaining: float
