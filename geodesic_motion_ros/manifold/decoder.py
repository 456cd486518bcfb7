"""The trained decoder in plain numpy: what the control tick and the graph evaluate.

The networks are learned in torch (`learning`); their weights are evaluated here, so that running a skill needs no
torch. Both agree to rounding (tested).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.manifold.progress_decoder import ProgressDecoder
from geodesic_motion_ros.utils.checked_numbers import SMALLEST_SCALE


@dataclass(frozen=True)
class Decoded:
    """What the decoder says of latent points, one row each.

    Attributes
    ----------
    positions : (n, 3) mean tool positions [m] in the skill's base frame.
    quaternions : (n, 4) mean directions of the von Mises-Fisher distribution on S^3 (w, x, y, z).
    sigma : (n, 3) standard deviation of the position [m].
    kappa : (n,) concentration of the orientation.
    """

    positions: np.ndarray
    quaternions: np.ndarray
    sigma: np.ndarray
    kappa: np.ndarray

    @property
    def spread(self) -> np.ndarray:
        """kappa^(-1/2) (n,): the angular standard deviation, the same role for orientation as sigma for position."""
        return self.kappa**-0.5


@dataclass(frozen=True)
class TaskSpaceDecoder(ProgressDecoder):
    """p(x, q | z): two tanh layers for the means, RBF networks for sigma^-1 and kappa.

    With the perceptron's outputs o (7), and those of progress (`ProgressDecoder`), at y = z,
    position = position_offset + position_scale * o[:3], quaternion = o[3:7] / |o[3:7]|,
    v_k = exp(-rbf_rate |z - c_k|^2), 1 / sigma = sigma_weights v + sigma_floor [1/m],
    kappa = kappa_weights v + kappa_floor. Weights of the RBF networks are positive, so sigma grows and kappa falls
    away from the data.
    """

    network: ClassVar[str] = "decoder"
    lowest: ClassVar[dict[str, float]] = {
        "position_scale": SMALLEST_SCALE, "rbf_rate": SMALLEST_SCALE, "sigma_weights": 0.0, "kappa_weights": 0.0,
        "sigma_floor": SMALLEST_SCALE, "kappa_floor": SMALLEST_SCALE, "progress_weights": 0.0,
        "progress_floor": SMALLEST_SCALE, "period": SMALLEST_SCALE,
    }  # fmt: skip

    position_offset: np.ndarray
    position_scale: np.ndarray
    sigma_weights: np.ndarray
    sigma_floor: np.ndarray
    kappa_weights: np.ndarray
    kappa_floor: np.ndarray

    def decode(self, latent: np.ndarray) -> Decoded:
        """Decode latent points (n, d)."""
        return Decoded(*self.poses(latent), *self.uncertainty(latent))

    def poses(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The means alone: positions (n, 3) [m] and quaternions (n, 4)."""
        out = self.outputs(self.seen(latent))
        return self.position_offset + self.position_scale * out[:, :3], normalise(out[:, 3:7])

    def uncertainty(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """sigma (n, 3) [m] and kappa (n,) alone: cheaper than decoding, enough to prune a grid."""
        weights = np.vstack([self.sigma_weights, self.kappa_weights])
        precisions = self.kernels(latent, weights)
        return 1.0 / (precisions[:, :3] + self.sigma_floor), precisions[:, 3] + self.kappa_floor

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        centres, outputs = len(np.atleast_1d(self.rbf_centres)), 7 + self.progress_numbers
        return super().expected_shapes() | {
            "W3": (outputs, self.b2.size), "b3": (outputs,), "position_offset": (3,), "position_scale": (),
            "rbf_centres": (centres, *self.W1.shape[-1:]), "rbf_rate": (),
            "sigma_weights": (3, centres), "sigma_floor": (3,), "kappa_weights": (centres,), "kappa_floor": (),
        }  # fmt: skip


def rms_sigma(decoded_sigma: np.ndarray) -> np.ndarray:
    """Root mean square over the coordinates of sigma (n, 3) [m] or (n, eta) [rad]: one number per latent point, the
    support's measure.
    """
    return np.sqrt(np.mean(decoded_sigma**2, axis=-1))
