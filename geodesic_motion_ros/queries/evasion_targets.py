"""Evasion targets: places nearby to which no obstacle is expected to come, on a skill's graph and beside it, and the
paths there, for every kind of skill.

`proposers/evasion.py` decides when an arm evades, `evasion_motion.py` whether a path is free in motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.arm_in_scene import ArmInScene, clearance_at
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.manifold.latent_graph import LatentGraph
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import shortest_free_path
from geodesic_motion_ros.queries.posture import solve_path
from geodesic_motion_ros.queries.query import Query
from geodesic_motion_ros.queries.search import LatentPath
from geodesic_motion_ros.robot.kinematics import Robot

#: Steps of a displacement.
_STEPS = 3


def paths_to_targets(
    graph: LatentGraph, query: Query[Any], start: np.ndarray, evaluation: NodeEvaluation, steps: int, apart: float
) -> Iterator[LatentPath]:
    """Return paths from a latent point (d,) to evasion targets, one in each direction, the nearest first.

    evaluation : where obstacles are expected to be, all at once; apart : a target's clearance from that, at least [m].
    steps : targets are no more grid steps away.
    """
    near = graph.nodes_near(start, steps)
    near = near[query.to_goal[near] < query.cost_limit]
    if len(near) == 0:
        return
    source, near = int(near[0]), np.ascontiguousarray(near[:: 1 + len(near) // constants.EVASION_NODES])
    evaluate_nodes(near, evaluation)
    free = near[evaluation.clearance[near] >= apart]
    directions = _in_all_directions(free, (graph.latent[free] - start) / graph.grid.spacing)
    for target in directions[: constants.EVASION_TARGETS]:
        # By the triangle inequality a node is no nearer to the target than their costs from the start, or to the goal,
        # differ.
        from_start, to_goal = (np.abs(costs - costs[target]) for costs in (query.from_start, query.to_goal))
        ahead = np.maximum(from_start, to_goal)
        nodes, edges, _ = shortest_free_path(graph.adjacency, query.graph.base, ahead, source, target)
        if len(edges) > 0:
            points = np.concatenate([start[None], graph.latent[nodes]])
            yield LatentPath(nodes, points, float(np.max(query.graph.energies(edges))), 0.0)


def displaced_paths(
    robot: Robot, arm: ArmInScene, start: np.ndarray, undisplaced: np.ndarray, reach: float, apart: float
) -> Iterator[np.ndarray]:
    """Return configurations (m, eta) of paths from one (eta,) that displace the tool straight, turned as it is, or
    swivel the arm about it: to evasion targets beside the graph, the shortest first, of those the one with most
    clearance; and then to targets that are farther, in steps twice as long.

    Parameters
    ----------
    arm : among where obstacles are expected to be, all at once; a target's clearance from that is at least `apart` [m].
    undisplaced : (3,) where the tool would be on the graph [m]; no target is farther from there than `reach` [m].
    """
    position, quaternion = robot.forward(start)
    for length in (1.0 / _STEPS, 2.0 / _STEPS):
        found = []
        for number, (direction, swivel) in enumerate(_displacements(len(start))):
            steps = length * constants.EVASION_DISPLACEMENT * np.arange(1, _STEPS + 1)
            positions = position + steps[:, None] * direction
            swivels = np.full(_STEPS, length * constants.EVASION_SWIVEL * swivel)
            solved = solve_path(robot, positions, np.tile(quaternion, (_STEPS, 1)), start, swivels)
            within = solved.reached & (np.linalg.norm(positions - undisplaced, axis=1) <= reach)
            for step in range(int(np.argmin(np.append(within, False)))):
                clearance = clearance_at(solved.configurations[step], arm, np.inf)
                if clearance >= apart:
                    found.append((step, -clearance, number, solved.configurations[: step + 1]))
        for _, _, _, configurations in sorted(found, key=lambda target: target[:3]):
            yield np.concatenate([start[None], configurations])


def _displacements(joints: int) -> list[tuple[np.ndarray, float]]:
    """Directions (3,), of length 1 or 0, and swivels, -1, 0 or 1, of which one is 0."""
    directions = [np.array(one, dtype=float) for one in product((-1, 0, 1), repeat=3) if any(one)]
    displaced = [(one / np.linalg.norm(one), 0.0) for one in directions]
    return displaced + ([(np.zeros(3), -1.0), (np.zeros(3), 1.0)] if joints > 6 else [])


def _in_all_directions(nodes: np.ndarray, away: np.ndarray) -> list[int]:
    """Those of some nodes (n,), at offsets away (n, d), of which none lies behind another; the nearest first."""
    lengths = np.linalg.norm(away, axis=1)
    nodes, away = nodes[lengths > 0.0], away[lengths > 0.0] / lengths[lengths > 0.0, None]
    chosen: list[int] = []
    while len(nodes):
        chosen.append(int(nodes[0]))
        apart = away @ away[0] < constants.EVASION_COSINE
        nodes, away = nodes[apart], away[apart]
    return chosen
