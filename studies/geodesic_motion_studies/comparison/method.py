"""Method: what a row of the comparison has to offer, and what it receives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from geodesic_motion_ros.geometry.curves import Pose
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_studies.comparison.scene import Scene

#: Between ticks, and how long a motion that nothing follows takes to end [s].
TICK, BRAKING = 0.01, 0.1


@dataclass(frozen=True)
class Answer:
    """What a method says in one tick.

    Attributes
    ----------
    waypoints : what the arm is to play from `begin` [s] on, in the place of everything before; None: that goes on.
    refusal : why the arm follows no path to the goal; empty where it does.
    pose : of the tool, (3,) [m] and (4,), where it is to be by now, in a stream of poses that the arm follows as the
        twin does, in the place of everything before.
    planned : whether what is answered is new, and not the next piece of what an earlier tick planned.
    """

    waypoints: JointWaypoints | None = None
    begin: float = 0.0
    refusal: str = ""
    pose: Pose | None = None
    planned: bool = True

    @classmethod
    def playing(cls, reference: JointReference, begin: float, refusal: str = "") -> Answer:
        """Play a reference."""
        waypoints = JointWaypoints(reference.times, reference.positions, reference.velocities, reference.accelerations)
        return cls(waypoints, begin, refusal)

    @classmethod
    def moving(cls, positions: np.ndarray, velocities: np.ndarray, now: float, refusal: str = "") -> Answer:
        """Be at positions (eta,) [rad] with velocities (eta,) [rad/s] two ticks from now [s], and brake after that, if
        nothing new comes: a controller takes no trajectory that ends in motion.
        """
        ends = np.stack([positions, positions + 0.5 * BRAKING * velocities])
        still = np.stack([velocities, np.zeros_like(velocities)])
        return cls(JointWaypoints(np.array([2.0 * TICK, 2.0 * TICK + BRAKING]), ends, still), now, refusal)


class Method(Protocol):
    """A method that moves an arm among obstacles. One of them plays one scene at a time.

    Attributes
    ----------
    settings : what the table says of how it is set up; a result is valid for these.
    """

    settings: dict[str, Any]

    def reset(self, scene: Scene) -> None:
        """The arm stands at the scene's start, at time 0, and is to go to its goal."""

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """Called every 10 ms of simulated time with true positions and velocities of the obstacles, all that are there;
        where a camera watches them (`camera.py`) with what is known by it. Those that move have ages then.

        Every method knows what it has sent; the measured joints are given to those alone that track an arm that lags
        (`TracksArm`). What is answered reaches the arm one tick later, however long it was thought about.
        """


@runtime_checkable
class TracksArm(Protocol):
    """A method that counts how an arm follows what it is sent."""

    def track(self, measured: np.ndarray, now: float) -> None:
        """Called before a tick at `now` [s]: where the joints are measured to be (eta,) [rad]."""
