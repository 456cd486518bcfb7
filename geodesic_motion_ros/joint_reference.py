"""Joint references: a timed joint motion that keeps its limits as it is played, replanned in motion, and stopped.

A reference is knots of positions, velocities and accelerations; between them joint_trajectory_controller plays the
quintic through both (`quintic.py`). Every reference here is continuous in all three with the state it begins at, ends
at rest, and keeps the limits of velocity, acceleration and jerk between its knots too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numba
import numpy as np

from geodesic_motion_ros.cubic_spline import spline_bends, spline_samples
from geodesic_motion_ros.errors import PlanningError
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_time_law import SmoothLaw, braking_rates, fastest_rates
from geodesic_motion_ros.quintic import quintic_bounds, quintic_samples

#: Time between knots [s].
PERIOD = 0.02
#: Half of the triangle of time over which laws are averaged [s]; more where jerk is limited harder than a Panda's.
_SMOOTHING = 0.034
#: The same for stops, tried one after the other: the sooner they begin the better, but one that begins while the arm
#: accelerates as much as it may has to begin gently.
_STOP_SMOOTHINGS = (0.02, 0.06, 0.12)
#: Share of the limits of velocity and of acceleration that laws are planned with; averaging and corrections add to it.
_VELOCITY_SHARE, _ACCELERATION_SHARE = 0.95, 0.85
#: Share of the accelerations that a correction at the start is planned with, and what its length [s] may be.
_CORRECTION_SHARE, _SHORTEST_CORRECTION, _LONGEST_CORRECTION = 0.5, 0.06, 1.0
#: How often a law is slowed down where it exceeds limits before it is given up; sooner where after so many times its
#: strain is still above the last number: each time about half of the excess is left, at best.
_ATTEMPTS, _HOPELESS = 8, (3, 1.2)
#: Share of the limits to which a law is slowed down where it exceeds them, and the least factor of a rate at once.
_SLOWED_TO, _LEAST_FACTOR = 0.92, 0.5
#: Shares of the accelerations that stops are tried with, one after the other.
_BRAKING_SHARES = (0.97, 0.8, 0.5)
#: Points of a path nearer than this [s at full speed] are one.
_SHORTEST_CHORD = 1e-5
#: Segments of the grid on which a law is planned, at least.
_SEGMENTS = 150
#: Shortest time [s] in which a bridge's acceleration changes, where jerk would allow less.
_SHORTEST_RAMP = 0.005
#: The rest of a reference does not begin nearer than this [s] to a knot: over less, quintics are rounding errors.
_SHORTEST_INTERVAL = 1e-6
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
    clearance : (n - 1,) guaranteed clearance [m] between knots; inf as long as no certificate was asked for.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    latent: np.ndarray
    clearance: np.ndarray

    @classmethod
    def standing(cls, position: np.ndarray, latent: np.ndarray) -> JointReference:
        """Stay at a position (eta,) [rad], whose latent point is (d,)."""
        return _standing(position, latent, float(np.inf))

    @property
    def duration(self) -> float:
        """Time [s] until rest."""
        return float(self.times[-1])

    def sample(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position [rad], velocity [rad/s] and acceleration [rad/s^2] at `time` [s], (eta,) each; held at both ends."""
        position, velocity, acceleration = self.samples(np.array([float(time)]))[:, 0]
        return position, velocity, acceleration

    def samples(self, times: np.ndarray) -> np.ndarray:
        """The same at many times (k,) at once: (3, k, eta)."""
        return quintic_samples(self.times, self.positions, self.velocities, self.accelerations, times)

    def latent_at(self, time: float) -> np.ndarray:
        """Latent point (d,) at `time` [s], held at both ends."""
        return _interpolated(np.array([time]), self.times, self.latent)[0]

    def rest(self, time: float) -> JointReference:
        """What is left of the motion from `time` [s] on: the same quintics, with a knot where it begins.

        Within a microsecond of a knot it begins at that knot.
        """
        i = min(max(int(np.searchsorted(self.times, time, side="right")) - 1, 0), len(self.times) - 2)
        if self.times[i + 1] - time <= _SHORTEST_INTERVAL:
            i, time = i + 1, self.times[i + 1]
        if i == len(self.times) - 1:
            return _standing(self.positions[-1], self.latent[-1], float(self.clearance[-1]))
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
            self.clearance[i:],
        )

    def strain(self, limits: JointLimits) -> np.ndarray:
        """Velocity, acceleration and jerk over their limits between knots, (3, n - 1), of the joint nearest to its own.

        Never less than what is played, and 1 where a limit is just kept.
        """
        return self._judged(limits)[1]

    def keeps(self, limits: JointLimits) -> bool:
        """Whether all limits are kept, between knots too.

        An arm that stands outside its position limits may come back: where it begins counts as inside.
        """
        inside, strain = self._judged(limits)
        return inside and bool(np.all(strain <= 1.0 + _ROUNDING))

    def _judged(self, limits: JointLimits) -> tuple[bool, np.ndarray]:
        """Whether position limits are kept, and the strain (3, n - 1)."""
        ends, largest = quintic_bounds(self.times, self.positions, self.velocities, self.accelerations)
        inside = _inside(ends, self.positions[0], limits.lower, limits.upper)
        return inside, _strain(largest, limits.velocity, limits.acceleration, limits.jerk)


