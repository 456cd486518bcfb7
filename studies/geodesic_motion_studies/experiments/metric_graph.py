"""A graph of points in the latent space under any Riemannian metric, for experiments with toys and dimensions.

The planner's graphs (`manifold.pose_graph`, `manifold.configuration_graph`) measure their edges between decoded nodes;
this one asks the metric tensor, so that it serves every decoder and any number of latent dimensions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_ros.queries.path_smoothing import resample_latent
from geodesic_motion_studies.tools.metric import Metric, curve_length

_BLOCK = 4096


@dataclass(frozen=True)
class MetricGraph:
    """Nodes (n, d), undirected edges (m, 2) between them and their Riemannian lengths (m,)."""

    latent: np.ndarray
    edges: np.ndarray
    lengths: np.ndarray

    @classmethod
    def on_grid(cls, metric: Metric, grid: LatentGrid, kept: np.ndarray, neighbours: int) -> MetricGraph:
        """The lattice points that a mask keeps; an edge is measured by the mean of the tensors at its ends."""
        latent, edges = grid.nodes()[kept], grid.edges(grid.numbering(kept), neighbours)
        tensors = metric_tensors(metric, latent)
        steps = latent[edges[:, 1]] - latent[edges[:, 0]]
        squared = [np.einsum("mi,mij,mj->m", steps, tensors[ends], steps) for ends in edges.T]
        return cls(latent, edges, np.sqrt(0.5 * (squared[0] + squared[1])))

    def path(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        """Shortest path (p, d) between latent points (d,), by the nodes nearest to them; None where there is none."""
        nodes = self._nodes(start, goal) if len(self.latent) else None
        return None if nodes is None else np.concatenate([start[None], self.latent[nodes[1:-1]], goal[None]])

    def _nodes(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        _, (source, target) = cKDTree(self.latent).query(np.stack([start, goal]))
        count = len(self.latent)
        lengths = coo_matrix((self.lengths, tuple(self.edges.T)), shape=(count, count)).tocsr()
        distances, before = dijkstra(lengths, directed=False, indices=target, return_predecessors=True)
        if not np.isfinite(distances[source]):
            return None
        nodes = [source]
        while nodes[-1] != target:
            nodes.append(before[nodes[-1]])
        return np.array(nodes)


def evenly(curve: np.ndarray, points: int = 400) -> np.ndarray:
    """Points (points, d) of a polyline (m, d), equally far apart in the latent space."""
    return resample_latent(curve, math.inf, minimum=points)


def metric_tensors(metric: Metric, latent: np.ndarray) -> np.ndarray:
    """Metric tensors (n, d, d) at latent points (n, d), in blocks that fit into memory."""
    if len(latent) == 0:
        return np.empty((0, latent.shape[1], latent.shape[1]))
    points = torch.tensor(latent)
    with torch.no_grad():
        return torch.cat([metric(points[begin : begin + _BLOCK]) for begin in range(0, len(points), _BLOCK)]).numpy()


def latent_length(metric: Metric, curve: np.ndarray) -> float:
    """Riemannian length of a polyline (m, d), measured at points that are equally far apart in the latent space."""
    with torch.no_grad():
        return float(curve_length(metric, torch.tensor(evenly(curve))))


def magnification(tensors: np.ndarray) -> np.ndarray:
    """log sqrt det M (n,) of metric tensors (n, d, d)."""
    return 0.5 * np.linalg.slogdet(tensors)[1]
