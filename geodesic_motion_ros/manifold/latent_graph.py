"""What the graphs of all skills have in common: supported nodes of the latent space, and which of them are joined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.progress import Progress
from geodesic_motion_ros.manifold.sampled_nodes import SampledNodes, nearest_beside, sample_nodes
from geodesic_motion_ros.utils.errors import SkillError


@dataclass(frozen=True)
class LatentGraph:
    """Supported nodes of the latent space and the edges between them.

    Attributes
    ----------
    grid : the lattice the nodes were taken from, or the box of sampled ones.
    sigma_limit, energy_limit : largest rms sigma of a node, and squared length of an edge, that were kept.
    latent : (n, d) kept nodes; sigma : (n,) rms sigma.
    progress, mean_path_shares : (n,) tau of the nodes, and (n, K) shares of the mean paths there.
    component : (n,) number of the connected piece a node belongs to.
    edges : (m, 2); adjacency : the same in rows.
    progress_map : progress and shares at latent points off the nodes.
    """

    grid: LatentGrid | SampledNodes
    sigma_limit: float
    energy_limit: float
    latent: np.ndarray
    sigma: np.ndarray
    progress: np.ndarray
    mean_path_shares: np.ndarray
    component: np.ndarray
    edges: np.ndarray
    adjacency: Adjacency
    progress_map: Progress
    # Number of the kept node at every lattice point, -1 where it was pruned; empty of sampled nodes.
    _number: np.ndarray

    @property
    def mean_path_count(self) -> int:
        """K, 0 where progress is measured along the codes."""
        return self.mean_path_shares.shape[1]

    def pieces_with_demonstrations(self) -> np.ndarray:
        """Numbers of the connected pieces large enough to hold a path."""
        counts = np.bincount(self.component)
        return np.flatnonzero(counts >= max(2, 0.05 * counts.max()))

    def nearest_node_to(self, latent: np.ndarray) -> int:
        """Node closest to a latent point (d,), wherever that is."""
        squared = np.sum(((self.latent - latent) / self.grid.spacing) ** 2, axis=1)
        return int(np.argmin(squared))

    def node_near(self, latent: np.ndarray, allowed: np.ndarray, steps: int) -> int | None:
        """Allowed node (mask (n,)) closest to a latent point (d,), within a number of grid steps; None without one."""
        candidates = self.nodes_near(latent, steps)
        candidates = candidates[allowed[candidates]]
        return int(candidates[0]) if len(candidates) else None

    def nodes_near(self, latent: np.ndarray, steps: int) -> np.ndarray:
        """Nodes (c,) within a number of grid steps of a latent point (d,), the nearest first."""
        if len(self._number) == 0:
            squared = _squared_distances(self._all, self.latent, np.asarray(latent, dtype=float), self.grid.spacing)
            near = np.flatnonzero(squared <= steps**2)
            return near[np.argsort(squared[near], kind="stable")]
        centre = np.rint(self.grid.coordinates(latent)).astype(int)
        window = tuple(slice(max(0, c - steps), c + steps + 1) for c in centre)
        candidates = self._number[window].reshape(-1)
        candidates = candidates[candidates >= 0]
        distances = _squared_distances(candidates, self.latent, np.asarray(latent, dtype=float), self.grid.spacing)
        return candidates[np.argsort(distances, kind="stable")]

    @cached_property
    def sampled(self) -> tuple[np.ndarray, np.ndarray] | None:
        """What a `MetricField` wants of sampled nodes; None of a grid."""
        if len(self._number) > 0:
            return None
        coordinates = self.grid.coordinates(self.latent)
        return coordinates, nearest_beside(coordinates)

    @cached_property
    def _all(self) -> np.ndarray:
        return np.arange(len(self.latent))


@numba.njit(cache=True, nogil=True)
def _squared_distances(nodes: np.ndarray, latent: np.ndarray, point: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Of nodes (c,) at latent points (n, d) from a point (d,), in grid steps: (c,)."""
    result = np.zeros(len(nodes))
    for i in range(len(nodes)):
        for a in range(len(point)):
            result[i] += ((latent[nodes[i], a] - point[a]) / spacing[a]) ** 2
    return result


class ChosenNodes(NamedTuple):
    """Nodes of a latent space before they are decoded.

    Attributes
    ----------
    grid, latent, edges : as of `LatentGraph`. number : of the node at every lattice point, -1 where there is none;
        empty of sampled nodes.
    """

    grid: LatentGrid | SampledNodes
    latent: np.ndarray
    number: np.ndarray
    edges: np.ndarray

    @property
    def kept(self) -> np.ndarray | None:
        """Mask of the lattice points that are nodes; None of sampled ones."""
        return self.number.reshape(-1) >= 0 if self.number.size else None


def choose_nodes(
    lower: np.ndarray,
    upper: np.ndarray,
    shape: tuple[int, ...] | None,
    neighbours: int,
    codes: np.ndarray,
    mean_paths: MeanPaths | None,
    deviation: float,
    supported: Callable[[np.ndarray], np.ndarray],
    embedded: Callable[[np.ndarray], np.ndarray],
) -> ChosenNodes:
    """Choose nodes within a latent box: of a lattice, or samples of the tube around codes.

    Parameters
    ----------
    lower, upper : (d,) corners of the box. shape : lattice points along each axis; None: nodes are sampled.
    neighbours : directions of each node, or nearest nodes that it is joined to.
    codes, mean_paths, deviation, supported, embedded : as of `sample_nodes`.
    """
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if shape is None:
        latent, edges, spacing = sample_nodes(codes, mean_paths, deviation, supported, embedded, neighbours)
        return ChosenNodes(SampledNodes(lower, upper, spacing), latent, np.empty(0, dtype=int), edges)
    grid = LatentGrid(lower, upper, tuple(shape))
    lattice = grid.nodes()
    kept = supported(lattice)
    number = grid.numbering(kept)
    return ChosenNodes(grid, lattice[kept], number, grid.edges(number, neighbours))


def refuse_unsupported(nodes: int, sigma_limit: float, unit: str) -> None:
    """SkillError where there are less than two nodes."""
    if nodes < 2:
        raise SkillError(
            f"no part of the latent box has sigma below {sigma_limit:.4g} {unit}: "
            "the skill's thresholds do not belong to its weights"
        )


def connected_pieces(edges: np.ndarray, nodes: int) -> np.ndarray:
    """Number (n,) of the connected piece that each of `nodes` nodes belongs to, for edges (m, 2)."""
    linked = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(nodes, nodes))
    return connected_components(linked, directed=False)[1]
