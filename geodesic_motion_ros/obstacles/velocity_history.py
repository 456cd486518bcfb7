"""How far the velocity of an obstacle may be off, by how it has changed of late.

An obstacle that moves straight on is expected to go on so. One that has turned, started or changed its speed may do so
again, and meet an arm that passes it on its straight line: in the prediction it is enlarged with time, by a multiple of
what its velocity has changed, and no faster than it has moved of late. One that has sped up or slowed down on a
straight line may do so again, but hardly leaves the line: it is expected at several velocities along it, and enlarged
by less, so that an arm finds room beside the line. Changes that may come from noise of the detected positions do not
count. One that begins to move, or turns for the first time, or stops for a moment, is not foreseen.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from geodesic_motion_ros.geometry.vectors import Vector, added

#: Positions are compared every so often [s], over so long [s].
INTERVAL, MEMORY = 0.1, 2.0
#: The velocity of an obstacle is expected to change by up to so many times what it has changed.
CHANGE_FACTOR = 4.0
#: Changes of the velocity [m/s] up to so many times the noise of a position [m] (standard deviation, each axis) may
#: come from that alone: of the velocities of `obstacles/velocity_filter.py` 98 % of them do, from 10 to 60 a second.
NOISE_FACTOR = 25.0
#: Velocities along a line differ by no more than twice this [m/s], where there may be so many.
APART = 0.03


class VelocityBounds(NamedTuple):
    """Bounds of the error of a velocity in a prediction [m/s]: along its direction, and to every side."""

    along: float
    across: float

    def velocities(self, velocity: Vector, most: int) -> list[tuple[Vector, float]]:
        """Velocities (3,) [m/s], each with a bound of its error to every side [m/s], that cover the bounds together; at
        most so many.
        """
        if not self.along:
            return [(velocity, self.across)]
        speed = math.hypot(*velocity)
        count = max(1, min(math.ceil(self.along / max(self.across, APART)), most))
        half = self.along / count
        factors = (1.0 + half * (2 * i + 1 - count) / speed for i in range(count))
        error = math.hypot(half, self.across)
        return [((f * velocity[0], f * velocity[1], f * velocity[2]), error) for f in factors]


class VelocityHistory:
    """Bounds the error of one obstacle's velocity by how that has changed in the last two seconds.

    Example
    -------
    >>> history = VelocityHistory()
    >>> history.see(centre, time)  # every time that it is detected
    >>> history.error(velocity)  # [m/s], 0 as long as it moves straight on
    """

    def __init__(self) -> None:
        # The newest four positions, and of every four in a row when they begin, and the mean velocity over them.
        self._positions: deque[tuple[float, Vector]] = deque(maxlen=4)
        self._means: deque[tuple[float, Vector]] = deque()
        # The newest position of all, and the velocity from the one before to it.
        self._newest: tuple[float, Vector] | None = None
        self._at_last: Vector = (0.0, 0.0, 0.0)

    def see(self, position: Vector, time: float) -> None:
        """Take a position (3,) [m] at a time [s] that is not before the last."""
        if self._newest is not None and time > self._newest[0]:
            self._at_last = _velocity(self._newest[1], position, time - self._newest[0])
        self._newest = time, position
        positions = self._positions
        if positions and time < positions[-1][0] + INTERVAL - 1e-6:
            return
        positions.append((time, position))
        if len(positions) == 4:
            begin, first = positions[0]
            self._means.append((begin, _velocity(first, position, time - begin)))
        while self._means and self._means[0][0] < time - MEMORY - 1e-6:
            self._means.popleft()

    def moved(self, shift: Vector) -> VelocityHistory:
        """Make the history of what has moved as this has, but was elsewhere, by a shift (3,) [m]."""
        other = VelocityHistory()
        for time, place in self._positions:
            other._positions.append((time, added(place, shift)))
        other._means = self._means.copy()
        other._newest = None if self._newest is None else (self._newest[0], added(self._newest[1], shift))
        other._at_last = self._at_last
        return other

    def error(self, velocity: Vector, noise: float = 0.0) -> float:
        """Bound e [m/s] of the error of the present velocity v (3,) [m/s] in a prediction.

        e = min(CHANGE_FACTOR max(0, c - NOISE_FACTOR noise), f), where c is the largest distance of v from its means
        over three intervals within the memory, and f the fastest that the obstacle has been then: where it turns back
        its velocity is next to none, and changes most. What stands, with no velocity at all, has no error. An estimate,
        no guarantee: who stands may start.

        noise : standard deviation of a position in each axis [m].
        """
        if not any(velocity):
            return 0.0
        change = max((math.dist(mean, velocity) for _, mean in self._means), default=0.0)
        return self._bounded(change, velocity, noise)

    def _bounded(self, change: float, velocity: Vector, noise: float) -> float:
        # The last two detections show a new speed at once, where they are exact.
        last = math.hypot(*self._at_last) if noise == 0.0 else 0.0
        fastest = max(math.hypot(*velocity), last, *(math.hypot(*mean) for _, mean in self._means))
        return min(CHANGE_FACTOR * max(0.0, change - NOISE_FACTOR * noise), fastest)

    def bounds(self, velocity: Vector, noise: float = 0.0) -> VelocityBounds:
        """`error` in two parts: along the present velocity, where it is its speed that has changed, and across it. Each
        is worked out as `error`, of the parts of the changes in its direction.
        """
        if not any(velocity):
            return VelocityBounds(0.0, 0.0)
        speed = math.hypot(*velocity)
        along = across = 0.0
        for _, mean in self._means:
            change = velocity[0] - mean[0], velocity[1] - mean[1], velocity[2] - mean[2]
            part = abs(sum(c * v for c, v in zip(change, velocity, strict=True))) / speed
            along, across = max(along, part), max(across, math.sqrt(max(0.0, math.hypot(*change) ** 2 - part**2)))
        along, across = (self._bounded(change, velocity, noise) for change in (along, across))
        if along <= 2.0 * max(across, APART):
            return VelocityBounds(0.0, self.error(velocity, noise))
        return VelocityBounds(along, across)


def _velocity(begin: Vector, end: Vector, duration: float) -> Vector:
    return (end[0] - begin[0]) / duration, (end[1] - begin[1]) / duration, (end[2] - begin[2]) / duration
