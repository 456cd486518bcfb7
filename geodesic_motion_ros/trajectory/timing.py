"""A joint reference along a path: as fast as the limits allow, from whatever state of motion.

Every reference is continuous in position, velocity and acceleration with the state it begins at, ends at rest, and
keeps the limits of velocity, acceleration and jerk between its knots too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.geometry.cubic_spline import spline_bends, spline_samples
from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.trajectory.time_optimal import SmoothLaw, averaging_width, fastest_rates
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference, ending_at_rest, interpolated, knot_times
from geodesic_motion_ros.utils.errors import PlanningError

#: Half of the triangle of time over which laws are averaged [s]; more where jerk is limited harder than a Panda's.
_SMOOTHING = 0.034
#: Share of the limits of velocity and of acceleration that laws are planned with; averaging and corrections add to it.
_VELOCITY_SHARE, _ACCELERATION_SHARE = 0.95, 0.85
#: Share of the accelerations that a correction at the start is planned with, and what its length [s] may be.
_CORRECTION_SHARE, _SHORTEST_CORRECTION, _LONGEST_CORRECTION = 0.5, 0.06, 1.0
#: How often a law is slowed down where it exceeds limits before it is given up; sooner where after so many times its
#: ratio to the limits is still above the last number: each time about half of the excess is left, at best.
_ATTEMPTS, _HOPELESS = 8, (3, 1.2)
#: Share of the limits to which a law is slowed down where it exceeds them, and the least factor of a rate at once.
_SLOWED_TO, _LEAST_FACTOR = 0.92, 0.5
#: Points of a path nearer than this [s at full speed] are one.
_SHORTEST_CHORD = 1e-5
#: Stands for a change of rate that is not limited.
_UNLIMITED = 1e9
#: A motion that was faster than was shown slows down with this time constant [s].
_SLOWING = 0.5
#: Segments of the grid on which a law is planned, at least.
_SEGMENTS = 150
#: Rounding of what is exactly at a limit.
_ROUNDING = 1e-6


def timed_joint_reference(
    path: np.ndarray,
    latent: np.ndarray,
    limits: JointLimits,
    start_velocity: np.ndarray | None = None,
    start_acceleration: np.ndarray | None = None,
    period: float = PERIOD,
    tool: LimitedTool | None = None,
    longest: float = math.inf,
    shown: np.ndarray | None = None,
) -> JointReference | None:
    """A fast reference along a path, from the present state of motion until rest at the path's end.

    The path is drawn by a cubic spline and passed under the fastest law within the limits, averaged over time
    (`time_optimal.py`). What the start differs from the state of motion in position, velocity and acceleration fades
    as a quintic in time, which leaves the path meanwhile. Where the motion exceeds limits the law is slowed down
    there, and again.

    Parameters
    ----------
    path : (m, eta) joint positions [rad]; the first one is what is commanded now. latent : (m, d) their latent points.
    start_velocity, start_acceleration : (eta,) [rad/s], [rad/s^2] commanded now; at rest by default.
    period : time between knots [s].
    tool : with limits that its motion keeps besides, as far as the state it starts from allows: speeds and
        accelerations that exceed them there fade first.
    longest : a motion that takes longer [s] need not be worked out.
    shown : (m,) times [s], which do not fall, at which the motion that was shown passed the points of the path: the law
        is nowhere faster than that, but where it takes over a faster one. None: it is as fast as can be.

    Returns
    -------
    The reference, or None where the state of motion cannot be led onto the path within the limits: then stop first. So
    too where the law takes longer than `longest`: slowed down it would take longer still.

    Raises
    ------
    PlanningError : shapes do not fit, or values that are not finite.
    """
    joints = len(limits.velocity)
    path, latent = np.asarray(path, dtype=float), np.asarray(latent, dtype=float)
    velocity = np.zeros(joints) if start_velocity is None else np.asarray(start_velocity, dtype=float)
    acceleration = np.zeros(joints) if start_acceleration is None else np.asarray(start_acceleration, dtype=float)
    _check(path, latent, velocity, acceleration, joints)
    tool = None if tool is None or not tool.limits.limited else tool
    curve = _PathCurve.through(path, latent, limits)
    constraints = _constraints(curve.grid_motion, limits, tool)
    if shown is not None:
        paced = curve.paced(np.asarray(shown, dtype=float), curve.initial_rate(velocity, limits))
        constraints = np.concatenate([constraints, paced], axis=2)
    state = np.stack([path[0], velocity, acceleration])
    slow, width = np.ones(len(curve.grid)), averaging_width(_SMOOTHING, limits)
    for attempts in range(1, _ATTEMPTS + 1):
        law, begin = _planned_law(curve, limits, constraints, slow, width, velocity, acceleration)
        if law.end - begin > longest + _ROUNDING:
            return None
        attempt, fading = _played(curve, law, begin, limits, tool, state, period)
        inside, limit_ratio = attempt.measured(limits)
        if tool is not None:
            limit_ratio[:2] = np.maximum(limit_ratio[:2], tool_limit_ratio(tool, attempt, fading))
        worst = np.max(limit_ratio)
        if inside and worst <= 1.0 + _ROUNDING:
            return attempt
        if worst <= 1.0:
            # Only positions are outside, and slower ones would be too.
            return None
        if attempts == _HOPELESS[0] and worst > _HOPELESS[1]:
            return None
        slow *= _slower(curve.grid, law, begin + attempt.times, limit_ratio)
    return None


def load_references(limits: JointLimits, tool: LimitedTool | None = None) -> None:
    """Load the compiled kernels of `timed_joint_reference`, also those for motions that have to be slowed down: for
    one that begins in the opposite direction.
    """
    # Continuous joints have no limits.
    lower, upper = np.maximum(limits.lower, -math.pi), np.minimum(limits.upper, math.pi)
    path = 0.5 * (lower + upper) + 0.1 * limits.velocity * np.linspace(0.0, 1.0, 6)[:, None]
    still = np.zeros_like(limits.velocity)
    timed_joint_reference(path, np.zeros((6, 1)), limits, -0.3 * limits.velocity, still, tool=tool)


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

    knots : (m,). kept : (m,) which points of the path they are. positions, bends : (m, eta) q and q'' there.
    latent : (m, d).
    grid : (g,) where laws are planned. grid_motion : (3, g, eta) q, q' and q'' there.
    """

    knots: np.ndarray
    kept: np.ndarray
    positions: np.ndarray
    bends: np.ndarray
    latent: np.ndarray
    grid: np.ndarray
    grid_motion: np.ndarray

    @classmethod
    def through(cls, path: np.ndarray, latent: np.ndarray, limits: JointLimits) -> _PathCurve:
        passed, kept = _distinct(path, limits.velocity)
        knots, positions = passed[kept], path[kept]
        knots[-1] = max(knots[-1], knots[-2] + _SHORTEST_CHORD)
        bends = spline_bends(knots, positions)
        pieces = math.ceil(_SEGMENTS / (len(kept) - 1))
        grid = np.interp(np.arange(pieces * (len(kept) - 1) + 1) / pieces, np.arange(len(kept)), knots)
        return cls(knots, kept, positions, bends, latent[kept], grid, spline_samples(knots, positions, bends, grid))

    def initial_rate(self, velocity: np.ndarray, limits: JointLimits) -> float:
        """The rate s' at which a motion of a velocity (eta,) passes the first point; it does not go back."""
        slope = self.grid_motion[1, 0] / limits.acceleration
        length = float(slope @ slope)
        return max(0.0, float(slope @ (velocity / limits.acceleration)) / length) if length > 0.0 else 0.0

    def paced(self, shown: np.ndarray, rate: float) -> np.ndarray:
        """The parameter s as one more "joint" (4, g, 1), as of `_constraints`: no faster than a motion that passes the
        points of the path at the times `shown` [s], and slowing down to that from a rate.
        """
        rates = np.diff(self.knots) / np.maximum(np.diff(shown[self.kept]), _SHORTEST_CHORD)
        pace = np.interp(self.grid, 0.5 * (self.knots[1:] + self.knots[:-1]), rates)
        row = np.zeros((4, len(pace), 1))
        row[0], row[2, :, 0], row[3] = 1.0, np.maximum(pace, rate - self.grid / _SLOWING), _UNLIMITED
        return row

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


