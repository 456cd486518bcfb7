"""Nodes of latent spaces of more than three dimensions, where a lattice would be nearly all empty: samples of the tube.

Candidates are drawn where the model is supported: codes of the demonstrations and their mean paths with the covariance
of the codes, q(z | s), most of them moved in any direction by up to where the kernels end. Of these so many are kept
that every candidate has a node near, and no two nodes are close (a greedy cover, near the farthest-point sampling of
T. Gonzalez, "Clustering to minimize the maximum intercluster distance", Theoretical Computer Science 38, 1985). Near is
what the decoder says: points are compared where it embeds them, in the space whose chords are the metric's short
distances. Each node is joined to its nearest there, as in the graphs of N. Chen et al., "Fast approximate geodesics for
deep generative models" (ICANN 2019), and in turn to those that mean paths and demonstrations pass.

Where axes of the latent space decode to hardly anything many candidates decode alike. The one nearest to a mean path is
kept: off mean paths the metric grows e to the tenth times, and paths along nodes that lie anywhere would be dear.

Sigma takes no part in choosing nodes: it only raises walls, and most nodes would stand in them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.mean_path import MeanPaths

#: Nodes at most, and candidates for each.
MOST_NODES, _CANDIDATES = 20_000, 5
#: Nearest nodes that a node is joined to: with those that have it among theirs a third more.
NEIGHBOURS = 24
#: How far from the codes candidates are drawn, in deviations of the kernels: support ends nearer.
_TUBE = 3.0
#: What latent distance counts beside the distance of what is decoded, where both are as wide: it keeps apart what
#: decodes alike.
_LATENT_SHARE = 0.1
#: How much the radius in which a node is alone grows while there are too many.
_GROWTH = 1.05
#: The metric between nodes is that of the nearest and so many beside it.
_BESIDE = 16
_SEED = 0


@dataclass(frozen=True)
class SampledNodes:
    """The box of sampled nodes, and what a step is among them.

    Attributes
    ----------
    lower, upper : (d,) corners of the latent box.
    spacing : (d,) along an axis so far as the nearest node of a node is, the median.
    """

    lower: np.ndarray
    upper: np.ndarray
    spacing: np.ndarray

    @property
    def shape(self) -> tuple[int, ...]:
        """Steps that the box is wide along each axis, and one more."""
        return tuple(int(side) + 1 for side in np.ceil((self.upper - self.lower) / self.spacing))

    @property
    def step(self) -> float:
        """Distance of the samples of a path, in which smoothing is measured: the smallest spacing. Along an axis that
        has collapsed nodes are far apart.
        """
        return float(np.min(self.spacing))

    def coordinates(self, latent: np.ndarray) -> np.ndarray:
        """Latent points (n, d) in units of the spacing, 0 at `lower`."""
        return (latent - self.lower) / self.spacing


def sample_nodes(
    codes: np.ndarray,
    mean_paths: MeanPaths | None,
    deviation: float,
    supported: Callable[[np.ndarray], np.ndarray],
    embedded: Callable[[np.ndarray], np.ndarray],
    neighbours: int = NEIGHBOURS,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Choose nodes (n, d), edges (m, 2) between them, sorted, and their spacing (d,); always the same ones.

    Parameters
    ----------
    codes : (N, S, d) of the demonstrations. mean_paths : of these, None without any.
    deviation : of the model's kernels in the latent space.
    supported : tells of latent points (n, d) whether they may be nodes, (n,).
    embedded : makes of latent points what the metric compares, (n, F), sigma left out.
    """
    candidates = _candidates(codes, mean_paths, deviation)
    may_be = supported(candidates)
    candidates = candidates[may_be]
    if mean_paths is not None:
        # Of those that decode alike the first is kept: the ends, however the factors there are rounded.
        factors = mean_paths.conformal_factors(candidates, 1.0)
        factors[: np.count_nonzero(may_be[: 2 * len(mean_paths.centres)])] = 0.0
        candidates = candidates[np.argsort(factors, kind="stable")]
    if len(candidates) < 2:
        return candidates, np.empty((0, 2), dtype=int), np.ones(codes.shape[-1])
    decoded = embedded(candidates)
    share = _LATENT_SHARE * math.sqrt(np.var(decoded, axis=0).sum() / np.var(candidates, axis=0).sum())
    axes = _principal_axes(np.concatenate([decoded, share * candidates], axis=1))

    def placed(latent: np.ndarray) -> np.ndarray:
        return np.concatenate([embedded(latent), share * latent], axis=1) @ axes

    places = placed(candidates)
    kept = np.sort(_cover(places, MOST_NODES))
    latent, places = candidates[kept], places[kept]
    tree = cKDTree(places)
    near = tree.query(places, k=min(neighbours + 1, len(places)))[1]
    pairs = [np.stack([np.repeat(np.arange(len(near)), near.shape[1] - 1), near[:, 1:].reshape(-1)], axis=1)]
    # The next node along a path need not be among the nearest.
    for curve in codes if mean_paths is None else np.concatenate([mean_paths.centres, codes]):
        passed = tree.query(placed(curve))[1]
        pairs.append(np.stack([passed[:-1], passed[1:]], axis=1))
    edges = np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)
    return latent, edges[edges[:, 0] != edges[:, 1]], _spacing(latent, share, embedded)


