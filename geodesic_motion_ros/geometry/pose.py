"""Pose: where a tool is, and how it is turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.quaternions import angle_between


@dataclass(frozen=True)
class Pose:
    """Pose of a tool in a frame: position (3,) [m], unit quaternion (4,)."""

    position: np.ndarray
    quaternion: np.ndarray

    def is_within(self, other: Pose, limits: tuple[float, float]) -> bool:
        """Whether another pose is no farther away than limits [m], [rad]."""
        near = np.linalg.norm(self.position - other.position) <= limits[0]
        return bool(near) and bool(angle_between(self.quaternion, other.quaternion) <= limits[1])
