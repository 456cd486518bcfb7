"""JointReference: a timed joint motion that ends at rest, what is left of it, and how one goes over into another.

A reference is knots of positions, velocities and accelerations; between them joint_trajectory_controller plays the
quintic through both (`quintic.py`). Limits of velocity, acceleration and jerk are judged between the knots too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.geometry.quintic import control_points, quintic_bounds, quintic_samples
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.robot.position_based_velocity import STILL, approach_speed

#: Time between knots [s].
PERIOD = 0.02
#: The rest of a reference does not begin nearer than this [s] to a knot: over less, quintics are rounding errors.
_SHORTEST_INTERVAL = 1e-6
#: Times [s] that differ by less are the same, whatever is differentiated three times over a millisecond.
SAME_TIME = 1e-13
#: Rounding of what is exactly at a limit.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class JointReference:
    """A timed motion of eta joints that ends at rest.

    Attributes
    ----------
    times : (n,) of the knots [s], increasing from 0.
    positions, velocities, accelerations : (n, eta) [rad], [rad/s], [rad/s^2]; the last two end at 0.
    latent : (n, d) latent points the positions were decoded from.

    How far the arm stays from obstacles on it is not known: `certification.certificate.JudgedTrajectory`.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    latent: np.ndarray

    @classmethod
    def standing(cls, position: np.ndarray, latent: np.ndarray) -> JointReference:
        """Stay at a position (eta,) [rad], whose latent point is (d,)."""
        still = np.zeros((2, len(position)))
        return cls(np.array([0.0, PERIOD]), np.stack([position] * 2), still, still, np.stack([latent] * 2))

    @property
    def duration(self) -> float:
        """Time [s] until rest."""
        return float(self.times[-1])

    @property
    def is_finite(self) -> bool:
        """Whether all its numbers are finite: kernels compare, and a comparison with NaN is false."""
        knots = self.times, self.positions, self.velocities, self.accelerations
        return all(np.isfinite(values).all() for values in knots)

    def sample(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position [rad], velocity [rad/s] and acceleration [rad/s^2] at `time` [s], (eta,) each; constant after it."""
        position, velocity, acceleration = self.samples(np.array([float(time)]))[:, 0]
        return position, velocity, acceleration

    def samples(self, times: np.ndarray) -> np.ndarray:
        """The same at many times (k,) at once: (3, k, eta)."""
        return quintic_samples(self.times, self.positions, self.velocities, self.accelerations, times)

    def jerks(self, begin: float, end: float) -> np.ndarray:
        """Largest jerk [rad/s^3] of a joint in each millisecond from `begin` to `end` [s], (k,); 0 where that is none.
        """
        times = np.arange(begin, end, 1e-3)
        if len(times) < 2:
            return np.zeros(1)
        return np.abs(np.diff(self.samples(times)[2], axis=0)).max(axis=1) / 1e-3

    def latent_at(self, time: float) -> np.ndarray:
        """Latent point (d,) at `time` [s], constant beyond both ends."""
        return interpolated(np.array([time]), self.times, self.latent)[0]

    def rest(self, time: float) -> JointReference:
        """What is left of the motion from `time` [s] on: the same quintics, with a knot where it begins.

        Within a microsecond of a knot it begins at that knot.
        """
        i = min(max(int(np.searchsorted(self.times, time, side="right")) - 1, 0), len(self.times) - 2)
        if self.times[i + 1] - time <= _SHORTEST_INTERVAL:
            i, time = i + 1, self.times[i + 1]
        if i == len(self.times) - 1:
            return JointReference.standing(self.positions[-1], self.latent[-1])
        share = (time - self.times[i]) / (self.times[i + 1] - self.times[i])
        latent = self.latent[i] + share * (self.latent[i + 1] - self.latent[i])
        position, velocity, acceleration = self.sample(time)
        ahead = slice(i + 1, None)
        return JointReference(
            np.append(0.0, self.times[ahead] - time),
            np.concatenate([position[None], self.positions[ahead]]),
            np.concatenate([velocity[None], self.velocities[ahead]]),
            np.concatenate([acceleration[None], self.accelerations[ahead]]),
            np.concatenate([latent[None], self.latent[ahead]]),
        )

    def limit_ratio(self, limits: JointLimits) -> np.ndarray:
        """Velocity, acceleration and jerk over their limits between knots, (3, n - 1), of the joint nearest to its own.

        Never less than what is played, and 1 where a limit is just kept.
        """
        return self.measured(limits)[1]

    def keeps(self, limits: JointLimits) -> bool:
        """Whether all limits are kept, between knots too.

        An arm that stands outside its position limits may come back: where it begins counts as inside.
        """
        inside, limit_ratio = self.measured(limits)
        return inside and bool(np.all(limit_ratio <= 1.0 + _ROUNDING))

    def measured(self, limits: JointLimits) -> tuple[bool, np.ndarray]:
        """Whether position limits are kept, as of `keeps`, and `limit_ratio` (3, n - 1); a motion that is not finite
        keeps none.
        """
        ends, largest = quintic_bounds(self.times, self.positions, self.velocities, self.accelerations)
        inside = self.is_finite and _inside(ends, self.positions[0], limits.lower, limits.upper)
        limit_ratio = _limit_ratio(largest, limits.velocity, limits.acceleration, limits.jerk)
        approach = limits.position_based_velocity
        if approach is not None:
            towards_stops = _approach_ratio(
                self.times, self.positions, self.velocities, self.accelerations, ends, limits.velocity,
                approach.deceleration, approach.offset, approach.lower, approach.upper,
            )  # fmt: skip
            np.maximum(limit_ratio[0], towards_stops, out=limit_ratio[0])
        return inside, limit_ratio


def joined(old: JointReference, since: float, new: JointReference, until: float) -> JointReference:
    """An old reference from its knot at `since` [s] until `until` [s], and from there on a new one.

    The new one begins in the old one's state of motion there, at a knot or between two: what remains of a quintic is
    the quintic between its ends. `since` may be a little after its knot, as a clock of absolute times rounds: then the
    first knot is the state of motion at `since` itself. Were the knot moved there as it is, by a tenth of a microsecond
    alone, a quintic of a millisecond behind it would break the limit of the jerk. Both times may lie beyond the old
    one's end, where the arm stands.
    """
    if until <= since + _ROUNDING:
        return new
    kept = kept_knots(old, since, until)
    rows = {name: getattr(old, name)[kept] for name in ("positions", "velocities", "accelerations", "latent")}
    if abs(since - old.times[kept[0]]) > SAME_TIME:
        for values, begin in zip(rows.values(), (*old.sample(since), old.latent_at(since)), strict=True):
            values[0] = begin
    return JointReference(
        np.concatenate([[0.0], old.times[kept[1:]] - since, until - since + new.times]),
        *(np.concatenate([values, getattr(new, name)]) for name, values in rows.items()),
    )


def kept_knots(old: JointReference, since: float, until: float) -> np.ndarray:
    """Which knots of an old reference `joined` keeps."""
    if until <= since + _ROUNDING:
        return np.empty(0, dtype=np.int64)
    return np.flatnonzero((old.times >= min(since, old.duration) - _ROUNDING) & (old.times < until - _ROUNDING))


def knot_times(duration: float, period: float) -> np.ndarray:
    """Whole periods [s] that hold a duration, at least one."""
    return period * np.arange(max(1, int(np.ceil(duration / period - _ROUNDING))) + 1)


def ending_at_rest(
    times: np.ndarray, positions: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray, latent: np.ndarray
) -> JointReference:
    """The reference of knots (n,) with what is 0 at the end up to rounding exactly so."""
    velocities[-1], accelerations[-1] = 0.0, 0.0
    return JointReference(times, positions, velocities, accelerations, latent)


@numba.njit(cache=True, nogil=True)
def interpolated(at: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (n, d) at knots (n,), not decreasing, linearly at `at` (k,): (k, d); constant beyond both ends."""
    result = np.empty((len(at), values.shape[1]))
    for k in range(len(at)):
        i = int(np.searchsorted(knots, at[k], side="right")) - 1
        if i < 0 or i >= len(knots) - 1:
            result[k] = values[0 if i < 0 else len(knots) - 1]
            continue
        share = (at[k] - knots[i]) / (knots[i + 1] - knots[i])
        for a in range(values.shape[1]):
            result[k, a] = (1.0 - share) * values[i, a] + share * values[i + 1, a]
    return result


@numba.njit(cache=True, nogil=True)
def _inside(ends: np.ndarray, begin: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> bool:
    """Whether lowest and highest positions (2, eta) keep their limits (eta,); those it begins at count as inside."""
    for j in range(len(begin)):
        lowest, highest = min(lower[j], begin[j]) - _ROUNDING, max(upper[j], begin[j]) + _ROUNDING
        if not (lowest <= ends[0, j] and ends[1, j] <= highest):
            return False
    return True


@numba.njit(cache=True, nogil=True)
def _limit_ratio(largest: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, jerk: np.ndarray) -> np.ndarray:
    """Of magnitudes (3, n, eta) of velocity, acceleration and jerk: (3, n) over the limits, by the worst joint."""
    result = np.zeros(largest.shape[:2])
    for k, limits in enumerate((velocity, acceleration, jerk)):
        for i in range(largest.shape[1]):
            for j in range(largest.shape[2]):
                result[k, i] = max(result[k, i], largest[k, i, j] / limits[j])
    return result


@numba.njit(cache=True, nogil=True)
def _approach_ratio(
    times: np.ndarray,
    positions: np.ndarray,
    velocities: np.ndarray,
    accelerations: np.ndarray,
    ends: np.ndarray,
    velocity: np.ndarray,
    deceleration: np.ndarray,
    offset: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> np.ndarray:
    """Of a motion's speeds (n - 1,) over their limits towards stops, where these are below `velocity` (eta,).

    On an interval the limit is a concave function of the position, and so no less than its chord over the range of the
    control points. Velocity and chord are polynomials of time then: as many times the chord as the largest ratio of
    their control points is never exceeded by the velocity.

    ends : (2, eta) lowest and highest position [rad] of the whole motion.
    """
    result = np.zeros(len(times) - 1)
    points, speeds = np.empty(6), np.empty(6)
    for j in range(positions.shape[1]):
        for side in (-1.0, 1.0):
            stop = upper[j] if side > 0.0 else -lower[j]
            nearest_to_it = ends[1, j] if side > 0.0 else -ends[0, j]
            if approach_speed(stop - nearest_to_it, deceleration[j], offset[j]) >= velocity[j]:
                continue
            for i in range(len(times) - 1):
                h = times[i + 1] - times[i]
                control_points(points, h, positions, velocities, accelerations, i, j)
                # A derivative has one point less, and as many once its degree is raised.
                for k in range(6):
                    before = points[k] - points[k - 1] if k > 0 else 0.0
                    after = points[k + 1] - points[k] if k < 5 else 0.0
                    speeds[k] = side * (k * before + (5 - k) * after) / h
                if np.max(speeds) <= 0.0:
                    continue
                begin = side * positions[i, j]
                points *= side
                low, high = np.min(points), np.max(points)
                slowest = approach_speed(stop - begin - high, deceleration[j], offset[j])
                if slowest >= velocity[j]:
                    continue
                change = 0.0
                if high > low:
                    fastest = approach_speed(stop - begin - low, deceleration[j], offset[j])
                    change = (fastest - slowest) / (high - low)
                for k in range(6):
                    # Where the motion enters the range in which no speed is allowed, none is in all of the interval.
                    limit = slowest + change * (high - points[k]) if slowest > STILL else STILL
                    result[i] = max(result[i], speeds[k] / limit)
    return result
