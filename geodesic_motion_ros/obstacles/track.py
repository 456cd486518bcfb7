"""Track: the state of one obstacle, estimated from its messages: where it is, and where it may be once none arrive.

Times are on the clock of `tracker`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from geodesic_motion_ros.geometry.vectors import Vector
from geodesic_motion_ros.obstacles.velocity_filter import SAME_INSTANT, ObstacleMotion

# What was taken up to so long [s] before the newest was overtaken by it; further back, the sender's clock was set back,
# and so it was where so many in a row go on behind the newest, one after the other.
REORDER_WINDOW, _GOING_ON = 1.0, 3

# What moves and is not published again for so long [s] may have come to a stand anywhere since: at places that are so
# far apart [m] at most, each enlarged so that nothing between them is left out, but no more than so many.
MOTION_LASTS, _APART, _MOST_PLACES = 0.3, 0.05, 16
# Until it is published again the stretch grows every so often [s], up to what it comes to in so long [s].
UNCERTAINTY_GROWTH_PERIOD, UNCERTAINTY_GROWTH_TIME = 0.05, 2.0
# What stands is published larger by this share of the noise of one detection, so that it can stay as it is.
_SLACK = 0.25
# What was in transit for longer [s] tells nothing of now, or two clocks do not agree: nothing is expected to have moved
# on meanwhile. With clocks that do not agree, a prediction would put obstacles where they never were.
LONGEST_TRANSIT = 1.0


class MessageOrder:
    """Which of the messages about one thing were overtaken, by when they were taken [s]."""

    def __init__(self) -> None:
        self._newest = self._behind = -math.inf
        self._count = 0

    def register(self, taken: float) -> bool:
        """Register a message by when it was taken; returns whether it was overtaken, and is to be ignored."""
        behind = self._newest - taken
        if not SAME_INSTANT <= behind < REORDER_WINDOW:
            self._newest, self._count = (self._newest if 0.0 < behind < SAME_INSTANT else taken), 0
            return False
        self._count = self._count + 1 if taken > self._behind else 1
        self._behind = taken
        if self._count < _GOING_ON:
            return True
        self._newest, self._count = taken, 0
        return False


class Place(NamedTuple):
    """Where an obstacle may be, and how it may move on.

    Attributes
    ----------
    centre, radius, solid : as of `Track`.
    velocity, error : (3,) [m/s], and a bound of its error [m/s].
    since : when it was there [s].
    """

    centre: Vector
    radius: float
    solid: np.ndarray | None
    velocity: Vector
    error: float
    since: float


@dataclass
class Track:
    """The estimated state of one obstacle: its shape and place by the newest message, and its motion by all of them.

    Attributes
    ----------
    centre, radius : (3,), [m]; solid : (16,) row of a solid, as of `geometry/shapes.py`, whose radius then counts.
    arrival, taken : when the update arrived, and when its data were taken [s]. expires : when it vanishes [s].
    """

    centre: tuple[float, float, float]
    radius: float
    arrival: float
    taken: float
    expires: float
    solid: np.ndarray | None = None
    motion: ObstacleMotion = field(default_factory=ObstacleMotion)

    @property
    def moves(self) -> bool:
        """Whether its updates say that it moves."""
        return self.motion.moves

    @property
    def since(self) -> float:
        """When it was where it was published to be, as far as its motion goes."""
        return self.taken if self.arrival - self.taken <= LONGEST_TRANSIT else self.arrival

    def placed(self, before: Track | None) -> Track:
        """Where it is by its motion, out of where it was detected.

        What stands keeps the place where it was published, as long as that contains the new one and is larger by twice
        `_SLACK` at most: a planner goes on with a search among what does not change.
        """
        motion = self.motion
        if not motion.place_error:
            return self
        stands = not any(motion.velocity)
        placed = self._moved(np.subtract(motion.place, self.centre), motion.place_error)
        if not stands:
            return placed
        if before is not None and before.covers(placed, 2.0 * _SLACK * motion.noise.deviation):
            return replace(self, centre=before.centre, radius=before.radius, solid=before.solid)
        return placed._moved(np.zeros(3), _SLACK * motion.noise.deviation)

    def covers(self, other: Track, by: float) -> bool:
        """Whether it contains another and is larger by so much [m] at most."""
        off = math.dist(self.centre, other.centre)
        if self.solid is None or other.solid is None:
            return self.solid is other.solid and off <= self.radius - other.radius <= by
        # A point of a box is off by what the extents are off, and by what the rotation turns it: both singular values
        # of the difference of two rotations that are not zero are the same.
        turned = math.sqrt(0.5) * np.linalg.norm(self.solid[7:] - other.solid[7:])
        extents = np.linalg.norm(self.solid[3:6] - other.solid[3:6]) + turned * np.linalg.norm(other.solid[3:6])
        off += float(extents)
        return off <= self.solid[6] - other.solid[6] <= by

    def places(self, now: float, most: int) -> list[Place]:
        """Where it may be: one place for each velocity at which it may move on, at most so many, and, once it is not
        published any more, places where it may have come to a stand since it was last seen.
        """
        velocities = self.motion.bounds.velocities(self.motion.velocity, most)
        moving = [Place(self.centre, self.radius, self.solid, *each, self.since) for each in velocities]
        if not self.doubted(now):
            return moving
        passed = min(now + UNCERTAINTY_GROWTH_PERIOD - self.since, UNCERTAINTY_GROWTH_TIME)
        reach, grown = passed * np.array(self.motion.velocity), passed * self.motion.error
        length = float(np.linalg.norm(reach))
        count = min(2 + int(length / _APART), _MOST_PLACES)
        half = 0.5 * length / (count - 1)
        return moving + [self._standing(share * reach, half, share * grown) for share in np.linspace(0.0, 1.0, count)]

    def doubted(self, now: float) -> bool:
        """Whether it moved and has not been published for too long."""
        return now >= self.arrival + MOTION_LASTS and self.moves

    def changes(self, now: float) -> float:
        """When `places` changes by itself [s], inf for never."""
        if not self.moves:
            return math.inf
        if not self.doubted(now):
            return self.arrival + MOTION_LASTS
        return now + UNCERTAINTY_GROWTH_PERIOD if now < self.since + UNCERTAINTY_GROWTH_TIME else math.inf

    def _standing(self, shift: np.ndarray, half: float, grown: float) -> Place:
        """Where it stands after a shift (3,) [m], enlarged by half of the distance to the next place [m] and by how far
        off its line it may be there [m].
        """
        there = self._moved(shift, half + grown)
        radius = math.hypot(self.radius + grown, half)
        return Place(there.centre, radius, there.solid, (0.0, 0.0, 0.0), 0.0, self.since)

    def _moved(self, shift: np.ndarray, by: float) -> Track:
        """After a shift (3,) [m], and larger by so much [m]."""
        solid = None if self.solid is None else self.solid.copy()
        if solid is not None:
            solid[:3] += shift
            solid[6] += by
        return replace(self, centre=tuple((self.centre + shift).tolist()), radius=self.radius + by, solid=solid)
