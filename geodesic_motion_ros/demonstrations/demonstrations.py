"""Demonstrations: recordings of a task as checked arrays in SI units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np

from geodesic_motion_ros.demonstrations.checks import (
    Abscissa,
    check_columns,
    check_resampling,
    check_rising_times,
    check_samples,
)
from geodesic_motion_ros.geometry.curves import PoseCurve, arc_length, interpolate
from geodesic_motion_ros.geometry.quaternions import continuous_signs, normalise
from geodesic_motion_ros.utils.checked_numbers import ARM_REACH, UNIT_NORM_TOLERANCE
from geodesic_motion_ros.utils.errors import DemonstrationError

SHORTEST_PATH = 1e-4
"""A path shorter than this [m] is noise of a hand that stood still: nothing to resample by."""


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One motion as a person demonstrated it. The arrays are checked copies and cannot be written to.

    Attributes
    ----------
    positions : (T, 3) tool positions [m].
    quaternions : (T, 4) tool orientations, scalar first; scaled to unit length, neighbours made to lie in one
        hemisphere, the first keeps its recorded sign.
    times : (T,) [s], strictly increasing.
    name : what error messages and tables call it.

    Raises
    ------
    DemonstrationError
        Names the demonstration, the sample and the column of what cannot be used: fewer than two samples,
        wrong shapes, NaN or infinite values, quaternions that are zero or not of unit length, positions
        beyond any arm's reach, times that do not increase.
    """

    positions: np.ndarray
    quaternions: np.ndarray
    times: np.ndarray
    name: str

    def __post_init__(self) -> None:
        positions = check_columns(self.positions, ("px", "py", "pz"), self.name)
        quaternions = check_columns(self.quaternions, ("qw", "qx", "qy", "qz"), self.name)
        times = check_rising_times(self.times, self.name)
        if not len(positions) == len(quaternions) == len(times):
            raise DemonstrationError(
                f"demonstration '{self.name}' has {len(positions)} positions, {len(quaternions)} quaternions "
                f"and {len(times)} times; it needs one of each per sample"
            )
        check_samples(len(positions), self.name)
        _check_reach(positions, self.name)
        check_norms(quaternions, self.name)
        self._freeze(positions, continuous_signs(normalise(quaternions)), times)

    def _freeze(self, positions: np.ndarray, quaternions: np.ndarray, times: np.ndarray) -> None:
        for name, array in (("positions", positions), ("quaternions", quaternions), ("times", times)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.times)

    @property
    def curve(self) -> PoseCurve:
        """The motion without its timing."""
        return PoseCurve(self.positions, self.quaternions)

    @property
    def length(self) -> float:
        """Length [m] of the path of the positions."""
        return float(arc_length(self.positions)[-1])

    def resample(self, samples: int = 200, by: Abscissa = "arc_length") -> Demonstration:
        """Resample the motion at `samples` instants, equally spaced in arc length of the positions or in time.

        Positions and times are interpolated linearly, quaternions on great circles. Times stay those of the
        recording. Raises DemonstrationError for fewer than 2 samples, another `by`, or an arc length of zero.
        """
        check_resampling(samples, by)
        if by == "arc_length" and self.length < SHORTEST_PATH:
            raise DemonstrationError(
                f"demonstration '{self.name}' moves {self.length * 1e3:.3g} mm in all: it has no arc length; "
                "resample by 'time'"
            )
        abscissa = arc_length(self.positions) if by == "arc_length" else self.times
        at = np.linspace(abscissa[0], abscissa[-1], samples)
        positions, quaternions = interpolate(abscissa, self.positions, self.quaternions, at)
        times = at if by == "time" else np.interp(at, abscissa, self.times)
        return Demonstration(positions, quaternions, times, self.name)


Item = TypeVar("Item")
Items = TypeVar("Items", bound="DemonstrationSet")


