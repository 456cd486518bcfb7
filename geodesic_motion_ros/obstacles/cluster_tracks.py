"""ClusterTracks: which clusters of a cloud are those of the clouds before, and how they move.

A cluster is an obstacle as a marker is, with the velocity of `velocity_filter.py`, but of a few spheres
(`tracked_cluster.py`). A thing has a number (`things.py`). One that has a new number goes on with the cluster whose
place is nearest of those that a velocity explains, and that were about as large; or begins, as what it was a part of
moves. What is not seen at all any more moves on for a moment.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from geodesic_motion_ros.geometry.clusters import Cluster
from geodesic_motion_ros.geometry.line_of_sight import LineOfSight
from geodesic_motion_ros.obstacles.track import Place
from geodesic_motion_ros.obstacles.tracked_cluster import FIRST_NOISE, TrackedCluster

#: What is hidden wholly goes on as it did for so long [s] at most.
HIDDEN = 2.0


class ClusterTracks:
    """The clusters of one source of clouds."""

    def __init__(self) -> None:
        self._things: list[TrackedCluster] = []
        self._count, self._arrival = 0, -math.inf
        # Of the middles of clusters of late [m].
        self._noise = FIRST_NOISE

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
            if math.isfinite(mismatch := thing.mismatch(cluster, time, self._arrival))
        )
        thing_of: dict[int, int] = {}
        for _, one, i in pairs:
            if i not in thing_of and one not in thing_of.values():
                thing_of[i] = one
        known = list(self._things)
        by_number = {thing.cluster: thing for thing in known if thing.cluster}
        for i, cluster in enumerate(clusters):
            if i in thing_of:
                thing = known[thing_of[i]]
            else:
                thing = TrackedCluster(self._count, cluster, time, self._noise, by_number.get(cluster.part_of))
                self._count += 1
                self._things.append(thing)
            thing.see(cluster, around, arrival, taken, time)
            self._noise = thing.noise
        wholes = {cluster.part_of for cluster in clusters if cluster.part_of}
        for one, thing in enumerate(known):
            if one not in thing_of.values():
                hidden = moment > 0.0 and sight.hides_beside(np.array([thing.expected(time)]))[0]
                # `CloudMemory` shows what stands for as long as it counts, and what has parted is its parts.
                over = thing.stands or (thing.cluster in wholes and not hidden)
                thing.expires = thing.seen + (0.0 if over else HIDDEN if hidden else moment)
        self._arrival = arrival
        self.expire(arrival)

    def expire(self, now: float) -> None:
        """Forget those that have not been seen for a moment."""
        self._things = [thing for thing in self._things if now < thing.expires]

    def moving(self) -> int:
        """Count those that move."""
        return sum(thing.moves for thing in self._things)

    def places(self, now: float, most: int) -> Iterator[tuple[int, Place]]:
        """Yield everywhere that they may be, each with its number; most : as of `Track.places`."""
        for thing in self._things:
            for place in thing.places(now, most):
                yield thing.number, place

    def changes(self, now: float) -> float:
        """Return when `places` changes by itself [s]; inf for never."""
        return min((thing.changes(now) for thing in self._things), default=math.inf)
