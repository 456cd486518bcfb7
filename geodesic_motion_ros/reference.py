"""From a latent path to a reference: smooth it, decode it, meet the asked ends, give it a time law, follow it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numba
import numpy as np
from scipy.ndimage import gaussian_filter1d

from geodesic_motion_ros.graph.transport import carried
from geodesic_motion_ros.quaternions import angle_between, rotation_vector_between, slerp


def resample_latent(path: np.ndarray, spacing: float, minimum: int = 40) -> np.ndarray:
    """Points (n, d) evenly spaced by latent arc length on a polyline (m, d), at most `spacing` apart, ends kept."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    count = max(minimum, int(np.ceil(length[-1] / spacing)) + 1)
    at = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(at, length, column) for column in path.T], axis=1)


def smooth_latent(points: np.ndarray, width: float) -> np.ndarray:
    """Gaussian smoothing of an evenly spaced curve (n, d) with both ends fixed.

    `width` is the Gaussian's standard deviation in samples, at most a quarter of the curve. The curve is
    continued beyond each end by point reflection, which is odd about the end, so the filtered one passes through it.
    """
    if width <= 0.0:
        return points
    width = min(width, (len(points) - 1) / 4.0)
    pad = int(np.ceil(4.0 * width))
    before = 2.0 * points[0] - points[pad:0:-1]
    after = 2.0 * points[-1] - points[-2 : -pad - 2 : -1]
    smooth = gaussian_filter1d(np.concatenate([before, points, after]), width, axis=0, truncate=4.0)[pad:-pad]
    smooth[0], smooth[-1] = points[0], points[-1]
    return smooth


