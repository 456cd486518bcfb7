"""MotionCurve: a curve of tool poses whose velocity is continuous, cut and projected onto exactly."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.graph.transport import carry
from geodesic_motion_ros.quaternions import continuous_signs

#: Knots closer than this [s] are one: second derivatives of shorter segments would be rounding errors.
SHORTEST_STEP = 1e-5


@dataclass(frozen=True)
class MotionLimits:
    """What the tool may do: speeds [m/s], [rad/s] and accelerations [m/s^2], [rad/s^2]."""

    speed: float
    angular_speed: float
    acceleration: float
    angular_acceleration: float

    def fraction(self, linear: np.ndarray, angular: np.ndarray) -> np.ndarray:
        """Speed over what is allowed, (...), of velocities (..., 3) [m/s] and (..., 3) [rad/s]: the larger of both."""
        moving = np.linalg.norm(linear, axis=-1) / self.speed
        return np.maximum(moving, np.linalg.norm(angular, axis=-1) / self.angular_speed)


def distinct(positions: np.ndarray, quaternions: np.ndarray, limits: MotionLimits) -> np.ndarray:
    """Indices of those poses (n, 3), (n, 4) that a curve can be drawn through: both ends, and none twice in a row."""
    return _distinct(_chords(positions, quaternions) / np.repeat([limits.speed, limits.angular_speed], 3))


@dataclass(frozen=True)
class MotionCurve:
    """Cubic Hermite segments between poses; the parameter u [s] is a time in which no limit of speed is exceeded.

    On a segment of length h, at s in [0, 1], with chord c (a difference of positions or a rotation vector) and tangents
    m0, m1 times h: y(s) = (3 s^2 - 2 s^3) c + (s - 2 s^2 + s^3) m0 + (s^3 - s^2) m1; the position is x_i + y(s), the
    orientation exp(y(s)) q_i.

    Attributes
    ----------
    knots : (n,) u [s], increasing. positions : (n, 3) [m]. quaternions : (n, 4) in one hemisphere along the curve.
    chords : (n - 1, 6) translation [m] and rotation vector [rad, base frame] of each segment.
    tangents : (n, 6) derivative with respect to u: velocity [m/s] and angular velocity [rad/s, base frame].
    """

    knots: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray
    chords: np.ndarray
    tangents: np.ndarray

    @classmethod
    def through(
        cls, positions: np.ndarray, quaternions: np.ndarray, limits: MotionLimits, initial: np.ndarray | None = None
    ) -> MotionCurve:
        """The curve through distinct poses (n, 3), (n, 4); `initial` (6,) is the direction of motion it begins with.

        Tangents are those of the parabola through three successive poses (Bessel's), so a corner is rounded within the
        two segments that meet there.
        """
        chords = _chords(positions, quaternions)
        # Smooth where a maximum of both would have a kink; never less than the slower of both takes.
        scale = np.repeat([limits.speed, limits.angular_speed], 3)
        steps = np.maximum(np.linalg.norm(chords / scale, axis=1), SHORTEST_STEP)
        tangents = _bessel_tangents(chords, steps)
        if initial is not None:
            tangents[0] = initial / np.linalg.norm(initial / scale)
        knots = np.concatenate([[0.0], np.cumsum(steps)])
        return cls(knots, positions, continuous_signs(quaternions), chords, tangents)

    def moved(self, move: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]) -> MotionCurve:
        """The same curve with its poses (n, 3), (n, 4) moved by a rigid motion."""
        origin, _ = move(np.zeros((1, 3)), self.quaternions[:1])
        positions, quaternions = move(self.positions, self.quaternions)

        def turned(pairs: np.ndarray) -> np.ndarray:
            return np.concatenate([move(part, self.quaternions[:1])[0] - origin for part in np.split(pairs, 2, 1)], 1)

        return MotionCurve(self.knots, positions, quaternions, turned(self.chords), turned(self.tangents))

    def pose(self, segment: int, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] and quaternion (4,) at a share in [0, 1] of a segment."""
        position, quaternion = self.positions[segment].copy(), self.quaternions[segment].copy()
        step = self.knots[segment + 1] - self.knots[segment]
        moved = _hermite(share, step, self.chords[segment], self.tangents[segment], self.tangents[segment + 1])
        carry(position, quaternion, moved)
        return position, quaternion

    def velocity(self, segment: int, share: float) -> np.ndarray:
        """Derivative with respect to u, (6,) [m/s], [rad/s], at a share in [0, 1] of a segment."""
        step = self.knots[segment + 1] - self.knots[segment]
        return _hermite_slope(share, step, self.chords[segment], self.tangents[segment], self.tangents[segment + 1])

    def foot(
        self, position: np.ndarray, quaternion: np.ndarray, count: int, metres_per_radian: float
    ) -> tuple[int, float, float, float]:
        """Where a pose is closest to the first `count` segments: segment, share of it, distance [m], angle [rad]."""
        return _foot(
            self.knots, self.positions, self.quaternions, self.chords, self.tangents, position, quaternion, count,
            metres_per_radian,
        )  # fmt: skip

    def from_share(self, segment: int, share: float) -> tuple[MotionCurve, int]:
        """The curve from a share of a segment on, geometrically the same, and how many segments it leaves out."""
        left = (1.0 - share) * (self.knots[segment + 1] - self.knots[segment])
        if left < SHORTEST_STEP and segment + 2 < len(self.knots):
            segment, share = segment + 1, 0.0
        position, quaternion = self.pose(segment, share)
        at = self.knots[segment] + share * (self.knots[segment + 1] - self.knots[segment])
        ahead = slice(segment + 1, None)
        first = chord(position, quaternion, self.positions[segment + 1], self.quaternions[segment + 1])
        return MotionCurve(
            np.concatenate([[0.0], np.maximum(self.knots[ahead] - at, SHORTEST_STEP)]),
            np.concatenate([position[None], self.positions[ahead]]),
            continuous_signs(np.concatenate([quaternion[None], self.quaternions[ahead]])),
            np.concatenate([first[None], self.chords[ahead]]),
            np.concatenate([self.velocity(segment, share)[None], self.tangents[ahead]]),
        ), segment

    def until(self, segment: int, share: float) -> MotionCurve:
        """The beginning of the curve, up to a share of a segment."""
        position, quaternion = self.pose(segment, share)
        upto = slice(None, segment + 1)
        at = self.knots[segment] + max(share * (self.knots[segment + 1] - self.knots[segment]), SHORTEST_STEP)
        last = chord(self.positions[segment], self.quaternions[segment], position, quaternion)
        return MotionCurve(
            np.append(self.knots[upto], at),
            np.concatenate([self.positions[upto], position[None]]),
            continuous_signs(np.concatenate([self.quaternions[upto], quaternion[None]])),
            np.concatenate([self.chords[:segment], last[None]]),
            np.concatenate([self.tangents[upto], self.velocity(segment, share)[None]]),
        )

    def bulges(self) -> tuple[np.ndarray, np.ndarray]:
        """How far [m], [rad] the segments leave their chords, (n - 1,) each.

        y(s) - s c = (s - 2 s^2 + s^3) (m0 - c) + (s^3 - s^2) (m1 - c), and the two factors add up to at most 1/4.
        """
        steps = np.diff(self.knots)[:, None]
        first = (self.tangents[:-1] * steps - self.chords).reshape(-1, 2, 3)
        last = (self.tangents[1:] * steps - self.chords).reshape(-1, 2, 3)
        bulge = 0.25 * np.maximum(np.linalg.norm(first, axis=2), np.linalg.norm(last, axis=2))
        return bulge[:, 0], bulge[:, 1]


@numba.njit(cache=True, nogil=True)
def chord(position: np.ndarray, quaternion: np.ndarray, to: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """Translation [m] and shortest rotation vector [rad, base frame] (6,) from one pose to another."""
    result = np.empty(6)
    for j in range(3):
        result[j] = to[j] - position[j]
    w, x, y, z = turned[0], turned[1], turned[2], turned[3]
    a, b, c, d = quaternion[0], -quaternion[1], -quaternion[2], -quaternion[3]
    cosine = w * a - x * b - y * c - z * d
    result[3] = w * b + x * a + y * d - z * c
    result[4] = w * c - x * d + y * a + z * b
    result[5] = w * d + x * c - y * b + z * a
    sine = math.sqrt(result[3] ** 2 + result[4] ** 2 + result[5] ** 2)
    # The angle is 2 atan(sine / cosine); the sign of the quaternion that is shorter.
    sign = 1.0 if cosine >= 0.0 else -1.0
    scale = sign * (2.0 if sine < 1e-9 else 2.0 * math.atan2(sine, abs(cosine)) / sine)
    for j in range(3, 6):
        result[j] *= scale
    return result


@numba.njit(cache=True, nogil=True)
def _chords(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    result = np.empty((len(positions) - 1, 6))
    for i in range(len(result)):
        result[i] = chord(positions[i], quaternions[i], positions[i + 1], quaternions[i + 1])
    return result


@numba.njit(cache=True, nogil=True)
def _distinct(chords: np.ndarray) -> np.ndarray:
    """For chords (n - 1, 6) that are scaled to seconds."""
    count = len(chords)
    passed = np.empty(count)
    total = 0.0
    for i in range(count):
        squared = 0.0
        for j in range(6):
            squared += chords[i, j] * chords[i, j]
        total += math.sqrt(squared)
        passed[i] = total
    kept = np.zeros(count + 1, dtype=np.int64)
    size, at = 1, 0.0
    for i in range(count):
        if passed[i] - at >= SHORTEST_STEP and total - passed[i] >= SHORTEST_STEP:
            kept[size] = i + 1
            size += 1
            at = passed[i]
    kept[size] = count
    return kept[: size + 1]


@numba.njit(cache=True, nogil=True)
def _bessel_tangents(chords: np.ndarray, steps: np.ndarray) -> np.ndarray:
    count = len(steps)
    tangents = np.empty((count + 1, 6))
    for i in range(1, count):
        before, after = steps[i - 1], steps[i]
        for j in range(6):
            slope = chords[i - 1, j] / before * after + chords[i, j] / after * before
            tangents[i, j] = slope / (before + after)
    for j in range(6):
        if count == 1:
            tangents[0, j] = tangents[1, j] = chords[0, j] / steps[0]
        else:
            tangents[0, j] = 2.0 * chords[0, j] / steps[0] - tangents[1, j]
            tangents[count, j] = 2.0 * chords[count - 1, j] / steps[count - 1] - tangents[count - 1, j]
    return tangents


@numba.njit(cache=True, nogil=True)
def _hermite(s: float, step: float, chord: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    return s * s * (3.0 - 2.0 * s) * chord + s * (1.0 - s) * step * ((1.0 - s) * first - s * last)


@numba.njit(cache=True, nogil=True)
def _hermite_slope(s: float, step: float, chord: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    return 6.0 * s * (1.0 - s) / step * chord + (1.0 - s) * (1.0 - 3.0 * s) * first + s * (3.0 * s - 2.0) * last


@numba.njit(cache=True, nogil=True)
def _closest(
    target: np.ndarray, step: float, chord: np.ndarray, first: np.ndarray, last: np.ndarray, metres_per_radian: float
) -> tuple[float, float, float]:
    """Gauss and Newton's iteration for the share of a segment closest to `target` (6,); share, distance, angle."""
    s = 0.5
    for _ in range(12):
        gap = target - _hermite(s, step, chord, first, last)
        slope = step * _hermite_slope(s, step, chord, first, last)
        along, length = 0.0, 1e-30
        for j in range(6):
            weight = 1.0 if j < 3 else metres_per_radian**2
            along += weight * gap[j] * slope[j]
            length += weight * slope[j] * slope[j]
        before = s
        s = min(1.0, max(0.0, s + along / length))
        if abs(s - before) < 1e-15:
            break
    gap = target - _hermite(s, step, chord, first, last)
    distance = math.sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2])
    return s, distance, math.sqrt(gap[3] * gap[3] + gap[4] * gap[4] + gap[5] * gap[5])


@numba.njit(cache=True, nogil=True)
def _foot(
    knots: np.ndarray,
    positions: np.ndarray,
    quaternions: np.ndarray,
    chords: np.ndarray,
    tangents: np.ndarray,
    position: np.ndarray,
    quaternion: np.ndarray,
    count: int,
    metres_per_radian: float,
) -> tuple[int, float, float, float]:
    """`MotionCurve.foot`: on the segment whose chord is nearest, or one of those beside it."""
    near, least = 0, np.inf
    for i in range(count):
        away = _from_chord(position, positions[i], chords[i]) + metres_per_radian * _turned(quaternion, quaternions[i])
        if away < least:
            near, least = i, away
    segment, share, distance, angle = near, 0.0, np.inf, np.inf
    for i in range(max(0, near - 1), min(count, near + 2)):
        target = chord(positions[i], quaternions[i], position, quaternion)
        s, off, turned = _closest(
            target, knots[i + 1] - knots[i], chords[i], tangents[i], tangents[i + 1], metres_per_radian
        )
        if off + metres_per_radian * turned < distance + metres_per_radian * angle - 1e-12:
            segment, share, distance, angle = i, s, off, turned
    return segment, share, distance, angle


@numba.njit(cache=True, nogil=True)
def _from_chord(point: np.ndarray, begin: np.ndarray, chord: np.ndarray) -> float:
    """Distance [m] of a point (3,) from where a chord leads straight on from its beginning."""
    along, squared = 0.0, 1e-18
    for j in range(3):
        along += (point[j] - begin[j]) * chord[j]
        squared += chord[j] * chord[j]
    share, result = min(1.0, max(0.0, along / squared)), 0.0
    for j in range(3):
        result += (begin[j] + share * chord[j] - point[j]) ** 2
    return math.sqrt(result)


@numba.njit(cache=True, nogil=True)
def _turned(first: np.ndarray, second: np.ndarray) -> float:
    """`quaternions.angle_between` for two of them, (4,) each."""
    minus, plus = 0.0, 0.0
    for j in range(4):
        minus += (first[j] - second[j]) ** 2
        plus += (first[j] + second[j]) ** 2
    return 4.0 * math.asin(min(0.5 * math.sqrt(min(minus, plus)), math.sqrt(0.5)))
