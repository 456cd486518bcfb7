"""TrackedCluster: one cluster over several clouds: where it is, how it moves, and its spheres.

Its place is the middle of its ball, if it is one, else that of its box. A ball has the radius that it has on average,
for what is seen from one side tells little of how large it is. What the arm, or something else, hides makes a box
smaller, and moves the middle of what is left, which is no motion. So its size is the largest of the last `SIZE_MEMORY`,
and where it is smaller along an axis one of its two sides counts as seen: the one that puts its middle nearer to where
it is expected. Its spheres stay as they are while they hold what is seen.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from geodesic_motion_ros.geometry.clusters import BALL_DEVIATION, Cluster, ball_of_radius
from geodesic_motion_ros.geometry.vectors import Vector, difference
from geodesic_motion_ros.obstacles.track import Place, Track
from geodesic_motion_ros.obstacles.velocity_filter import ObstacleMotion

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
#: The radius of a ball is averaged over so many clouds. It is one as long as points deviate by no more than so many
#: times what they may at first. Its middle is where it is expected as far as few points say that: as if so many did.
BALLS, STILL_BALL, EXPECTED = 60, 2.0, 1.0
#: Noise of a middle [m] until it is known from the detections; and what it is at least: cubes that stand show less.
FIRST_NOISE, LEAST_NOISE = 0.002, 0.0015


class TrackedCluster:
    """One cluster over time.

    Parameters
    ----------
    number : in labels. cluster, time : when it is seen first [s]. noise : of middles, as far as is known [m].
    whole : what it was a part of.
    """

    def __init__(self, number: int, cluster: Cluster, time: float, noise: float, whole: TrackedCluster | None) -> None:
        self.number = number
        self._motion = ObstacleMotion(noise, LEAST_NOISE)
        if whole is not None and whole.moves:
            place = cluster.centre if cluster.ball is None else _middle_of(cluster.ball)
            self._motion = whole._motion.moved(difference(place, whole.expected(time)))
        self._track = Track(cluster.centre, 0.0, -math.inf, -math.inf, math.inf)
        # When it was seen, and half extents (3,) [m] then.
        self._sizes: deque[tuple[float, Vector]] = deque()
        # Spheres (k, 4) around the place [m], the radius that holds them all, and when they were seen [s].
        self._spheres, self._radius, self._spheres_seen = np.zeros((0, 4)), 0.0, -math.inf
        # As of `Cluster`, when it was seen last.
        self.stands, self.cluster, self._is_ball = False, 0, False
        # How far the points of its ball are from the middle, and the radius that holds them [m], on average of so many.
        self._ball_radius, self._ball_reach, self._balls = 0.0, 0.0, 0
        self.seen, self.expires = -math.inf, math.inf

    def expected(self, time: float) -> Vector:
        """Return where it is expected (3,) [m] at a time [s]."""
        return self._motion.expected(time)

    @property
    def _was_seen(self) -> bool:
        return self.seen > -math.inf

    @property
    def moves(self) -> bool:
        """Whether it has a velocity that counts."""
        return not self.stands and self._motion.moves

    @property
    def noise(self) -> float:
        """The noise of its place [m]."""
        return self._motion.noise.deviation

    def mismatch(self, cluster: Cluster, time: float, seen_last: float) -> float:
        """Return how far a cluster at a time [s] is from where this one is expected [m]; inf where it is another one.

        seen_last : when the last cloud arrived [s]. What it has not shown comes out again near where it is expected.
        """
        if cluster.number and cluster.number == self.cluster:
            return 0.0
        # What is remembered of where it was is not this one.
        if cluster.stands and self.moves:
            return math.inf
        comes_out, last = self.seen != seen_last, self._sizes[-1][1]
        # What comes out again may be hidden in part.
        larger = [half - before for half, before in zip(cluster.half, last, strict=True)]
        if max(larger) > SAME_SIZE or (min(larger) < -SAME_SIZE and not comes_out):
            return math.inf
        place = cluster.centre if cluster.ball is None or not self._is_ball else _middle_of(cluster.ball)
        near = self._motion.is_at if comes_out else self._motion.is_reached
        return self._motion.distance(place, time) if near(place, time) else math.inf

    def see(self, cluster: Cluster, around: float, arrival: float, taken: float, time: float) -> None:
        """Take a detection; around : radius of every point [m]. Times as of `ClusterTracks.replace`."""
        while self._sizes and self._sizes[0][0] < time - SIZE_MEMORY:
            self._sizes.popleft()
        ball = self._take_ball(cluster, time)
        self._go_on_at(cluster, ball, time)
        place = self._middle(cluster, time) if ball is None else _middle_of(ball)
        if ball is None and self._sizes and min(self._hidden(cluster)) < -GROWN:
            # A part of it was seen before, and the middle of that tells nothing of how the whole moves.
            self._motion = ObstacleMotion(self.noise, LEAST_NOISE)
        self._motion.see(place, time)
        self._sizes.append((time, cluster.half))
        self._take_spheres(cluster, ball, place, around, time)
        track = Track(place, self._radius, arrival, taken, math.inf, motion=self._motion)
        self._track = track.placed(self._track if self._was_seen else None)
        self.cluster, self.seen, self.expires = cluster.number, arrival, math.inf

    def _take_ball(self, cluster: Cluster, time: float) -> np.ndarray | None:
        """Take the radius of the ball that a cluster is, and return that ball, as of `Cluster`, with the radius that it
        has on average; None where it is none. What is seen from one side tells little of how large a ball is, and so of
        where its middle is. One that was a ball stays one as long as its points are on that.
        """
        if cluster.ball is None and not self._is_ball:
            return None
        seen = cluster.ball
        if seen is not None:
            self._balls = min(self._balls + 1, BALLS) if self._is_ball else 1
            radii = np.linalg.norm(cluster.points - seen[:3], axis=1)
            self._ball_radius += (float(np.mean(radii)) - self._ball_radius) / self._balls
        if self._is_ball:
            expected, weight = np.array(self.expected(time)), EXPECTED
        else:
            assert seen is not None
            expected, weight = np.ascontiguousarray(seen[:3]), 0.0
        middle, deviation = ball_of_radius(cluster.points, expected, self._ball_radius, weight)
        if deviation > STILL_BALL * BALL_DEVIATION:
            return None
        farthest = float(np.max(np.linalg.norm(cluster.points - middle, axis=1)))
        if seen is not None:
            self._ball_reach += (float(seen[3] + farthest - np.max(radii)) - self._ball_reach) / self._balls
        # What sticks out by more is not noise.
        return np.array([*middle, max(self._ball_reach, farthest - STEADY_SPHERE)])

    def _go_on_at(self, cluster: Cluster, ball: np.ndarray | None, time: float) -> None:
        """Go on at the middle of its ball, or of its box, where it was the other one before: it has not moved by what
        is between them.
        """
        was_ball, self._is_ball = self._is_ball, ball is not None
        if was_ball == self._is_ball or not self._was_seen:
            return
        if ball is not None:
            shift = difference(_middle_of(ball), self._middle(cluster, time))
        else:
            shift = difference(cluster.centre, self.expected(time))
            self._sizes.clear()
        self._motion = self._motion.moved(shift)
        if not self.stands:
            self._spheres = self._spheres - np.array([*shift, 0.0])

    def _take_spheres(
        self, cluster: Cluster, ball: np.ndarray | None, place: Vector, around: float, time: float
    ) -> None:
        """Take the spheres of a cluster at a place (3,) [m], or its ball, where those that it has do not hold it."""
        stands = cluster.stands
        origin = np.zeros(3) if stands else np.array(place)
        covering = cluster.spheres if stands or ball is None else ball[None]
        spheres = covering - np.array([*origin, -around])
        same = stands == self.stands and time <= self._spheres_seen + SIZE_MEMORY
        if stands:
            # Another cut is no news, but where it is smaller, for what is hidden is remembered.
            same &= np.sum(spheres[:, 3] ** 3) > SMALLER * np.sum(self._spheres[:, 3] ** 3)
        # A ball that moves has its radius on average.
        same &= stands or ball is None
        points = np.column_stack([cluster.covered - origin, np.full(len(cluster.covered), around)])
        if not (same and _hold(self._spheres, points if stands else spheres)):
            self._spheres, self._spheres_seen, self.stands = spheres, time, stands
            self._radius = float(np.max(np.linalg.norm(spheres[:, :3], axis=1) + spheres[:, 3]))

    def places(self, now: float, most: int) -> Iterator[Place]:
        """Yield where each of its spheres may be; most : as of `Track.places`."""
        if self.stands:
            for x, y, z, radius in self._spheres.tolist():
                yield Place((x, y, z), radius, None, (0.0, 0.0, 0.0), 0.0, self._track.since)
            return
        for place in self._track.places(now, max(1, most // len(self._spheres))):
            larger = place.radius - self._radius
            for x, y, z, radius in self._spheres.tolist():
                centre = place.centre[0] + x, place.centre[1] + y, place.centre[2] + z
                yield place._replace(centre=centre, radius=radius + larger)

    def changes(self, now: float) -> float:
        """Return when `places` changes by itself, or it vanishes [s]; inf for never."""
        return min(self.expires, self._track.changes(now))

    def _hidden(self, cluster: Cluster) -> list[float]:
        """Return by how much its half extents (3,) [m] have been larger of late."""
        return [max(half[axis] for _, half in self._sizes) - cluster.half[axis] for axis in range(3)]

    def _middle(self, cluster: Cluster, time: float) -> Vector:
        """Find the middle of its box (3,) [m], with what is hidden of it: where it is expected, if that would show what
        is seen.
        """
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


def _middle_of(ball: np.ndarray) -> Vector:
    x, y, z, _ = ball.tolist()
    return x, y, z


def _hold(spheres: np.ndarray, others: np.ndarray) -> bool:
    """Whether each of others (m, 4) is in one of spheres (k, 4) [m], but for what is steady."""
    apart = np.linalg.norm(others[:, None, :3] - spheres[:, :3], axis=2) + others[:, None, 3] - spheres[:, 3]
    return bool(np.all(np.min(apart, axis=1, initial=math.inf) <= STEADY_SPHERE))
