"""TrackedObstacle: one obstacle by all messages about it, in one track, or in several where its detections contradict.

A detection that no velocity explains is an error, or another object under the same name, or the obstacle was put
elsewhere: nobody knows until the next ones. So it begins a track of its own, and the place before counts as well, until
two detections in a row agree on another one. Where detections come back to two places by turns, two publishers use one
name, and both places count as long as both are published. Seldom detected, an obstacle may have moved from place to
place as well: then one track goes on, and the place that it has left is remembered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

from geodesic_motion_ros.geometry.vectors import Vector
from geodesic_motion_ros.obstacles.track import MessageOrder, Place, Track
from geodesic_motion_ros.obstacles.velocity_filter import LONGEST_GAP, SAME_PLACE, ObstacleMotion

#: A place counts until so many detections in a row agree on another one, or it has not been detected for `LONGEST_GAP`.
AGREEING = 2
#: A place that is not detected for so long [s] is forgotten; until then a detection there continues its track.
REMEMBERED = 2.0
#: So many messages in a row, each soon after the last, are a stream: it is expected to continue.
_STREAM = 3
# What is nearer than this [m] is at the very same place.
_VERY_SAME = 1e-3


@dataclass
class _Candidate:
    """A place where the obstacle may be.

    Attributes
    ----------
    agreeing : how many detections in a row were there. is_left : whether enough of them have agreed on another one.
    returned : when the detections last came back to it [s], on the clock of arrivals.
    tolerance : what is detected within this of it [m], and within the noise, has come back.
    """

    track: Track
    agreeing: int = 0
    is_left: bool = False
    returned: float = -math.inf
    tolerance: float = SAME_PLACE

    @property
    def arrival(self) -> float:
        return self.track.arrival

    def left(self, noise: float) -> _Candidate:
        """The place that its obstacle has left: where it was detected last, at rest. Only what stands comes back to the
        very same place.
        """
        motion = ObstacleMotion(noise)
        motion.see(*self.track.motion.newest)
        return _Candidate(replace(self.track, motion=motion), is_left=True, tolerance=_VERY_SAME)


class TrackedObstacle:
    """The places where one obstacle may be, by all messages about it.

    Attributes
    ----------
    order : of its messages. deleted : it is remembered alone so that an overtaken message does not bring it back.
    expires : when it vanishes, or is forgotten once it is deleted [s]; inf for never.
    publishers : the living publishers one of which latched its newest message; empty where none did.
    abandoned : when the last of these ended [s]; inf where none did.
    """

    def __init__(self) -> None:
        self.order = MessageOrder()
        self.deleted = False
        self.expires = math.inf
        self.publishers: frozenset[str] = frozenset()
        self.abandoned = math.inf
        # The one that was detected last stands last.
        self._candidates: list[_Candidate] = []
        self._arrivals = (-math.inf,) * _STREAM
        self._deleted_at = -math.inf

    @property
    def newest(self) -> Track:
        """The track of the newest detection."""
        return self._candidates[-1].track

    def see(self, detection: Track, time: float, known_noise: float) -> None:
        """Take a detection, of a time [s] of the sender's clock as far as it is known.

        known_noise : of the detections of its source [m].
        """
        now, centre = detection.arrival, detection.centre
        if self.deleted and now > self._deleted_at:
            self._candidates, self._arrivals = [], (-math.inf,) * _STREAM
        self.deleted = False
        others = [one for one in self._candidates if now - one.arrival <= REMEMBERED]
        before = self._explaining(others, centre, time)
        agreeing, returned = 1, -math.inf
        if before is None:
            detection.motion = ObstacleMotion(known_noise)
        else:
            detection.motion, returned = before.track.motion, before.returned
            if before is not others[-1]:
                returned = now
            elif detection.motion.is_at(centre, time):
                agreeing = before.agreeing + 1
            else:
                others.insert(0, before.left(known_noise))
            others.remove(before)
        detection.motion.see(centre, time)
        for other in others:
            other.is_left |= agreeing >= AGREEING
        placed = detection.placed(before.track if before else None)
        self._candidates = [*others, _Candidate(placed, agreeing, returned=returned)]
        self.expires, self.publishers, self.abandoned = detection.expires, frozenset(), math.inf
        self._arrivals = *self._arrivals[1:], now

    def delete(self, now: float, until: float) -> None:
        """Delete it at a time [s], and remember that until another. What is deleted and sent again in one message has
        not been away.
        """
        self.deleted, self._deleted_at, self.expires, self.publishers = True, now, until, frozenset()

    def abandon(self, publisher: str, now: float) -> None:
        """Note that a publisher has ended."""
        if publisher in self.publishers:
            self.publishers = frozenset()
            self.abandoned = now if math.isinf(self.expires) else math.inf

    def is_answered_for(self, timeout: float) -> bool:
        """Whether it may stand without being published again: it was latched by a publisher that lives, or vanishes by
        itself. What is published again and again, never longer than a timeout [s] apart, must be published further.
        """
        streamed = all(later - earlier <= timeout for earlier, later in pairwise(self._arrivals))
        return (bool(self.publishers) or math.isfinite(self.expires)) and not streamed

    def alternates(self, now: float) -> bool:
        """Whether detections have come back, lately, to two places or more."""
        return sum(now - one.returned <= REMEMBERED for one in self._candidates) > 1

    def places(self, now: float, most: int) -> list[Place]:
        """Everywhere it may be; most : as of `Track.places`."""
        return [] if self.deleted else [place for track in self._tracks(now) for place in track.places(now, most)]

    def centres(self, now: float) -> list[Vector]:
        """Where the tracks that count are (3,) [m]."""
        return [track.centre for track in self._tracks(now)]

    def changes(self, now: float) -> float:
        """When `places` changes by itself, or it vanishes [s]; inf for never."""
        if self.deleted:
            return self.expires
        ends = [one.arrival + limit for one in self._candidates[:-1] for limit in (LONGEST_GAP, REMEMBERED)]
        changes = [track.changes(now) for track in self._tracks(now)]
        return min(self.expires, *changes, *(end for end in ends if end > now))

    def _tracks(self, now: float) -> Iterator[Track]:
        """The tracks that count."""
        alternates = self.alternates(now)
        for one in self._candidates:
            unclear = not one.is_left and now - one.arrival < LONGEST_GAP
            by_turns = alternates and now - one.returned <= REMEMBERED and now - one.arrival < REMEMBERED
            if one is self._candidates[-1] or unclear or by_turns:
                yield one.track

    @staticmethod
    def _explaining(candidates: list[_Candidate], centre: Vector, time: float) -> _Candidate | None:
        """The candidate that a detection (3,) [m] at a time [s] belongs to: the nearest of those that are expected
        there, or were last detected there; the last one as far as a velocity explains it.
        """
        near = [
            one for one in candidates[:-1]
            if one.track.motion.distance(centre, time) <= one.tolerance + one.track.motion.noise_bound
        ]  # fmt: skip
        near += [one for one in candidates[-1:] if one.track.motion.is_reached(centre, time)]
        return min(near, key=lambda one: one.track.motion.distance(centre, time), default=None)
