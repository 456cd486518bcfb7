"""What a search needs of a graph that was carried to a query: where its nodes' body points are, and what edges cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class WeightedGraph:
    """Nodes and edges carried to a query. Squared length of an edge: w_e^2 = b_e + sum_k m_k a_ek.

    With K body points each carries 1 / K of the body's share, so that K equal points weigh as much as one.

    Attributes
    ----------
    edges : (m, 2); body_points : (n, K, 3) [m] body points of the nodes.
    conformal : (m,) factors >= 1 that all of an edge's squared length carries.
    fixed : (m,) b_e, what no obstacle stretches; shares : (m, K) a_ek.
    base : (m,) obstacle-free length of every edge.
    """

    edges: np.ndarray
    body_points: np.ndarray
    conformal: np.ndarray
    fixed: np.ndarray
    shares: np.ndarray
    base: np.ndarray

    def energies(self, edges: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Obstacle-free squared lengths of edges under the pull-back metric alone, without the conformal factor."""
        return self.base[edges] ** 2 / self.conformal[edges]
