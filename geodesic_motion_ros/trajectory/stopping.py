"""Stops of a joint motion: along its path, or from its state of motion alone; and motions that slow down.

As every reference a stop is continuous with the state it begins at, and keeps the limits between its knots too.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.trajectory.time_optimal import SmoothLaw, averaging_width, braking_rates
from geodesic_motion_ros.trajectory.timing import tool_limit_ratio
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference, ending_at_rest, interpolated, knot_times

#: Halves of the triangle of time over which laws are averaged [s], tried one after the other: the sooner a stop begins
#: the better, but one that begins while the arm accelerates as much as it may has to begin gently.
_STOP_SMOOTHINGS = (0.02, 0.06, 0.12)
#: Shares of the accelerations that stops are tried with, one after the other.
_BRAKING_SHARES = (0.97, 0.8, 0.5)
#: Stops are planned on so much of what is ahead [s], and on all of it where that does not suffice.
_AHEAD = 1.0
#: A motion is slowed down to this share of what keeps lower limits: its knots are not those of the reference.
_SLOWED_SHARE = 0.97
#: A tool keeps its limits where it is over them by no more than this factor: they are measured at samples.
_TOOL_ROUNDING = 1.01
#: Shortest time [s] in which a bridge's acceleration changes, where jerk would allow less.
_SHORTEST_RAMP = 0.005


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
        width = averaging_width(smoothing, limits)
        if going.duration <= width:
            return going
        # The average begins to fall one width before the law does.
        near = _grid(going, width, _AHEAD, period)
        for share in _BRAKING_SHARES:
            grid, rates, stop = _braked(going, near, share * limits.acceleration)
            if stop >= grid[-1] and grid[-1] < going.duration:
                grid, rates, stop = _braked(going, _grid(going, width, np.inf, period), share * limits.acceleration)
            passed = grid < stop
            knots, rates = np.append(grid[passed], stop), np.append(rates[passed], rates[-1])
            law = SmoothLaw.along(knots, rates, width)
            halt = _passed(going, law, law.end + width, period)
            if halt.keeps(limits):
                return halt
    return leaving_stop(reference, time, limits, period) or going


def leaving_stop(
    reference: JointReference, time: float, limits: JointLimits, period: float = PERIOD
) -> JointReference | None:
    """The soonest stop from `time` [s] of a reference on, which leaves its path; None where that does not keep the
    limits, or takes longer than to go on.
    """
    going = reference.rest(time)
    bridge = bridge_to_rest(*going.sample(0.0), limits, period)
    if not bridge.keeps(limits) or bridge.duration >= going.duration:
        return None
    return replace(bridge, latent=np.repeat(going.latent[:1], len(bridge.times), axis=0))


def slowed_reference(
    reference: JointReference,
    time: float,
    limits: JointLimits,
    kept: JointLimits,
    tool: LimitedTool | None = None,
    period: float = PERIOD,
) -> JointReference | None:
    """Slow the rest of a reference down from `time` [s] on, along its own path, until it keeps lower limits; None where
    that does not succeed: then it is to stop.

    It is passed at a rate that falls from 1, as that of a stop does, to one at which all of the rest keeps the limits.

    limits, tool : kept from then on. kept : wider limits that the reference keeps, and the motion while it slows down.
    """
    going = reference.rest(time)
    velocity, acceleration, jerk = np.max(going.limit_ratio(limits), axis=1)
    tool_speed, tool_acceleration = tool_excess(going, tool)
    largest = max(velocity, tool_speed, max(acceleration, tool_acceleration) ** 0.5, jerk ** (1.0 / 3.0))
    slowest = _SLOWED_SHARE / max(1.0, largest)
    for smoothing in _STOP_SMOOTHINGS:
        width = averaging_width(smoothing, kept)
        if going.duration <= width:
            return None
        whole = _grid(going, width, np.inf, period)
        for share in _BRAKING_SHARES:
            _, rates, _ = _braked(going, whole, share * kept.acceleration)
            law = SmoothLaw.along(whole, np.maximum(rates, slowest), width)
            slower = _passed(going, law, float(law.times[-1]) + width, period)
            # The average has fallen one width after the law has.
            fallen = law.times[int(np.argmax(law.rates <= slowest))] + 2.0 * width
            if slower.keeps(kept) and keeps_all(slower.rest(min(fallen, slower.duration)), limits, tool):
                return slower
    return None


def keeps_all(reference: JointReference, limits: JointLimits, tool: LimitedTool | None) -> bool:
    """Whether a reference keeps the limits of the joints, and those of the tool up to a hundredth."""
    return reference.keeps(limits) and max(tool_excess(reference, tool)) <= _TOOL_ROUNDING


def tool_excess(reference: JointReference, tool: LimitedTool | None) -> tuple[float, float]:
    """Largest speed and acceleration of the tool along a reference, over their limits; 0 without limits."""
    if tool is None or not tool.limits.limited:
        return 0.0, 0.0
    speed, acceleration = np.max(tool_limit_ratio(tool, reference, 0.0), axis=1)
    return float(speed), float(acceleration)


def _passed(going: JointReference, law: SmoothLaw, end: float, period: float) -> JointReference:
    """A reference under a law that begins one width before time 0 at the rate 1, until a time [s]."""
    times = knot_times(end, period)
    at, rate, change = law.sample(times - law.width)
    positions, velocities, accelerations = going.samples(at)
    return ending_at_rest(
        times,
        positions,
        velocities * rate[:, None],
        accelerations * rate[:, None] ** 2 + velocities * change[:, None],
        interpolated(at, going.times, going.latent),
    )


def _grid(going: JointReference, begin: float, ahead: float, period: float) -> np.ndarray:
    """Times (g,) [s] of a reference from `begin` on, so far ahead at most; the last is its end where that is nearer."""
    grid = np.arange(begin, min(going.duration, begin + ahead), 0.5 * period)
    return grid if begin + ahead < going.duration else np.append(grid, going.duration)


def _braked(going: JointReference, grid: np.ndarray, acceleration: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """A grid (g,) of times [s] of a reference, the rates (g,) of the hardest braking there, and where that ends."""
    _, slopes, bends = going.samples(grid)
    return grid, *braking_rates(grid, slopes, bends, np.broadcast_to(acceleration, slopes.shape))


def bridge_to_rest(
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    limits: JointLimits,
    period: float = PERIOD,
) -> JointReference:
    """A stop from a state of motion (eta,) [rad], [rad/s], [rad/s^2] alone, along no path: for when there is none.

    Accelerations go linearly to those of braking, stay there, and go linearly to 0: in the same times for all joints,
    each braking as hard as it must to be at rest with the others. Position limits are not judged. The latent points
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
    positions, velocities, accelerations = quintic_samples(ends, *cubics, times)
    return ending_at_rest(times, positions, velocities, accelerations, np.empty((len(times), 0)))
