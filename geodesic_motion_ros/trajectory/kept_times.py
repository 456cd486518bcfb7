"""A joint reference that passes points at the times that somebody else has given them, where the limits allow that."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.geometry.cubic_spline import spline_bends_between, spline_samples
from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.trajectory.stopping import keeps_all
from geodesic_motion_ros.trajectory.timing import correction_length
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference, ending_at_rest, interpolated

#: Points that a cubic spline needs for its ends to follow from the others.
_FEWEST = 4
#: What fades may leave the spline by this [rad]: an arm that is led onto it from farther off would overshoot.
_LARGEST_FADE = 2e-3
#: An arm brakes at the end of a path in motion with this share of the limits; where that exceeds them, and as long as
#: there is path, in a time that is longer by this factor.
_BRAKING_SHARE, _LONGER = 0.8, 1.4
#: A path that ends slower than these shares of the joints' limits is to end at rest: one that begins at rest, and one
#: that does not, which is part of another one.
_SLOW_END = 0.05, 1e-3


def kept_times_reference(
    times: np.ndarray,
    path: np.ndarray,
    latent: np.ndarray,
    limits: JointLimits,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    tool: LimitedTool | None = None,
    leads_in: bool = False,
) -> JointReference | None:
    """Return the reference that passes a path at its times, and is at rest at its end; None where that exceeds limits,
    as it does where the path begins in another motion than the arm's.

    A cubic spline in time leads through the points; the little that the state of motion differs from it fades as a
    quintic. On a path that ends in motion the arm brakes as late as the limits allow, and comes to rest where the path
    ends. An arm at rest on a path of fewer points than say how fast it is goes from rest to rest in its time.

    Parameters
    ----------
    times : (m,) [s], increasing from 0. path : (m, eta) [rad]; the first one is what is commanded now. latent : (m, d).
    velocity, acceleration : (eta,) commanded now. leads_in : the path is not known where it begins: it leads from the
        present motion to its second point.
    """
    still = np.zeros_like(velocity)
    if len(times) >= _FEWEST:
        begins = velocity if leads_in else None
        bends = spline_bends_between(times, path, begins, None)
        last = spline_samples(times, path, bends, times[-1:])[1, 0]
        if np.max(np.abs(last) / limits.velocity) < _SLOW_END[int(velocity.any())]:
            last, bends = still, spline_bends_between(times, path, begins, still)
    elif velocity.any() or acceleration.any():
        return None
    else:
        last, bends = still, spline_bends_between(times, path, still, still)
    state = np.stack([path[0], velocity, acceleration])
    mismatch = state - spline_samples(times, path, bends, times[:1])[:, 0]
    length = correction_length(mismatch, limits.acceleration, limits.jerk)
    if length > times[-1]:
        return None
    fade = np.zeros((3, 2, path.shape[1]))
    fade[:, 0] = mismatch
    braking = _braking_time(last, limits) if last.any() else 0.0
    while 0.5 * braking <= times[-1]:
        at, law = _law(float(times[-1]), braking)
        fading = quintic_samples(np.array([0.0, length]), fade[0], fade[1], fade[2], at)
        if np.max(np.abs(fading[0])) > _LARGEST_FADE:
            return None
        passed, rate, change = law[0], law[1][:, None], law[2][:, None]
        motion, (place, slope, bend) = fading, spline_samples(times, path, bends, passed)
        motion[0] += place
        motion[1] += slope * rate
        motion[2] += bend * rate**2 + slope * change
        motion[:, 0] = state
        reference = ending_at_rest(at, motion[0], motion[1], motion[2], interpolated(passed, times, latent))
        if keeps_all(reference, limits, tool):
            return reference
        if braking == 0.0:
            return None
        braking *= _LONGER
    return None


def _braking_time(velocity: np.ndarray, limits: JointLimits) -> float:
    """The time [s] in which the limits allow a stop from a velocity (eta,) along a path, as of `_law`."""
    speed = np.abs(velocity) / _BRAKING_SHARE
    return float(max(np.max(1.5 * speed / limits.acceleration), np.max(np.sqrt(6.0 * speed / limits.jerk)), PERIOD))


def _law(end: float, braking: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [s] of knots, and how far a path of a time `end` [s] has been passed then: s, s' and s'' (3, n). It is
    passed at its own times but for a time `braking` [s] at the end, in which the rate falls to 0.
    """
    begin = end - 0.5 * braking
    duration = begin + braking
    at = np.linspace(0.0, duration, max(2, int(np.ceil(duration / PERIOD - 1e-6))) + 1)
    law = np.stack([at, np.ones_like(at), np.zeros_like(at)])
    if braking > 0.0:
        share = np.clip((at - begin) / braking, 0.0, 1.0)
        law[0] = np.minimum(at, begin) + braking * (share - share**3 + 0.5 * share**4)
        law[1] = 1.0 - 3.0 * share**2 + 2.0 * share**3
        law[2] = -6.0 * share * (1.0 - share) / braking
    return at, law