def _constraints(grid_motion: np.ndarray, limits: JointLimits, tool: LimitedTool | None) -> np.ndarray:
    """q', q'', largest speeds and accelerations (4, g, eta) of a path (3, g, eta), and of the "joints" of the tool."""
    joints = np.empty((4, *grid_motion.shape[1:]))
    joints[:2] = grid_motion[1:]
    joints[2:] = np.stack([_VELOCITY_SHARE * limits.velocity, _ACCELERATION_SHARE * limits.acceleration])[:, None]
    if limits.position_based_velocity is not None:
        joints[2] = _VELOCITY_SHARE * np.where(grid_motion[1] < 0.0, *limits.largest_speeds(grid_motion[0]))
    if tool is None:
        return joints
    return np.concatenate([joints, tool.constraints(grid_motion, _VELOCITY_SHARE, _ACCELERATION_SHARE)], axis=2)


def _planned_law(
    curve: _PathCurve,
    limits: JointLimits,
    constraints: np.ndarray,
    slow: np.ndarray,
    width: float,
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> tuple[SmoothLaw, float]:
    """The averaged law along a curve, slowed down by factors (g,) of the rate, and when in it the motion begins.

    constraints : as of `_constraints`. width : as of `SmoothLaw` [s].
    """
    slopes, bends = constraints[:2]
    speeds, accelerations = slow[:, None] * constraints[2], slow[:, None] ** 2 * constraints[3]
    slope, bend = curve.grid_motion[1:, 0] / limits.acceleration
    length = float(slope @ slope)
    moving = length > 0.0 and (velocity.any() or acceleration.any())
    if not moving:
        rates = fastest_rates(curve.grid, slopes, bends, speeds, accelerations, 0.0)
        return SmoothLaw.along(curve.grid, rates, width), -width
    rate = curve.initial_rate(velocity, limits)
    rates = fastest_rates(curve.grid, slopes, bends, speeds, accelerations, rate)
    change = float(slope @ (acceleration / limits.acceleration - bend * rates[0] ** 2)) / length
    return SmoothLaw.along(curve.grid, rates, width, change), 0.0


def _played(
    curve: _PathCurve,
    law: SmoothLaw,
    begin: float,
    limits: JointLimits,
    tool: LimitedTool | None,
    state: np.ndarray,
    period: float,
) -> tuple[JointReference, float]:
    """Knots of the motion along a curve from its time `begin` on, led onto it from a state (3, eta) by a quintic.

    Also in which time [s] the quintic does so.
    """
    mismatch = state - curve.motion(law.sample(np.array([begin])))[:, 0]
    length = correction_length(mismatch, limits.acceleration, limits.jerk)
    if tool is not None:
        length = max(length, correction_length(tool.mismatch(state[0], mismatch), tool.accelerations, tool.jerks))
    times = knot_times(max(law.end - begin, length), period)
    passed = law.sample(begin + times)
    fading = np.zeros((3, 2, mismatch.shape[1]))
    fading[:, 0] = mismatch
    position, velocity, acceleration = fading
    motion = curve.motion(passed) + quintic_samples(np.array([0.0, length]), position, velocity, acceleration, times)
    motion[:, 0] = state
    position, velocity, acceleration = motion
    latent = interpolated(passed[0], curve.knots, curve.latent)
    return ending_at_rest(times, position, velocity, acceleration, latent), length


def tool_limit_ratio(tool: LimitedTool, reference: JointReference, fading: float) -> np.ndarray:
    """The tool's speeds and accelerations over its limits (2, n - 1); its initial ones are allowed while they fade."""
    times = reference.times
    # The first knot of all intervals of an even number is a knot of the reference.
    samples = np.empty((3, 2 * len(times) - 1, reference.positions.shape[1]))
    samples[:, ::2] = reference.positions, reference.velocities, reference.accelerations
    samples[:, 1::2] = reference.samples(0.5 * (times[1:] + times[:-1]))
    return tool.limit_ratio(samples, int(np.searchsorted(times, fading)), fading)


@numba.njit(cache=True, nogil=True)
def correction_length(mismatch: np.ndarray, acceleration: np.ndarray, jerk: np.ndarray) -> float:
    """Return the time [s] in which a mismatch (3, eta) of position, velocity and acceleration fades as a quintic.

    Over a time T the acceleration of the quintic that takes a position, or a velocity, and nothing else to 0 is at most
    5.78 / T^2, or 3.94 / T, of it; the jerk of one that takes an acceleration to 0 at most 9 / T.
    """
    needed = _SHORTEST_CORRECTION
    for j in range(len(jerk)):
        room = _CORRECTION_SHARE * acceleration[j]
        by_position, by_velocity = math.sqrt(5.78 * abs(mismatch[0, j]) / room), 3.94 * abs(mismatch[1, j]) / room
        needed = max(needed, by_position, by_velocity, 18.0 * abs(mismatch[2, j]) / jerk[j])
    return min(needed, _LONGEST_CORRECTION)


def _slower(grid: np.ndarray, law: SmoothLaw, times: np.ndarray, limit_ratio: np.ndarray) -> np.ndarray:
    """Factors (g,) of a grid's rates to bring back what exceeds limits: `limit_ratio` (3, n - 1) between `times` (n,).

    Half the rate means half the velocity, a quarter of the acceleration, an eighth of the jerk.
    """
    # All of what the average between two times is taken over.
    return _factors(grid, law.sample(times[:-1] - law.width)[0], law.sample(times[1:] + law.width)[0], limit_ratio)


@numba.njit(cache=True, nogil=True)
def _factors(grid: np.ndarray, begins: np.ndarray, ends: np.ndarray, limit_ratio: np.ndarray) -> np.ndarray:
    """The same where `limit_ratio` (3, n) depends on the rate from s = begins to ends (n,)."""
    result = np.ones(len(grid))
    for i in range(len(begins)):
        excess = max(limit_ratio[0, i], math.sqrt(limit_ratio[1, i]), limit_ratio[2, i] ** (1.0 / 3.0))
        if excess > 1.0:
            first = max(int(np.searchsorted(grid, begins[i])) - 1, 0)
            last = min(int(np.searchsorted(grid, ends[i])) + 1, len(grid))
            for k in range(first, last):
                result[k] = min(result[k], max(_LEAST_FACTOR, _SLOWED_TO / excess))
    return result