@dataclass(frozen=True, eq=False)
class DemonstrationSet(Generic[Item]):
    """Demonstrations of one task, of poses or of configurations.

    Attributes
    ----------
    items : at least one.
    has_times : whether their times are those of the recording, and not assumed.
    """

    items: tuple[Item, ...]
    has_times: bool = field(default=True, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "items", tuple(self.items))
        if not self.items:
            raise DemonstrationError("no demonstrations: at least one is needed")

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Item]:
        return iter(self.items)

    def __getitem__(self, index: int) -> Item:
        return self.items[index]

    def resample(self: Items, samples: int = 200, by: Abscissa = "arc_length") -> Items:
        """Resample all demonstrations to equally many samples; see `Demonstration.resample`."""
        return replace(self, items=tuple(item.resample(samples, by) for item in self))

    def split(self: Items, held_out: Sequence[int]) -> tuple[Items, Items]:
        """Split by index into (to train on, held out); DemonstrationError: bad indices, an empty side."""
        indices = list(held_out)
        wrong = [index for index in indices if index not in range(len(self))]
        if wrong:
            raise DemonstrationError(
                f"cannot hold out demonstration {wrong[0]}: the {len(self)} are numbered 0 to {len(self) - 1}"
            )
        if len(set(indices)) != len(indices):
            raise DemonstrationError(f"cannot hold out a demonstration twice: {indices}")
        if not 0 < len(indices) < len(self):
            raise DemonstrationError(
                f"cannot hold out {len(indices)} of {len(self)} demonstrations: hold out at least one and "
                "leave at least one to train on"
            )
        kept = tuple(item for index, item in enumerate(self.items) if index not in indices)
        return replace(self, items=kept), replace(self, items=tuple(self.items[index] for index in indices))

    def stacked(self, name: str) -> np.ndarray:
        """Stack an array of every demonstration, (N, T, C); DemonstrationError where the numbers of samples differ."""
        lengths = [len(item) for item in self]
        if len(set(lengths)) > 1:
            raise DemonstrationError(
                f"demonstrations have between {min(lengths)} and {max(lengths)} samples: resample them first"
            )
        return np.stack([getattr(item, name) for item in self])


@dataclass(frozen=True, eq=False)
class Demonstrations(DemonstrationSet[Demonstration]):
    """Demonstrations of one task, as poses of a tool.

    Attributes
    ----------
    items : at least one.
    frame : name of the frame that positions and orientations are expressed in.
    has_orientation : False for recordings of positions alone; their quaternions are the identity then.
    """

    frame: str = "base"
    has_orientation: bool = True

    def positions_array(self) -> np.ndarray:
        """Stack positions (N, T, 3) [m]; DemonstrationError where the numbers of samples differ."""
        return self.stacked("positions")

    def quaternions_array(self) -> np.ndarray:
        """Stack quaternions (N, T, 4); DemonstrationError where the numbers of samples differ."""
        return self.stacked("quaternions")

    def align_hemispheres(self) -> Demonstrations:
        """Flip whole demonstrations (q -> -q, the same rotations) so that all lie on the sheet of the first.

        Two recordings of one motion may start with opposite signs. A demonstration is flipped when its
        quaternions have a negative dot product with those of the first, averaged along the arc length.
        """
        sheets = [item.curve.resample(100).quaternions for item in self]
        flip = [float(np.mean(np.sum(sheet * sheets[0], axis=1))) < 0.0 for sheet in sheets]
        return replace(
            self,
            items=tuple(
                replace(item, quaternions=-item.quaternions) if negative else item
                for item, negative in zip(self, flip, strict=True)
            ),
        )


def _check_reach(positions: np.ndarray, demonstration: str) -> None:
    sample = int(np.argmax(np.linalg.norm(positions, axis=1)))
    distance = np.linalg.norm(positions[sample])
    if distance > ARM_REACH:
        raise DemonstrationError(
            f"demonstration '{demonstration}', sample {sample}: the position is {distance:.4g} m from the "
            f"base and no arm reaches {ARM_REACH:g} m; positions must be in metres"
        )


def check_norms(quaternions: np.ndarray, demonstration: str) -> None:
    """Refuse quaternions (T, 4) that are zero or not of unit length, (T, 0) are none: DemonstrationError."""
    if not quaternions.shape[1]:
        return
    norms = np.linalg.norm(quaternions, axis=1)
    bad = np.flatnonzero(np.abs(norms - 1.0) > UNIT_NORM_TOLERANCE)
    if len(bad):
        sample = bad[0]
        what = "is zero" if norms[sample] == 0.0 else f"has length {norms[sample]:.4g}"
        raise DemonstrationError(
            f"demonstration '{demonstration}', sample {sample}, columns qw,qx,qy,qz: the quaternion {what}; "
            f"it must have length 1 within {UNIT_NORM_TOLERANCE:g} (are the columns in the right order?)"
        )
