"""The trained decoder of joint configurations in plain numpy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.manifold.progress_decoder import ProgressDecoder
from geodesic_motion_ros.utils.checked_numbers import SMALLEST_SCALE


@dataclass(frozen=True)
class DecodedJoints:
    """What the decoder says of latent points, one row each.

    Attributes
    ----------
    configurations : (n, eta) mean joint positions [rad].
    sigma : (n, eta) their standard deviations [rad].
    """

    configurations: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class JointSpaceDecoder(ProgressDecoder):
    """p(theta | z): two tanh layers for the mean configuration, an RBF network for sigma^-1.

    With the perceptron's outputs o (eta), and those of progress (`ProgressDecoder`), at y = z,
    theta = joint_offset + joint_scale o[:eta], and, with v_k = exp(-rbf_rate |z - c_k|^2),
    1 / sigma = sigma_weights v + sigma_floor [1/rad]. The weights of the RBF network are positive, so sigma grows
    away from the data.
    """

    network: ClassVar[str] = "decoder"
    lowest: ClassVar[dict[str, float]] = {
        "joint_scale": SMALLEST_SCALE, "rbf_rate": SMALLEST_SCALE, "sigma_weights": 0.0, "sigma_floor": SMALLEST_SCALE,
        "progress_weights": 0.0, "progress_floor": SMALLEST_SCALE, "period": SMALLEST_SCALE,
    }  # fmt: skip

    joint_offset: np.ndarray
    joint_scale: np.ndarray
    sigma_weights: np.ndarray
    sigma_floor: np.ndarray

    @property
    def joints(self) -> int:
        """eta, the number of joints."""
        return len(self.joint_offset)

    def decode(self, latent: np.ndarray) -> DecodedJoints:
        """Decode latent points (n, d)."""
        return DecodedJoints(self.configurations(latent), self.uncertainty(latent))

    def configurations(self, latent: np.ndarray) -> np.ndarray:
        """Mean configurations (n, eta) [rad] alone."""
        return self.joint_offset + self.joint_scale * self.outputs(self.seen(latent))[:, : self.joints]

    def uncertainty(self, latent: np.ndarray) -> np.ndarray:
        """sigma (n, eta) [rad] alone: cheaper than decoding, enough to prune a grid."""
        return 1.0 / (self.kernels(latent, self.sigma_weights) + self.sigma_floor)

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        centres, joints = len(np.atleast_1d(self.rbf_centres)), self.b3.size - self.progress_numbers
        return super().expected_shapes() | {
            "joint_offset": (joints,), "joint_scale": (), "rbf_centres": (centres, *self.W1.shape[-1:]),
            "rbf_rate": (), "sigma_weights": (joints, centres), "sigma_floor": (joints,),
        }  # fmt: skip
