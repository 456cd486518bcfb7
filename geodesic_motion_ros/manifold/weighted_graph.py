"""WeightedGraph: a graph transported to a query, as a search reads it: its nodes' body points, and its edges' costs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation

if TYPE_CHECKING:
    from typing import Self


@dataclass(frozen=True)
class WeightedGraph:
    """Nodes and edges transported to a query. Squared length of an edge: w_e^2 = b_e + sum_k m_k a_ek.

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

    def without(self, lost: np.ndarray) -> Self:
        """The same where the edges of a mask (m,) are none: they cost infinitely much."""
        if not np.any(lost):
            return self
        fixed, base = (np.where(lost, np.inf, lengths) for lengths in (self.fixed, self.base))
        return replace(self, fixed=fixed, base=base)

    def energies(self, edges: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Obstacle-free squared lengths of edges under the pull-back metric alone, without the conformal factor."""
        return self.base[edges] ** 2 / self.conformal[edges]


class GraphAmongObstacles(NamedTuple):
    """Nodes and edges transported to a query, among obstacles, as the compiled kernels of searches read them.

    Attributes
    ----------
    first, node, edge : as of `Adjacency`. base, fixed, shares : as of `WeightedGraph`.
    evaluation : what the obstacles do. margin : nodes with less clearance [m] are not entered, but for the ends.
    """

    first: np.ndarray
    node: np.ndarray
    edge: np.ndarray
    base: np.ndarray
    fixed: np.ndarray
    shares: np.ndarray
    evaluation: NodeEvaluation
    margin: float

    @classmethod
    def of(
        cls,
        adjacency: Adjacency,
        base: np.ndarray,
        fixed: np.ndarray,
        shares: np.ndarray,
        evaluation: NodeEvaluation,
        margin: float,
    ) -> GraphAmongObstacles:
        """The graph with edges as of an adjacency."""
        return cls(adjacency.first, adjacency.node, adjacency.edge, base, fixed, shares, evaluation, float(margin))
