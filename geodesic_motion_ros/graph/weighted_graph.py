"""What a search needs of a graph that was carried to a query: where its nodes' body points are, and what edges cost."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.graph.grid import Adjacency


@dataclass(frozen=True)
class WeightedGraph(ABC):
    """Nodes and edges carried to a query. Squared length of an edge: w_e^2 = b_e + sum_k m_k a_ek.

    With K body points each carries 1 / K of the body's share, so that K equal points weigh as much as one. The shares
    a_ek of single body points are worked out where obstacles touch, and kept (`fill_shares`).

    Attributes
    ----------
    edges : (m, 2); body_points : (n, K, 3) [m] body points of the nodes.
    conformal : (m,) factors >= 1 that all of an edge's squared length carries.
    fixed : (m,) b_e, what no obstacle stretches; moving : (m,) sum_k a_ek.
    shares : (m, K) a_ek, valid where filled (m,).
    """

    edges: np.ndarray
    body_points: np.ndarray
    conformal: np.ndarray
    fixed: np.ndarray
    moving: np.ndarray
    shares: np.ndarray
    filled: np.ndarray

    @property
    def base(self) -> np.ndarray:
        """Obstacle-free length of every edge, (m,)."""
        return np.sqrt(self.fixed + self.moving)

    def energies(self, edges: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Obstacle-free squared lengths of edges under the pull-back metric alone, without the conformal factor."""
        return (self.fixed[edges] + self.moving[edges]) / self.conformal[edges]

    @abstractmethod
    def fill_shares(self, adjacency: Adjacency, touched: np.ndarray) -> None:
        """Work out the shares of all edges at the touched nodes (mask (n,)) that are not filled yet."""