def timed_joint_reference(
    path: np.ndarray,
    latent: np.ndarray,
    limits: JointLimits,
    start_velocity: np.ndarray | None = None,
    start_acceleration: np.ndarray | None = None,
    period: float = PERIOD,
) -> JointReference | None:
    """A fast reference along a path, from the present state of motion until rest at the path's end.

    The path is drawn by a cubic spline and passed under the fastest law within the limits, averaged over time
    (`joint_time_law.py`). What the start differs from the state of motion in position, velocity and acceleration fades
    as a quintic in time, which leaves the path meanwhile. Where the motion exceeds limits the law is slowed down
    there, and again.

    Parameters
    ----------
    path : (m, eta) joint positions [rad]; the first one is what is commanded now. latent : (m, d) their latent points.
    start_velocity, start_acceleration : (eta,) [rad/s], [rad/s^2] commanded now; at rest by default.
    period : time between knots [s].

    Returns
    -------
    The reference, or None where the state of motion cannot be led onto the path within the limits: then stop first.

    Raises
    ------
    PlanningError : shapes do not fit, or values that are not finite.
    """
    joints = len(limits.velocity)
    path, latent = np.asarray(path, dtype=float), np.asarray(latent, dtype=float)
    velocity = np.zeros(joints) if start_velocity is None else np.asarray(start_velocity, dtype=float)
    acceleration = np.zeros(joints) if start_acceleration is None else np.asarray(start_acceleration, dtype=float)
    _check(path, latent, velocity, acceleration, joints)
    curve = _PathCurve.through(path, latent, limits)
    state = np.stack([path[0], velocity, acceleration])
    slow = np.ones(len(curve.grid))
    for attempts in range(1, _ATTEMPTS + 1):
        law, begin = _planned_law(curve, limits, slow, velocity, acceleration)
        attempt = _played(curve, law, begin, limits, state, period)
        inside, strain = attempt._judged(limits)
        worst = np.max(strain)
        if inside and worst <= 1.0 + _ROUNDING:
            return attempt
        if worst <= 1.0:
            # Only positions are outside, and slower ones would be too.
            return None
        if attempts == _HOPELESS[0] and worst > _HOPELESS[1]:
            return None
        slow *= _slower(curve.grid, law, begin + attempt.times, strain)
    return None


def load_references(limits: JointLimits) -> None:
    """Load the compiled kernels of `timed_joint_reference`, also those for motions that have to be slowed down: for
    one that begins by going the other way.
    """
    path = 0.5 * (limits.lower + limits.upper) + 0.1 * limits.velocity * np.linspace(0.0, 1.0, 6)[:, None]
    timed_joint_reference(path, np.zeros((6, 1)), limits, -0.3 * limits.velocity, np.zeros_like(limits.velocity))


def stopping_reference(
    reference: JointReference, time: float, limits: JointLimits, period: float = PERIOD
) -> JointReference:
    """The soonest stop from `time` [s] of a reference on, along its own path.

    The path is the reference itself, passed at a rate that falls from 1 to 0 as fast as the limits allow and is then
    averaged over time, so that position, velocity and acceleration are continuous at `time`. Where the average exceeds
    a limit, a longer average and less braking are tried, then `bridge_to_rest`, which leaves the path. Going on is what
    is left at last: the reference ends at rest by itself.
    """
    going = reference.rest(time)
    for smoothing in _STOP_SMOOTHINGS:
        width = _averaging_width(smoothing, limits)
        if going.duration <= width:
            return going
        # The average begins to fall one width before the law does.
        grid = np.append(np.arange(width, going.duration, 0.5 * period), going.duration)
        _, slopes, bends = going.samples(grid)
        for share in _BRAKING_SHARES:
            rates, stop = braking_rates(grid, slopes, bends, np.broadcast_to(share * limits.acceleration, slopes.shape))
            passed = grid < stop
            knots, rates = np.append(grid[passed], stop), np.append(rates[passed], rates[-1])
            law = SmoothLaw.along(knots, rates, width)
            times = _knot_times(law.end + width, period)
            at, rate, change = law.sample(times - width)
            positions, velocities, accelerations = going.samples(at)
            halt = _ending_at_rest(
                times,
                positions,
                velocities * rate[:, None],
                accelerations * rate[:, None] ** 2 + velocities * change[:, None],
                _interpolated(at, going.times, going.latent),
            )
            if halt.keeps(limits):
                return halt
    bridge = bridge_to_rest(*going.sample(0.0), limits, period)
    bridge = replace(bridge, latent=np.repeat(going.latent[:1], len(bridge.times), axis=0))
    return bridge if bridge.keeps(limits) and bridge.duration < going.duration else going


