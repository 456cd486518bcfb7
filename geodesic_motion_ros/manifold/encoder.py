"""The trained encoders in plain numpy: the latent mean of a pose or a configuration, to reconstruct demonstrations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.manifold.perceptron import Perceptron
from geodesic_motion_ros.utils.checked_numbers import SMALLEST_SCALE


@dataclass(frozen=True)
class TaskSpaceEncoder(Perceptron):
    """Mean of q(z | x, q): the perceptron's outputs at y = ((x - position_offset) / position_scale, q), or of
    q(z | x, q, s) at y = (..., 2 s - 1), where it reads progress, the fraction s of the arc.

    Positions [m] in the skill's base frame; the sign of the quaternion matters: in a two-cluster skill q and -q have
    codes in different clusters.
    """

    network: ClassVar[str] = "encoder"
    lowest: ClassVar[dict[str, float]] = {"position_scale": SMALLEST_SCALE}

    position_offset: np.ndarray
    position_scale: np.ndarray

    def encode(self, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
        """Codes (..., d) of positions (..., 3) [m] and unit quaternions (..., 4); where it reads progress, of whole
        curves (..., T, 3), (..., T, 4), equally spaced along their arcs.
        """
        scaled = (positions - self.position_offset) / self.position_scale
        return self.outputs(_with_progress(np.concatenate([scaled, quaternions], axis=-1), self.W1.shape[1]))

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        inputs = 8 if self.W1.shape[-1:] == (8,) else 7
        return super().expected_shapes() | {"W1": (self.b1.size, inputs), "position_offset": (3,), "position_scale": ()}


@dataclass(frozen=True)
class JointSpaceEncoder(Perceptron):
    """Mean of q(z | theta): the perceptron's outputs at y = (theta - joint_offset) / joint_scale, or of q(z | theta, s)
    at y = (..., 2 s - 1), where it reads progress, the fraction s of the arc.
    """

    network: ClassVar[str] = "encoder"
    lowest: ClassVar[dict[str, float]] = {"joint_scale": SMALLEST_SCALE}

    joint_offset: np.ndarray
    joint_scale: np.ndarray

    def encode(self, configurations: np.ndarray) -> np.ndarray:
        """Codes (..., d) of configurations (..., eta) [rad]; where it reads progress, of whole curves (..., T, eta),
        equally spaced along their arcs.
        """
        scaled = (configurations - self.joint_offset) / self.joint_scale
        return self.outputs(_with_progress(scaled, self.W1.shape[1]))

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        inputs = self.W1.shape[-1]
        joints = inputs - 1 if self.joint_offset.shape == (inputs - 1,) else inputs
        return super().expected_shapes() | {"joint_offset": (joints,), "joint_scale": ()}


def _with_progress(inputs: np.ndarray, width: int) -> np.ndarray:
    """Inputs (..., T, n) of an encoder with so many, 2 s - 1 among them where they are n + 1."""
    if inputs.shape[-1] == width:
        return inputs
    progress = np.broadcast_to(np.linspace(-1.0, 1.0, inputs.shape[-2]), inputs.shape[:-1])
    return np.concatenate([inputs, progress[..., None]], axis=-1)
