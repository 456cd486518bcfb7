"""TaskFrame: where the frame that a skill was demonstrated in stands now.

A skill taught relative to an object follows the object. Start and goal go from the base frame into the task frame, the
graph is carried to them there, and its poses come back: since frames are rigid, all distances stay what they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geodesic_motion_ros.geometry.quaternions import inverse, multiply, rotate


@dataclass(frozen=True)
class TaskFrame:
    """Pose of the task frame in the base frame: origin (3,) [m] and unit quaternion (4,)."""

    origin: np.ndarray
    quaternion: np.ndarray

    @classmethod
    def identity(cls) -> TaskFrame:
        """The task frame is the base frame: skills that were demonstrated in the base frame."""
        return cls(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))

    @cached_property
    def is_identity(self) -> bool:
        """Whether nothing has to be converted."""
        return bool(np.all(self.origin == 0.0) and np.all(self.quaternion == [1.0, 0.0, 0.0, 0.0]))

    def points_to_base(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the task frame as the base frame sees them."""
        return points if self.is_identity else self.origin + rotate(self.quaternion, points)

    def covariances_to_base(self, covariances: np.ndarray) -> np.ndarray:
        """Covariances (n, 3, 3) of positions of the task frame as the base frame sees them."""
        axes = rotate(self.quaternion, np.eye(3))
        return covariances if self.is_identity else axes.T @ covariances @ axes

    def to_task(self, positions: np.ndarray, quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses (..., 3), (..., 4) of the base frame as the task frame sees them."""
        if self.is_identity:
            return positions, quaternions
        back = inverse(self.quaternion)
        return rotate(back, positions - self.origin), multiply(back, quaternions)

    def to_base(self, positions: np.ndarray, quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses (..., 3), (..., 4) of the task frame as the base frame sees them."""
        if self.is_identity:
            return positions, quaternions
        return self.origin + rotate(self.quaternion, positions), multiply(self.quaternion, quaternions)
