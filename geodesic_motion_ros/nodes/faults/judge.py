"""Judges of commands: what every command must be, whatever happens. Know nothing of ROS.

The first promise: every reference is finite, inside limits with a margin, starts within 0.02 rad of what was last
commanded, ends at rest; and its stamp is not old.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.errors import RobotError
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.quintic import quintic_samples
from geodesic_motion_ros.simulation.trajectory_player import JointWaypoints, TrajectoryPlayer

#: A reference starts no further than this from what was last commanded: a joint [rad], the tool's orientation [rad],
#: and its position [m], which an arm half a metre long moves by at such an angle.
LARGEST_STEP, LARGEST_STEP_POSITION = 0.02, 0.01
#: A reference that begins further than this in the past has an old stamp [s]. The first knot is that before the
#: present, and the judge hears of it a moment later.
OLDEST_BEGIN = 0.25
#: Of limits of velocity and acceleration, for rounding; of positions [rad].
_ROUNDING = 1e-6
#: An arm that commands begin at anew may be this far outside the margin of its limits [rad]: it stands there.
_SAMPLES_PER_SEGMENT = 5


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

    def forget(self) -> None:
        """The next trajectory is a first one."""
        self._player = None

    def hear(self, command: Trajectory, measured: np.ndarray | None = None) -> list[str]:
        """What is wrong with the next trajectory, as sentences; none where nothing is.

        measured : (eta,) [rad] where the arm is. Before the first trajectory it is what commands begin at; afterwards
            it is to be given only where the planner has said that it found the arm elsewhere.
        """
        self.count += 1
        wrong = self._wrong_in_itself(command)
        points = command.waypoints
        late = command.heard - command.begin - points.times[-1]
        if late > 0.0:
            wrong.append(f"ends {late:.3f} s in the past")
        if command.heard - command.begin > OLDEST_BEGIN:
            wrong.append(f"has a stamp {command.heard - command.begin:.3f} s old")
        step = self._step(command, measured)
        self.largest_step = max(self.largest_step, step)
        if not step <= LARGEST_STEP:
            wrong.append(f"starts {step:.4f} rad from what was commanded")
        return wrong

    def last_desired(self, time: float) -> np.ndarray | None:
        """Position, velocity, acceleration (3, eta) that the commands heard so far ask for at a time [s]."""
        return None if self._player is None else self._player.sample(time)

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
            ("velocity", samples[1], limits.velocity), ("acceleration", samples[2], limits.acceleration),
        ):  # fmt: skip
            share = float(np.max(np.abs(values) / most))
            if share > 1.0 + _ROUNDING:
                wrong.append(f"has {share:.3f} times the {name} allowed")
        if np.any(np.abs(points.velocities[-1]) > _ROUNDING) or np.any(np.abs(points.accelerations[-1]) > _ROUNDING):
            wrong.append("does not end at rest")
        return wrong

    def _step(self, command: Trajectory, measured: np.ndarray | None) -> float:
        """From what is commanded to where the trajectory starts [rad]; then it is what is commanded."""
        first = command.waypoints.positions[0]
        if self._player is None:
            self._player = TrajectoryPlayer(first if measured is None else measured, np.zeros_like(first))
        start = max(command.heard, command.begin + float(command.waypoints.times[0]))
        before = self._player.sample(start)[0]
        try:
            self._player.replace(command.waypoints, command.begin, command.heard)
        except RobotError:  # said already: the trajectory ends in the past, and would be refused
            return 0.0
        after = self._player.sample(start)[0]
        steps = [float(np.max(np.abs(after - before)))]
        if measured is not None:
            steps.append(float(np.max(np.abs(after - measured))))
        return min(steps)


class TargetJudge:
    """Judges a stream of tool poses."""

    def __init__(self) -> None:
        self._before: Target | None = None
        self.largest_step = 0.0
        self.count = 0

    def forget(self) -> None:
        """The next pose is a first one."""
        self._before = None

    def hear(self, command: Target, measured: tuple[np.ndarray, np.ndarray] | None = None) -> list[str]:
        """What is wrong with the next pose; as of `TrajectoryJudge`, with the tool's measured pose."""
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
            for position, quaternion in self._starts(measured)
        ]
        distance, angle = min(steps, default=(0.0, 0.0))
        self.largest_step = max(self.largest_step, angle)
        if distance > LARGEST_STEP_POSITION or angle > LARGEST_STEP:
            wrong.append(f"is {1000 * distance:.1f} mm and {angle:.4f} rad from the one before")
        before, self._before = self._before, command
        if before is not None and measured is None and float(before.quaternion @ command.quaternion) < 0.0:
            wrong.append("has the other sign of the quaternion than the one before")
        return wrong

    def _starts(self, measured: tuple[np.ndarray, np.ndarray] | None) -> Sequence[tuple[np.ndarray, np.ndarray]]:
        before = [] if self._before is None else [(self._before.position, self._before.quaternion)]
        return before if measured is None else [*before, measured]
