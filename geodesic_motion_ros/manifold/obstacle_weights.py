"""What obstacles do to the nodes of a graph, worked out where a search first reaches them.

A coarse grid over the workspace tells how far obstacles are at least from each of its cells: most body points are in
cells that no obstacle is near, and need no more than a look at it. Nothing outlives the obstacles that it was worked
out for: with the next ones, or none, everything begins anew.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.geometry.distance_field import field_distance
from geodesic_motion_ros.geometry.shapes import bounding_radii, solid_distance, thicknesses
from geodesic_motion_ros.manifold.ambient_law import AmbientLaw
from geodesic_motion_ros.manifold.ambient_metric import CUTOFF, cloud_factor, completion, gaussian, solid_factor
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.obstacles.obstacles import Obstacles

#: Side of a cell of the workspace [m]; larger where there would be more cells along one side than so many.
_CELL, _MOST_CELLS = 0.06, 64
#: Factors are at most this: the cheapest path never goes through it, and what does not move there still costs nothing.
_LARGEST = 1e12


class NodeEvaluation(NamedTuple):
    """Lazy cache of the effects of obstacles on the n nodes of a graph: metric factors and clearance of each node.

    A search fills it where it comes to a node first (`evaluate_node`); compiled kernels read it. An edge becomes longer
    by the factors of both its nodes (`shortest_path.edge_weight`), and a node with less clearance than the margin of a
    search is removed.

    Attributes
    ----------
    body : the arm, or the tool, at every node.
    centres, radii : (o, 3), (o,) [m] the spheres that can affect any node. solids : (b, 16) the solids that can
        (`geometry/shapes.py`). squares, placing : of the cloud's `DistanceField`.
    strength, width_ratio, completed : of the ambient metric, see `ambient_metric.ambient_factor`; strength is 0 without
        one.
    excess : an obstacle whose surface is farther from a body point than this does not affect it [m].
    within : clearances from here on are not distinguished [m].
    gaps : distance [m] of the cells (x, y, z) of a grid over the body's box from obstacles, at least; scale : cells per
        metre.
    heads, listed, following : a cell linked list: the spheres near a cell (x, y, z) are listed[e] for
        e = heads[x, y, z], then for following[e], and so on until e is -1.
    evaluated : (n,) whether the next three are known for a node already.
    factors : (n, K) ambient factors of the body points. affected : (n,) whether any of them exceeds 1.
    clearance : (n,) [m] of the body, negative inside an obstacle, inf from `within` on.
    """

    body: NodeBody
    centres: np.ndarray
    radii: np.ndarray
    solids: np.ndarray
    squares: np.ndarray
    placing: np.ndarray
    strength: float
    width_ratio: float
    completed: bool
    excess: float
    within: float
    gaps: np.ndarray
    scale: float
    heads: np.ndarray
    listed: np.ndarray
    following: np.ndarray
    evaluated: np.ndarray
    factors: np.ndarray
    affected: np.ndarray
    clearance: np.ndarray

    @classmethod
    def of(
        cls,
        body: NodeBody,
        obstacles: Obstacles,
        strength: float,
        width_ratio: float,
        within: float,
        law: AmbientLaw = "gaussian",
    ) -> NodeEvaluation:
        """Nothing evaluated yet, for a body among obstacles, which stand where they are."""
        nodes, points = body.points.shape[:2]
        thickest = float(np.max(body.point_radii, initial=0.0))
        sizes = np.concatenate([obstacles.radii, bounding_radii(obstacles.solids)])
        depths = np.concatenate([obstacles.radii, thicknesses(obstacles.solids)])
        felt = CUTOFF * width_ratio * (depths + thickest) - depths
        places = np.concatenate([obstacles.centres, obstacles.solids[:, :3]])
        gap = np.linalg.norm(np.maximum(np.maximum(body.lower - places, places - body.upper), 0.0), axis=1) - sizes
        near = gap <= np.maximum(felt, within)
        excess = float(np.max(felt[near], initial=0.0))
        squares, placing = obstacles.cloud
        if squares.size:
            thickness = obstacles.cloud.thickness
            excess = max(excess, CUTOFF * width_ratio * (thickness + thickest) - thickness)
        spheres = len(obstacles.radii)
        centres = np.ascontiguousarray(obstacles.centres[near[:spheres]])
        radii, solids = obstacles.radii[near[:spheres]], obstacles.solids[near[spheres:]]
        sides = body.upper - body.lower
        cell = max(_CELL, float(np.max(sides)) / _MOST_CELLS)
        reach = max(excess, within + float(np.max(body.link_radii, initial=0.0)))
        shape = np.floor(sides / cell).astype(np.int64) + 1
        gaps, heads, listed, following = _gaps(
            body.lower, shape, cell, centres, radii, solids, bounding_radii(solids), reach
        )
        if squares.size:
            _lower_gaps(gaps, body.lower, cell, squares, placing)
        return cls(
            body, centres, radii, solids, squares, placing, 0.0 if law == "hard" else float(strength),
            float(width_ratio), law == "completed", excess, float(within), gaps, 1.0 / cell, heads, listed, following,
            np.zeros(nodes, dtype=np.bool_), np.empty((nodes, points)), np.empty(nodes, dtype=np.bool_),
            np.empty(nodes),
        )  # fmt: skip

    def copied(self) -> NodeEvaluation:
        """The same nodes evaluated; what is evaluated from now on is written to one of both alone."""
        names = ("evaluated", "factors", "affected", "clearance")
        return self._replace(**{name: getattr(self, name).copy() for name in names})

    def is_felt(self, margin: float) -> bool:
        """Whether obstacles affect a node that was evaluated, or leave it less clearance than a margin [m]."""
        nodes = np.flatnonzero(self.evaluated)
        return bool(np.any(self.affected[nodes]) or np.any(self.clearance[nodes] < margin))


@numba.njit(cache=True, nogil=True)
def _gaps(
    lower: np.ndarray,
    shape: np.ndarray,
    cell: float,
    centres: np.ndarray,
    radii: np.ndarray,
    solids: np.ndarray,
    sizes: np.ndarray,
    reach: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lower bounds of the distance [m] of cells from obstacles; `reach` where none is nearer.

    Also heads, listed and following of a `NodeEvaluation`, with the spheres that are nearer than `reach`. sizes : (b,)
    radii of spheres around the solids [m].
    """
    result = np.full((shape[0], shape[1], shape[2]), reach)
    heads, most, count = np.full((shape[0], shape[1], shape[2]), -1, dtype=np.int32), 0, 0
    half = 0.5 * math.sqrt(3.0) * cell
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for o in range(len(radii)):
        _cells_around(centres[o], radii[o] + reach + half, lower, shape, cell, first, last)
        most += max(0, last[0] - first[0]) * max(0, last[1] - first[1]) * max(0, last[2] - first[2])
    listed, following = np.empty(most, dtype=np.int32), np.empty(most, dtype=np.int32)
    for o in range(len(radii)):
        _cells_around(centres[o], radii[o] + reach + half, lower, shape, cell, first, last)
        for i in range(first[0], last[0]):
            dx = lower[0] + (i + 0.5) * cell - centres[o, 0]
            for j in range(first[1], last[1]):
                dy = lower[1] + (j + 0.5) * cell - centres[o, 1]
                for k in range(first[2], last[2]):
                    dz = lower[2] + (k + 0.5) * cell - centres[o, 2]
                    gap = math.sqrt(dx * dx + dy * dy + dz * dz) - half - radii[o]
                    if gap < reach:
                        result[i, j, k] = min(result[i, j, k], gap)
                        listed[count], following[count], heads[i, j, k] = o, heads[i, j, k], count
                        count += 1
    for b in range(len(solids)):
        _cells_around(solids[b], sizes[b] + reach + half, lower, shape, cell, first, last)
        for i in range(first[0], last[0]):
            x = lower[0] + (i + 0.5) * cell
            for j in range(first[1], last[1]):
                y = lower[1] + (j + 0.5) * cell
                for k in range(first[2], last[2]):
                    gap = solid_distance(x, y, lower[2] + (k + 0.5) * cell, solids, b) - half
                    result[i, j, k] = min(result[i, j, k], gap)
    return result, heads, listed, following


