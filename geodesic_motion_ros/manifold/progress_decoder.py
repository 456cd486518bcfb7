"""What the decoders of both spaces share: how far along the demonstrations a latent point is, decoded beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.manifold.perceptron import Perceptron
from geodesic_motion_ros.manifold.radial_basis import radial_basis


@dataclass(frozen=True)
class ProgressDecoder(Perceptron):
    """p(s | z) = N(mu_s(z), sigma_s(z)^2) of the fraction s of a demonstration's arc, beside what a subclass decodes.

    With the perceptron's last output o_s, mu_s = (1 + o_s) / 2; 1 / sigma_s = progress_weights v + progress_floor, v
    the kernels of the subclass. Models of earlier releases, and of the raw sheet, decode no progress.
    """

    later: ClassVar[tuple[str, ...]] = ("progress_weights", "progress_floor")

    progress_weights: np.ndarray = field(default_factory=lambda: np.empty(0), kw_only=True)
    progress_floor: np.ndarray = field(default_factory=lambda: np.empty(0), kw_only=True)

    rbf_centres: np.ndarray = field(kw_only=True)
    rbf_rate: np.ndarray = field(kw_only=True)

    @property
    def latent_dimension(self) -> int:
        return self.W1.shape[1]

    @property
    def kernel_deviation(self) -> float:
        """The standard deviation of the kernels, as densities of the latent space."""
        return math.sqrt(0.5 / float(self.rbf_rate))

    @property
    def decodes_progress(self) -> bool:
        """Whether the model decodes progress."""
        return self.progress_weights.size > 0

    def progress_features(self, latent: np.ndarray, length: float, sigma_weight: float) -> np.ndarray:
        """Make the features (n, 2) [m] by which progress takes part in the metric, at latent points (n, d):
        length mu_s, and length sigma_weight sigma_s. Of a model that decodes none (n, 0).
        """
        if not self.decodes_progress or length == 0.0:
            return np.empty((len(latent), 0))
        precision = radial_basis(latent, self.rbf_centres, float(self.rbf_rate), self.progress_weights[None])[:, 0]
        return length * np.stack([self.mean_progress(latent), sigma_weight / (precision + self.progress_floor)], axis=1)

    def mean_progress(self, latent: np.ndarray) -> np.ndarray:
        """Return mu_s (n,) of latent points (n, d); of a model that decodes no progress zeros."""
        return 0.5 * (1.0 + self.outputs(latent)[:, -1]) if self.decodes_progress else np.zeros(len(latent))

    def progress_energies(
        self, latent: np.ndarray, edges: np.ndarray, length: float, sigma_weight: float
    ) -> np.ndarray:
        """Measure the squared lengths (m,) [m^2] that progress gives edges (m, 2) between latent points (n, d)."""
        features = self.progress_features(latent, length, sigma_weight)
        return np.sum((features[edges[:, 1]] - features[edges[:, 0]]) ** 2, axis=1)

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        centres = len(np.atleast_1d(self.rbf_centres))
        return super().expected_shapes() | {"progress_weights": (centres,), "progress_floor": ()}
