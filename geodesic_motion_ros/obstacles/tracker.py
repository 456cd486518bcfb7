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

import numpy as np

from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.shapes import no_solids
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.obstacles.track import REORDER_WINDOW, MessageOrder, Track
from geodesic_motion_ros.obstacles.velocity_filter import ObstacleMotion

Key = tuple[str, int]


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
    cloud : distances from the points of the newest cloud, which stands.
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

    def __len__(self) -> int:
        """Spheres and solids, and one for a cloud."""
        return len(self.radii) + len(self.solids) + (self.cloud.squares.size > 0)

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
            labels=tuple(label for label in self.labels if label not in labels),
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
            self.solid_velocity_errors,
        )  # fmt: skip


class ObstacleTracker:
    """Book-keeping of obstacles by source and key: replacement, deletion, lifetime, silence.

    A source is expected to keep talking from its first message on. It is *silent* when it has not been
    heard for longer than a timeout, whether or not its obstacles have expired meanwhile: a dead detector
    must not look like a free table. It is *late* when it talks of what is longer ago than that. A source that deletes
    its last obstacle is inactive, and not expected to talk again. A source is *unusable* as long as nothing that
    it sent could be used: something is there, and nobody knows where.

    Parameters
    ----------
    required : sources that are expected to talk from the beginning on, and while they are inactive too.
    """

    def __init__(self, required: Sequence[str] = ()) -> None:
        self._required = tuple(required)
        self._tracks: dict[str, dict[Key, Track]] = {}
        # when the newest message arrived, and when the newest was taken
        self._heard: dict[str, tuple[float, float]] = {}
        # required sources that have deleted their last obstacle: they must go on all the same
        self._inactive: set[str] = set()
        # why no message of a source could be used
        self._unusable: dict[str, str] = {}
        # when a source is forgotten [s]
        self._ends: dict[str, float] = {}
        # how noisy the detections of a source were of late, where they were not exact [m]
        self._noise: dict[str, float] = {}
        self._next_expiry = math.inf
        self._version = 0
        self._set: ObstacleSet | None = None
        self._cloud, self._cloud_source = DistanceField.none(), ""
        self._cloud_order = MessageOrder()

    def hear(self, source: str, now: float, transit: float = 0.0, forget_after: float = 0.0) -> None:
        """Note that a valid message of a source arrived, even one without obstacles, after a transit [s].

        forget_after : [s] the source and its obstacles are forgotten so long after its last message; 0 never.
        """
        _, newest = self._heard.get(source, (now, -math.inf))
        self._heard[source] = now, max(newest, now - max(0.0, transit))
        self._unusable.pop(source, None)
        self._inactive.discard(source)
        self._ends[source] = now + forget_after if forget_after > 0.0 else math.inf
        self._next_expiry = min(self._next_expiry, self._ends[source])

    def refuse(self, source: str, reason: str) -> None:
        """Note that a message of a source could not be used.

        Where nothing was heard of it before, or it has deleted its last obstacle, it is unusable until a message can be
        used.
        """
        if source not in self._heard or source in self._inactive:
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
        tracks = self._tracks.setdefault(source, {})
        before = tracks.get(key)
        order = MessageOrder() if before is None else before.order
        taken = now - max(0.0, transit)
        if order.register(taken):
            return False
        self.hear(source, now, transit, forget_after)
        expires = now + lifetime if lifetime > 0.0 else math.inf
        if before is not None and before.deleted:
            before = None
        motion = ObstacleMotion(self._noise.get(source, 0.0)) if before is None else before.motion
        detected = tuple(float(c) for c in centre)
        motion.see(detected, now - transit)
        if motion.noise.deviation:
            self._noise[source] = motion.noise.deviation
        track = Track(detected, float(radius), now, taken, expires, solid, motion, order)
        tracks[key] = track.placed(before)
        self._next_expiry = min(self._next_expiry, expires, track.changes(now))
        self._changed()
        return True

    def delete(self, source: str, key: Key, now: float, transit: float = 0.0) -> bool:
        """Remove one sphere; False when there is none or the message was overtaken."""
        self.hear(source, now, transit)
        track = self._tracks.get(source, {}).get(key)
        deleted = track is not None and not track.deleted and not track.order.register(now - max(0.0, transit))
        if deleted:
            self._mark_deleted(track, now)
        self._deactivate_when_empty(source)
        return deleted

    def delete_all(self, source: str, now: float, namespace: str = "", transit: float = 0.0) -> int:
        """Remove every sphere of a source, or of one namespace when it is not empty; returns how many."""
        self.hear(source, now, transit)
        doomed = [
            track
            for key, track in self._tracks.get(source, {}).items()
            if not track.deleted
            and (not namespace or key[0] == namespace)
            and not track.order.register(now - max(0.0, transit))
        ]
        for track in doomed:
            self._mark_deleted(track, now)
        self._deactivate_when_empty(source)
        return len(doomed)

    def replace_cloud(
        self, source: str, cloud: DistanceField, now: float, transit: float = 0.0, forget_after: float = 0.0
    ) -> bool:
        """Exchange the cloud for one that arrived at `now` [s]; False when that was overtaken and is ignored.

        forget_after : as of `hear`.
        """
        if self._cloud_order.register(now - max(0.0, transit)):
            return False
        self.hear(source, now, transit, forget_after)
        self._cloud, self._cloud_source = cloud, source
        self._changed()
        return True

    def clear(self) -> None:
        """Forget every obstacle and that any source was heard."""
        self._tracks.clear()
        self._heard.clear()
        self._inactive.clear()
        self._unusable.clear()
        self._ends.clear()
        self._noise.clear()
        self._cloud, self._cloud_order = DistanceField.none(), MessageOrder()
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

        So too, as source/namespace/id, obstacles that moved and were not published again, though their source talks.
        """
        return {name: now - arrival for name, arrival, _ in self._old(now, timeout) if now - arrival > timeout}

    def late(self, now: float, timeout: float) -> dict[str, float]:
        """The sources, and obstacles likewise, that are heard, but of what was taken longer than a timeout [s] ago,
        with how long it is [s].
        """
        return {name: now - taken for name, arrival, taken in self._old(now, timeout) if now - arrival <= timeout}

    def _old(self, now: float, timeout: float) -> Iterator[tuple[str, float, float]]:
        """What was taken longer ago: names, times of arrival, and when it was taken."""
        for source, (arrival, taken) in self._heard.items():
            if now - taken > timeout:
                yield source, arrival, taken
        for source, tracks in self._tracks.items():
            _, newest = self._heard.get(source, (now, now))
            if now - newest <= timeout:
                for key, track in tracks.items():
                    moved = track.moves and now - track.taken > timeout
                    received_late = not track.deleted and track.arrival - track.taken > timeout >= now - track.arrival
                    if moved or received_late:
                        yield _label(source, key), track.arrival, track.taken

    def current(self, now: float) -> ObstacleSet:
        """The spheres that exist now, expired ones removed."""
        if now >= self._next_expiry:
            self._expire(now)
        if self._set is None:
            self._set = self._assemble(now)
        return self._set

    def _expire(self, now: float) -> None:
        for tracks in self._tracks.values():
            for key in [key for key, track in tracks.items() if now >= track.expires]:
                del tracks[key]
        for source in [source for source, end in self._ends.items() if now >= end]:
            self._forget(source)
        tracks = [track for tracks in self._tracks.values() for track in tracks.values()]
        changes = [min(track.expires, track.changes(now)) for track in tracks]
        self._next_expiry = min([*changes, *self._ends.values()], default=math.inf)
        self._changed()

    def _forget(self, source: str) -> None:
        del self._ends[source]
        self._tracks.pop(source, None)
        if source == self._cloud_source:
            self._cloud, self._cloud_order = DistanceField.none(), MessageOrder()
        self._deactivate_when_empty(source)

    def _mark_deleted(self, track: Track, now: float) -> None:
        # A deleted key is remembered for a while, so that an overtaken ADD does not bring the obstacle back.
        track.deleted = True
        track.expires = now + REORDER_WINDOW
        self._next_expiry = min(self._next_expiry, track.expires)
        self._changed()

    def _deactivate_when_empty(self, source: str) -> None:
        if all(track.deleted for track in self._tracks.get(source, {}).values()):
            if source in self._required:
                self._inactive.add(source)
            else:
                self._heard.pop(source, None)

    def _changed(self) -> None:
        self._version += 1
        self._set = None

    def _assemble(self, now: float) -> ObstacleSet:
        alive = [
            (source, key, place)
            for source, tracks in sorted(self._tracks.items())
            for key, track in sorted(tracks.items())
            if not track.deleted
            for place in track.places(now)
        ]
        spheres = [track for _, _, track in alive if track.solid is None]
        solids = [track for _, _, track in alive if track.solid is not None]
        return ObstacleSet(
            np.array([track.centre for track in spheres], dtype=float).reshape(-1, 3),
            np.array([track.radius for track in spheres], dtype=float),
            tuple(_label(source, key) for source, key, _ in sorted(alive, key=lambda item: item[2].solid is not None)),
            self._version,
            _velocities(spheres),
            _velocity_errors(spheres),
            np.array([track.since for track in spheres], dtype=float),
            np.array([track.solid for track in solids], dtype=float).reshape(-1, 16),
            _velocities(solids),
            _velocity_errors(solids),
            np.array([track.since for track in solids], dtype=float),
            self._cloud,
        )


def _label(source: str, key: Key) -> str:
    return f"{source}/{key[0]}/{key[1]}"


def _velocities(tracks: list[Track]) -> np.ndarray:
    return np.array([track.motion.velocity for track in tracks], dtype=float).reshape(-1, 3)


def _velocity_errors(tracks: list[Track]) -> np.ndarray:
    return np.array([track.motion.error for track in tracks], dtype=float)
