"""The time law: how fast a curve may be passed so that the tool's speed and acceleration stay within their limits.

With u(t) the curve's parameter, the acceleration of the tool is x''(u) u'^2 + x'(u) u'', tangential and centripetal
parts together, and the angular one likewise. In (S, A) = (u'^2, u'') every limit |x'' S + x' A| <= a is a convex set
that holds the origin, and along a segment of length h with A constant, S grows by 2 A h. The fastest law follows from
two passes, as in H. Pham and Q.-C. Pham, "A new approach to time-optimal path parameterization based on reachability
analysis", IEEE Transactions on Robotics, 2018: backwards the largest S at each knot from which the end can be reached
at rest, forwards the largest A that stays below it.

Limits hold exactly at both ends and in the middle of every segment; between these x'' and S are linear in u and x' is
quadratic.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.motion_curve import SHORTEST_STEP, MotionCurve, MotionLimits

#: Halvings of the interval of squared rates: 2^-24 of it is left.
_HALVINGS = 24


@numba.njit(cache=True, nogil=True)
def _quadratics(
    knots: np.ndarray, chords: np.ndarray, tangents: np.ndarray, limits: np.ndarray, speeds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Per segment six forms p S^2 + 2 q S A + r A^2 <= 1, (n - 1, 6, 3), and per knot the largest S by speed (n,).

    The forms are those of both accelerations at the begin, the middle and the end of the segment; S is that at its
    begin.
    """
    count = len(chords)
    forms, caps = np.zeros((count, 6, 3)), np.full(count + 1, np.inf)
    for i in range(count):
        h = knots[i + 1] - knots[i]
        for part in range(2):
            fastest = np.zeros(3)
            for j in range(3 * part, 3 * part + 3):
                c, m0, m1 = chords[i, j], tangents[i, j], tangents[i + 1, j]
                for k in range(3):
                    s = 0.5 * k
                    slope = 6.0 * s * (1.0 - s) * c / h + (1.0 - s) * (1.0 - 3.0 * s) * m0 + s * (3.0 * s - 2.0) * m1
                    bend = ((6.0 - 12.0 * s) * c / h + (6.0 * s - 4.0) * m0 + (6.0 * s - 2.0) * m1) / h
                    fastest[k] += slope * slope
                    of_squared = bend / limits[part]
                    of_change = (slope + 2.0 * s * h * bend) / limits[part]
                    forms[i, 3 * part + k, 0] += of_squared * of_squared
                    forms[i, 3 * part + k, 1] += of_squared * of_change
                    forms[i, 3 * part + k, 2] += of_change * of_change
            for k in range(2):
                squared = max(fastest[2 * k], fastest[1])
                if squared > 0.0:
                    caps[i + k] = min(caps[i + k], speeds[part] ** 2 / squared)
    return forms, caps


@numba.njit(cache=True, nogil=True)
def _accelerations(forms: np.ndarray, squared: float, strain: float) -> tuple[float, float]:
    """Smallest and largest A that the six forms (6, 3) of a segment allow at S; the first the larger where none."""
    low, high = -np.inf, np.inf
    for k in range(6):
        p, q, r = forms[k, 0], forms[k, 1] * squared, forms[k, 2]
        rest = p * squared * squared - strain * strain
        if r <= 1e-18:
            if rest > 0.0:
                return 1.0, -1.0
            continue
        inside = q * q - r * rest
        if inside < 0.0:
            return 1.0, -1.0
        root = math.sqrt(inside)
        low, high = max(low, (-q - root) / r), min(high, (-q + root) / r)
    return low, high


@numba.njit(cache=True, nogil=True)
def _reaches(forms: np.ndarray, step: float, squared: float, after: float, strain: float) -> bool:
    """Whether some A leads from S at a segment's begin to [0, after] at its end."""
    low, high = _accelerations(forms, squared, strain)
    low, high = max(low, -0.5 * squared / step), min(high, 0.5 * (after - squared) / step)
    return low <= high


@numba.njit(cache=True, nogil=True)
def _largest(knots: np.ndarray, forms: np.ndarray, caps: np.ndarray, strain: float) -> np.ndarray:
    """Backward pass: largest S (n,) from which the end can be reached at rest."""
    result = np.zeros(len(knots))
    for i in range(len(forms) - 1, -1, -1):
        step, after = knots[i + 1] - knots[i], result[i + 1]
        low, high = 0.0, min(caps[i], 1e6)
        if _reaches(forms[i], step, high, after, strain):
            result[i] = high
            continue
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if _reaches(forms[i], step, middle, after, strain):
                low = middle
            else:
                high = middle
        result[i] = low
    return result


