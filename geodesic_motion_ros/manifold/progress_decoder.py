"""What the decoders of both spaces share: how far along the demonstrations a latent point is, decoded beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.manifold.perceptron import Perceptron
from geodesic_motion_ros.manifold.radial_basis import radial_basis

#: A step of the perceptron's outputs of progress as a step of s, by their number.
PROGRESS_SCALES = {1: 0.5, 2: 0.5 / np.pi}


@dataclass(frozen=True)
class ProgressDecoder(Perceptron):
    """p(s | z) = N(mu_s(z), sigma_s(z)^2) of the fraction s of a demonstration's arc, beside what a subclass decodes.

    With the perceptron's last output o_s, mu_s = (1 + o_s) / 2; 1 / sigma_s = progress_weights v + progress_floor, v
    the kernels of the subclass. Models of earlier releases, and of the raw sheet, decode no progress.

    Rounds are learned on a cylinder, whose sheet is unrolled: z_0 and z_0 + period are one place. The perceptron and
    the kernels of such a model see y = (r cos(z_0 / r), r sin(z_0 / r), z_1, ...), r = period / 2 pi, in the place of
    z: a step along the sheet is as long as it was. In the place of s there are two numbers, on a circle of
    circumference 1: its mean is the last two outputs over 2 pi, and a step along it is as long as one of s.
    """

    later: ClassVar[tuple[str, ...]] = ("progress_weights", "progress_floor", "period")

    progress_weights: np.ndarray = field(default_factory=lambda: np.empty(0), kw_only=True)
    progress_floor: np.ndarray = field(default_factory=lambda: np.empty(0), kw_only=True)
    period: np.ndarray = field(default_factory=lambda: np.empty(0), kw_only=True)

    rbf_centres: np.ndarray = field(kw_only=True)
    rbf_rate: np.ndarray = field(kw_only=True)

    @property
    def latent_dimension(self) -> int:
        return self.W1.shape[1] - self.is_closed

    @property
    def is_closed(self) -> bool:
        """Whether the model is of rounds, on a cylinder."""
        return self.period.size > 0

    @property
    def progress_numbers(self) -> int:
        """How many numbers of progress the model decodes: none, s, or two on a circle."""
        return (1 + self.is_closed) if self.progress_weights.size > 0 else 0

    def seen(self, latent: np.ndarray) -> np.ndarray:
        """Return what the networks see of latent points (..., d): y (..., d + 1) on a cylinder, else the points."""
        if not self.is_closed:
            return latent
        radius = float(self.period) / (2.0 * np.pi)
        turned = latent[..., :1] / radius
        return np.concatenate([radius * np.cos(turned), radius * np.sin(turned), latent[..., 1:]], axis=-1)

    def kernels(self, latent: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Weigh the kernels v (outputs, K) at latent points (n, d): (n, outputs)."""
        return radial_basis(self.seen(latent), self.rbf_centres, float(self.rbf_rate), weights)

    @property
    def kernel_deviation(self) -> float:
        """The standard deviation of the kernels, as densities of the latent space."""
        return math.sqrt(0.5 / float(self.rbf_rate))

    def progress_features(self, latent: np.ndarray, length: float, sigma_weight: float) -> np.ndarray:
        """Make the features (n, 2 or 3) [m] by which progress takes part in the metric, at latent points (n, d):
        length mu_s, but for a constant, and length sigma_weight sigma_s. Of a model that decodes none (n, 0).
        """
        numbers = self.progress_numbers
        if numbers == 0 or length == 0.0:
            return np.empty((len(latent), 0))
        precision = self.kernels(latent, self.progress_weights[None])
        mean = PROGRESS_SCALES[numbers] * self.outputs(self.seen(latent))[:, -numbers:]
        return length * np.concatenate([mean, sigma_weight / (precision + self.progress_floor)], axis=1)

    def mean_progress(self, latent: np.ndarray) -> np.ndarray:
        """Return mu_s (n,) of latent points (n, d); of a model that decodes no progress, or of rounds, zeros."""
        return 0.5 * (1.0 + self.outputs(latent)[:, -1]) if self.progress_numbers == 1 else np.zeros(len(latent))

    def progress_energies(
        self, latent: np.ndarray, edges: np.ndarray, length: float, sigma_weight: float
    ) -> np.ndarray:
        """Measure the squared lengths (m,) [m^2] that progress gives edges (m, 2) between latent points (n, d)."""
        features = self.progress_features(latent, length, sigma_weight)
        return np.sum((features[edges[:, 1]] - features[edges[:, 0]]) ** 2, axis=1)

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        centres = len(np.atleast_1d(self.rbf_centres))
        return super().expected_shapes() | {"progress_weights": (centres,), "progress_floor": (), "period": ()}
