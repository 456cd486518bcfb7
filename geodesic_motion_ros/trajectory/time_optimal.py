"""How fast a path of joint positions may be passed so that velocities and accelerations stay within their limits.

With s(t) the path's parameter, joint j moves at q'_j s' and accelerates with q'_j s'' + q''_j s'^2. In (S, A) =
(s'^2, s'') every limit is a pair of straight lines, and along a segment of length h with A constant S grows by 2 A h.
The fastest law follows from two passes, as in H. Pham and Q.-C. Pham, "A new approach to time-optimal path
parameterization based on reachability analysis", IEEE Transactions on Robotics, 2018: backwards the largest S at each
knot from which the end can be reached at rest, forwards the largest A that stays below it. Limits hold at both ends of
every segment.

Such a law jumps in acceleration. `SmoothLaw` is its average over a triangle of time, which bounds the jerk and leaves
the path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.robot.limits import JointLimits

#: Squared rate that stands for no limit: paths that do not move have none.
_UNLIMITED = 1e6
#: Coefficients of A below this do not limit it.
_NEGLIGIBLE = 1e-12


@numba.njit(cache=True, nogil=True)
def _changes(
    i: int, step: float, slopes: np.ndarray, bends: np.ndarray, limits: np.ndarray, squared: float
) -> tuple[float, float, float, float]:
    """Smallest and largest A on segment i that begins at S, and how each of them changes with S.

    slopes, bends, limits : (n, eta) q', q'' and largest accelerations at the knots.
    """
    low, high, low_slope, high_slope = -np.inf, np.inf, 0.0, 0.0
    for end in range(2):
        for j in range(slopes.shape[1]):
            bend = bends[i + end, j]
            factor = slopes[i + end, j] + 2.0 * step * end * bend
            if abs(factor) < _NEGLIGIBLE:
                continue
            middle, half = -bend / factor, limits[i + end, j] / abs(factor)
            if middle * squared - half > low:
                low, low_slope = middle * squared - half, middle
            if middle * squared + half < high:
                high, high_slope = middle * squared + half, middle
    return low, high, low_slope, high_slope


@numba.njit(cache=True, nogil=True)
def _caps(slopes: np.ndarray, bends: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Largest S (n,) by velocity, and by acceleration where nothing but S matters."""
    result = np.full(len(slopes), _UNLIMITED)
    for i in range(len(slopes)):
        for j in range(slopes.shape[1]):
            if abs(slopes[i, j]) >= _NEGLIGIBLE:
                result[i] = min(result[i], (velocity[i, j] / slopes[i, j]) ** 2)
            elif abs(bends[i, j]) >= _NEGLIGIBLE:
                result[i] = min(result[i], acceleration[i, j] / abs(bends[i, j]))
    return result


