"""Curves of poses: arc length, interpolation, resampling.

Symbols: s in [0, 1] is the fraction of the arc length of the positions, the abscissa along which curves are
compared and averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.quaternions import angle_between, rotate_by, rotation_vector_between

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

    def resample(self, samples: int) -> PoseCurve:
        """The same curve at `samples` points, equally spaced in arc length of the positions."""
        return PoseCurve(
            *interpolate(
                arc_length_fractions(self.positions),
                self.positions,
                self.quaternions,
                np.linspace(0.0, 1.0, samples),
            )
        )


def arc_length(positions: np.ndarray) -> np.ndarray:
    """Length [m] travelled up to each of the positions (n, 3); (n,), from 0."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])


def arc_length_fractions(positions: np.ndarray) -> np.ndarray:
    """Arc length scaled to [0, 1] (n,). Equally spaced for a curve that stays in one place."""
    length = arc_length(positions)
    return length / length[-1] if length[-1] > 0.0 else np.linspace(0.0, 1.0, len(positions))


def pose_arc_length(positions: np.ndarray, quaternions: np.ndarray, rotation_length: float) -> np.ndarray:
    """Arc length [m] up to each of the poses (n, 3), (n, 4) that counts turning as well; (n,), from 0.

    Sums sqrt(|dx|^2 + (rotation_length * angle)^2), so that a tool that turns on the spot still moves on.
    """
    moved = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    turned = angle_between(quaternions[1:], quaternions[:-1])
    return np.concatenate([[0.0], np.cumsum(np.hypot(moved, rotation_length * turned))])


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