@numba.njit(cache=True, nogil=True)
def _lower_gaps(gaps: np.ndarray, lower: np.ndarray, cell: float, squares: np.ndarray, placing: np.ndarray) -> None:
    """Take account of a cloud in the gaps; it tells no distance beyond its own reach."""
    half = 0.5 * math.sqrt(3.0) * cell
    for i in range(gaps.shape[0]):
        for j in range(gaps.shape[1]):
            for k in range(gaps.shape[2]):
                x, y, z = lower[0] + (i + 0.5) * cell, lower[1] + (j + 0.5) * cell, lower[2] + (k + 0.5) * cell
                gaps[i, j, k] = min(gaps[i, j, k], field_distance(x, y, z, squares, placing) - half)


@numba.njit(cache=True, nogil=True)
def _cells_around(
    centre: np.ndarray,
    around: float,
    lower: np.ndarray,
    shape: np.ndarray,
    cell: float,
    first: np.ndarray,
    last: np.ndarray,
) -> None:
    """Of each axis the first cell within a distance [m] of a centre (3 or more numbers), and the one after the last."""
    for a in range(3):
        # Bounded before they become whole numbers: an obstacle may be larger than those go.
        first[a] = int(max(0.0, (centre[a] - around - lower[a]) / cell))
        last[a] = int(min(float(shape[a]), max(0.0, (centre[a] + around - lower[a]) / cell + 1.0)))


