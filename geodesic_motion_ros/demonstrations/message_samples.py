"""Messages -> arrays, received by a bag's recorder or by a node. Knows no ROS: any object with the fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from geodesic_motion_ros.demonstrations.clocks import Clock
from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take
from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Messages without any of the joints, as of a gripper, are no flaw between those that count, up to so long [s].
OTHERS_ALONE = 1.0

#: Joints that come apart are merged where the samples of each are no farther apart than so many of its usual steps.
FARTHEST_APART = 3.0
#: Joints whose stamps lag behind the recorder by times that differ by more [ns] are stamped by different clocks.
CLOCKS_APART = 50_000_000

#: When they were received (T,) and stamped (T,) [ns], and their values (T, C).
Samples = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class ReceivedTake:
    """A take out of messages, and what was found in them.

    received : (T,) when its samples were received [ns].
    breaks : times [s] at which the stamps began again.
    """

    take: Take
    flaws: tuple[Flaw, ...]
    received: np.ndarray
    breaks: tuple[float, ...]

    @classmethod
    def of(cls, samples: Samples, names: Sequence[str], name: str) -> ReceivedTake:
        """Make the take of samples in the order in which they were received; names : of their columns."""
        received, stamps, values = samples
        clock = Clock.of(received, stamps)
        seconds = clock.nanoseconds(received, stamps) / 1e9
        return cls(Take(name, seconds, values, tuple(names)), clock.flaws(name), received, clock.breaks)


class JointSamples:
    """Positions [rad] of named joints out of sensor_msgs/JointState, whatever their order in each message and whatever
    else it has.

    Messages without a finite position of one of them are passed over, unless no message has them all: then those of
    several messages are merged, by joint and stamp.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._rows: list[tuple[int, int, np.ndarray]] = []
        self._parts: list[tuple[int, int, np.ndarray]] = []
        self._found = np.zeros(len(self._names), dtype=int)
        self._seen: dict[str, None] = {}
        self._of_others: list[int] = []

    def __len__(self) -> int:
        return len(self._rows) or int(self._found.min())

    def add(self, received: int, message: Any) -> None:
        """Take a message that was received at a time [ns]."""
        self._seen |= dict.fromkeys(message.name)
        if set(message.name).isdisjoint(self._names):
            self._of_others.append(received)
            return
        row = positions_in(message, self._names)
        finite = np.isfinite(row)
        self._found += finite
        # drivers of ros2_control publish NaN before the first state of the hardware
        (self._rows if np.all(finite) else self._parts).append((received, stamp_of(message.header), row))

    @property
    def missing_joints(self) -> list[str]:
        """The joints that no message names."""
        return [name for name in self._names if name not in self._seen]

    def lacking(self) -> str:
        """Say why no message counts, of those that were added."""
        lacking = f"no message has {', '.join(self.missing_joints or ['a finite position of each of the joints'])}"
        return f"{lacking}; the joints there are {brief(', '.join(self._seen) or 'none', 300)}"

    def take(self, name: str) -> ReceivedTake:
        """Make the take of the messages, at least one sample.

        DemonstrationError: the joints come in several messages, and never at one time.
        """
        if not self._rows:
            return self._merged(name)
        read = ReceivedTake.of(stack_rows(self._rows), self._names, name)
        return replace(read, flaws=(*read.flaws, *self._passed_over(name)))

    def _merged(self, name: str) -> ReceivedTake:
        """Samples whenever the joint comes that comes least often, the others on straight lines between theirs."""
        received, stamps, parts = stack_rows(self._parts)
        finite = np.isfinite(parts)
        lags = np.array([np.median((received - stamps)[own]) for own in finite.T])
        unset = f"whose clocks differ by {np.ptp(lags) / 1e9:.2f} s" if np.ptp(lags) > CLOCKS_APART else ""
        clock = Clock.of(received, stamps, len(self), unset)
        times = clock.nanoseconds(received, stamps)
        rarest = finite[:, np.argmin(self._found)]
        at, first = np.unique(times[rarest], return_index=True)
        values, near = np.empty((len(at), len(self._names))), np.ones(len(at), dtype=bool)
        for joint, own in enumerate(finite.T):
            there, place = np.unique(times[own], return_index=True)
            values[:, joint] = np.interp(at, there, parts[own, joint][place])
            near &= _is_near(at, there)
        what = f"has its joints in several messages: {self._groups()}"
        if not np.any(near):
            raise DemonstrationError(f"{name} {what}; they never come at one time")
        merged = Flaw(name, 0.0, what, Action.READ, "merged by joint and time")
        take = Take(name, at[near] / 1e9, values[near], self._names)
        return ReceivedTake(take, (*clock.flaws(name), merged), received[rarest][first][near], clock.breaks)

    def _groups(self) -> str:
        """The joints that come together, as "a, b | c"."""
        patterns = dict.fromkeys(tuple(np.isfinite(row)) for _, _, row in self._parts)
        groups = [", ".join(name for name, own in zip(self._names, each, strict=True) if own) for each in patterns]
        return brief(" | ".join(group for group in groups if group), 300)

    def _passed_over(self, name: str) -> tuple[Flaw, ...]:
        """What is lost with the messages that do not count, of at least one that does.

        Those of other joints are a flaw where they are alone for OTHERS_ALONE, as when a driver renames its joints.
        """
        received = np.array([row[0] for row in self._rows])
        flaws = []
        if self._parts:
            total = len(received) + len(self._parts)
            what = f"has {len(self._parts)} of {total} messages without a finite position of each of the joints"
            first = (self._parts[0][0] - received[0]) / 1e9
            flaws.append(Flaw(name, first, what, Action.REPAIRED, "they are left out"))
        others = np.array(self._of_others)
        for begin, end in pairwise([*others[:1], *received, *others[-1:]]):
            alone = (end - begin) / 1e9
            if alone > OTHERS_ALONE and np.any((others >= begin) & (others <= end)):
                listed = brief(", ".join(joint for joint in self._seen if joint not in self._names), 200)
                what = f"has for {alone:.2f} s only messages of other joints: {listed}"
                flaws.append(Flaw(name, (begin - received[0]) / 1e9, what, Action.REPAIRED, "they are left out"))
        return tuple(flaws)


def positions_in(message: Any, names: Sequence[str]) -> np.ndarray:
    """Read positions (eta,) [rad] of joints in a message, NaN of those that it does not have."""
    order, positions = {name: place for place, name in enumerate(message.name)}, message.position
    places = [order.get(name, len(positions)) for name in names]
    return np.array([positions[place] if place < len(positions) else np.nan for place in places], dtype=float)


def _is_near(at: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Whether times (T,) lie between samples at `times` that are no farther apart than FARTHEST_APART usual steps."""
    steps = np.diff(times, append=np.inf)
    step = steps[np.searchsorted(times, at, "right") - 1]
    near = (at >= times[0]) & (step <= FARTHEST_APART * np.median(np.diff(times))) if len(times) > 1 else False
    return near | np.isin(at, times)


def stamp_of(header: Any) -> int:
    """Read the stamp of a header [ns]."""
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def stack_rows(rows: Sequence[tuple[int, int, np.ndarray]]) -> Samples:
    """Stack at least one row into samples: received, stamped [ns], values (C,)."""
    received, stamps, values = zip(*rows, strict=True)
    return np.array(received), np.array(stamps), np.array(values, dtype=float)