@numba.njit(cache=True, nogil=True)
def _largest_squared_rates(
    knots: np.ndarray, slopes: np.ndarray, bends: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Backward pass: largest S (n,) from which the end can be reached at rest.

    The smallest A less the largest one is convex and piecewise linear in S, and not positive at 0: Newton's iteration
    from above ends at its root after a few steps.
    """
    result = _caps(slopes, bends, velocity, acceleration)
    result[-1] = 0.0
    for i in range(len(knots) - 2, -1, -1):
        h = knots[i + 1] - knots[i]
        for _ in range(30):
            squared = result[i]
            low, high, low_slope, high_slope = _changes(i, h, slopes, bends, acceleration, squared)
            if -0.5 * squared / h > low:
                low, low_slope = -0.5 * squared / h, -0.5 / h
            if 0.5 * (result[i + 1] - squared) / h < high:
                high, high_slope = 0.5 * (result[i + 1] - squared) / h, -0.5 / h
            if low - high <= 1e-12 * abs(low) or low_slope - high_slope <= 0.0:
                break
            result[i] = max(0.0, squared - (low - high) / (low_slope - high_slope))
    return result


@numba.njit(cache=True, nogil=True)
def fastest_rates(
    knots: np.ndarray,
    slopes: np.ndarray,
    bends: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    initial: float,
) -> np.ndarray:
    """Rates s' (n,) of the fastest law that begins at the rate `initial`, or as near below as can be, and ends at rest.

    Parameters
    ----------
    knots : (n,) s, increasing. slopes, bends : (n, eta) q', q''.
    velocity, acceleration : (n, eta) limits [rad/s], [rad/s^2], which may differ along the path.
    """
    largest = _largest_squared_rates(knots, slopes, bends, velocity, acceleration)
    result = np.zeros(len(knots))
    result[0] = min(initial * initial, largest[0])
    for i in range(len(knots) - 1):
        h = knots[i + 1] - knots[i]
        _, high, _, _ = _changes(i, h, slopes, bends, acceleration, result[i])
        result[i + 1] = max(0.0, min(largest[i + 1], result[i] + 2.0 * h * high))
    return np.sqrt(result)


@numba.njit(cache=True, nogil=True)
def braking_rates(
    knots: np.ndarray, slopes: np.ndarray, bends: np.ndarray, acceleration: np.ndarray
) -> tuple[np.ndarray, float]:
    """Rates s' (n,) from 1 at the first knot under the hardest braking, and the s at which they reach 0.

    The path must keep its limits when it is passed at the rate 1: then it keeps them at any lower, constant one, and
    braking as hard as each segment allows never ends where nothing is allowed. Where the path is too short, its end.
    """
    result = np.zeros(len(knots))
    result[0] = 1.0
    for i in range(len(knots) - 1):
        h = knots[i + 1] - knots[i]
        low, _, _, _ = _changes(i, h, slopes, bends, acceleration, result[i])
        low = min(low, 0.0)
        result[i + 1] = result[i] + 2.0 * h * low
        if result[i + 1] <= 0.0:
            stop = knots[i] - 0.5 * result[i] / low
            result[i + 1 :] = 0.0
            return np.sqrt(result), stop
    return np.sqrt(result), knots[-1]


@dataclass(frozen=True)
class SmoothLaw:
    """s(t) averaged over a triangle of time: continuous up to its second derivative.

    Between `times` the second derivative is constant; before and after them the first one is. The average over
    (t - width, t + width) with weights that fall linearly is the second difference of the second integral, over
    width^2.

    Attributes
    ----------
    times : (n,) [s], increasing. values, rates : (n,) s and s' there. width : half of the triangle's base [s].
    """

    times: np.ndarray
    values: np.ndarray
    rates: np.ndarray
    width: float

    @classmethod
    def along(cls, knots: np.ndarray, rates: np.ndarray, width: float, past_change: float = 0.0) -> SmoothLaw:
        """From knots s (n,) passed at rates (n,), the first one at time 0; `past_change` is s'' before that."""
        return cls(*_knots_in_time(knots, rates, width, past_change), width)

    @property
    def end(self) -> float:
        """Time [s] from which on the rate does not change any more."""
        return float(self.times[-1] + self.width)

    def sample(self, at: np.ndarray) -> np.ndarray:
        """s, s' and s'' (3, k) at the times `at` (k,) [s]."""
        return _averaged(self.times, self.values, self.rates, self.width, at)


@numba.njit(cache=True, nogil=True)
def _knots_in_time(
    knots: np.ndarray, rates: np.ndarray, width: float, past_change: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, values and rates of a law: one knot in the past, then those at which time goes on."""
    times, values, passing = np.empty(len(knots) + 1), np.empty(len(knots) + 1), np.empty(len(knots) + 1)
    times[0], times[1] = -width, 0.0
    values[0], values[1] = knots[0] - rates[0] * width + 0.5 * past_change * width**2, knots[0]
    passing[0], passing[1] = rates[0] - past_change * width, rates[0]
    count, now = 2, 0.0
    for i in range(1, len(knots)):
        both = rates[i - 1] + rates[i]
        step = 2.0 * (knots[i] - knots[i - 1]) / both if both > 0.0 else 0.0
        if step > 0.0:
            now += step
            times[count], values[count], passing[count] = now, knots[i], rates[i]
            count += 1
    return times[:count], values[:count], passing[:count]


@numba.njit(cache=True, nogil=True)
def _averaged(times: np.ndarray, values: np.ndarray, rates: np.ndarray, width: float, at: np.ndarray) -> np.ndarray:
    count = len(times)
    once, twice = np.zeros(count), np.zeros(count)
    for i in range(count - 1):
        h = times[i + 1] - times[i]
        change = (rates[i + 1] - rates[i]) / h
        once[i + 1] = once[i] + h * (values[i] + h * (rates[i] / 2.0 + h * change / 6.0))
        twice[i + 1] = twice[i] + h * (once[i] + h * (values[i] / 2.0 + h * (rates[i] / 6.0 + h * change / 24.0)))
    result = np.zeros((3, len(at)))
    for k in range(len(at)):
        for part in range(-1, 2):
            weight = (1.0 if part != 0 else -2.0) / (width * width)
            time = at[k] + part * width
            i = min(max(int(np.searchsorted(times, time)) - 1, 0), count - 1)
            h = time - times[i]
            change = 0.0
            if h > 0.0 and i < count - 1:
                change = (rates[i + 1] - rates[i]) / (times[i + 1] - times[i])
            first = once[i] + h * (values[i] + h * (rates[i] / 2.0 + h * change / 6.0))
            second = twice[i] + h * (once[i] + h * (values[i] / 2.0 + h * (rates[i] / 6.0 + h * change / 24.0)))
            result[0, k] += weight * second
            result[1, k] += weight * first
            result[2, k] += weight * (values[i] + h * (rates[i] + h * change / 2.0))
    return result


def averaging_width(least: float, limits: JointLimits) -> float:
    """Half of the triangle [s] over which a jump from one acceleration limit to the other keeps half of the jerk's."""
    return max(least, 4.0 * float(np.max(limits.acceleration / limits.jerk)))
