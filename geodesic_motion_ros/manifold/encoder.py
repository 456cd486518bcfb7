"""The trained encoders in plain numpy: the latent mean of a pose or a configuration, to reconstruct demonstrations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.manifold.perceptron import Perceptron
from geodesic_motion_ros.utils.checked_numbers import SMALLEST_SCALE


@dataclass(frozen=True)
class TaskSpaceEncoder(Perceptron):
    """Mean of q(z | x, q): the perceptron's outputs at y = ((x - position_offset) / position_scale, q).

    Positions [m] in the skill's base frame; the sign of the quaternion matters: in a two-cluster skill q and -q have
    codes in different clusters.
    """

    network: ClassVar[str] = "encoder"
    lowest: ClassVar[dict[str, float]] = {"position_scale": SMALLEST_SCALE}

    position_offset: np.ndarray
    position_scale: np.ndarray

    def encode(self, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
        """Codes (..., d) of positions (..., 3) [m] and unit quaternions (..., 4)."""
        scaled = (positions - self.position_offset) / self.position_scale
        return self.outputs(np.concatenate([scaled, quaternions], axis=-1))

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        return super().expected_shapes() | {"W1": (self.b1.size, 7), "position_offset": (3,), "position_scale": ()}


@dataclass(frozen=True)
class JointSpaceEncoder(Perceptron):
    """Mean of q(z | theta): the perceptron's outputs at y = (theta - joint_offset) / joint_scale."""

    network: ClassVar[str] = "encoder"
    lowest: ClassVar[dict[str, float]] = {"joint_scale": SMALLEST_SCALE}

    joint_offset: np.ndarray
    joint_scale: np.ndarray

    def encode(self, configurations: np.ndarray) -> np.ndarray:
        """Codes (..., d) of configurations (..., eta) [rad]."""
        return self.outputs((configurations - self.joint_offset) / self.joint_scale)

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        return super().expected_shapes() | {"joint_offset": (self.W1.shape[-1],), "joint_scale": ()}
