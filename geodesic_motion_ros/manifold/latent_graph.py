"""What the graphs of all skills have in common: supported nodes of the latent grid, and which of them are joined."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid
from geodesic_motion_ros.manifold.progress import ProgressMap
from geodesic_motion_ros.utils.errors import SkillError


@dataclass(frozen=True)
class LatentGraph:
    """Supported nodes of the latent grid and the edges between them.

    Attributes
    ----------
    grid : the lattice the nodes were taken from.
    sigma_limit, energy_limit : largest rms sigma of a node, and squared length of an edge, that were kept.
    latent : (n, d) kept nodes; sigma : (n,) rms sigma.
    progress, mean_path_shares : (n,) tau of the nodes, and (n, K) shares of the mean paths there.
    component : (n,) number of the connected piece a node belongs to.
    edges : (m, 2); adjacency : the same in rows.
    """

    grid: LatentGrid
    sigma_limit: float
    energy_limit: float
    latent: np.ndarray
    sigma: np.ndarray
    progress: np.ndarray
    mean_path_shares: np.ndarray
    component: np.ndarray
    edges: np.ndarray
    adjacency: Adjacency
    progress_map: ProgressMap
    # Number of the kept node at every lattice point, -1 where it was pruned.
    _number: np.ndarray

    @property
    def mean_path_count(self) -> int:
        """K, 0 where progress is measured along the codes."""
        return self.mean_path_shares.shape[1]

    def pieces_with_demonstrations(self) -> np.ndarray:
        """Numbers of the connected pieces large enough to hold a path."""
        counts = np.bincount(self.component)
        return np.flatnonzero(counts >= max(2, 0.05 * counts.max()))

    def node_near(self, latent: np.ndarray, allowed: np.ndarray, steps: int) -> int | None:
        """Allowed node (mask (n,)) closest to a latent point (d,), within a number of grid steps; None without one."""
        candidates = self.nodes_near(latent, steps)
        candidates = candidates[allowed[candidates]]
        return int(candidates[0]) if len(candidates) else None

    def nodes_near(self, latent: np.ndarray, steps: int) -> np.ndarray:
        """Nodes (c,) within a number of grid steps of a latent point (d,), the nearest first."""
        centre = np.rint(self.grid.coordinates(latent)).astype(int)
        window = tuple(slice(max(0, c - steps), c + steps + 1) for c in centre)
        candidates = self._number[window].reshape(-1)
        candidates = candidates[candidates >= 0]
        distances = _squared_distances(candidates, self.latent, np.asarray(latent, dtype=float), self.grid.spacing)
        return candidates[np.argsort(distances, kind="stable")]


@numba.njit(cache=True, nogil=True)
def _squared_distances(nodes: np.ndarray, latent: np.ndarray, point: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Of nodes (c,) at latent points (n, d) from a point (d,), in grid steps: (c,)."""
    result = np.zeros(len(nodes))
    for i in range(len(nodes)):
        for a in range(len(point)):
            result[i] += ((latent[nodes[i], a] - point[a]) / spacing[a]) ** 2
    return result


def refuse_unsupported(kept: np.ndarray, sigma_limit: float, unit: str) -> None:
    """SkillError where a mask (nodes,) keeps less than two nodes."""
    if np.count_nonzero(kept) < 2:
        raise SkillError(
            f"no part of the latent box has sigma below {sigma_limit:.4g} {unit}: "
            "the skill's thresholds do not belong to its weights"
        )


def connected_pieces(edges: np.ndarray, nodes: int) -> np.ndarray:
    """Number (n,) of the connected piece that each of `nodes` nodes belongs to, for edges (m, 2)."""
    linked = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(nodes, nodes))
    return connected_components(linked, directed=False)[1]
