"""The prior of the latent codes: on the canonical (endpoint-normalised) sheet it tells how far along a sample lies.

p(z | s) = N((PRIOR_REACH (2 s - 1), 0, ...), diag(progress_deviation^2, 1, ...)), s the fraction of the arc: it makes
the sheet a strip. On the raw sheet, the paper's, p(z) = N(0, 1).

Where demonstrations are rounds the strip is that of a cylinder, unrolled: z_0 and z_0 + 2 PRIOR_REACH are one place.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from geodesic_motion_ros.learning.settings import CommonSettings
from geodesic_motion_ros.manifold.encoder import PRIOR_REACH


def prior_means(fractions: np.ndarray, settings: CommonSettings) -> np.ndarray:
    """Means (n, d) at fractions (n,) of the arc."""
    means = np.zeros((len(fractions), settings.latent_dimension))
    if settings.sheet == "canonical":
        means[:, 0] = PRIOR_REACH * (2.0 * fractions - 1.0)
    return means


def prior_variance(settings: CommonSettings) -> Tensor:
    """Variances (d,)."""
    variance = torch.ones(settings.latent_dimension)
    if settings.sheet == "canonical":
        variance[0] = settings.progress_deviation**2
    return variance
