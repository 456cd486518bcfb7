"""ClusterTracks: which clusters of a cloud are those of the clouds before, and how they move.

A cluster is an obstacle as a marker is, with the velocity of `velocity_filter.py`, but of a few spheres. It has no
name, so it goes on with the one whose place is nearest of those that a velocity explains, and that were about as large.

What the arm, or something else, hides of it makes it smaller, and moves the middle of what is left, which is no motion.
So its size is the largest of the last `SIZE_MEMORY`, and where it is smaller along an axis one of its two sides counts
as seen: the one that puts its middle nearer to where it is expected. Its spheres stay as they are while they hold what
is seen. What is not seen at all any more moves on for a moment.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence

import numpy as np

from geodesic_motion_ros.geometry.clusters import Cluster
from geodesic_motion_ros.geometry.line_of_sight import LineOfSight
from geodesic_motion_ros.obstacles.track import Place, Track
from geodesic_motion_ros.obstacles.tracked_obstacle import TrackedObstacle
from geodesic_motion_ros.obstacles.velocity_history import Vector

#: A cluster is as large as it was at any time for so long [s].
SIZE_MEMORY = 2.0
#: What differs by more between two clouds in a half extent [m] is another one: two that met, or have parted.
SAME_SIZE = 0.03
#: By so much [m] a half extent changes with the noise of a camera and the steps of its pixels.
STEADY_SIZE = 0.01
#: What has grown by more than this [m] in a half extent was seen in part before.
GROWN = 0.02
#: Spheres hold others that stick out by no more than this [m], which noise does.
STEADY_SPHERE = 0.005
#: Spheres of what stands are replaced by ones with less than this share of their volume.
SMALLER = 0.85
#: What is hidden wholly goes on as it did for so long [s] at most.
HIDDEN = 2.0
#: Noise of a middle [m] until it is known from the detections.
_FIRST_NOISE = 0.002


class _Thing:
    """One cluster over time."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.obstacle = TrackedObstacle()
        # When it was seen, and half extents (3,) [m] then.
        self._sizes: deque[tuple[float, Vector]] = deque()
        # Spheres (k, 4) around the place [m], the radius that holds them all, and when they were seen [s].
        self._spheres, self._radius, self._spheres_seen = np.zeros((0, 4)), 0.0, -math.inf
        self.stands = False
        self.seen = -math.inf

    def expected(self, time: float) -> Vector:
        """Where it is expected (3,) [m] at a time [s]."""
        motion = self.obstacle.newest.motion
        passed = max(0.0, time - motion.newest[1])
        x, y, z = (p + passed * v for p, v in zip(motion.place, motion.velocity, strict=True))
        return x, y, z

    @property
    def moves(self) -> bool:
        """Whether it has a velocity that counts."""
        return not self.stands and self.obstacle.newest.moves

    def mismatch(self, cluster: Cluster, time: float) -> float:
        """How far a cluster at a time [s] is from where this one is expected [m]; inf where it is another one."""
        motion = self.obstacle.newest.motion
        last = self._sizes[-1][1]
        # What is remembered of where it was is not this one.
        if cluster.stands and self.moves:
            return math.inf
        if any(abs(a - b) > SAME_SIZE for a, b in zip(cluster.half, last, strict=True)):
            return math.inf
        return motion.distance(cluster.centre, time) if motion.is_reached(cluster.centre, time) else math.inf

    def see(self, cluster: Cluster, around: float, arrival: float, taken: float, time: float, noise: float) -> None:
        """Take a detection; around : radius of every point [m]. Times as of `ClusterTracks.replace`."""
        while self._sizes and self._sizes[0][0] < time - SIZE_MEMORY:
            self._sizes.popleft()
        centre = self._placed(cluster, time)
        if self._sizes and min(self._hidden(cluster)) < -GROWN:
            # A part of it was seen before, and the middle of that tells nothing of how the whole moves.
            self.obstacle = TrackedObstacle()
        self._sizes.append((time, cluster.half))
        place = np.zeros(3) if cluster.stands else np.array(centre)
        spheres = cluster.spheres - np.array([*place, -around])
        same = cluster.stands == self.stands and time <= self._spheres_seen + SIZE_MEMORY
        if cluster.stands:
            # Another cut is no news, but where it is smaller, for what is hidden is remembered.
            same &= np.sum(spheres[:, 3] ** 3) > SMALLER * np.sum(self._spheres[:, 3] ** 3)
        points = np.column_stack([cluster.points - place, np.full(len(cluster.points), around)])
        if not (same and _hold(self._spheres, points if cluster.stands else spheres)):
            self._spheres, self._spheres_seen, self.stands = spheres, time, cluster.stands
            self._radius = float(np.max(np.linalg.norm(spheres[:, :3], axis=1) + spheres[:, 3]))
        self.obstacle.see(Track(centre, self._radius, arrival, taken, math.inf), time, noise)
        self.seen = arrival

    def places(self, now: float, most: int) -> Iterator[Place]:
        """Where each of its spheres may be; most : as of `Track.places`."""
        if self.stands:
            for x, y, z, radius in self._spheres.tolist():
                yield Place((x, y, z), radius, None, (0.0, 0.0, 0.0), 0.0, self.obstacle.newest.since)
            return
        for place in self.obstacle.places(now, max(1, most // len(self._spheres))):
            larger = place.radius - self._radius
            for x, y, z, radius in self._spheres.tolist():
                centre = place.centre[0] + x, place.centre[1] + y, place.centre[2] + z
                yield place._replace(centre=centre, radius=radius + larger)

    def _hidden(self, cluster: Cluster) -> list[float]:
        """By how much its half extents (3,) [m] have been larger of late."""
        return [max(half[axis] for _, half in self._sizes) - cluster.half[axis] for axis in range(3)]

    def _placed(self, cluster: Cluster, time: float) -> Vector:
        """Where it is (3,) [m], with what is hidden of it: where it is expected, if that would show what is seen."""
        if not self._sizes:
            return cluster.centre
        expected = self.expected(time)
        hidden = self._hidden(cluster)
        if max(hidden) <= STEADY_SIZE:
            return cluster.centre
        points = np.column_stack([cluster.points - np.array(expected), np.zeros(len(cluster.points))])
        if not self.stands and _hold(self._spheres, points):
            return expected
        middle = []
        for axis in range(3):
            seen = cluster.centre[axis]
            if hidden[axis] > STEADY_SIZE:
                seen += math.copysign(hidden[axis], expected[axis] - seen)
            middle.append(seen)
        return middle[0], middle[1], middle[2]


def _hold(spheres: np.ndarray, others: np.ndarray) -> bool:
    """Whether each of others (m, 4) is in one of spheres (k, 4) [m], but for what is steady."""
    apart = np.linalg.norm(others[:, None, :3] - spheres[:, :3], axis=2) + others[:, None, 3] - spheres[:, 3]
    return bool(np.all(np.min(apart, axis=1, initial=math.inf) <= STEADY_SPHERE))


class ClusterTracks:
    """The clusters of one source of clouds."""

    def __init__(self) -> None:
        self._things: list[_Thing] = []
        self._count = 0
        # Of the middles of clusters of late [m].
        self._noise = _FIRST_NOISE

    def replace(
        self,
        clusters: Sequence[Cluster],
        around: float,
        arrival: float,
        taken: float,
        time: float,
        moment: float,
        sight: LineOfSight,
    ) -> None:
        """Take the clusters of the newest cloud.

        Parameters
        ----------
        around : radius around every point [m].
        arrival, taken : when the cloud arrived, and when it was taken [s], as of `Track`; time : the latter on the
            clock of its sender, as far as it is known [s].
        moment : what is not seen any more counts for so long [s], and for `HIDDEN` as long as it is hidden.
        sight : what the camera sees.
        """
        pairs = sorted(
            (mismatch, one, i)
            for one, thing in enumerate(self._things)
            for i, cluster in enumerate(clusters)
            if math.isfinite(mismatch := thing.mismatch(cluster, time))
        )
        thing_of: dict[int, int] = {}
        for _, one, i in pairs:
            if i not in thing_of and one not in thing_of.values():
                thing_of[i] = one
        known = list(self._things)
        for i, cluster in enumerate(clusters):
            if i in thing_of:
                thing = known[thing_of[i]]
            else:
                thing = _Thing(self._count)
                self._count += 1
                self._things.append(thing)
            thing.see(cluster, around, arrival, taken, time, self._noise)
            self._noise = thing.obstacle.newest.motion.noise.deviation or self._noise
        for one, thing in enumerate(known):
            if one not in thing_of.values():
                hidden = moment > 0.0 and sight.hides_beside(np.array([thing.expected(time)]))[0]
                # `CloudMemory` shows what stands for as long as it counts.
                counts = 0.0 if thing.stands else HIDDEN if hidden else moment
                thing.obstacle.expires = thing.seen + counts
        self.expire(arrival)

    def expire(self, now: float) -> None:
        """Forget those that have not been seen for a moment."""
        self._things = [thing for thing in self._things if now < thing.obstacle.expires]

    def moving(self) -> int:
        """How many move."""
        return sum(thing.moves for thing in self._things)

    def places(self, now: float, most: int) -> Iterator[tuple[int, Place]]:
        """Everywhere they may be, each with its number; most : as of `Track.places`."""
        for thing in self._things:
            for place in thing.places(now, most):
                yield thing.number, place

    def changes(self, now: float) -> float:
        """When `places` changes by itself [s]; inf for never."""
        return min((thing.obstacle.changes(now) for thing in self._things), default=math.inf)
