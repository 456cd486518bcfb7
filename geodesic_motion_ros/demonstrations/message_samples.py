"""Messages -> arrays, received by a bag's recorder or by a node. Knows no ROS: any object with the fields."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take
from geodesic_motion_ros.utils.checked_files import brief

#: Stamps of a header are used where at least this share of them rises; clocks that are not set give zeros.
RISING_SHARE = 0.5

#: Messages without any of the joints, as of a gripper, are no flaw between those that count, up to so long [s].
OTHERS_ALONE = 1.0

#: When they were received (T,) and stamped (T,) [ns], and their values (T, C).
Samples = tuple[np.ndarray, np.ndarray, np.ndarray]


class JointSamples:
    """Positions [rad] of named joints out of sensor_msgs/JointState, whatever their order in each message and whatever
    else it has; messages without a finite position of one of them are passed over.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._rows: list[tuple[int, int, np.ndarray]] = []
        self._seen: dict[str, None] = {}
        self._incomplete: list[int] = []
        self._of_others: list[int] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, received: int, message: Any) -> None:
        """Take a message that was received at a time [ns]."""
        order = {name: place for place, name in enumerate(message.name)}
        self._seen |= dict.fromkeys(order)
        positions = message.position
        if order.keys().isdisjoint(self._names):
            self._of_others.append(received)
            return
        places = [order.get(name, len(positions)) for name in self._names]
        row = np.array([positions[place] if place < len(positions) else np.nan for place in places], dtype=float)
        if np.all(np.isfinite(row)):
            self._rows.append((received, stamp_of(message.header), row))
        else:
            # drivers of ros2_control publish NaN before the first state of the hardware
            self._incomplete.append(received)

    @property
    def unnamed(self) -> list[str]:
        """The joints that no message names."""
        return [name for name in self._names if name not in self._seen]

    def lacking(self) -> str:
        """Why no message counts, of those that were added."""
        lacking = f"no message has {', '.join(self.unnamed or ['a finite position of each of the joints'])}"
        return f"{lacking}; the joints there are {brief(', '.join(self._seen) or 'none', 300)}"

    def arrays(self) -> Samples:
        """At least one message counts."""
        return stacked(self._rows)

    def take(self, name: str) -> tuple[Take, tuple[Flaw, ...]]:
        """A take of at least one message, and what was found in its times."""
        received, stamps, values = self.arrays()
        times, flaws = seconds_of(received, stamps, name)
        return Take(name, times, values, self._names), (*flaws, *self.passed_over(name))

    def passed_over(self, name: str) -> tuple[Flaw, ...]:
        """What is lost with the messages that do not count, of at least one that does.

        Those of other joints are a flaw where they are alone for OTHERS_ALONE, as when a driver renames its joints.
        """
        received = np.array([row[0] for row in self._rows])
        flaws = []
        if self._incomplete:
            total = len(received) + len(self._incomplete)
            what = f"has {len(self._incomplete)} of {total} messages without a finite position of each of the joints"
            first = (self._incomplete[0] - received[0]) / 1e9
            flaws.append(Flaw(name, first, what, Action.REPAIRED, "they are left out"))
        others = np.array(self._of_others)
        for begin, end in pairwise([*others[:1], *received, *others[-1:]]):
            alone = (end - begin) / 1e9
            if alone > OTHERS_ALONE and np.any((others >= begin) & (others <= end)):
                listed = brief(", ".join(joint for joint in self._seen if joint not in self._names), 200)
                what = f"has for {alone:.2f} s only messages of other joints: {listed}"
                flaws.append(Flaw(name, (begin - received[0]) / 1e9, what, Action.REPAIRED, "they are left out"))
        return tuple(flaws)


def seconds_of(received: np.ndarray, stamps: np.ndarray, name: str) -> tuple[np.ndarray, tuple[Flaw, ...]]:
    """Times (T,) [s] from the first on: those of the headers, or of the recorder where headers have none that rise."""
    if len(stamps) > 1 and (np.any(stamps <= 0) or np.mean(np.diff(stamps) > 0) < RISING_SHARE):
        unset = "without stamps" if np.any(stamps <= 0) else "with stamps that do not rise"
        flaw = Flaw(name, 0.0, f"has headers {unset}", Action.REPAIRED, "the times of the recorder are used")
        return (received - received[0]) / 1e9, (flaw,)
    return (stamps - stamps[0]) / 1e9, ()


def stamp_of(header: Any) -> int:
    """[ns]"""
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def stacked(rows: Sequence[tuple[int, int, np.ndarray]]) -> Samples:
    """Samples of at least one row: received, stamped [ns], values (C,)."""
    received, stamps, values = zip(*rows, strict=True)
    return np.array(received), np.array(stamps), np.array(values, dtype=float)
