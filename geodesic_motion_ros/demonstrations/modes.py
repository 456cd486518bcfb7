"""Modes: groups of a task's demonstrations that differ from one another more than people differ within each."""

from __future__ import annotations

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import pdist, squareform

#: Mean silhouette from which a split counts as real: "reasonable structure" begins at 0.5, "strong" at 0.7 (L. Kaufman,
#: P. Rousseeuw, "Finding groups in data", 1990). Demonstrations of one mode stay below 0.45 on real recordings.
SMALLEST_SILHOUETTE = 0.6
MOST_MODES = 5
#: Below 1, blends lie mostly near one or two demonstrations, and so out to the rim of what was demonstrated.
BLEND_CONCENTRATION = 0.7


def cluster_modes(curves: np.ndarray) -> np.ndarray:
    """Number the mode (N,) of every curve, from 0 in order of first appearance; all 0 where there is one.

    Average linkage of the root mean square distances between curves (N, T, 3) [m], or (N, T, eta) [rad], at equal
    fractions of the arc; the number of modes is that with the largest mean silhouette, if it reaches
    SMALLEST_SILHOUETTE.
    """
    count = len(curves)
    flat = curves.reshape(count, -1) / np.sqrt(curves.shape[1])
    best, labels = SMALLEST_SILHOUETTE, np.zeros(count, dtype=int)
    if count < 3:
        return labels
    distances = pdist(flat)
    tree = linkage(distances, "average")
    for modes in range(2, min(MOST_MODES, count - 1) + 1):
        split = fcluster(tree, modes, "maxclust")
        silhouette = _mean_silhouette(squareform(distances), split)
        if silhouette > best:
            best, labels = silhouette, split
    _, first, numbered = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[numbered]


def blend_weights(modes: np.ndarray, blends: int, seed: int) -> np.ndarray:
    """Draw weights (N blends, N) of random convex combinations, each within one mode of modes (N,)."""
    random = np.random.default_rng(seed)
    weights = np.zeros((len(modes) * blends, len(modes)))
    for row, mode in enumerate(np.repeat(modes, blends)):
        own = np.flatnonzero(modes == mode)
        weights[row, own] = random.dirichlet(np.full(len(own), BLEND_CONCENTRATION))
    return weights


def _mean_silhouette(distances: np.ndarray, labels: np.ndarray) -> float:
    """Mean over curves of (b - a) / max(a, b): a to the own mode, b to the nearest other; 0 for a mode of one."""
    values = []
    for i, own in enumerate(labels):
        fellows = np.flatnonzero((labels == own) & (np.arange(len(labels)) != i))
        others = [distances[i, labels == other].mean() for other in set(labels) - {own}]
        if len(fellows) == 0 or not others:
            values.append(0.0)
            continue
        within, beside = distances[i, fellows].mean(), min(others)
        values.append((beside - within) / max(within, beside, 1e-12))
    return float(np.mean(values))
