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

from geodesic_motion_ros.graph.ambient import CUTOFF, ambient_factor
from geodesic_motion_ros.graph.node_body import NodeBody

#: Side of a cell of the workspace [m]; larger where there would be more cells along one side than so many.
_CELL, _MOST_CELLS = 0.06, 64


class Reshaping(NamedTuple):
    """A body at n nodes among obstacles; compiled kernels read and fill it.

    Attributes
    ----------
    centres, radii : (o, 3), (o,) [m] the obstacles that any node can feel.
    strength, width_ratio : of the ambient metric, see `ambient.ambient_factor`.
    excess : no body point feels an obstacle whose surface is farther than this [m].
    within : clearances from here on are not told apart [m].
    gaps : distance [m] of the cells (x, y, z) of a grid over the body's box from obstacles, at least; scale : cells per
        metre.
    looked : (n,) nodes for which the following is known already.
    factors : (n, K) ambient factors of the body points; touched : (n,) whether any of them exceeds 1.
    clearance : (n,) [m] of the body, negative inside an obstacle, inf from `within` on.
    """

    body: NodeBody
    centres: np.ndarray
    radii: np.ndarray
    strength: float
    width_ratio: float
    excess: float
    within: float
    gaps: np.ndarray
    scale: float
    looked: np.ndarray
    factors: np.ndarray
    touched: np.ndarray
    clearance: np.ndarray

    @classmethod
    def of(
        cls,
        body: NodeBody,
        centres: np.ndarray,
        radii: np.ndarray,
        strength: float,
        width_ratio: float,
        within: float,
    ) -> Reshaping:
        """A body among spheres (o, 3), (o,) [m]."""
        nodes, points = body.points.shape[:2]
        felt = CUTOFF * width_ratio * (radii + np.max(body.point_radii, initial=0.0)) - radii
        gap = np.linalg.norm(np.maximum(np.maximum(body.lower - centres, centres - body.upper), 0.0), axis=1) - radii
        near = gap <= np.maximum(felt, within)
        excess = float(np.max(felt[near], initial=0.0))
        centres, radii = np.ascontiguousarray(centres[near]), np.ascontiguousarray(radii[near])
        sides = body.upper - body.lower
        cell = max(_CELL, float(np.max(sides)) / _MOST_CELLS)
        reach = max(excess, within + float(np.max(body.link_radii, initial=0.0)))
        gaps = _gaps(body.lower, np.floor(sides / cell).astype(np.int64) + 1, cell, centres, radii, reach)
        return cls(
            body, centres, radii, float(strength), float(width_ratio), excess, float(within), gaps, 1.0 / cell,
            np.zeros(nodes, dtype=np.bool_), np.empty((nodes, points)), np.empty(nodes, dtype=np.bool_),
            np.empty(nodes),
        )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _gaps(
    lower: np.ndarray, shape: np.ndarray, cell: float, centres: np.ndarray, radii: np.ndarray, reach: float
) -> np.ndarray:
    """Lower bounds of the distance [m] of cells from obstacles; `reach` where none is nearer."""
    result = np.full((shape[0], shape[1], shape[2]), reach)
    half = 0.5 * math.sqrt(3.0) * cell
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for o in range(len(radii)):
        around = radii[o] + reach + half
        for a in range(3):
            first[a] = max(0, math.floor((centres[o, a] - around - lower[a]) / cell))
            last[a] = min(shape[a], math.floor((centres[o, a] + around - lower[a]) / cell) + 1)
        for i in range(first[0], last[0]):
            dx = lower[0] + (i + 0.5) * cell - centres[o, 0]
            for j in range(first[1], last[1]):
                dy = lower[1] + (j + 0.5) * cell - centres[o, 1]
                for k in range(first[2], last[2]):
                    dz = lower[2] + (k + 0.5) * cell - centres[o, 2]
                    gap = math.sqrt(dx * dx + dy * dy + dz * dz) - half - radii[o]
                    result[i, j, k] = min(result[i, j, k], gap)
    return result


@numba.njit(cache=True, nogil=True, inline="always")
def _gap(x: float, y: float, z: float, lower: np.ndarray, scale: float, gaps: np.ndarray) -> float:
    """Of the cell that holds a point of the body's box."""
    # Unsigned: compiled code need not look for negative indices.
    return gaps[np.uint32((x - lower[0]) * scale), np.uint32((y - lower[1]) * scale), np.uint32((z - lower[2]) * scale)]


@numba.njit(cache=True, nogil=True, inline="always")
def look(
    node: int,
    points: np.ndarray,
    point_radii: np.ndarray,
    spheres: np.ndarray,
    sphere_radii: np.ndarray,
    links: np.ndarray,
    link_radii: np.ndarray,
    first: np.ndarray,
    lower: np.ndarray,
    centres: np.ndarray,
    radii: np.ndarray,
    strength: float,
    width_ratio: float,
    excess: float,
    within: float,
    gaps: np.ndarray,
    scale: float,
    looked: np.ndarray,
    factors: np.ndarray,
    touched: np.ndarray,
    clearance: np.ndarray,
) -> None:
    """Work out what obstacles do to a node, where that has not been done yet. For use within compiled loops.

    The parameters are the entries of `Reshaping` and of its body. They come one by one because compiled code counts
    references to all arrays of a tuple each time it reads one: that costs five times as much as what is done here.
    """
    if not looked[node]:
        looked[node] = True
        touched[node] = False
        for k in range(points.shape[1]):
            x, y, z = points[node, k, 0], points[node, k, 1], points[node, k, 2]
            factors[node, k] = 1.0
            if _gap(x, y, z, lower, scale, gaps) < excess:
                factors[node, k] = ambient_factor(x, y, z, point_radii[k], centres, radii, strength, width_ratio)
                touched[node] = touched[node] or factors[node, k] > 1.0
        nearest = math.inf
        for g in range(links.shape[1]):
            x, y, z = links[node, g, 0], links[node, g, 1], links[node, g, 2]
            if _gap(x, y, z, lower, scale, gaps) >= link_radii[g] + within:
                continue
            for o in range(len(radii)):
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
        clearance[node] = nearest


@numba.njit(cache=True, nogil=True)
def look_at(nodes: np.ndarray, reshaping: Reshaping) -> None:
    """Work out what obstacles do to some nodes (k,)."""
    (
        (points, point_radii, spheres, sphere_radii, links, link_radii, first, lower, _),
        centres, radii, strength, width_ratio, excess, within, gaps, scale, looked, factors, touched, clearance,
    ) = reshaping  # fmt: skip
    for node in nodes:
        look(
            node, points, point_radii, spheres, sphere_radii, links, link_radii, first, lower, centres, radii, strength,
            width_ratio, excess, within, gaps, scale, looked, factors, touched, clearance,
        )  # fmt: skip
