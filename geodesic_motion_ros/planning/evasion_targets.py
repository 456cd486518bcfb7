"""Evasion targets: places nearby on a skill's graph that nothing is expected to come to, and the paths there.

For every kind of skill. When an arm evades is for `evasion`, and whether a path is free in motion for the certificate.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geodesic_motion_ros.graph.latent_graph import LatentGraph
from geodesic_motion_ros.graph.reshaping import Reshaping, look_at
from geodesic_motion_ros.graph.shortest_path import shortest_free_path
from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.search import LatentPath, SearchQuery


def paths_to_targets(
    graph: LatentGraph, query: SearchQuery, start: np.ndarray, reshaping: Reshaping, steps: int, apart: float
) -> Iterator[LatentPath]:
    """Paths from a latent point (d,) to evasion targets, one in each direction, the nearest first.

    reshaping : where obstacles are expected to be, all at once; apart : a target's clearance from that, at least [m].
    steps : targets are no more grid steps away.
    """
    near = graph.nodes_near(start, steps)
    near = near[query.to_goal[near] < constants.EVASION_RETURN_SHARE * query.cost_limit]
    if len(near) == 0:
        return
    source, near = int(near[0]), np.ascontiguousarray(near[:: 1 + len(near) // constants.EVASION_NODES])
    look_at(near, reshaping)
    free = near[reshaping.clearance[near] >= apart]
    directions = _in_all_directions(free, (graph.latent[free] - start) / graph.grid.spacing)
    for target in directions[:constants.EVASION_TARGETS]:
        # By the triangle inequality a node is no nearer to the target than their costs from the start, or to the goal,
        # differ.
        from_start, to_goal = (np.abs(costs - costs[target]) for costs in (query.from_start, query.to_goal))
        ahead = np.maximum(from_start, to_goal)
        nodes, edges, _ = shortest_free_path(graph.adjacency, query.graph.base, ahead, source, target)
        if len(edges) > 0:
            points = np.concatenate([start[None], graph.latent[nodes]])
            yield LatentPath(nodes, points, float(np.max(query.graph.energies(edges))), 0.0)


def _in_all_directions(nodes: np.ndarray, away: np.ndarray) -> list[int]:
    """Of nodes (n,) at offsets away (n, d), the nearest first, those of which none lies behind another one."""
    lengths = np.linalg.norm(away, axis=1)
    nodes, away = nodes[lengths > 0.0], away[lengths > 0.0] / lengths[lengths > 0.0, None]
    chosen: list[int] = []
    while len(nodes):
        chosen.append(int(nodes[0]))
        apart = away @ away[0] < constants.EVASION_COSINE
        nodes, away = nodes[apart], away[apart]
    return chosen
