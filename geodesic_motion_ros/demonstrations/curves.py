"""Curves of poses: arc length, interpolation, resampling, moving the ends.

Symbols: s in [0, 1] is the fraction of the arc length of the positions, the abscissa along which curves are
compared, averaged and corrected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.quaternions import rotate_by, rotation_vector_between

Pose = tuple[np.ndarray, np.ndarray]
"""A position (3,) [m] and a unit quaternion (4,), scalar first."""


@dataclass(frozen=True)
class PoseCurve:
    """A sampled motion without its timing.

    Attributes
    ----------
    positions : (n, 3) [m]; quaternions : (n, 4) unit, scalar first, neighbours in one hemisphere.
    """

    positions: np.ndarray
    quaternions: np.ndarray

    @property
    def start(self) -> Pose:
        return self.positions[0], self.quaternions[0]

    @property
    def goal(self) -> Pose:
        return self.positions[-1], self.quaternions[-1]

    def resampled(self, samples: int) -> PoseCurve:
        """The same curve at `samples` points, equally spaced in arc length of the positions."""
        return PoseCurve(
            *interpolate(
                arc_length_fractions(self.positions),
                self.positions,
                self.quaternions,
                np.linspace(0.0, 1.0, samples),
            )
        )

    def with_ends(self, start: Pose, goal: Pose) -> PoseCurve:
        """Move the ends to demanded poses; the offsets fade linearly in arc length.

        x'(s) = x(s) + (1 - s) d0 + s d1, with d0, d1 the position offsets at the start and at the goal, and
        q'(s) = exp((1 - s) r0 + s r1) q(s), with r0, r1 the shortest rotation vectors [rad, base frame]
        there.
        """
        s = arc_length_fractions(self.positions)[:, None]
        positions = (
            self.positions + (1.0 - s) * (start[0] - self.positions[0]) + s * (goal[0] - self.positions[-1])
        )
        at_start = rotation_vector_between(self.quaternions[0], start[1])
        at_goal = rotation_vector_between(self.quaternions[-1], goal[1])
        return PoseCurve(positions, rotate_by((1.0 - s) * at_start + s * at_goal, self.quaternions))


def arc_length(positions: np.ndarray) -> np.ndarray:
    """Length [m] travelled up to each of the positions (n, 3); (n,), from 0."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])


def arc_length_fractions(positions: np.ndarray) -> np.ndarray:
    """Arc length scaled to [0, 1] (n,). Equally spaced for a curve that stays in one place."""
    length = arc_length(positions)
    return length / length[-1] if length[-1] > 0.0 else np.linspace(0.0, 1.0, len(positions))


def interpolate(
    abscissa: np.ndarray, positions: np.ndarray, quaternions: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) linearly and quaternions (n, 4) on great circles between samples at abscissa (n,),
    never falling.

    Returns positions (m, 3) and quaternions (m, 4) at the values `at` (m,). Abscissas may repeat (a pause of
    the hand): the last of the equal samples counts.
    """
    left = np.clip(np.searchsorted(abscissa, at, side="right") - 1, 0, len(abscissa) - 2)
    width = abscissa[left + 1] - abscissa[left]
    fraction = np.divide(at - abscissa[left], width, out=np.ones_like(at), where=width > 0.0)[:, None]
    step = rotation_vector_between(quaternions[left], quaternions[left + 1])
    moved = (1.0 - fraction) * positions[left] + fraction * positions[left + 1]
    return moved, rotate_by(fraction * step, quaternions[left])