def joined(old: JointReference, since: float, new: JointReference, until: float) -> JointReference:
    """An old reference from its knot at `since` [s] until `until` [s], and from there on a new one.

    The new one begins in the old one's state of motion there, at a knot or between two: what remains of a quintic is
    the quintic between its ends. Both times may lie beyond the old one's end, where the arm stands.
    """
    if until <= since + _ROUNDING:
        return new
    kept = np.flatnonzero((old.times >= min(since, old.duration) - _ROUNDING) & (old.times < until - _ROUNDING))
    # Where it stands at its end, the old one keeps the clearance that it has there.
    clearance = np.append(old.clearance, old.clearance[-1])[kept]
    passed = old.times[kept] - since
    return JointReference(
        np.concatenate([np.where(passed > _ROUNDING, passed, 0.0), until - since + new.times]),
        *(
            np.concatenate([getattr(old, name)[kept], getattr(new, name)])
            for name in ("positions", "velocities", "accelerations", "latent")
        ),
        np.concatenate([clearance, new.clearance]),
    )


def bridge_to_rest(
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    limits: JointLimits,
    period: float = PERIOD,
) -> JointReference:
    """A stop from a state of motion (eta,) [rad], [rad/s], [rad/s^2] alone, along no path: for when there is none.

    Accelerations go linearly to those of braking, stay there, and go linearly to 0: in the same times for all joints,
    each braking as hard as it must to be at rest with the others. Position limits are not looked at. The latent points
    have no coordinates, (n, 0).
    """
    ramp = max(float(np.max((np.abs(acceleration) + limits.acceleration) / limits.jerk)), _SHORTEST_RAMP)
    swing = velocity + 0.5 * ramp * acceleration
    steady = max(0.0, float(np.max(np.abs(swing) / limits.acceleration)) - ramp)
    braking = -swing / (ramp + steady)
    after_ramp = velocity + 0.5 * ramp * (acceleration + braking)
    before_end = after_ramp + steady * braking
    moves = (
        ramp * velocity + ramp**2 * (2.0 * acceleration + braking) / 6.0,
        steady * after_ramp + 0.5 * steady**2 * braking,
        ramp * before_end + ramp**2 * braking / 3.0,
    )
    spans = np.array([ramp, steady, ramp])
    # Without a steady part, two of the four knots are one.
    kept = np.append(True, spans > 0.0)
    ends = np.append(0.0, np.cumsum(spans))[kept]
    still = np.zeros_like(velocity)
    cubics = (
        position + np.cumsum([still, *moves], axis=0)[kept],
        np.stack([velocity, after_ramp, before_end, still])[kept],
        np.stack([acceleration, braking, braking, still])[kept],
    )
    pieces = [np.linspace(a, b, int(np.ceil((b - a) / period)), endpoint=False) for a, b in pairwise(ends)]
    times = np.append(np.concatenate(pieces), ends[-1])
    return _ending_at_rest(times, *quintic_samples(ends, *cubics, times), np.empty((len(times), 0)))


def _knot_times(duration: float, period: float) -> np.ndarray:
    """Whole periods [s] that hold a duration, at least one."""
    return period * np.arange(max(1, int(np.ceil(duration / period - _ROUNDING))) + 1)


def _ending_at_rest(
    times: np.ndarray, positions: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray, latent: np.ndarray
) -> JointReference:
    """The reference with what is 0 at the end up to rounding exactly so."""
    velocities[-1], accelerations[-1] = 0.0, 0.0
    return JointReference(times, positions, velocities, accelerations, latent, np.full(len(times) - 1, np.inf))


def _standing(position: np.ndarray, latent: np.ndarray, clearance: float) -> JointReference:
    still = np.zeros((2, len(position)))
    return JointReference(
        np.array([0.0, PERIOD]), np.stack([position] * 2), still, still, np.stack([latent] * 2), np.array([clearance])
    )


