"""How fast an obstacle moves, out of the positions it was seen at; knows nothing of ROS."""

from __future__ import annotations

import math

from geodesic_motion_ros.velocity_history import VelocityHistory

Point = tuple[float, float, float]

# Positions of this last time [s] count: noise of 1 mm (standard deviation, each axis) at 60 Hz makes 11 mm/s (rms), and
# a change of velocity is noticed half as much later.
WINDOW = 0.15
# After a gap longer than this [s], nobody knows what happened meanwhile.
LONGEST_GAP = 0.5
# Nothing near an arm is faster [m/s]: it is another object under the same name.
FASTEST = 3.0
# Times of arrival are this uncertain [s]: over less, no speed is told from two positions.
SHORTEST_INTERVAL = 0.01
#: Times that differ by less [s] are of one instant: a stamp is compared by two clocks, read one after the other.
SAME_INSTANT = 0.001


class ObstacleVelocity:
    """Velocity of one obstacle: the slope of the straight line that fits its last positions best (least squares).

    With times t_i and positions p_i of the last `WINDOW` seconds, two of them at least, the velocity is
    sum (t_i - mean t) p_i / sum (t_i - mean t)^2. It is zero for the first position, and again after a gap, a jump, or
    a clock that was set back.
    """

    def __init__(self) -> None:
        self._seen: list[tuple[float, Point]] = []
        self._history = VelocityHistory()

    def see(self, centre: Point, time: float) -> None:
        """Take the newest position [m], seen at `time` [s] of one clock."""
        if self._seen and abs(time - self._seen[-1][0]) < SAME_INSTANT:
            time = self._seen[-1][0]
        if self._seen and not self._continues(centre, time):
            self._seen, self._history = [], VelocityHistory()
        if self._seen and time == self._seen[-1][0]:
            self._seen.pop()
        self._seen.append((time, centre))
        while len(self._seen) > 2 and self._seen[0][0] < time - WINDOW:
            del self._seen[0]
        self._history.see(centre, time)

    @property
    def known(self) -> bool:
        """Whether positions tell a velocity; without one it is zero."""
        return len(self._seen) > 1

    @property
    def velocity(self) -> Point:
        """[m/s] at the newest position."""
        if not self.known:
            return 0.0, 0.0, 0.0
        # Relative to the newest: differences of large times and positions would lose digits.
        now, (x, y, z) = self._seen[-1]
        middle = sum(time - now for time, _ in self._seen) / len(self._seen)
        along_x = along_y = along_z = spread = 0.0
        for time, point in self._seen:
            weight = time - now - middle
            along_x += weight * (point[0] - x)
            along_y += weight * (point[1] - y)
            along_z += weight * (point[2] - z)
            spread += weight * weight
        return along_x / spread, along_y / spread, along_z / spread

    @property
    def error(self) -> float:
        """Bound of the error of that [m/s], by how it has changed in the last two seconds."""
        return self._history.error(self.velocity)

    def _continues(self, centre: Point, time: float) -> bool:
        before, last = self._seen[-1]
        elapsed = time - before
        return 0.0 <= elapsed <= LONGEST_GAP and math.dist(centre, last) <= FASTEST * max(elapsed, SHORTEST_INTERVAL)