@numba.njit(cache=True, nogil=True)
def evaluate_node(node: int, evaluation: NodeEvaluation) -> None:
    """Work out what obstacles do to a node, where that has not been done yet. For use within compiled loops."""
    (
        (points, point_radii, spheres, sphere_radii, links, link_radii, first, lower, _),
        centres, radii, solids, squares, placing, strength, width_ratio, completed, excess, within, gaps, scale, heads,
        listed, following, evaluated, factors, affected, clearance,
    ) = evaluation  # fmt: skip
    if not evaluated[node]:
        evaluated[node] = True
        affected[node] = False
        x0, y0, z0 = lower[0], lower[1], lower[2]
        for k in range(points.shape[1]):
            x, y, z = points[node, k, 0], points[node, k, 1], points[node, k, 2]
            factors[node, k] = 1.0
            # Unsigned: compiled code need not look for negative indices.
            i, j, h = np.uint32((x - x0) * scale), np.uint32((y - y0) * scale), np.uint32((z - z0) * scale)
            if gaps[i, j, h] < excess:
                entry = heads[i, j, h]
                while entry >= 0:
                    o = listed[entry]
                    dx, dy, dz = x - centres[o, 0], y - centres[o, 1], z - centres[o, 2]
                    width = width_ratio * (radii[o] + point_radii[k])
                    squared = dx * dx + dy * dy + dz * dz
                    if completed:
                        factors[node, k] += completion(math.sqrt(squared) - radii[o], radii[o], width, strength)
                    else:
                        factors[node, k] += gaussian(squared, width, strength)
                    entry = following[entry]
                if len(solids) > 0:
                    factors[node, k] += solid_factor(
                        x, y, z, point_radii[k], solids, strength, width_ratio, completed
                    )
                if squares.size > 0:
                    factors[node, k] += cloud_factor(
                        x, y, z, point_radii[k], squares, placing, strength, width_ratio, completed
                    )
                factors[node, k] = min(factors[node, k], _LARGEST)
                affected[node] = affected[node] or factors[node, k] > 1.0
        nearest = math.inf
        for g in range(links.shape[1]):
            x, y, z = links[node, g, 0], links[node, g, 1], links[node, g, 2]
            i, j, h = np.uint32((x - x0) * scale), np.uint32((y - y0) * scale), np.uint32((z - z0) * scale)
            if gaps[i, j, h] >= link_radii[g] + within:
                continue
            entry = heads[i, j, h]
            while entry >= 0:
                o = listed[entry]
                entry = following[entry]
                dx, dy, dz = x - centres[o, 0], y - centres[o, 1], z - centres[o, 2]
                reach = link_radii[g] + radii[o] + min(within, nearest)
                if reach <= 0.0 or dx * dx + dy * dy + dz * dz >= reach * reach:
                    continue
                for s in range(first[g], first[g + 1]):
                    both = sphere_radii[s] + radii[o]
                    dx = spheres[node, s, 0] - centres[o, 0]
                    dy = spheres[node, s, 1] - centres[o, 1]
                    dz = spheres[node, s, 2] - centres[o, 2]
                    squared = dx * dx + dy * dy + dz * dz
                    if squared < (both + within) ** 2:
                        nearest = min(nearest, math.sqrt(squared) - both)
            for b in range(len(solids)):
                if solid_distance(x, y, z, solids, b) >= link_radii[g] + min(within, nearest):
                    continue
                for s in range(first[g], first[g + 1]):
                    distance = solid_distance(spheres[node, s, 0], spheres[node, s, 1], spheres[node, s, 2], solids, b)
                    if distance - sphere_radii[s] < within:
                        nearest = min(nearest, distance - sphere_radii[s])
            if squares.size > 0 and field_distance(x, y, z, squares, placing) < link_radii[g] + min(within, nearest):
                for s in range(first[g], first[g + 1]):
                    distance = field_distance(
                        spheres[node, s, 0], spheres[node, s, 1], spheres[node, s, 2], squares, placing
                    )
                    if distance - sphere_radii[s] < within:
                        nearest = min(nearest, distance - sphere_radii[s])
        clearance[node] = nearest


@numba.njit(cache=True, nogil=True)
def evaluate_nodes(nodes: np.ndarray, evaluation: NodeEvaluation) -> None:
    """Work out what obstacles do to some nodes (k,)."""
    for node in nodes:
        # As the searches number nodes: one kernel for all.
        evaluate_node(np.int32(node), evaluation)


@numba.njit(cache=True, nogil=True)
def first_clear(nodes: np.ndarray, goal: int, evaluation: NodeEvaluation, margin: float) -> int:
    """The first of some nodes (k,) with a clearance of a margin [m] at least, or the goal's; -1 where there is none.

    What obstacles do to the nodes after it is not worked out.
    """
    for i in range(len(nodes)):
        evaluate_nodes(nodes[i : i + 1], evaluation)
        if nodes[i] == goal or evaluation.clearance[nodes[i]] >= margin:
            return nodes[i]
    return -1