@numba.njit(cache=True, nogil=True)
def _interpolated(at: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (n, d) at knots (n,), linearly at `at` (k,): (k, d)."""
    result = np.empty((len(at), values.shape[1]))
    for k in range(len(at)):
        i = min(max(int(np.searchsorted(knots, at[k], side="right")) - 1, 0), len(knots) - 2)
        share = min(max((at[k] - knots[i]) / (knots[i + 1] - knots[i]), 0.0), 1.0)
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
def _strain(largest: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, jerk: np.ndarray) -> np.ndarray:
    """Of magnitudes (3, n, eta) of velocity, acceleration and jerk: (3, n) over the limits, by the worst joint."""
    result = np.zeros(largest.shape[:2])
    for k, limits in enumerate((velocity, acceleration, jerk)):
        for i in range(largest.shape[1]):
            for j in range(largest.shape[2]):
                result[k, i] = max(result[k, i], largest[k, i, j] / limits[j])
    return result


def _averaging_width(least: float, limits: JointLimits) -> float:
    """Half of the triangle [s] over which a jump from one acceleration limit to the other keeps half of the jerk's."""
    return max(least, 4.0 * float(np.max(limits.acceleration / limits.jerk)))


def _check(path: np.ndarray, latent: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, joints: int) -> None:
    if path.ndim != 2 or path.shape[1] != joints or len(path) < 2 or len(latent) != len(path):
        raise PlanningError(
            f"path {path.shape} and latent {latent.shape}: they must be (m, {joints}) and (m, d), m at least 2"
        )
    for name, values in (("velocity", velocity), ("acceleration", acceleration)):
        if values.shape != (joints,):
            raise PlanningError(f"the start's {name} has shape {values.shape}: it must be ({joints},)")
    if not all(np.all(np.isfinite(values)) for values in (path, velocity, acceleration)):
        raise PlanningError("the path and the state of motion it starts from must be finite")


@dataclass(frozen=True)
class _PathCurve:
    """A cubic spline through a path; its parameter s is about the time [s] that full speed would take.

    knots : (m,). positions, bends : (m, eta) q and q'' there. latent : (m, d).
    grid : (g,) where laws are planned. grid_slopes, grid_bends : (g, eta) q' and q'' there.
    """

    knots: np.ndarray
    positions: np.ndarray
    bends: np.ndarray
    latent: np.ndarray
    grid: np.ndarray
    grid_slopes: np.ndarray
    grid_bends: np.ndarray

    @classmethod
    def through(cls, path: np.ndarray, latent: np.ndarray, limits: JointLimits) -> _PathCurve:
        passed, kept = _distinct(path, limits.velocity)
        knots, positions = passed[kept], path[kept]
        knots[-1] = max(knots[-1], knots[-2] + _SHORTEST_CHORD)
        bends = spline_bends(knots, positions)
        pieces = math.ceil(_SEGMENTS / (len(kept) - 1))
        grid = np.interp(np.arange(pieces * (len(kept) - 1) + 1) / pieces, np.arange(len(kept)), knots)
        _, grid_slopes, grid_bends = spline_samples(knots, positions, bends, grid)
        return cls(knots, positions, bends, latent[kept], grid, grid_slopes, grid_bends)

    def motion(self, law: np.ndarray) -> np.ndarray:
        """Positions, velocities and accelerations (3, k, eta) where s, s' and s'' are (3, k)."""
        motion = spline_samples(self.knots, self.positions, self.bends, law[0])
        _pass_at(motion, law)
        return motion


@numba.njit(cache=True, nogil=True)
def _distinct(path: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) [s] at which full speed passes the points of a path, and which of them (k,) are not one.

    Both ends stay, and a path that does not move keeps two points.
    """
    last = len(path) - 1
    passed, kept, count = np.zeros(last + 1), np.zeros(last + 1, dtype=np.int64), 1
    for i in range(1, last + 1):
        squared = 0.0
        for j in range(path.shape[1]):
            squared += ((path[i, j] - path[i - 1, j]) / velocity[j]) ** 2
        passed[i] = passed[i - 1] + math.sqrt(squared)
    for i in range(1, last):
        apart = math.floor(passed[i] / _SHORTEST_CHORD) > math.floor(passed[i - 1] / _SHORTEST_CHORD)
        if apart and passed[i] < passed[last] - _SHORTEST_CHORD:
            kept[count] = i
            count += 1
    kept[count] = last
    return passed, kept[: count + 1]


@numba.njit(cache=True, nogil=True)
def _pass_at(motion: np.ndarray, law: np.ndarray) -> None:
    """Turn q' and q'' of (3, k, eta) into velocities and accelerations where s' and s'' are law[1:]."""
    for k in range(motion.shape[1]):
        rate, change = law[1, k], law[2, k]
        for j in range(motion.shape[2]):
            motion[2, k, j] = motion[1, k, j] * change + motion[2, k, j] * rate**2
            motion[1, k, j] *= rate


def _planned_law(
    curve: _PathCurve, limits: JointLimits, slow: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> tuple[SmoothLaw, float]:
    """The averaged law along a curve, slowed down by factors (g,) of the rate, and when in it the motion begins."""
    width = _averaging_width(_SMOOTHING, limits)
    speeds = np.outer(_VELOCITY_SHARE * slow, limits.velocity)
    accelerations = np.outer(_ACCELERATION_SHARE * slow**2, limits.acceleration)
    slope, bend = curve.grid_slopes[0] / limits.acceleration, curve.grid_bends[0] / limits.acceleration
    length = float(slope @ slope)
    moving = length > 0.0 and bool(np.any(velocity) or np.any(acceleration))
    if not moving:
        rates = fastest_rates(curve.grid, curve.grid_slopes, curve.grid_bends, speeds, accelerations, 0.0)
        return SmoothLaw.along(curve.grid, rates, width), -width
    rate = max(0.0, float(slope @ (velocity / limits.acceleration)) / length)
    rates = fastest_rates(curve.grid, curve.grid_slopes, curve.grid_bends, speeds, accelerations, rate)
    change = float(slope @ (acceleration / limits.acceleration - bend * rates[0] ** 2)) / length
    return SmoothLaw.along(curve.grid, rates, width, change), 0.0


def _played(
    curve: _PathCurve, law: SmoothLaw, begin: float, limits: JointLimits, state: np.ndarray, period: float
) -> JointReference:
    """Knots of the motion along a curve from its time `begin` on, led onto it from a state (3, eta) by a quintic."""
    mismatch = state - curve.motion(law.sample(np.array([begin])))[:, 0]
    length = _correction_length(mismatch, limits.acceleration, limits.jerk)
    times = _knot_times(max(law.end - begin, length), period)
    passed = law.sample(begin + times)
    fading = np.stack([mismatch, np.zeros_like(mismatch)], axis=1)
    motion = curve.motion(passed) + quintic_samples(np.array([0.0, length]), *fading, times)
    motion[:, 0] = state
    return _ending_at_rest(times, *motion, _interpolated(passed[0], curve.knots, curve.latent))


@numba.njit(cache=True, nogil=True)
def _correction_length(mismatch: np.ndarray, acceleration: np.ndarray, jerk: np.ndarray) -> float:
    """Time [s] in which a mismatch (3, eta) of position, velocity and acceleration can fade as a quintic.

    Over a time T the acceleration of the quintic that takes a position, or a velocity, and nothing else to 0 is at most
    5.78 / T^2, or 3.94 / T, of it; the jerk of one that takes an acceleration to 0 at most 9 / T.
    """
    needed = _SHORTEST_CORRECTION
    for j in range(len(jerk)):
        room = _CORRECTION_SHARE * acceleration[j]
        by_position, by_velocity = math.sqrt(5.78 * abs(mismatch[0, j]) / room), 3.94 * abs(mismatch[1, j]) / room
        needed = max(needed, by_position, by_velocity, 18.0 * abs(mismatch[2, j]) / jerk[j])
    return min(needed, _LONGEST_CORRECTION)


def _slower(grid: np.ndarray, law: SmoothLaw, times: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Factors (g,) of the rate on a grid that bring back what exceeds limits: `strain` (3, n - 1) between `times` (n,).

    Half the rate means half the velocity, a quarter of the acceleration, an eighth of the jerk.
    """
    # All of what the average between two times is taken over.
    return _factors(grid, law.sample(times[:-1] - law.width)[0], law.sample(times[1:] + law.width)[0], strain)


@numba.njit(cache=True, nogil=True)
def _factors(grid: np.ndarray, begins: np.ndarray, ends: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """The same where the strain (3, n) depends on the rate from s = begins to ends (n,)."""
    result = np.ones(len(grid))
    for i in range(len(begins)):
        excess = max(strain[0, i], math.sqrt(strain[1, i]), strain[2, i] ** (1.0 / 3.0))
        if excess > 1.0:
            first = max(int(np.searchsorted(grid, begins[i])) - 1, 0)
            last = min(int(np.searchsorted(grid, ends[i])) + 1, len(grid))
            for k in range(first, last):
                result[k] = min(result[k], max(_LEAST_FACTOR, _SLOWED_TO / excess))
    return result
