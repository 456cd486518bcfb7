"""The trained encoders in plain numpy: the latent mean of a pose or a configuration, to reconstruct demonstrations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.manifold.perceptron import Perceptron
from geodesic_motion_ros.utils.checked_numbers import SMALLEST_SCALE

#: The canonical sheet runs from -PRIOR_REACH to PRIOR_REACH on the first latent axis, by the prior.
PRIOR_REACH = 3.0
#: Latent points so far apart on the first axis are one point of a cylinder, the sheet of rounds.
PERIOD = 2.0 * PRIOR_REACH


@dataclass(frozen=True)
class TaskSpaceEncoder(Perceptron):
    """Mean of q(z | x, q): the perceptron's outputs at y = ((x - position_offset) / position_scale, q), or of
    q(z | x, q, s) at y = (..., 2 s - 1), where it reads progress, the fraction s of the arc, of rounds at
    y = (..., cos 2 pi s, sin 2 pi s): these are added to the prior's mean, (PRIOR_REACH (2 s - 1), 0, ...).

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
        return _encoded(self, np.concatenate([scaled, quaternions], axis=-1))

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        inputs = min(max((0, *self.W1.shape)[-1], 7), 9)
        return super().expected_shapes() | {"W1": (self.b1.size, inputs), "position_offset": (3,), "position_scale": ()}


@dataclass(frozen=True)
class JointSpaceEncoder(Perceptron):
    """Mean of q(z | theta): the perceptron's outputs at y = (theta - joint_offset) / joint_scale, or of q(z | theta, s)
    at y = (..., 2 s - 1), where it reads progress, the fraction s of the arc, of rounds at
    y = (..., cos 2 pi s, sin 2 pi s): these are added to the prior's mean, (PRIOR_REACH (2 s - 1), 0, ...).
    """

    network: ClassVar[str] = "encoder"
    lowest: ClassVar[dict[str, float]] = {"joint_scale": SMALLEST_SCALE}

    joint_offset: np.ndarray
    joint_scale: np.ndarray

    def encode(self, configurations: np.ndarray) -> np.ndarray:
        """Codes (..., d) of configurations (..., eta) [rad]; where it reads progress, of whole curves (..., T, eta),
        equally spaced along their arcs.
        """
        return _encoded(self, (configurations - self.joint_offset) / self.joint_scale)

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        inputs = (0, *self.W1.shape)[-1]
        joints = min(max(self.joint_offset.size, inputs - 2), inputs)
        return super().expected_shapes() | {"joint_offset": (joints,), "joint_scale": ()}


def _encoded(encoder: Perceptron, inputs: np.ndarray) -> np.ndarray:
    """Codes (..., T, d) of an encoder's inputs (..., T, n), the numbers of progress beside them that it reads."""
    numbers = encoder.W1.shape[1] - inputs.shape[-1]
    if numbers == 0:
        return encoder.outputs(inputs)
    along = np.linspace(-1.0, 1.0, inputs.shape[-2])
    # 2 pi s, as of s in [0, 1]
    turned = np.pi * (1.0 + along)
    read = along[:, None] if numbers == 1 else np.stack([np.cos(turned), np.sin(turned)], axis=1)
    codes = encoder.outputs(np.concatenate([inputs, np.broadcast_to(read, (*inputs.shape[:-1], numbers))], axis=-1))
    codes[..., 0] += PRIOR_REACH * along
    return codes