def _candidates(codes: np.ndarray, mean_paths: MeanPaths | None, deviation: float) -> np.ndarray:
    """The mean paths, their ends first, the codes, and points drawn around both."""
    random, dimension = np.random.default_rng(_SEED), codes.shape[-1]
    count = _CANDIDATES * MOST_NODES
    shown, inside = [codes], _drawn_between(codes, count, random)[0]
    away = _TUBE * deviation * random.random((count, 1)) * _directions(count, dimension, random)
    if mean_paths is not None:
        half = count // 2
        centres, which, at = _drawn_between(mean_paths.centres, half, random)
        spread = np.linalg.cholesky(np.linalg.inv(mean_paths.precisions))[which, at]
        inside[:half] = centres + np.einsum("nab,nb->na", spread, random.normal(size=centres.shape))
        # Where paths without obstacles run.
        away[: half // 2] = 0.0
        shown = [mean_paths.centres[:, [0, -1]], mean_paths.centres, codes]
    return np.concatenate([*(each.reshape(-1, dimension) for each in shown), inside + away])


def _directions(count: int, dimension: int, random: np.random.Generator) -> np.ndarray:
    """So many unit vectors (n, d) in any direction."""
    directions = random.normal(size=(count, dimension))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _drawn_between(
    curves: np.ndarray, count: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """So many points (n, d) between neighbours of curves (C, S, d); of which curve, and after which sample, (n,)."""
    which, at = random.integers(len(curves), size=count), random.integers(curves.shape[1] - 1, size=count)
    share = random.random((count, 1))
    return (1.0 - share) * curves[which, at] + share * curves[which, at + 1], which, at


def _spacing(latent: np.ndarray, share: float, embedded: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Distances (d,) along the axes that count the same where nodes (n, d) are compared, so that they have about one to
    the nearest node.
    """
    some = latent[:: 1 + len(latent) // 1000]
    slopes = [
        np.mean(np.sum((embedded(some + side) - embedded(some - side)) ** 2, axis=1)) / (4.0 * np.max(side) ** 2)
        for side in np.diag(1e-3 * np.std(latent, axis=0))
    ]
    spacing = 1.0 / np.sqrt(np.array(slopes) + share**2)
    nearest = cKDTree(latent / spacing).query(some / spacing, k=2)[0][:, 1]
    return spacing * float(np.median(nearest))


def _principal_axes(points: np.ndarray) -> np.ndarray:
    """Find the principal axes (F, f) of points (n, F): trees are slow in many dimensions."""
    centred = points - points.mean(axis=0)
    variances, axes = np.linalg.eigh(centred.T @ centred)
    # What is left out is less than a hundredth of the deviation.
    return axes[:, np.cumsum(variances) > 1e-4 * variances.sum()]


def _cover(places: np.ndarray, most: int) -> np.ndarray:
    """Choose at most so many of places (n, F), none of which is nearer to another than a radius that all others have
    one within.
    """
    kept = np.arange(len(places))
    share = max(1, len(places) // most)
    radius = 0.7 * float(np.median(cKDTree(places).query(places[:2000], k=share + 1)[0][:, -1]))
    while True:
        pairs = cKDTree(places[kept]).query_pairs(radius, output_type="ndarray")
        close = Adjacency.from_edges(pairs, len(kept))
        kept = kept[_alone(close.first, close.node)]
        if len(kept) <= most:
            return kept
        radius *= _GROWTH


@numba.njit(cache=True, nogil=True)
def _alone(first: np.ndarray, node: np.ndarray) -> np.ndarray:
    """Which of n nodes are kept, one after the other, where none beside them is yet (n,)."""
    kept, covered = np.zeros(len(first) - 1, dtype=np.bool_), np.zeros(len(first) - 1, dtype=np.bool_)
    for i in range(len(kept)):
        if not covered[i]:
            kept[i] = True
            for slot in range(first[i], first[i + 1]):
                covered[node[slot]] = True
    return kept


def nearest_beside(coordinates: np.ndarray) -> np.ndarray:
    """Of each of n nodes itself and the nearest others, (n, _BESIDE + 1) int32, for coordinates (n, d) in steps."""
    near = cKDTree(coordinates).query(coordinates, k=min(_BESIDE + 1, len(coordinates)))[1]
    return np.ascontiguousarray(near.reshape(len(coordinates), -1), dtype=np.int32)
