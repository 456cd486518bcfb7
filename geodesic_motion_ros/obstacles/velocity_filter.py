"""Where an obstacle is and how fast it moves, out of its noisy detections; knows nothing of ROS.

The motion is the straight line p(t) = c + v (t - m) that fits n detections p_i, at times t_i with mean m, best (least
squares), as in any textbook of regression. With S = sum (t_i - m)^2 and noise of a standard deviation sigma in each
axis of each detection (`detection_noise.py`)

    c = mean p_i,  v = sum (t_i - m) p_i / S,  var v = sigma^2 / S,  var p(t) = sigma^2 (1 / n + (t - m)^2 / S)

in each axis: over a time T, S is n T^2 / 12, and the velocity the quieter the longer the line, by T^1.5. So detections
count from as long ago on as one straight line explains them. Cut in two, with a line for each part, which are six
numbers more, n detections of one line leave less squares by sigma^2 chi^2 of six degrees. Where that is more than
`BREAK` sigma^2 the obstacle has turned, started or stopped, and the line begins with what came after.

How long after it that is noticed, and how long until the velocity is first right within 20 % [s]: medians of 30 runs,
nine tenths in brackets, 5 % of the detections lost. What moves at 0.1 m/s is hardly known to move there before, and
what stops has come to a stand when its slope is not significant any more:

    noise, rate    m/s  noticed: starts  turns by 90 degrees  right: starts  turns        stops
    1 cm, 30 Hz    0.3  0.20 (0.23)      0.13 (0.17)          0.30 (0.43)    0.27 (0.37)  0.20 (0.24)
    1 cm, 30 Hz    0.1  0.43 (0.60)      0.37 (0.37)          0.63 (0.87)    0.60 (0.90)  0.47 (0.57)
    1 mm, 60 Hz    0.3  0.03 (0.03)      0.02 (0.03)          0.12 (0.12)    0.13 (0.13)  0.15 (0.34)
    1 mm, 60 Hz    0.1  0.07 (0.08)      0.05 (0.07)          0.15 (0.20)    0.18 (0.23)  0.29 (0.59)

What turns too slowly for that is larger instead: by what the velocities of the older and the newer half of its line
differ beyond noise.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from copy import copy
from operator import add, sub

from geodesic_motion_ros.geometry.vectors import Vector, added
from geodesic_motion_ros.obstacles.detection_noise import DetectionNoise
from geodesic_motion_ros.obstacles.velocity_history import CHANGE_FACTOR, VelocityBounds, VelocityHistory

#: Detections of this last time [s] count, two of them at least; of exact ones (`DetectionNoise`) these alone.
SHORTEST = 0.15
#: Those of longer ago [s] do not count: of what moves, which may turn too slowly to be noticed, and of what does not.
LONGEST, LONGEST_STANDING = 2.0, 6.0
#: What is faster [m/s] moves; of what is slower the velocity may be noise.
MOVING = 0.02
#: Noise alone makes 36 of one cut in 360000: of six cuts thirty times a second in half an hour, were each by itself.
#: That is what this is where the noise was found 14 % too small, which it is once in a few minutes.
BREAK = 49.0
#: So many standard deviations bound the errors of place and velocity, in 97 % of all cases (chi^2, three axes). What
#: moves, with a slope within that, has come to a stand.
BOUND = 3.0
#: What stands begins to move with a slope of more than so many: noise alone makes that once in 65000.
SIGNIFICANT = 5.0
#: After a gap longer than this [s], nobody knows what happened meanwhile.
LONGEST_GAP = 0.5
#: Nothing near an arm is faster [m/s]: what is farther off, and by more than so much [m], is at another place.
FASTEST, SAME_PLACE = 3.0, 0.1
#: Times that differ by less [s] are of one instant: a stamp is compared by two clocks, read one after the other.
SAME_INSTANT = 0.001
# Where detections are exact, what is less [m] is rounding: sums count from an origin that is renewed so often [s].
_ROUNDING, _RENEWED = 1e-8, 6.0
_AT_REST = (0.0, 0.0, 0.0)

# Over some detections, of times and positions from one origin: how many, and the sums of t, t^2, p (3) and t p (3).
Sums = tuple[float, ...]
_NOTHING: Sums = (0.0,) * 9


class ObstacleMotion:
    """Place and velocity of one obstacle.

    An obstacle whose slope is not significant stands, at the mean of its detections. It may all the same drift, too
    slowly to be known: with 1 cm of noise at 30 Hz by 7 cm/s after half a second, 2.5 cm/s after one and 5 mm/s after
    three. Where that has brought it until now is within the bound of a line, which is therefore taken in the place of
    that of a mean, half as large; over a prediction it does not count, or nothing would ever stand. It stands too at
    its first detection, and again after a gap, a jump, or a clock that was set back. Exact detections are taken as they
    are.

    Attributes
    ----------
    place : (3,) [m] at the newest detection.
    place_error : bound of the error of that [m], 0 for exact detections.
    velocity : (3,) [m/s], zero for what stands.
    noise : of its detections.
    """

    def __init__(self, known_noise: float = 0.0, least_noise: float = 0.0) -> None:
        """known_noise, least_noise : as of `DetectionNoise`."""
        self.noise = DetectionNoise(known_noise, least_noise)
        self.place = self.velocity = _AT_REST
        self.place_error = self._velocity_error = 0.0
        self._begin_again()

    def _begin_again(self) -> None:
        # Time [s] and position [m] of each detection that may count, and the sums over those before it; over all.
        self._seen: list[tuple[float, Vector, Sums]] = []
        self._sums = _NOTHING
        self._origin = -math.inf, _AT_REST
        self._history = VelocityHistory()
        self.noise.begin_again()

    def see(self, centre: Vector, time: float) -> None:
        """Take the newest detection [m], of `time` [s] of one clock."""
        if self._seen:
            before = self._seen[-1][0]
            if abs(time - before) < SAME_INSTANT:
                time = before
            if not (0.0 <= time - before <= LONGEST_GAP and self.is_reached(centre, time)):
                self._begin_again()
        if self._seen and time == self._seen[-1][0]:
            self._sums = self._seen.pop()[2]
        else:
            self.noise.see(centre, time)
        if time - self._origin[0] > _RENEWED:
            kept, self._seen, self._sums, self._origin = self._seen, [], _NOTHING, (time, centre)
            for earlier, place, _ in kept:
                self._add(place, earlier)
        self._add(centre, time)
        self._history.see(centre, time)
        self._fit()

    def moved(self, shift: Vector) -> ObstacleMotion:
        """Make the motion of what has moved as this has, but was elsewhere, by a shift (3,) [m]."""
        other = copy(self)
        other.noise = self.noise.moved(shift)
        begin, origin = self._origin
        other._origin, other.place = (begin, added(origin, shift)), added(self.place, shift)
        other._seen = [(time, added(place, shift), sums) for time, place, sums in self._seen]
        other._history = self._history.moved(shift)
        return other

    @property
    def moves(self) -> bool:
        return math.hypot(*self.velocity) > MOVING

    @property
    def error(self) -> float:
        """Bound of the error of the velocity [m/s]: of the line, and by how it has changed in the last two seconds."""
        return self._velocity_error + self._history.error(self.velocity, self.noise.deviation)

    @property
    def bounds(self) -> VelocityBounds:
        """`error`, in two parts where the velocity has changed along its direction alone."""
        along, across = self._history.bounds(self.velocity, self.noise.deviation)
        return VelocityBounds(along, across + self._velocity_error)

    @property
    def newest(self) -> tuple[Vector, float]:
        """The newest detection (3,) [m], and its time [s]."""
        time, centre, _ = self._seen[-1]
        return centre, time

    def is_reached(self, centre: Vector, time: float) -> bool:
        """Whether a velocity explains that it is detected there (3,) [m] at a time [s]."""
        last, before = self.newest
        return math.dist(centre, last) <= max(FASTEST * abs(time - before), SAME_PLACE) + self.noise_bound

    def is_at(self, centre: Vector, time: float) -> bool:
        """Whether it is expected there (3,) [m] at a time [s]."""
        return self.distance(centre, time) <= SAME_PLACE + self.noise_bound

    def distance(self, centre: Vector, time: float) -> float:
        """How far a detection (3,) [m] at a time [s] is from where it is expected, or from the last one [m]."""
        return min(math.dist(centre, self.expected(time)), math.dist(centre, self.newest[0]))

    def expected(self, time: float) -> Vector:
        """Return where it is expected (3,) [m] at a time [s] that is not before the newest detection."""
        passed = max(0.0, time - self.newest[1])
        x, y, z = (p + passed * v for p, v in zip(self.place, self.velocity, strict=True))
        return x, y, z

    @property
    def noise_bound(self) -> float:
        """How far apart noise alone makes two detections of one place [m]."""
        return math.sqrt(2.0 * BREAK) * self.noise.deviation

    def _add(self, centre: Vector, time: float) -> None:
        self._seen.append((time, centre, self._sums))
        begin, (a, b, c) = self._origin
        t, x, y, z = time - begin, centre[0] - a, centre[1] - b, centre[2] - c
        self._sums = tuple(map(add, self._sums, (1.0, t, t * t, x, y, z, t * x, t * y, t * z)))

    def _fit(self) -> None:
        time, detected, _ = self._seen[-1]
        deviation = self.noise.deviation
        first = self._first(deviation)
        count, middle, spread, mean, along = _line(self._over(first))
        velocity_deviation = max(deviation, _ROUNDING) / math.sqrt(spread)
        velocity = along[0] / spread, along[1] / spread, along[2] / spread
        significant = BOUND if any(self.velocity) else SIGNIFICANT
        stands = math.hypot(*velocity) <= significant * velocity_deviation
        self.velocity = _AT_REST if stands else velocity
        begin, origin = self._origin
        since = time - begin - middle
        self.place, self.place_error, self._velocity_error = detected, 0.0, 0.0
        if deviation:
            x, y, z = (o + p + since * v for o, p, v in zip(origin, mean, self.velocity, strict=True))
            self.place = x, y, z
            self.place_error = BOUND * math.hypot(deviation / math.sqrt(count), since * velocity_deviation)
            self._velocity_error = 0.0 if stands else BOUND * velocity_deviation
            self._allow_for_turn(deviation)

    def _allow_for_turn(self, deviation: float) -> None:
        """Enlarge the errors of what turns too slowly to begin a new line: older and newer half have other velocities.

        At a constant acceleration a over the time T of the line these differ by a T / 2, and the line's end is off by
        a T^2 / 12: by T / 6 of the difference.
        """
        half = len(self._seen) // 2
        if half < 2 or not self.moves:
            return
        older, newer = _line(self._over(0, half)), _line(self._over(half))
        velocities = [[along / spread for along in line] for _, _, spread, _, line in (older, newer)]
        noise = BOUND * deviation * math.sqrt(1.0 / older[2] + 1.0 / newer[2])
        turned = max(0.0, math.dist(*velocities) - noise)
        self.place_error += turned * (self._seen[-1][0] - self._seen[0][0]) / 6.0
        self._velocity_error += min(CHANGE_FACTOR * turned, math.hypot(*self.velocity))

    def _over(self, first: int, end: int | None = None) -> Sums:
        """Sums over the detections from the first one on, before the end."""
        return tuple(map(sub, self._sums if end is None else self._seen[end][2], self._seen[first][2]))

    def _first(self, deviation: float) -> int:
        """The first detection of those that count; what is of longer ago than any may count is forgotten."""
        seen, newest = self._seen, self._seen[-1][0]
        latest = max(0, min(bisect_left(seen, (newest - SHORTEST,)), len(seen) - 2))
        longest = LONGEST if self.moves else LONGEST_STANDING
        first = min(bisect_left(seen, (newest - longest,)), latest)
        if deviation:
            first = min(self._after_change(first, BREAK * deviation**2), latest)
        del seen[:first]
        # Exact ones of long ago are kept: noise is not known at once.
        return 0 if deviation else latest - first

    def _after_change(self, first: int, least: float) -> int:
        """Where a second line begins, among the detections from the first one on, if two leave less squares than one by
        more than the least [m^2]; else the first one. Cuts are tried 2, 4, 8 ... detections ago.
        """
        begin, one, end, count = first, _explained(self._over(first)), len(self._seen), 2
        while count <= end - first - 2:
            cut = end - count
            gain = _explained(self._over(first, cut)) + _explained(self._over(cut)) - one
            if gain > least:
                least, begin = gain, cut
            count *= 2
        return begin


def _line(sums: Sums) -> tuple[float, float, float, Vector, Vector]:
    """n, the mean time m [s], S [s^2], the mean position [m], and sum (t - m) p [m s], of sums over detections."""
    n, t, tt, x, y, z, tx, ty, tz = sums
    m = t / n
    # Of one detection alone no velocity is known.
    return n, m, (tt - m * t) if n > 1 else math.inf, (x / n, y / n, z / n), (tx - m * x, ty - m * y, tz - m * z)


def _explained(sums: Sums) -> float:
    """How much less squares [m^2] a line leaves than the origin: n c^2 + S v^2."""
    n, _, spread, (x, y, z), (a, b, c) = _line(sums)
    return n * (x * x + y * y + z * z) + (a * a + b * b + c * c) / spread
