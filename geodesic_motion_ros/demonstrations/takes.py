"""Takes: what was recorded in one go, as arrays, before anything in it was repaired; and what is found in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from geodesic_motion_ros.demonstrations.checks import check_columns, check_times
from geodesic_motion_ros.demonstrations.column_names import POSITION, QUATERNION

POSE = (*POSITION, *QUATERNION)


class Action(Enum):
    """The treatment of a flaw."""

    KEPT = "kept"
    REPAIRED = "repaired"
    LEFT_OUT = "left out"
    REFUSED = "refused"
    #: What lies between demonstrations, and is no flaw of them.
    PASSED_OVER = "passed over"
    #: How it was read, of what recorders write in several forms: certain, and no flaw.
    READ = "read"


#: What even --strict accepts.
NO_FLAW = (Action.PASSED_OVER, Action.READ)


@dataclass(frozen=True)
class Flaw:
    """Something that a recording should not have.

    Attributes
    ----------
    demonstration : its name.
    time : of its beginning [s], as in the recording.
    what : a few words with the figures, as in "the demonstration ...".
    action, how : what is done about it, and how in a few words.
    """

    demonstration: str
    time: float
    what: str
    action: Action
    how: str = ""

    def __str__(self) -> str:
        done = f"{self.action.value}: {self.how}" if self.how else self.action.value
        return f"'{self.demonstration}' {self.what}, at {self.time:.2f} s; {done}"


@dataclass(frozen=True, eq=False)
class Take:
    """Samples in the order in which they were recorded; DemonstrationError where one is not finite, or not in seconds.

    Attributes
    ----------
    name : what messages call it.
    times : (T,) [s]; may repeat, fall and have gaps.
    values : (T, C) joints [rad] or poses: positions [m] and, where recorded, quaternions, neighbours in one hemisphere.
    names : (C,) of the columns: those of the joints, or the first of POSE.
    found : how the file was read that it is from, and what was wrong there.
    in_one_go : whether nothing in the file says where a demonstration begins.
    has_times : whether the times are those of the recording, and not assumed.
    """

    name: str
    times: np.ndarray
    values: np.ndarray
    names: tuple[str, ...]
    found: tuple[Flaw, ...] = ()
    in_one_go: bool = False
    has_times: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", check_times(self.times, self.name))
        object.__setattr__(self, "values", check_columns(self.values, self.names, self.name, self.times))

    def __len__(self) -> int:
        return len(self.times)

    @property
    def is_of_joints(self) -> bool:
        """Whether the columns are joints."""
        return self.names[0] not in POSITION

    def part(self, samples: slice | np.ndarray, name: str | None = None) -> Take:
        """Cut the take to some samples, under another name if one is given."""
        return replace(self, times=self.times[samples], values=self.values[samples], name=name or self.name)


def sizes_by_column(sizes: Mapping[str, float], names: Sequence[str]) -> np.ndarray:
    """Look up one size (C,) for each column, among those of "joint", "position" and "quaternion"."""
    kinds = ("position" if name in POSITION else "quaternion" if name in QUATERNION else "joint" for name in names)
    return np.array([sizes[kind] for kind in kinds])
