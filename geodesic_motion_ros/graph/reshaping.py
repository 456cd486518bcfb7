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
    gaps : distance [m] of the cells (x, y, z) of a grid over the body's box from obstacles, at least; cell : their
        side [m].
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
    cell: float
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
            body, centres, radii, float(strength), float(width_ratio), excess, float(within), gaps, cell,
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


@numba.njit(cache=True, nogil=True)
def look_at(node: int, reshaping: Reshaping) -> None:
    """Work out what obstacles do to a node, where that has not been done yet."""
    if reshaping.looked[node]:
        return
    reshaping.looked[node] = True
    body, gaps, centres, radii = reshaping.body, reshaping.gaps, reshaping.centres, reshaping.radii
    lower, scale = body.lower, 1.0 / reshaping.cell
    touched = False
    for k in range(body.points.shape[1]):
        x, y, z = body.points[node, k, 0], body.points[node, k, 1], body.points[node, k, 2]
        gap = gaps[int((x - lower[0]) * scale), int((y - lower[1]) * scale), int((z - lower[2]) * scale)]
        factor = 1.0
        if gap < reshaping.excess:
            radius = body.point_radii[k]
            factor = ambient_factor(x, y, z, radius, centres, radii, reshaping.strength, reshaping.width_ratio)
        reshaping.factors[node, k] = factor
        touched = touched or factor > 1.0
    reshaping.touched[node] = touched

    clearance, within = math.inf, reshaping.within
    for g in range(len(body.link_radii)):
        x, y, z = body.links[node, g, 0], body.links[node, g, 1], body.links[node, g, 2]
        gap = gaps[int((x - lower[0]) * scale), int((y - lower[1]) * scale), int((z - lower[2]) * scale)]
        if gap >= body.link_radii[g] + within:
            continue
        for o in range(len(radii)):
            dx, dy, dz = x - centres[o, 0], y - centres[o, 1], z - centres[o, 2]
            reach = body.link_radii[g] + radii[o] + min(within, clearance)
            if reach <= 0.0 or dx * dx + dy * dy + dz * dz >= reach * reach:
                continue
            for s in range(body.first[g], body.first[g + 1]):
                both = body.sphere_radii[s] + radii[o]
                dx = body.spheres[node, s, 0] - centres[o, 0]
                dy = body.spheres[node, s, 1] - centres[o, 1]
                dz = body.spheres[node, s, 2] - centres[o, 2]
                squared = dx * dx + dy * dy + dz * dz
                if squared < (both + within) ** 2:
                    clearance = min(clearance, math.sqrt(squared) - both)
    reshaping.clearance[node] = clearance


@numba.njit(cache=True, nogil=True)
def look_everywhere(reshaping: Reshaping) -> None:
    """Work out what obstacles do to every node."""
    for node in range(len(reshaping.looked)):
        look_at(node, reshaping)
