"""Where to give way to: places nearby on a skill's graph that nothing is expected to come to, and the ways there.

For every kind of skill. When one gives way, and whether a way is free in motion, is told by whoever asks.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geodesic_motion_ros.graph.latent_graph import LatentGraph
from geodesic_motion_ros.graph.reshaping import Reshaping, look_at
from geodesic_motion_ros.graph.shortest_path import shortest_free_path
from geodesic_motion_ros.latent_way import LatentWay, WayQuery

#: Who has no way gives way to what comes within so many times the prediction: to get out of the way takes longer than
#: to stop.
AHEAD = 2.0
#: Where a way aside was looked for in vain another is looked for after so long [s].
AGAIN = 0.05
#: Refuges are looked for among so many nodes, in directions of which any two have no larger cosine than this, and so
#: many ways are tried.
_MOST_LOOKED_AT, _ALIKE, _MOST_REFUGES = 500, 0.7, 4
#: From there the goal must be reachable, without obstacles, at less than this share of what a way may cost.
_WAY_BACK = 0.5


def ways_aside(
    graph: LatentGraph, query: WayQuery, start: np.ndarray, reshaping: Reshaping, steps: int, apart: float
) -> Iterator[LatentWay]:
    """Ways from a latent point (d,) to refuges, one in each direction, the nearest first.

    reshaping : where obstacles are expected to be, all at once; apart : a refuge's clearance from that, at least [m].
    steps : refuges are no more grid steps away.
    """
    near = graph.nodes_near(start, steps)
    near = near[query.to_goal[near] < _WAY_BACK * query.cost_limit]
    if len(near) == 0:
        return
    source, near = int(near[0]), np.ascontiguousarray(near[:: 1 + len(near) // _MOST_LOOKED_AT])
    look_at(near, reshaping)
    free = near[reshaping.clearance[near] >= apart]
    directions = _in_all_directions(free, (graph.latent[free] - start) / graph.grid.spacing)
    for refuge in directions[:_MOST_REFUGES]:
        # By the triangle inequality a node is no nearer to the refuge than the difference of their costs.
        ahead = np.abs(query.from_start - query.from_start[refuge])
        nodes, edges, _ = shortest_free_path(graph.adjacency, query.graph.base, ahead, source, refuge)
        if len(edges) > 0:
            points = np.concatenate([start[None], graph.latent[nodes]])
            yield LatentWay(nodes, points, float(np.max(query.graph.energies(edges))), 0.0)


def _in_all_directions(nodes: np.ndarray, away: np.ndarray) -> list[int]:
    """Of nodes (n,) at offsets away (n, d), the nearest first, those of which none lies behind another one."""
    lengths = np.linalg.norm(away, axis=1)
    nodes, away = nodes[lengths > 0.0], away[lengths > 0.0] / lengths[lengths > 0.0, None]
    chosen: list[int] = []
    while len(nodes):
        chosen.append(int(nodes[0]))
        apart = away @ away[0] < _ALIKE
        nodes, away = nodes[apart], away[apart]
    return chosen
