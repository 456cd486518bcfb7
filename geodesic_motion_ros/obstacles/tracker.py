"""Which obstacles exist now, out of everything that the obstacle topics published; knows nothing of ROS.

Every topic is one source. Within a source an obstacle is identified by its key: (namespace, id) for
markers, so that several publishers share a topic without disturbing each other. Time is passed in [s, any
steady clock]: when a message arrived, and for how long its data had been in transit then: less than nothing by a
stamp of the future. The data are as old as that makes them; lifetimes, and what must be published again and again,
count from the arrival.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np

from geodesic_motion_ros.geometry.clusters import Cluster
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.line_of_sight import LineOfSight
from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.geometry.shapes import no_solids
from geodesic_motion_ros.obstacles.cluster_tracks import ClusterTracks
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.obstacles.track import REORDER_WINDOW, MessageOrder, Place, Track
from geodesic_motion_ros.obstacles.tracked_obstacle import TrackedObstacle

Key = tuple[str, int]

# What moves is expected at so many velocities at most, all obstacles together: planning takes its time for each.
_MOST_VELOCITIES = 24


@dataclass(frozen=True)
class ObstacleSet:
    """Obstacles at one instant, in the base frame: spheres, and then solids, each ordered by source and key.

    Attributes
    ----------
    centres : (n, 3) [m].
    radii : (n,) [m].
    labels : n + b texts `source/namespace/id`, in the same order.
    version : grows by one whenever the set changes; equal versions mean the same obstacles.
    velocities, velocity_errors : (n, 3), (n,) [m/s] by the updates until the newest one of each sphere
        (`velocity_filter.py`).
    times : (n,) [s] when each sphere was where its newest update says, on the clock that is passed in.
    solids, solid_velocities, solid_velocity_errors, solid_times : (b, 16) rows as of `geometry/shapes.py`, (b, 3),
        (b,), (b,), likewise.
    cloud : distances from those points of the newest cloud that stand; its clusters are among the spheres.
    names : n + b texts as the labels, each with the nodes that publish on its topic; cloud_name : likewise.
    """

    centres: np.ndarray
    radii: np.ndarray
    labels: tuple[str, ...]
    version: int
    velocities: np.ndarray
    velocity_errors: np.ndarray
    times: np.ndarray
    solids: np.ndarray = field(default_factory=no_solids)
    solid_velocities: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    solid_velocity_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    solid_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    cloud: DistanceField = field(default_factory=DistanceField.none)
    names: tuple[str, ...] = ()
    cloud_name: str = ""

    def __len__(self) -> int:
        """How many obstacles, a cloud for one: what may be at several places, or move on at several velocities, too."""
        return len(set(self.labels)) + (self.cloud.squares.size > 0)

    def without(self, labels: Collection[str]) -> ObstacleSet:
        """Without the obstacles of these labels, under the same version."""
        kept = np.array([label not in labels for label in self.labels], dtype=bool)
        if np.all(kept):
            return self
        spheres, solids = kept[: len(self.radii)], kept[len(self.radii) :]
        return replace(
            self, centres=self.centres[spheres], radii=self.radii[spheres], velocities=self.velocities[spheres],
            velocity_errors=self.velocity_errors[spheres], times=self.times[spheres], solids=self.solids[solids],
            solid_velocities=self.solid_velocities[solids], solid_times=self.solid_times[solids],
            solid_velocity_errors=self.solid_velocity_errors[solids],
            labels=tuple(compress(self.labels, kept)), names=tuple(compress(self.names, kept)),
        )  # fmt: skip

    def moved_on(self, now: float, longest: float, time: float) -> Obstacles:
        """Where the obstacles are at `now` [s], having moved linearly since their updates, for `longest` [s] at most.

        time : what `now` is on the clock of the planner [s].
        """
        ages, solid_ages = (
            np.where(np.any(velocities, axis=1), np.clip(now - times, 0.0, longest), 0.0)
            for velocities, times in ((self.velocities, self.times), (self.solid_velocities, self.solid_times))
        )
        solids = self.solids.copy()
        solids[:, :3] += solid_ages[:, None] * self.solid_velocities
        solids[:, 6] += solid_ages * self.solid_velocity_errors
        return Obstacles(
            self.centres + ages[:, None] * self.velocities, self.radii + ages * self.velocity_errors, self.velocities,
            solids, self.solid_velocities, self.cloud, time, ages, solid_ages, self.velocity_errors,
            self.solid_velocity_errors, self.names[: len(self.radii)], self.names[len(self.radii) :], self.cloud_name,
        )  # fmt: skip


class ObstacleTracker:
    """Book-keeping of obstacles by source and key: replacement, deletion, lifetime, silence.

    A source is expected to keep talking as long as it has an obstacle that nobody answers for, and after a message
    without obstacles. A publisher that latched an obstacle answers for it while it lives; so does a lifetime; but
    neither for what moves, or is published again and again (`TrackedObstacle.is_answered_for`). An expected source is
    *silent* when it has not been heard for longer than a timeout. It is *late* when it talks of what is longer ago than
    that. A source is *unusable* as long as nothing that it sent could be used: something is there, and nobody knows
    where.

    Parameters
    ----------
    required : sources that are expected to talk from the beginning on, and while they have no obstacle too.
    """

    def __init__(self, required: Sequence[str] = ()) -> None:
        self._required = tuple(required)
        self._tracked: dict[str, dict[Key, TrackedObstacle]] = {}
        # when the newest message arrived, and when the newest was taken
        self._heard: dict[str, tuple[float, float]] = {}
        # sources that have sent a message without obstacles, as a sign of life
        self._alive: set[str] = set()
        # why no message of a source could be used
        self._unusable: dict[str, str] = {}
        # when a source is forgotten [s]
        self._ends: dict[str, float] = {}
        # how noisy the detections of a source were of late, where they were not exact [m]
        self._noise: dict[str, float] = {}
        # the nodes that publish on the topic of a source
        self._publishers: dict[str, Sequence[str]] = {}
        self._next_expiry = math.inf
        self._version = 0
        self._set: ObstacleSet | None = None
        self._cloud, self._cloud_source = DistanceField.none(), ""
        self._clusters = ClusterTracks()
        self._cloud_order = MessageOrder()

    def hear(
        self, source: str, now: float, transit: float = 0.0, forget_after: float = 0.0, empty: bool = False
    ) -> None:
        """Note that a valid message of a source arrived, after a transit [s].

        forget_after : [s] the source and its obstacles are forgotten so long after its last message; 0 never.
        empty : it was one without obstacles, a sign of life that must be followed by others.
        """
        if empty:
            self._alive.add(source)
        _, newest = self._heard.get(source, (now, -math.inf))
        self._heard[source] = now, max(newest, now - max(0.0, transit))
        self._unusable.pop(source, None)
        self._ends[source] = now + forget_after if forget_after > 0.0 else math.inf
        self._next_expiry = min(self._next_expiry, self._ends[source])

    def set_publishers(self, source: str, nodes: Sequence[str]) -> None:
        """Set the full names of the nodes that publish on the topic of a source."""
        if nodes != self._publishers.get(source, ()):
            self._publishers[source] = nodes
            self._changed()

    def refuse(self, source: str, reason: str) -> None:
        """Note that a message of a source could not be used.

        Where nothing is known of it, as nothing was heard of it before, or it has deleted its last obstacle, it is
        unusable until a message can be used.
        """
        if source not in self._heard or self._is_idle(source):
            self._unusable[source] = reason

    def put(
        self,
        source: str,
        key: Key,
        centre: np.ndarray,
        radius: float,
        now: float,
        lifetime: float = 0.0,
        solid: np.ndarray | None = None,
        transit: float = 0.0,
        forget_after: float = 0.0,
    ) -> bool:
        """Add a sphere or a solid, or move it.

        Parameters
        ----------
        centre, radius : [m]; must be finite and positive (checked where messages are read).
        lifetime : [s] the sphere vanishes by itself this long after its last update; 0 keeps it until
            deleted.
        solid : (16,) row of a solid around the centre, see `geometry/shapes.py`; its radius counts, and not `radius`.
        transit : [s] so long before `now` it was there. However long that is, the obstacle counts: one too many does
            less harm than one of which nothing is known.
        forget_after : as of `hear`.

        Returns
        -------
        False when what is known of the same key was taken later: the message was overtaken and is ignored.
        """
        obstacle = self._tracked.setdefault(source, {}).setdefault(key, TrackedObstacle())
        taken = now - max(0.0, transit)
        if obstacle.order.register(taken):
            return False
        self.hear(source, now, transit, forget_after)
        expires = now + lifetime if lifetime > 0.0 else math.inf
        x, y, z = (float(c) for c in centre)
        detection = Track((x, y, z), float(radius), now, taken, expires, solid)
        obstacle.see(detection, now - transit, self._noise.get(source, 0.0))
        if obstacle.newest.motion.noise.deviation:
            self._noise[source] = obstacle.newest.motion.noise.deviation
        self._next_expiry = min(self._next_expiry, obstacle.changes(now))
        self._changed()
        return True

    def answer_for(self, source: str, keys: Collection[Key], publishers: Collection[str]) -> None:
        """Note that the newest messages about some obstacles were latched, by one of some publishers that live."""
        for key in keys:
            if obstacle := self._tracked.get(source, {}).get(key):
                obstacle.publishers = frozenset(publishers)

    def end(self, source: str, publisher: str, now: float) -> None:
        """Note that a publisher has ended: nobody answers for what it may have latched any more."""
        for obstacle in self._tracked.get(source, {}).values():
            obstacle.abandon(publisher, now)

    def delete(self, source: str, key: Key, now: float, transit: float = 0.0) -> bool:
        """Remove one sphere; False when there is none or the message was overtaken."""
        self.hear(source, now, transit)
        obstacle = self._tracked.get(source, {}).get(key)
        return obstacle is not None and self._delete(source, [obstacle], now, transit) == 1

    def delete_all(self, source: str, now: float, namespace: str = "", transit: float = 0.0) -> int:
        """Remove every obstacle of a source, or of one namespace when it is not empty; returns how many."""
        self.hear(source, now, transit)
        doomed = [one for key, one in self._tracked.get(source, {}).items() if not namespace or key[0] == namespace]
        return self._delete(source, doomed, now, transit)

    def _delete(self, source: str, obstacles: list[TrackedObstacle], now: float, transit: float) -> int:
        taken = now - max(0.0, transit)
        doomed = [one for one in obstacles if not one.deleted and not one.order.register(taken)]
        for one in doomed:
            # Remembered for a while, so that an overtaken ADD does not bring the obstacle back.
            one.delete(now, now + REORDER_WINDOW)
            self._next_expiry = min(self._next_expiry, one.expires)
            self._changed()
        if all(one.deleted for one in self._tracked.get(source, {}).values()):
            self._alive.discard(source)
            self._rest_when_empty(source)
        return len(doomed)

    def replace_cloud(
        self,
        source: str,
        cloud: DistanceField,
        now: float,
        transit: float = 0.0,
        forget_after: float = 0.0,
        clusters: Sequence[Cluster] = (),
        around: float = 0.0,
        moment: float = MOMENT,
        sight: LineOfSight | None = None,
    ) -> bool:
        """Exchange the cloud for one that arrived at `now` [s]; False when that was overtaken and is ignored.

        Parameters
        ----------
        forget_after : as of `hear`.
        clusters : what is not in the field and may move, with spheres of so large a radius `around` their points [m].
        moment : clusters that are not seen any more count for so long [s]. sight : what the camera sees.
        """
        taken = now - max(0.0, transit)
        if self._cloud_order.register(taken):
            return False
        self.hear(source, now, transit, forget_after, empty=True)
        self._cloud, self._cloud_source = cloud, source
        self._clusters.replace(clusters, around, now, taken, now - transit, moment, sight or LineOfSight.blank(None))
        self._next_expiry = min(self._next_expiry, self._clusters.changes(now))
        self._changed()
        return True

    def clear(self) -> None:
        """Forget every obstacle and that any source was heard."""
        self._tracked.clear()
        self._heard.clear()
        self._alive.clear()
        self._unusable.clear()
        self._ends.clear()
        self._noise.clear()
        self._forget_cloud()
        self._next_expiry = math.inf
        self._changed()

    def ages(self, now: float) -> dict[str, float]:
        """Seconds since the newest data of each expected source was taken."""
        return {source: now - taken for source, (_, taken) in self._heard.items()}

    def unusable(self) -> dict[str, str]:
        """The sources of which nothing is known though something should be, with the reason: what they sent could not
        be used, or they are required and have sent nothing.
        """
        unheard = {
            source: "nothing has been received yet (required_obstacle_topics)"
            for source in self._required
            if source not in self._heard
        }
        refused = {
            source: f"received, never usable: {reason}; publish what can be used, or call ~/clear_obstacles"
            for source, reason in self._unusable.items()
        }
        return unheard | refused

    def silent(self, now: float, timeout: float) -> dict[str, float]:
        """The expected sources not heard for longer than a timeout [s], with how long it is [s].

        So too, as source/namespace/id, obstacles that moved and were not published again, or that were latched by a
        publisher that has ended, though their source talks.
        """
        return {name: now - arrival for name, arrival, _ in self._old(now, timeout) if now - arrival > timeout}

    def late(self, now: float, timeout: float) -> dict[str, float]:
        """The sources, and obstacles likewise, that are heard, but of what was taken longer than a timeout [s] ago,
        with how long it is [s].
        """
        return {name: now - taken for name, arrival, taken in self._old(now, timeout) if now - arrival <= timeout}

    def alternating(self, now: float) -> dict[str, np.ndarray]:
        """The obstacles, as source/namespace/id, that are detected at several places by turns, with these (n, 3) [m]:
        two publishers use one name.
        """
        return {
            _label(source, key): np.array(obstacle.centres(now))
            for source, key, obstacle in self._existing()
            if obstacle.alternates(now)
        }

    def _old(self, now: float, timeout: float) -> Iterator[tuple[str, float, float]]:
        """What was taken longer ago: names, times of arrival, and when it was taken."""
        named = set()
        for source, (arrival, taken) in self._heard.items():
            if now - taken > timeout and self._is_expected(source, timeout):
                named.add(source)
                yield source, arrival, taken
        for source, key, obstacle in self._existing():
            track = obstacle.newest
            moved = track.moves and now - track.taken > timeout
            received_late = track.arrival - track.taken > timeout >= now - track.arrival
            if now - obstacle.abandoned > timeout:
                yield _label(source, key), obstacle.abandoned, obstacle.abandoned
            elif source not in named and (moved or (received_late and not obstacle.is_answered_for(timeout))):
                yield _label(source, key), track.arrival, track.taken

    def _is_expected(self, source: str, timeout: float) -> bool:
        """Whether a source must talk: nobody answers for one of its obstacles, or for there being none."""
        own = [one for name, _, one in self._existing() if name == source and math.isinf(one.abandoned)]
        unanswered = any(not one.is_answered_for(timeout) for one in own)
        return unanswered or source in self._alive or (source in self._required and not own)

    def _is_idle(self, source: str) -> bool:
        """Whether a source has no obstacle, and gives no sign of life."""
        return source not in self._alive and all(one.deleted for one in self._tracked.get(source, {}).values())

    def _existing(self) -> Iterator[tuple[str, Key, TrackedObstacle]]:
        """Obstacles that are not deleted."""
        for source, obstacles in self._tracked.items():
            for key, obstacle in obstacles.items():
                if not obstacle.deleted:
                    yield source, key, obstacle

    def current(self, now: float) -> ObstacleSet:
        """The spheres that exist now, expired ones removed."""
        if now >= self._next_expiry:
            self._expire(now)
        if self._set is None:
            self._set = self._assemble(now)
        return self._set

    def _expire(self, now: float) -> None:
        for source, obstacles in self._tracked.items():
            expired = [key for key, obstacle in obstacles.items() if now >= obstacle.expires]
            for key in expired:
                del obstacles[key]
            if expired:
                self._rest_when_empty(source)
        for source in [source for source, end in self._ends.items() if now >= end]:
            self._forget(source)
        self._clusters.expire(now)
        changes = [one.changes(now) for obstacles in self._tracked.values() for one in obstacles.values()]
        self._next_expiry = min([*changes, *self._ends.values(), self._clusters.changes(now)])
        self._changed()

    def _forget(self, source: str) -> None:
        del self._ends[source]
        self._tracked.pop(source, None)
        self._alive.discard(source)
        if source == self._cloud_source:
            self._forget_cloud()
        self._rest_when_empty(source)

    def _forget_cloud(self) -> None:
        self._cloud, self._clusters, self._cloud_order = DistanceField.none(), ClusterTracks(), MessageOrder()

    def _rest_when_empty(self, source: str) -> None:
        """Expect nothing more of a source whose last obstacle has vanished, unless it is required, or gives signs of
        life.
        """
        if self._is_idle(source) and source not in self._required:
            self._heard.pop(source, None)

    def _changed(self) -> None:
        self._version += 1
        self._set = None

    def _assemble(self, now: float) -> ObstacleSet:
        existing = sorted(self._existing(), key=lambda item: item[:2])
        moving = sum(obstacle.newest.moves for _, _, obstacle in existing) + self._clusters.moving()
        most = max(1, _MOST_VELOCITIES // max(1, moving))
        cloud = f"the point cloud of {self._cloud_source}"
        alive = [
            (_label(source, key), self._named(source, _label(source, key)), place)
            for source, key, one in existing
            for place in one.places(now, most)
        ] + [
            (_label(self._cloud_source, ("cluster", number)), self._named(self._cloud_source, cloud), place)
            for number, place in self._clusters.places(now, most)
        ]
        ordered = sorted(alive, key=lambda item: item[2].solid is not None)
        spheres = [place for _, _, place in alive if place.solid is None]
        solids = [place for _, _, place in alive if place.solid is not None]
        return ObstacleSet(
            np.array([place.centre for place in spheres], dtype=float).reshape(-1, 3),
            np.array([place.radius for place in spheres], dtype=float),
            tuple(label for label, _, _ in ordered),
            self._version,
            _velocities(spheres),
            _velocity_errors(spheres),
            np.array([place.since for place in spheres], dtype=float),
            np.array([place.solid for place in solids], dtype=float).reshape(-1, 16),
            _velocities(solids),
            _velocity_errors(solids),
            np.array([place.since for place in solids], dtype=float),
            self._cloud,
            tuple(name for _, name, _ in ordered),
            self._named(self._cloud_source, cloud),
        )

    def _named(self, source: str, label: str) -> str:
        nodes = self._publishers.get(source)
        return f"{label}, published by {' or '.join(nodes)}," if nodes else label


def _label(source: str, key: Key) -> str:
    return f"{source}/{key[0]}/{key[1]}"


def _velocities(places: list[Place]) -> np.ndarray:
    return np.array([place.velocity for place in places], dtype=float).reshape(-1, 3)


def _velocity_errors(places: list[Place]) -> np.ndarray:
    return np.array([place.error for place in places], dtype=float)
