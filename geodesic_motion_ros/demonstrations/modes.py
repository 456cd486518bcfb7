"""Modes: groups of a task's demonstrations that differ from one another more than people differ within each."""

from __future__ import annotations

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import pdist, squareform

#: Mean silhouette from which a split counts as real: "reasonable structure" begins at 0.5, "strong" at 0.7 (L. Kaufman,
#: P. Rousseeuw, "Finding groups in data", 1990). Demonstrations of one mode stay below 0.45 on real recordings.
SMALLEST_SILHOUETTE = 0.6
MOST_MODES = 5
#: A split counts as real, besides, where of so many random draws of one mode no more than so large a share splits as
#: well: leaves as little of the squared distances within as many parts. They are of the normal distribution with the
#: covariance of the curves (after SigClust: Y. Liu et al., Journal of the American Statistical Association 103, 2008).
#: Where people differ in one thing, such as the size of a motion, half of all splits reach SMALLEST_SILHOUETTE.
DRAWS, LARGEST_SHARE = 40, 0.05
#: Fewer curves cannot tell: of one mode, two and two draws in twenty are as far apart as of two.
ENOUGH = 6
#: Below 1, blends lie mostly near one or two demonstrations, and so out to the rim of what was demonstrated.
BLEND_CONCENTRATION = 0.7


def cluster_modes(curves: np.ndarray) -> np.ndarray:
    """Number the mode (N,) of every curve, from 0 in order of first appearance; all 0 where there is one.

    Average linkage of the root mean square distances between curves (N, T, 3) [m], or (N, T, eta) [rad], at equal
    fractions of the arc; the number of modes is that with the largest mean silhouette, if it reaches
    SMALLEST_SILHOUETTE and, of ENOUGH curves or more, draws of one mode hardly ever split as well.
    """
    count = len(curves)
    flat = curves.reshape(count, -1)
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
    if count >= ENOUGH and len(first) > 1 and not _is_real(flat, labels):
        return np.zeros(count, dtype=int)
    return np.argsort(np.argsort(first))[numbered]


def blend_weights(modes: np.ndarray, blends: int, seed: int) -> np.ndarray:
    """Draw weights (N blends, N) of random convex combinations, each within one mode of modes (N,)."""
    random = np.random.default_rng(seed)
    weights = np.zeros((len(modes) * blends, len(modes)))
    for row, mode in enumerate(np.repeat(modes, blends)):
        own = np.flatnonzero(modes == mode)
        weights[row, own] = random.dirichlet(np.full(len(own), BLEND_CONCENTRATION))
    return weights


def _is_real(points: np.ndarray, labels: np.ndarray) -> bool:
    """Whether points (N, D) with labels (N,) split better than draws of one mode do."""
    random, centred, modes = np.random.default_rng(0), points - points.mean(axis=0), len(set(labels))
    share, as_well = _share_within(points, labels), 0
    for _ in range(DRAWS):
        draw = random.normal(size=(len(points), len(points))) @ centred
        split = fcluster(linkage(pdist(draw), "average"), modes, "maxclust")
        as_well += _share_within(draw, split) <= share
    return as_well <= LARGEST_SHARE * DRAWS


def _share_within(points: np.ndarray, labels: np.ndarray) -> float:
    """The share of the squared distances of points (N, D) from their mean that is left from those of labels (N,)."""
    within = sum(float(np.sum((own - own.mean(axis=0)) ** 2)) for own in (points[labels == k] for k in set(labels)))
    return within / max(float(np.sum((points - points.mean(axis=0)) ** 2)), 1e-300)


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
