"""How noisy the detections of an obstacle are, found out from these themselves; knows nothing of ROS.

Of four detections p_i in a row, at times t_i, the third divided difference d = sum w_i p_i with
w_i = 1 / prod over j != i of (t_i - t_j) is zero for everything that moves at a constant acceleration, and for noise of
the standard deviation sigma in each axis d / sqrt(sum w_i^2) has that standard deviation too, however unevenly they
come. The median of its length is 1.538 sigma (chi distribution, three axes), and hardly feels single turns, starts and
outliers. Noise that lasts from one detection to the next, as of a filter in the detector, is not found.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque

from geodesic_motion_ros.geometry.vectors import Vector, added

#: Detections that are as accurate as this [m] are exact: a tenth of a millimetre tells a velocity within 2 mm/s.
EXACT = 1e-4
# Differences that count, of the last ones: their median is off by 5 % (standard deviation). At first as many as those
# hold, and then each new one takes the place of one of them, so that a start is not taken for noise.
_KEPT, _FIRST = 200, 8
_MEDIAN_LENGTH = 1.538


class DetectionNoise:
    """Standard deviation of detections, in each axis.

    Parameters
    ----------
    known : what it was of other detections of the same source [m]: holds until enough is known of these.
    least : what it is at least [m]: noise of some kinds is less for what stands than once that moves.
    """

    def __init__(self, known: float = 0.0, least: float = 0.0) -> None:
        self._least = least
        self._row: deque[tuple[float, Vector]] = deque(maxlen=4)
        self._lengths = deque([_MEDIAN_LENGTH * known] * _FIRST)
        self._assumed = _FIRST
        self._sorted = list(self._lengths)

    def moved(self, shift: Vector) -> DetectionNoise:
        """Make the same of detections that are elsewhere, by a shift (3,) [m]."""
        other = DetectionNoise(least=self._least)
        other._row.extend((time, added(place, shift)) for time, place in self._row)
        other._lengths, other._sorted = self._lengths.copy(), self._sorted.copy()
        other._assumed = self._assumed
        return other

    def begin_again(self) -> None:
        """What is detected next is not in one row with what was detected before."""
        self._row.clear()

    def see(self, centre: Vector, time: float) -> None:
        """Take a detection [m], later [s] than the last."""
        self._row.append((time, centre))
        if len(self._row) == 4:
            length = _scaled_difference(*self._row)
            self._lengths.append(length)
            insort(self._sorted, length)
            if self._assumed or len(self._lengths) > _KEPT:
                self._assumed = max(0, self._assumed - 1)
                del self._sorted[bisect_left(self._sorted, self._lengths.popleft())]

    @property
    def deviation(self) -> float:
        """[m], 0 where detections are exact, or too few to tell."""
        deviation = max(self._least, self._sorted[len(self._sorted) // 2] / _MEDIAN_LENGTH)
        return deviation if deviation > EXACT else 0.0


def _scaled_difference(
    first: tuple[float, Vector], second: tuple[float, Vector], third: tuple[float, Vector], fourth: tuple[float, Vector]
) -> float:
    """Length of d / sqrt(sum w_i^2) [m] of four detections."""
    (a, p), (b, q), (c, r), (d, s) = first, second, third, fourth
    u = 1.0 / ((a - b) * (a - c) * (a - d))
    v = 1.0 / ((b - a) * (b - c) * (b - d))
    w = 1.0 / ((c - a) * (c - b) * (c - d))
    # The weights add up to nothing: positions count from the last one.
    difference = (u * (p[k] - s[k]) + v * (q[k] - s[k]) + w * (r[k] - s[k]) for k in range(3))
    return math.hypot(*difference) / math.hypot(u, v, w, u + v + w)
