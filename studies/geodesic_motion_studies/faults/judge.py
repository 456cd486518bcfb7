"""Judges of commands: what every command must be, whatever happens. Know nothing of ROS.

The first promise: every reference is finite, inside limits with a margin, starts within 0.02 rad of what was last
commanded, ends at rest; and its stamp is not old. What is streamed neither stops nor sets out at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints, TrajectoryPlayer
from geodesic_motion_ros.utils.errors import RobotError
from geodesic_motion_studies.faults.stream_acceleration import StreamAcceleration

#: A reference starts no further than this from what was last commanded: a joint [rad], the tool's orientation [rad],
#: and its position [m], which an arm half a metre long moves by at such an angle.
LARGEST_STEP, LARGEST_STEP_POSITION = 0.02, 0.01
#: A reference that begins further than this in the past has an old stamp [s]. The first knot is that before the
#: present, and the judge hears of it a moment later.
OLDEST_BEGIN = 0.25
#: Of limits of velocity and acceleration, for rounding; of positions [rad].
_ROUNDING = 1e-6
#: Where limits are looked at between two knots.
_SAMPLES_PER_SEGMENT = 5

#: Position (3,) [m] and quaternion (4,) of the tool.
Pose = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Trajectory:
    """A joint trajectory as it was heard, at `heard` [s], of the clock of its stamp `begin` [s]."""

    heard: float
    begin: float
    waypoints: JointWaypoints


@dataclass(frozen=True)
class Target:
    """A commanded tool pose as it was heard, at `heard` [s]: position (3,) [m], quaternion (4,); `stamp` [s]."""

    heard: float
    stamp: float
    position: np.ndarray
    quaternion: np.ndarray


class TrajectoryJudge:
    """Judges a stream of joint trajectories, as joint_trajectory_controller would play it."""

    def __init__(self, limits: JointLimits) -> None:
        """limits : that commands keep, with margins."""
        self._limits = limits
        self._player: TrajectoryPlayer | None = None
        self.largest_step = 0.0
        self.count = 0

    def hear(self, command: Trajectory, places: np.ndarray | None = None) -> list[str]:
        """What is wrong with the next trajectory, as sentences; none where nothing is.

        places : (k, eta) [rad] where the arm has just been. At one of them commands begin before the first trajectory;
            afterwards they are to be given only where the planner has said that it found the arm elsewhere.
        """
        self.count += 1
        wrong = self._wrong_in_itself(command)
        points = command.waypoints
        late = command.heard - command.begin - points.times[-1]
        if late > 0.0:
            wrong.append(f"ends {late:.3f} s in the past")
        if command.heard - command.begin > OLDEST_BEGIN:
            wrong.append(f"has a stamp {command.heard - command.begin:.3f} s old")
        step = self._step(command, places)
        self.largest_step = max(self.largest_step, step)
        if not step <= LARGEST_STEP:
            wrong.append(f"starts {step:.4f} rad from what was commanded")
        return wrong

    def _wrong_in_itself(self, command: Trajectory) -> list[str]:
        points, limits = command.waypoints, self._limits
        if points.velocities is None or points.accelerations is None:
            return ["lacks velocities or accelerations"]
        if len(points.times) == 1:
            samples = np.stack([points.positions, points.velocities, points.accelerations])
        else:
            fine = np.linspace(0.0, 1.0, _SAMPLES_PER_SEGMENT + 1)
            at = np.unique(points.times[:-1, None] + np.diff(points.times)[:, None] * fine)
            samples = quintic_samples(
                points.times, *map(np.ascontiguousarray, (points.positions, points.velocities, points.accelerations)),
                at[at < points.times[-1]],
            )  # fmt: skip
        wrong = []
        below, above = limits.lower - samples[0].min(axis=0), samples[0].max(axis=0) - limits.upper
        outside = max(float(below.max()), float(above.max()))
        if outside > _ROUNDING:
            wrong.append(f"leaves the margin of the position limits by {outside:.4f} rad")
        for name, values, most in (
            ("velocity", samples[1], np.where(samples[1] < 0.0, *limits.largest_speeds(samples[0]))),
            ("acceleration", samples[2], limits.acceleration),
        ):  # fmt: skip
            share = float(np.max(np.abs(values) / most))
            if share > 1.0 + _ROUNDING:
                wrong.append(f"has {share:.3f} times the {name} allowed")
        if np.any(np.abs(points.velocities[-1]) > _ROUNDING) or np.any(np.abs(points.accelerations[-1]) > _ROUNDING):
            wrong.append("does not end at rest")
        return wrong

    def _step(self, command: Trajectory, places: np.ndarray | None) -> float:
        """From what is commanded to where the trajectory starts [rad]; then it is what is commanded.

        An arm that is given places may stand at one of them: what was commanded before, by another clock perhaps, need
        not be what it plays.
        """
        points = command.waypoints
        still = np.zeros_like(points.positions[0])
        players = [] if places is None else [TrajectoryPlayer(place, still) for place in places]
        if self._player is not None:
            players.insert(0, self._player)
        players = players or [TrajectoryPlayer(points.positions[0], still)]
        start = max(command.heard, command.begin + float(points.times[0]))
        steps = []
        for player in players:
            before = player.sample(start)[0]
            try:
                player.replace(points, command.begin, command.heard)
            except RobotError:  # said already: the trajectory ends in the past, and would be refused
                return 0.0
            steps.append(float(np.max(np.abs(player.sample(start)[0] - before))))
        nearest = int(np.argmin(steps))
        self._player = players[nearest]
        return steps[nearest]


class TargetJudge:
    """Judges a stream of tool poses."""

    def __init__(self, most_acceleration: float, period: float) -> None:
        """most_acceleration : that is not objected to [m/s^2]. period : of the stream [s]."""
        self._most, self._acceleration = most_acceleration, StreamAcceleration(period)
        self._before: Target | None = None
        self.largest_step = self.largest_acceleration = 0.0
        self.count = 0

    def hear(self, command: Target, places: Sequence[Pose] | None = None) -> list[str]:
        """What is wrong with the next pose; as of `TrajectoryJudge`, with poses of the tool."""
        self.count += 1
        wrong = []
        numbers = np.concatenate([command.position, command.quaternion])
        if not np.all(np.isfinite(numbers)):
            return ["is not finite"]
        if abs(float(np.linalg.norm(command.quaternion)) - 1.0) > _ROUNDING:
            wrong.append(f"has a quaternion of norm {np.linalg.norm(command.quaternion):.6f}")
        if command.heard - command.stamp > OLDEST_BEGIN:
            wrong.append(f"has a stamp {command.heard - command.stamp:.3f} s old")
        steps = [
            (float(np.linalg.norm(command.position - position)), float(angle_between(command.quaternion, quaternion)))
            for position, quaternion in self._starts(places)
        ]
        distance, angle = min(
            steps, key=lambda step: max(step[0] / LARGEST_STEP_POSITION, step[1] / LARGEST_STEP), default=(0.0, 0.0)
        )
        self.largest_step = max(self.largest_step, angle)
        if distance > LARGEST_STEP_POSITION or angle > LARGEST_STEP:
            wrong.append(f"is {1000 * distance:.1f} mm and {angle:.4f} rad from the one before")
        before, self._before = self._before, command
        if before is not None and places is None and float(before.quaternion @ command.quaternion) < 0.0:
            wrong.append("has the other sign of the quaternion than the one before")
        if places is not None:
            self._acceleration.begin_anew()
        acceleration = self._acceleration.hear(command.stamp, command.position)
        self.largest_acceleration = max(self.largest_acceleration, acceleration)
        if acceleration > self._most:
            wrong.append(f"ends an acceleration of {acceleration:.2f} m/s^2, allowed are {self._most:g}")
        return wrong

    def _starts(self, places: Sequence[Pose] | None) -> Sequence[Pose]:
        before = [] if self._before is None else [(self._before.position, self._before.quaternion)]
        return [*before, *(places or ())]
