"""How far demonstrations of different groups, of signs or of postures, are clusters in the latent space."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree


def share_in_own_group(codes: np.ndarray, groups: np.ndarray, demonstrations: np.ndarray) -> float:
    """Share of codes (N, T, d) whose nearest code of another demonstration is of the same group.

    groups : (N,) of the curves. demonstrations : (N,) which of them are of one demonstration, as q and -q are.
    """
    same = []
    for own, group, demonstration in zip(codes, groups, demonstrations, strict=True):
        others = np.flatnonzero(demonstrations != demonstration)
        _, nearest = cKDTree(codes[others].reshape(-1, codes.shape[-1])).query(own)
        same.append(groups[others[nearest // codes.shape[1]]] == group)
    return float(np.mean(same))
