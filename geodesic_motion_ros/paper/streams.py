"""What the paper's planner commands: tool poses, or joint trajectories. Knows nothing of ROS.

What is commanded is a mass that follows the leading point of the path (`paper.follower`): its state is a place (p,), a
pose as x, y, z [m], w, x, y, z or a configuration [rad], and its velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.nodes.cycle import PoseArrays
from geodesic_motion_ros.nodes.deviation import joint_deviation, pose_deviation
from geodesic_motion_ros.paper.follower import TimedPath, followed
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference, ending_at_rest, interpolated, joined

#: The mass has come to rest so long [s] after the leading point, at the latest.
_SETTLING = 5.0


@dataclass(frozen=True)
class Commanded:
    """What is commanded in a cycle, as of `CycleOutput`."""

    commanded: PoseArrays | None = None
    trajectory: tuple[JointReference, float] | None = None
    configuration: np.ndarray | None = None
    speed: float = 0.0


class PoseStream:
    """The stream of tool poses.

    Attributes
    ----------
    tolerance : [m], [rad] largest distance between measured and commanded pose.
    """

    topic = "target_pose"

    def __init__(self, planner: PaperPlanner, tolerance: tuple[float, float]) -> None:
        self._planner, self.tolerance = planner, tolerance
        self._place: np.ndarray | None = None
        self._velocity = np.zeros(7)

    @property
    def stands(self) -> bool:
        """Whether something is commanded already."""
        return self._place is not None

    def stand_at(self, measured: np.ndarray, now: float) -> None:
        """Command the measured place, at rest."""
        tool = self._planner.robot.forward(measured)
        self._place, self._velocity = np.concatenate(tool), np.zeros(7)
        self._planner.stand_at(self._place, *tool)

    def deviation(self, measured: np.ndarray, taken: float) -> tuple[str, str] | None:
        """How far the arm was from where it was sent when that was measured [s], and what is allowed; None while it
        follows.
        """
        return pose_deviation(self._planner.robot.forward(measured), self._pose(), *self.tolerance)

    def follow(self, now: float, advance: float, silent: bool) -> Commanded:
        """Move what is commanded on by a time [s], after the leading point; nothing while it is to be silent."""
        if self._place is None or silent:
            return Commanded()
        leading = self._planner.path
        assert leading is not None
        places = leading.places
        if places[0, 3:] @ self._place[3:] < 0.0:  # the same rotations as -q, near to what is commanded
            places = places * np.repeat([1.0, -1.0], [3, 4])
        # The leading point has moved on by `advance` already.
        before = self._planner.lead - advance
        found, rates, _ = followed(leading.times, places, before, self._place, self._velocity, advance, 1)
        self._place, self._velocity = found[-1], rates[-1]
        return Commanded(self._pose(), speed=float(np.linalg.norm(self._velocity[:3])))

    def _pose(self) -> PoseArrays:
        assert self._place is not None
        return self._place[:3].copy(), normalise(self._place[3:])


class TrajectoryStream:
    """The stream of joint trajectories: one for every path, from what is commanded `latency` [s] later until rest.

    Attributes
    ----------
    tolerance : [rad] largest distance of a joint from where it was sent.
    """

    topic = "joint_trajectory"

    def __init__(self, planner: PaperPlanner, tolerance: float, latency: float) -> None:
        """latency : a new trajectory takes over so long after its planning began [s]."""
        self._planner, self.tolerance, self._latency = planner, tolerance, latency
        # What the arm plays, as sent, and since when [s]; and the path that what was sent last follows.
        self._playing: tuple[JointReference, float] | None = None
        self._sent: TimedPath | None = None

    @property
    def stands(self) -> bool:
        """Whether something is commanded already."""
        return self._playing is not None

    def stand_at(self, measured: np.ndarray, now: float) -> None:
        """Command the measured place, at rest."""
        self._planner.stand_at(measured, *self._planner.robot.forward(measured))
        assert self._planner.path is not None
        self._playing = JointReference.standing(measured, self._planner.path.latent[0]), now
        # It is to be sent, too: what the arm may still be playing must not go on.
        self._sent = None

    def deviation(self, measured: np.ndarray, taken: float) -> tuple[str, str] | None:
        """See `PoseStream.deviation`."""
        return joint_deviation(measured, self._sample(taken)[0], self._planner.robot.joint_names, self.tolerance)

    def follow(self, now: float, advance: float, silent: bool) -> Commanded:
        """Send the newest path, once, from where the mass is to be when it takes over; also while poses would be
        silent: an arm that was lost is sent where it is to stand.
        """
        if self._playing is None:
            return Commanded()
        trajectory, leading = None, self._planner.path
        if leading is not None and leading is not self._sent:
            old, since = self._playing
            new = self._reference(leading, *self._sample(now + self._latency)[:2])
            self._playing = joined(old.rest(now - since), 0.0, new, self._latency), now
            self._sent, trajectory = leading, (new, now + self._latency)
        position, velocity, _ = self._sample(now)
        return Commanded(None, trajectory, position, float(np.max(np.abs(velocity))))

    def _reference(self, path: TimedPath, position: np.ndarray, velocity: np.ndarray) -> JointReference:
        lead = self._planner.lead
        most = math.ceil((path.duration - lead + _SETTLING) / PERIOD)
        knots = followed(path.times, path.places, lead, position, velocity, PERIOD, most)
        times = PERIOD * np.arange(len(knots[0]))
        return ending_at_rest(times, *knots, interpolated(lead + times, path.times, path.latent))

    def _sample(self, now: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        assert self._playing is not None
        reference, since = self._playing
        return reference.sample(now - since)
