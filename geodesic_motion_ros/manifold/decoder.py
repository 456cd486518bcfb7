"""The trained decoder in plain numpy: what the control tick and the graph evaluate.

The networks are learned in torch (`learning`); their weights are evaluated here, so that running a skill needs no
torch. Both agree to rounding (tested).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.manifold.full_covariance import covariance_root, kernel_rows, standard_deviations
from geodesic_motion_ros.manifold.progress_decoder import ProgressDecoder
from geodesic_motion_ros.utils.checked_numbers import SMALLEST_SCALE


@dataclass(frozen=True)
class Decoded:
    """What the decoder says of latent points, one row each.

    Attributes
    ----------
    positions : (n, 3) mean tool positions [m] in the skill's base frame.
    quaternions : (n, 4) mean directions on S^3 (w, x, y, z).
    root : (n, 3) standard deviations of the position [m], or (n, 6) features of the symmetric root of its full
        covariance (`covariance_root`).
    kappas : (n, 1) concentration of the orientation (von Mises-Fisher), or (n, 3) about the tool's axes (angular
        central Gaussian).
    """

    positions: np.ndarray
    quaternions: np.ndarray
    root: np.ndarray
    kappas: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations of the position (n, 3) [m]."""
        return standard_deviations(self.root)

    @property
    def kappa(self) -> np.ndarray:
        """Concentration (n,) of the orientation; of three the harmonic mean, whose spread is the mean square one."""
        return mean_concentration(self.kappas)

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

    With `sigma_shears` (3, K) the covariance of positions is full (`full_covariance`). Three rows of kappa_weights are
    concentrations kappa_i about the tool's axes, of an angular central Gaussian with q'A^-1 q = 1 + sum_i kappa_i c_i^2
    / 4, c the vector part of the turn from the mean to q. Skills of earlier releases have neither.
    """

    network: ClassVar[str] = "decoder"
    later: ClassVar[tuple[str, ...]] = (*ProgressDecoder.later, "sigma_shears")
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
    sigma_shears: np.ndarray = field(default_factory=lambda: np.empty(0), kw_only=True)

    @property
    def full(self) -> bool:
        """Whether the covariance of positions is full."""
        return self.sigma_shears.size > 0

    def decode(self, latent: np.ndarray) -> Decoded:
        """Decode latent points (n, d)."""
        return Decoded(*self.poses(latent), *self.deviations(latent))

    def poses(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The means alone: positions (n, 3) [m] and quaternions (n, 4)."""
        out = self.outputs(self.seen(latent))
        return self.position_offset + self.position_scale * out[:, :3], normalise(out[:, 3:7])

    def uncertainty(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """sigma (n, 3) [m] and kappa (n,) alone: cheaper than decoding, enough to prune a grid."""
        root, kappas = self.deviations(latent)
        return standard_deviations(root), mean_concentration(kappas)

    def deviations(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`Decoded`'s root (n, 3 or 6) [m] and kappas (n, 1 or 3)."""
        of_sigma = kernel_rows(self.sigma_weights, self.sigma_shears) if self.full else self.sigma_weights
        weights = np.vstack([of_sigma, self.kappa_weights])
        precisions = self.kernels(latent, weights)
        packed, kappas = precisions[:, : len(of_sigma)], precisions[:, len(of_sigma) :] + self.kappa_floor
        packed[:, :3] += self.sigma_floor
        return covariance_root(packed) if self.full else 1.0 / packed, kappas

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        centres, outputs = len(np.atleast_1d(self.rbf_centres)), 7 + self.progress_numbers
        of_kappa = (3, centres) if np.ndim(self.kappa_weights) == 2 else (centres,)
        return super().expected_shapes() | {
            "W3": (outputs, self.b2.size), "b3": (outputs,), "position_offset": (3,), "position_scale": (),
            "rbf_centres": (centres, *self.W1.shape[-1:]), "rbf_rate": (),
            "sigma_weights": (3, centres), "sigma_floor": (3,), "kappa_weights": of_kappa, "kappa_floor": (),
            "sigma_shears": (3, centres),
        }  # fmt: skip


def mean_concentration(kappas: np.ndarray) -> np.ndarray:
    """Harmonic mean (n,) of concentrations (n, 1) or (n, 3)."""
    return kappas[:, 0] if kappas.shape[1] == 1 else 1.0 / np.mean(1.0 / kappas, axis=1)


def rms_sigma(decoded_sigma: np.ndarray) -> np.ndarray:
    """Root mean square over the coordinates of sigma (n, 3) [m] or (n, eta) [rad]: one number per latent point, the
    support's measure.
    """
    return np.sqrt(np.mean(decoded_sigma**2, axis=-1))
