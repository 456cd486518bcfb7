"""A stream of joint trajectories, played by the rules of joint_trajectory_controller.

The rules are those of the controller of ROS 2 Jazzy with `interpolate_from_desired_state: true` and a position command
interface (ros2_controllers, joint_trajectory_controller: documentation of "Trajectory Representation" and "Trajectory
Replacement", `Trajectory::sample` and `validate_trajectory_msg`):

- A new trajectory replaces the old one at once; of a new one that ends in the past nothing is taken. One that is
  refused leaves the old one.
- Played is the segment that contains the present, however much of the trajectory is over by then.
- A trajectory without a begin of its own begins when it is received. One that begins in the future replaces the old one
  at once all the same.
- Before the first waypoint the motion goes there from what was desired at the moment of replacement.
- Between waypoints it is linear where only positions are given, cubic with velocities, quintic with accelerations.
- After the last waypoint its position is kept, for as long as nothing new comes: `cmd_timeout: 0`. With more, `overdue`
  tells that nothing new has come for so long after the end, and `hold` then asks for where the joints are measured.
  The controller heeds no `cmd_timeout` up to its `goal_time`, which is 0 here.
- A trajectory has all joints in any order and no others, at least one waypoint, positions at each, strictly increasing
  times, no efforts, and ends with velocities of zero (`allow_nonzero_velocity_at_trajectory_end: false`). An empty one
  is refused: it stops nothing.

Stricter than the controller, for it would play what no arm should (here or in `nodes/messages.py`): numbers must be
finite and positions inside the joints' limits, no joint comes twice, velocities and accelerations come at all waypoints
or at none, accelerations with velocities only. And it tells where a takeover steps: the controller plays that, an arm
whose own controller judges what it is sent stops (`Discontinuity`). Not there: tolerances that make the controller hold
an arm that stays behind, goals of the action interface, partial trajectories, integration, scaled speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.utils.errors import RobotError

#: A last velocity [rad/s] up to this is rest: rounding of single precision, as the controller has it.
REST = float(np.finfo(np.float32).eps)


#: Steps of a takeover up to these, of position [rad] and velocity [rad/s], are none: a Franka Research 3 is commanded
#: every millisecond, and lets accelerations of 10 rad/s^2 pass.
CONTINUOUS = 1e-5, 1e-2


@dataclass(frozen=True)
class Discontinuity:
    """A step of what is desired, where a trajectory takes over.

    Attributes
    ----------
    joint : the one whose step is the largest, over `CONTINUOUS`. position, velocity : its steps [rad], [rad/s].
    late : how long after its begin [s] the trajectory came; negative: before.
    """

    joint: int
    position: float
    velocity: float
    late: float

    @classmethod
    def between(cls, before: np.ndarray, after: np.ndarray, late: float) -> Discontinuity | None:
        """From what was desired (3, eta) to what is; None where that is continuous."""
        steps = np.abs(after - before)[:2]
        excess = np.max(steps / np.array(CONTINUOUS)[:, None], axis=0)
        joint = int(np.argmax(excess))
        return None if excess[joint] <= 1.0 else cls(joint, float(steps[0, joint]), float(steps[1, joint]), late)


@dataclass(frozen=True)
class JointWaypoints:
    """A joint trajectory as it is sent: n waypoints of eta joints, the last one at rest.

    Attributes
    ----------
    times : (n,) [s] after the trajectory's begin, strictly increasing.
    positions : (n, eta) [rad].
    velocities, accelerations : (n, eta) [rad/s], [rad/s^2], or None; accelerations come with velocities only.

    Raises
    ------
    RobotError : there are no waypoints, shapes do not fit, values are not finite, times do not increase, accelerations
        come without velocities, or the last velocity is not zero.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray | None = None
    accelerations: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.times.ndim != 1 or not len(self.times):
            raise RobotError(f"times of a trajectory have shape {self.times.shape}: expected (n,), n at least 1")
        shape = (len(self.times), self.positions.shape[-1])
        for name in ("times", "positions", "velocities", "accelerations"):
            values = getattr(self, name)
            if values is None:
                continue
            if name != "times" and values.shape != shape:
                raise RobotError(f"{name} of a trajectory have shape {values.shape}: expected {shape}")
            if not np.all(np.isfinite(values)):
                raise RobotError(
                    f"{name} of a trajectory hold {values[~np.isfinite(values)][0]}: expected finite numbers"
                )
        backward = np.flatnonzero(np.diff(self.times) <= 0.0)
        if len(backward):
            i = int(backward[0])
            raise RobotError(
                f"times of a trajectory must increase strictly: waypoint {i} is at {self.times[i]:.4f} s, "
                f"the next one at {self.times[i + 1]:.4f} s"
            )
        if self.velocities is None and self.accelerations is not None:
            raise RobotError("a trajectory has accelerations but no velocities: give both, or positions alone")
        if self.velocities is not None and np.any(np.abs(self.velocities[-1]) > REST):
            raise RobotError(
                f"a trajectory ends with velocities {np.round(self.velocities[-1], 4).tolist()} rad/s: "
                "the last ones must be zero"
            )

    @property
    def segment_ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities and accelerations (n - 1, 2, eta) where segments begin and end.

        With them the quintic of a segment is its line, or its cubic, where no more than that is given.
        """
        span = np.diff(self.times)[:, None, None]
        slope = np.diff(self.positions, axis=0)[:, None] / span
        if self.velocities is None:
            lines = np.repeat(slope, 2, axis=1)
            return lines, np.zeros_like(lines)
        velocities = _pairs(self.velocities)
        if self.accelerations is not None:
            return velocities, _pairs(self.accelerations)
        mean = velocities.mean(axis=1, keepdims=True)
        # The second derivative of the cubic through both ends, at its ends.
        bend = np.array([[[1.0], [-1.0]]]) * (6.0 * (slope - mean)) / span
        return velocities, bend + np.diff(velocities, axis=1) / span

    def preceded_by(self, time: float, state: np.ndarray) -> JointWaypoints:
        """The same with a waypoint before the first: positions, velocities, accelerations (3, eta) at `time` [s]."""
        given = [values for values in (self.positions, self.velocities, self.accelerations) if values is not None]
        extended = [np.concatenate([first[None], rest]) for first, rest in zip(state, given, strict=False)]
        return JointWaypoints(np.append(time, self.times), *extended)


class TrajectoryPlayer:
    """Samples the trajectory that is played, as new ones arrive and take over; times are of one clock [s].

    Parameters
    ----------
    positions, velocities : (eta,) [rad], [rad/s] desired until the first trajectory.
    """

    def __init__(self, positions: np.ndarray, velocities: np.ndarray) -> None:
        self._hold(positions, velocities)

    def _hold(self, positions: np.ndarray, velocities: np.ndarray) -> None:
        self._begin = 0.0
        self._times = np.empty(0)
        self._positions = self._velocities = self._accelerations = np.empty((0, 2, len(positions)))
        self._last = np.stack([positions, velocities, np.zeros(len(positions))])

    def replace(self, waypoints: JointWaypoints, begin: float | None, now: float) -> Discontinuity | None:
        """Play a trajectory that begins at `begin` from now on, or one that begins now (None); returns where it steps.

        Raises
        ------
        RobotError : it ends in the past; the old one goes on.
        """
        begin = now if begin is None else begin
        late = now - begin - float(waypoints.times[-1])
        if late > 0.0:
            raise RobotError(f"the trajectory ends in the past, {late:.3f} s ago")
        before = self.sample(now)
        if now - begin < waypoints.times[0]:
            waypoints = waypoints.preceded_by(now - begin, before)
        self._begin, self._times = begin, waypoints.times
        # in the one order in memory that the interpolation is compiled for
        self._positions, self._velocities, self._accelerations = (
            np.ascontiguousarray(ends) for ends in (_pairs(waypoints.positions), *waypoints.segment_ends)
        )
        still = np.zeros_like(waypoints.positions[-1])
        self._last = np.stack([waypoints.positions[-1], still, still])
        return Discontinuity.between(before, self.sample(now), now - begin)

    def overdue(self, now: float, timeout: float) -> bool:
        """Whether nothing new has come for longer than a `timeout` [s] since the trajectory ended; of none, never."""
        return len(self._times) > 0 and now - (self._begin + float(self._times[-1])) > timeout

    def hold(self, positions: np.ndarray) -> None:
        """Give the trajectory up: (eta,) [rad] are desired, at rest, until the next one."""
        self._hold(positions, np.zeros(len(positions)))

    def sample(self, time: float) -> np.ndarray:
        """Positions [rad], velocities [rad/s], accelerations [rad/s^2] desired at `time` [s], (3, eta)."""
        local = time - self._begin
        i = max(0, int(np.searchsorted(self._times, local, side="right")) - 1)
        if i >= len(self._positions):
            return self._last.copy()
        segment = self._positions[i], self._velocities[i], self._accelerations[i]
        return quintic_samples(self._times[i : i + 2], *segment, np.array([local]))[:, 0]


def _pairs(rows: np.ndarray) -> np.ndarray:
    """Rows (n, eta) as ends of segments (n - 1, 2, eta)."""
    return np.stack([rows[:-1], rows[1:]], axis=1)
