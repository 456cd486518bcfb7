"""MeanPaths: where the codes of each mode's demonstrations run on average, and how far off them a latent point lies.

Over s in [0, 1], the fraction of the arc, mode k of the demonstrations has the mean path r_k(s), the mean of its codes
z_i(s), and their covariance C_k(s). A latent point z lies

    u_k^2(z) = min_s (z - r_k(s))^T C_k(s)^-1 (z - r_k(s)),      u^2 = min_k (u_k^2 + 2 log(pi_max / pi_k)),

off it, pi_k the share of the demonstrations that the mode holds. exp(min(a u^2, LARGEST_EXPONENT)) >= 1 is the
conformal factor of the metric: 1 on the mean path of the largest mode, so that lengths there stay what they are; being
never below 1 it leaves obstacle-free costs a lower bound. Progress tau(z) is the soft argmin over s of the same
distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np
from scipy.ndimage import gaussian_filter1d

#: The conformal factor is at most e to this: further off the mean path the walls of sigma decide.
LARGEST_EXPONENT = 10.0
#: Covariances are smoothed over this share of the arc, and widened by this deviation: where the codes of a few
#: demonstrations happen to meet, the mean path is not infinitely sharp.
SMOOTHING = 0.05
SMALLEST_DEVIATION = 0.05
#: Temperature of the soft argmin over s, in units of u^2.
TEMPERATURE = 0.1


@dataclass(frozen=True)
class MeanPaths:
    """Mean paths of K modes at S fractions of the arc.

    Attributes
    ----------
    centres : (K, S, d) r_k(s); precisions : (K, S, d, d) C_k(s)^-1; penalties : (K,) 2 log(pi_max / pi_k) >= 0.
    """

    centres: np.ndarray
    precisions: np.ndarray
    penalties: np.ndarray

    @classmethod
    def of_codes(cls, codes: np.ndarray, modes: np.ndarray) -> MeanPaths:
        """Those of codes (N, S, d) in modes (N,), numbered from 0; at least one mode has two demonstrations."""
        members = [codes[modes == mode] for mode in range(modes.max() + 1)]
        centres = np.stack([own.mean(axis=0) for own in members])
        scatter = [np.einsum("isa,isb->sab", own - own.mean(axis=0), own - own.mean(axis=0)) for own in members]
        # What only one demonstration shows is as wide as the other modes are.
        pooled = sum(scatter) / sum(len(own) - 1 for own in members)
        spread = [s / (len(own) - 1) if len(own) > 1 else pooled for s, own in zip(scatter, members, strict=True)]
        smooth = gaussian_filter1d(np.stack(spread), SMOOTHING * codes.shape[1], axis=1, mode="nearest")
        floor = SMALLEST_DEVIATION**2 * np.eye(codes.shape[-1])
        shares = np.array([len(own) for own in members], dtype=float)
        return cls(centres, np.linalg.inv(smooth + floor), 2.0 * np.log(shares.max() / shares))

    def moved_to(self, centres: np.ndarray) -> MeanPaths:
        """Mean paths of the same widths through other centres (K, S, d)."""
        return replace(self, centres=centres)

    def conformal_factors(self, latent: np.ndarray, strength: float) -> np.ndarray:
        """exp(min(strength u^2, LARGEST_EXPONENT)) >= 1 at latent points (n, d), (n,)."""
        distances = _smallest(latent, self.centres, self.precisions)
        return np.exp(np.minimum(strength * (distances + self.penalties).min(axis=1), LARGEST_EXPONENT))

    def coordinates(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Progress (n,) and shares (n, K) of the mean paths at latent points (n, d).

        Shares are the softmax over k of -(u_k^2 + penalty_k) / 2; they sum to 1.
        """
        distances = _smallest(latent, self.centres, self.precisions)
        progress = _soft_argmin(latent, self.centres, self.precisions, distances, TEMPERATURE)
        exponents = -0.5 * (distances + self.penalties)
        weights = np.exp(exponents - exponents.max(axis=1, keepdims=True))
        shares = weights / weights.sum(axis=1, keepdims=True)
        return np.sum(shares * progress, axis=1), shares


@numba.njit(cache=True, nogil=True)
def _squared(latent: np.ndarray, i: int, centres: np.ndarray, precisions: np.ndarray, k: int, s: int) -> float:
    """(z_i - r_k(s))^T C_k(s)^-1 (z_i - r_k(s)); by indices, because views would cost more than the arithmetic."""
    total = 0.0
    for a in range(latent.shape[1]):
        for b in range(latent.shape[1]):
            along, across = latent[i, a] - centres[k, s, a], latent[i, b] - centres[k, s, b]
            total += along * precisions[k, s, a, b] * across
    return total


def _smallest(latent: np.ndarray, centres: np.ndarray, precisions: np.ndarray) -> np.ndarray:
    """u_k^2 (n, K), multiplied out to z^T P z - 2 r^T P z + r^T P r: products of matrices are several times faster."""
    count, samples, dimension = centres.shape
    pairs = (latent[:, :, None] * latent[:, None, :]).reshape(len(latent), dimension**2)
    leaning = np.einsum("ksab,ksb->ksa", precisions, centres)
    constant = np.einsum("ksa,ksa->ks", leaning, centres)
    smallest = np.empty((len(latent), count))
    for k in range(count):
        squared = pairs @ precisions[k].reshape(samples, dimension**2).T - 2.0 * latent @ leaning[k].T + constant[k]
        smallest[:, k] = squared.min(axis=1)
    # Rounding must not bring a conformal factor below 1.
    return np.maximum(smallest, 0.0)


@numba.njit(cache=True, nogil=True)
def _soft_argmin(
    latent: np.ndarray, centres: np.ndarray, precisions: np.ndarray, smallest: np.ndarray, temperature: float
) -> np.ndarray:
    """Soft argmin of s, (n, K), given u_k^2 (n, K)."""
    samples = centres.shape[1]
    progress = np.empty(smallest.shape)
    for i in range(len(latent)):
        for k in range(len(centres)):
            total, weighted = 0.0, 0.0
            for s in range(samples):
                exponent = (_squared(latent, i, centres, precisions, k, s) - smallest[i, k]) / temperature
                # Below exp(-40) it is below the rounding of the sum, which is about 1 or more.
                if exponent < 40.0:
                    weight = np.exp(-exponent)
                    total += weight
                    weighted += weight * s
            progress[i, k] = weighted / (total * (samples - 1))
    return progress
