"""The places of frames in each other, as transforms tell them. Knows nothing of ROS.

Each frame has one parent. What moves is kept for some seconds, and interpolated between the stamps before and after.
"""

from __future__ import annotations

import threading
from bisect import bisect_left, insort
from dataclasses import dataclass, field
from operator import itemgetter

import numpy as np

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.quaternions import slerp
from geodesic_motion_ros.geometry.task_frame import TaskFrame

#: For so long [ns] a transform counts beside newer ones, as in tf2.
KEPT = 10_000_000_000
_stamp = itemgetter(0)
#: Position [m] and unit quaternion (w, x, y, z).
Numbers = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class NotYetKnown(Refusal):
    """A refusal of what may be known in a moment: a transform that has not come yet."""


@dataclass
class _Link:
    """The places of a frame in its parent, by stamp [ns]; one alone where it is static."""

    parent: str
    static: bool
    places: list[tuple[int, Numbers]] = field(default_factory=list)

    def add(self, stamp: int, numbers: Numbers) -> None:
        if self.static or not self.places:
            self.places = [(stamp, numbers)]
            return
        if stamp > self.places[-1][0]:
            self.places.append((stamp, numbers))
        elif self.places[at := bisect_left(self.places, stamp, key=_stamp)][0] == stamp:
            self.places[at] = stamp, numbers
        else:
            insort(self.places, (stamp, numbers), key=_stamp)
        oldest = self.places[-1][0] - KEPT
        while self.places[0][0] < oldest:
            del self.places[0]

    def at(self, stamp: int) -> TaskFrame:
        """The place at a time [ns] between the first and the last."""
        after = 0 if self.static else bisect_left(self.places, stamp, key=_stamp)
        time, (origin, quaternion) = self.places[after]
        if self.static or time == stamp:
            return TaskFrame(np.array(origin), np.array(quaternion))
        earlier, (start, facing) = self.places[after - 1]
        share = (stamp - earlier) / (time - earlier)
        turned = slerp(np.array(facing), np.array(quaternion), np.array([share]))[0]
        return TaskFrame((1.0 - share) * np.array(start) + share * np.array(origin), turned)


class TransformTable:
    """The transforms that were heard; any thread may add and ask."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._links: dict[str, _Link] = {}

    def add(self, frame: str, parent: str, stamp: int, place: Numbers, static: bool) -> None:
        """Take note of where a frame stands in its parent at a time [ns]."""
        with self._lock:
            link = self._links.get(frame)
            if link is None or (link.parent, link.static) != (parent, static):
                link = self._links[frame] = _Link(parent, static)
            link.add(stamp, place)

    def forget_motion(self) -> None:
        """Forget all that is not static: its stamps are of a clock that was set."""
        with self._lock:
            self._links = {frame: link for frame, link in self._links.items() if link.static}

    def place(self, target: str, source: str, stamp: int) -> TaskFrame | Refusal:
        """Return where a frame stands in another one at a time [ns], 0 for the newest that all on the path know."""
        with self._lock:
            up, down = self._path(source), self._path(target)
            shared = next((frame for frame in up if frame in down), None)
            if shared is None:
                heard = {*self._links, *(link.parent for link in self._links.values())}
                return _unconnected(up, down, heard)
            steps = [*up[: up.index(shared)], *down[: down.index(shared)]]
            moving = {frame: self._links[frame] for frame in steps if not self._links[frame].static}
            if stamp == 0:
                stamp = min((link.places[-1][0] for link in moving.values()), default=0)
            for frame, link in moving.items():
                if (refusal := _outside(frame, link, stamp)) is not None:
                    return refusal
            in_shared, target_in_shared = (self._compose(path[: path.index(shared)], stamp) for path in (up, down))
        return TaskFrame(*target_in_shared.to_task(in_shared.origin, in_shared.quaternion))

    def _path(self, frame: str) -> list[str]:
        """A frame and all above it."""
        path = [frame]
        while (link := self._links.get(path[-1])) is not None and link.parent not in path:
            path.append(link.parent)
        return path

    def _compose(self, steps: list[str], stamp: int) -> TaskFrame:
        """Where the first frame of a path stands in the parent of the last."""
        place = TaskFrame.identity()
        for frame in steps:
            place = TaskFrame(*self._links[frame].at(stamp).to_base(place.origin, place.quaternion))
        return place


def _unconnected(up: list[str], down: list[str], heard: set[str]) -> NotYetKnown:
    unheard = [path[0] for path in (up, down) if path[0] not in heard]
    reason = (
        f"tf tells nothing of {' and '.join(unheard)}"
        if unheard
        else f"tf does not connect them: {up[0]} is below {up[-1]}, {down[0]} below {down[-1]}"
    )
    return NotYetKnown(VerdictCode.BAD_INPUT, reason)


def _outside(frame: str, link: _Link, stamp: int) -> Refusal | None:
    """Why a time is none that a link knows; None where it is."""
    first, last = link.places[0][0], link.places[-1][0]
    what = f"tf has {frame} in {link.parent}"
    if stamp > last:
        reason = f"{what} up to {1e-9 * (stamp - last):.3f} s before its stamp"
        return NotYetKnown(VerdictCode.BAD_INPUT, reason)
    if stamp < first:
        return Refusal(VerdictCode.BAD_INPUT, f"{what} from {1e-9 * (first - stamp):.3f} s after its stamp on")
    return None