def correct_ends(
    positions: np.ndarray,
    quaternions: np.ndarray,
    start: tuple[np.ndarray, np.ndarray],
    goal: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Move a pose curve (n, 3), (n, 4) so that it begins and ends at the given poses (position, quaternion).

    Both offsets, of position and of rotation vector, fade linearly with arc length towards the other end.
    """
    at_start = np.concatenate([start[0] - positions[0], rotation_vector_between(quaternions[0], start[1])])
    at_goal = np.concatenate([goal[0] - positions[-1], rotation_vector_between(quaternions[-1], goal[1])])
    share = arc_share(positions)[:, None]
    return carried(positions, quaternions, (1.0 - share) * at_start + share * at_goal)


def arc_share(positions: np.ndarray) -> np.ndarray:
    """Arc length up to each sample over the whole, (n,) from 0 to 1; even where the curve does not move."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])
    if length[-1] < 1e-9:
        return np.linspace(0.0, 1.0, len(positions))
    return length / length[-1]


def nominal_durations(positions: np.ndarray, quaternions: np.ndarray, speed: float, angular_speed: float) -> np.ndarray:
    """Time [s] that each segment of a pose curve takes at full speed, (n - 1,): translation or rotation, the slower."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    turns = angle_between(quaternions[1:], quaternions[:-1])
    return np.maximum(np.maximum(steps / speed, turns / angular_speed), 1e-9)


def cut_curve(
    positions: np.ndarray, quaternions: np.ndarray, nominal: np.ndarray, duration: float
) -> tuple[np.ndarray, np.ndarray]:
    """The beginning of a pose curve that takes `duration` [s] at full speed; the whole curve where that is shorter."""
    passed = np.concatenate([[0.0], np.cumsum(nominal)])
    if duration >= passed[-1]:
        return positions, quaternions
    i = int(np.searchsorted(passed, duration, side="right")) - 1
    share = (duration - passed[i]) / nominal[i]
    last = positions[i] + share * (positions[i + 1] - positions[i])
    turned = slerp(quaternions[i], quaternions[i + 1], np.array([share]))
    return np.concatenate([positions[: i + 1], last[None]]), np.concatenate([quaternions[: i + 1], turned])


@numba.njit(cache=True, nogil=True)
def _squared_rates(nominal: np.ndarray, rate_acceleration: float, initial_rate: float) -> np.ndarray:
    """Largest squared rates (n,) that both passes of `time_law` allow."""
    squared = np.ones(len(nominal) + 1)
    squared[0], squared[-1] = min(1.0, initial_rate**2), 0.0
    for i in range(len(nominal)):
        squared[i + 1] = min(squared[i + 1], squared[i] + 2.0 * rate_acceleration * nominal[i])
    for i in range(len(nominal) - 1, -1, -1):
        squared[i] = min(squared[i], squared[i + 1] + 2.0 * rate_acceleration * nominal[i])
    return squared


def time_law(nominal: np.ndarray, rate_acceleration: float, initial_rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [s] and rates (n,) along a curve whose segments take `nominal` (n - 1,) [s] at full speed.

    The rate (1: full speed) starts at `initial_rate`, ends at 0, never exceeds 1 and changes by at most
    `rate_acceleration` [1/s]: forward and backward pass of rate^2 <= previous^2 + 2 rate_acceleration du. An initial
    rate too fast to stop in the length left is lowered: ending at rest comes first.
    """
    rates = np.sqrt(_squared_rates(nominal, rate_acceleration, initial_rate))
    mean = 0.5 * (rates[1:] + rates[:-1])
    steps = np.divide(nominal, mean, out=np.zeros_like(nominal), where=mean > 0.0)
    return np.concatenate([[0.0], np.cumsum(steps)]), rates


@dataclass(frozen=True)
class TaskSpaceReference:
    """A timed, certified curve of tool poses in the base frame, from the asked start to the goal, ending at rest.

    Attributes
    ----------
    times : (n,) [s] from 0, not decreasing. rates : (n,) speed over full speed.
    positions : (n, 3) [m]; quaternions : (n, 4) in one hemisphere along the curve.
    latent : (n, d) latent points the poses were decoded from.
    clearance : (n - 1,) guaranteed clearance [m] of each stretch between samples, inf without obstacles.
    """

    times: np.ndarray
    rates: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray
    latent: np.ndarray
    clearance: np.ndarray

    @property
    def duration(self) -> float:
        """Time [s] until rest."""
        return float(self.times[-1])

    def moved(
        self, move: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    ) -> TaskSpaceReference:
        """The same reference with its poses (n, 3), (n, 4) moved by a rigid motion: times and clearances stay."""
        positions, quaternions = move(self.positions, self.quaternions)
        return replace(self, positions=positions, quaternions=quaternions)

    def sample(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] and quaternion (4,) at `time` [s], held at both ends."""
        i, share = self._locate(time)
        position = self.positions[i] + share * (self.positions[i + 1] - self.positions[i])
        return position, slerp(self.quaternions[i], self.quaternions[i + 1], np.array([share]))[0]

    def rate(self, time: float) -> float:
        """Speed over full speed at `time` [s]."""
        i, _ = self._locate(time)
        span = self.times[i + 1] - self.times[i]
        share = 0.0 if span <= 0.0 else min(1.0, max(0.0, (time - self.times[i]) / span))
        return float(self.rates[i] + share * (self.rates[i + 1] - self.rates[i]))

    def _locate(self, time: float) -> tuple[int, float]:
        """Segment that holds `time`, and the share of it passed under constant rate change."""
        i = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2))
        span = self.times[i + 1] - self.times[i]
        if span <= 0.0:
            return i, 1.0
        x = min(1.0, max(0.0, (time - self.times[i]) / span))
        first, last = self.rates[i], self.rates[i + 1]
        return i, float(x * (2.0 * first + (last - first) * x) / (first + last))


def timed_reference(
    positions: np.ndarray,
    quaternions: np.ndarray,
    latent: np.ndarray,
    clearance: np.ndarray,
    speed: float,
    angular_speed: float,
    acceleration: float,
    initial_speed: float,
) -> TaskSpaceReference:
    """Give a pose curve its time law: at most `speed` [m/s] and `angular_speed` [rad/s], `acceleration` [m/s^2]."""
    nominal = nominal_durations(positions, quaternions, speed, angular_speed)
    times, rates = time_law(nominal, acceleration / speed, initial_speed / speed)
    return TaskSpaceReference(times, rates, positions, quaternions, latent, clearance)


class ReferenceFollower:
    """The pacing of a stream: where the commanded pose is now, and how fast it moves.

    One follower belongs to one arm. `accept` switches to a new reference, which must begin at the commanded pose;
    `hold` stops; `advance` moves the commanded pose on by one control period.
    """

    def __init__(self, full_speed: float) -> None:
        """full_speed [m/s]: the planner's `speed`, to which rates of a reference are relative."""
        self._full_speed = full_speed
        self._reference: TaskSpaceReference | None = None
        self._time = 0.0
        self.position = np.full(3, np.nan)
        self.quaternion = np.full(4, np.nan)
        self.speed = 0.0

    @property
    def ready(self) -> bool:
        """Whether a pose to command is known."""
        return bool(np.all(np.isfinite(self.position)))

    @property
    def at_end(self) -> bool:
        """Whether the accepted reference has been followed to its end."""
        return self._reference is not None and self._time >= self._reference.duration

    def reset(self, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Stand at a pose, (3,) [m] and (4,), at rest and without a reference."""
        self._reference, self._time, self.speed = None, 0.0, 0.0
        self.position, self.quaternion = np.array(position, dtype=float), np.array(quaternion, dtype=float)

    def accept(self, reference: TaskSpaceReference) -> None:
        """Follow a reference from its beginning."""
        self._reference, self._time = reference, 0.0

    def hold(self) -> None:
        """Stay at the commanded pose."""
        self._reference, self.speed = None, 0.0

    def advance(self, period: float) -> tuple[np.ndarray, np.ndarray]:
        """Move on by `period` [s]; returns the commanded position (3,) and quaternion (4,), sign-continuous."""
        if self._reference is not None:
            self._time += period
            self.position, quaternion = self._reference.sample(self._time)
            self.quaternion = quaternion if quaternion @ self.quaternion >= 0.0 else -quaternion
            self.speed = self._full_speed * self._reference.rate(self._time)
        return self.position, self.quaternion
