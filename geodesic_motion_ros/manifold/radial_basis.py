"""Radial-basis-function networks in plain numpy: how sure the decoder is, away from the data and near it."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numba
import numpy as np

#: From so many points on it is worth it to share them among threads: when a graph is decoded, not in a tick.
_MANY = 20_000


def radial_basis(latent: np.ndarray, centres: np.ndarray, rate: float, weights: np.ndarray) -> np.ndarray:
    """weights v (n, outputs) at latent points (n, d), for v_k = exp(-rate |z - c_k|^2) and weights (outputs, K).

    Kernels below exp(-40), which is below the rounding of the others' sum wherever a point is near any, are left out.
    """
    latent, centres, weights = (np.ascontiguousarray(a, dtype=float) for a in (latent, centres.T, weights.T))
    if len(latent) < _MANY:
        return _radial_basis(latent, centres, rate, weights)
    parts = np.array_split(latent, os.cpu_count() or 1)
    with ThreadPoolExecutor(len(parts)) as threads:
        worked_out = threads.map(partial(_radial_basis, centres=centres, rate=rate, weights=weights), parts)
        return np.concatenate(list(worked_out))


@numba.njit(cache=True, nogil=True)
def _radial_basis(latent: np.ndarray, centres: np.ndarray, rate: float, weights: np.ndarray) -> np.ndarray:
    """As `radial_basis`, for centres (d, K) and weights (K, outputs): numbers used one after the other stand so."""
    outputs, squared = np.zeros((len(latent), weights.shape[1])), np.empty(len(weights))
    for i in range(len(latent)):
        squared[:] = 0.0
        for j in range(len(centres)):
            for k in range(len(squared)):
                squared[k] += (latent[i, j] - centres[j, k]) ** 2
        for k in range(len(squared)):
            if rate * squared[k] < 40.0:
                activation = math.exp(-rate * squared[k])
                for j in range(weights.shape[1]):
                    outputs[i, j] += weights[k, j] * activation
    return outputs