@numba.njit(cache=True, nogil=True)
def _fastest(knots: np.ndarray, forms: np.ndarray, largest: np.ndarray, initial: float, strain: float) -> np.ndarray:
    """Forward pass: S (n,) with the largest A everywhere."""
    result = np.zeros(len(knots))
    result[0] = initial
    for i in range(len(forms)):
        step = knots[i + 1] - knots[i]
        _, high = _accelerations(forms[i], result[i], strain)
        result[i + 1] = max(0.0, min(largest[i + 1], result[i] + 2.0 * step * high))
    return result


@numba.njit(cache=True, nogil=True)
def _soonest_rest(knots: np.ndarray, forms: np.ndarray, initial: float, strain: float) -> tuple[np.ndarray, int, float]:
    """S (n,) under the hardest braking allowed, and the segment and the share of it where the rest is reached."""
    result = np.zeros(len(knots))
    result[0] = initial
    for i in range(len(forms)):
        step = knots[i + 1] - knots[i]
        low, high = _accelerations(forms[i], result[i], strain)
        more = 1.1 * strain
        while low > high and more < 1e6:
            # Faster than this bend allows.
            low, high = _accelerations(forms[i], result[i], more)
            more *= 1.1
        after = result[i] + 2.0 * step * low
        if after <= 0.0:
            return result, i, -0.5 * result[i] / (low * step)
        result[i + 1] = after
    return result, len(forms), 0.0


def _arrays(curve: MotionCurve, limits: MotionLimits) -> tuple[np.ndarray, np.ndarray]:
    accelerations = np.array([limits.acceleration, limits.angular_acceleration])
    speeds = np.array([limits.speed, limits.angular_speed])
    return _quadratics(curve.knots, curve.chords, curve.tangents, accelerations, speeds)


def _times(knots: np.ndarray, rates: np.ndarray) -> np.ndarray:
    sums = rates[1:] + rates[:-1]
    steps = np.divide(2.0 * np.diff(knots), sums, out=np.zeros(len(sums)), where=sums > 0.0)
    return np.concatenate([[0.0], np.cumsum(steps)])


def fastest_law(curve: MotionCurve, limits: MotionLimits, initial_rate: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Times (n,) [s], rates u' (n,) and strain of the fastest law that begins at `initial_rate` and ends at rest.

    The strain is 1 where all limits are kept. Where the initial rate is too fast to be braked or bent within them, both
    accelerations are allowed 1.1 times as much, or 2.2, 4.4, ... times where needed: the rate itself never jumps.
    """
    forms, caps = _arrays(curve, limits)
    initial, strain = initial_rate**2, 1.0
    largest = _largest(curve.knots, forms, caps, strain)
    # Rounding, and the exact limit of speed that is also an initial rate, ask for no strain.
    while initial > largest[0] * (1.0 + 1e-6) + 1e-12 and strain < 1e6:
        strain = 1.1 if strain == 1.0 else 2.0 * strain
        caps[0] = max(caps[0], initial)
        largest = _largest(curve.knots, forms, caps, strain)
    initial = min(initial, largest[0])
    rates = np.sqrt(_fastest(curve.knots, forms, largest, initial, strain))
    return _times(curve.knots, rates), rates, strain


def braking_law(
    curve: MotionCurve, limits: MotionLimits, initial_rate: float, strain: float = 1.0
) -> tuple[MotionCurve, np.ndarray, np.ndarray] | None:
    """The beginning of a curve on which the soonest rest is reached, with times (n,) [s] and rates u' (n,).

    Accelerations may be `strain` times as large as the limits, in a segment whose bend the rate is too fast for 1.1
    times that, or 1.21, ... A law that is left for a stop says its own strain: with less, the next bend would be
    reached faster than by the law. None where the curve is too short for a rest.
    """
    forms, _ = _arrays(curve, limits)
    squared, segment, share = _soonest_rest(curve.knots, forms, initial_rate**2, strain)
    if segment == len(forms):
        return None
    cut = curve.until(segment, share)
    if cut.knots[-1] <= SHORTEST_STEP:
        # Two thousandths of a millimetre at full speed: as good as at rest.
        return cut, np.zeros(2), np.zeros(2)
    rates = np.append(np.sqrt(squared[: segment + 1]), 0.0)
    return cut, _times(cut.knots, rates), rates
