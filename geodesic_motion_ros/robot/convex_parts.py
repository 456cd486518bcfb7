"""Convex parts of a mesh, cut by planes.

A mesh collides as its convex hull, there as here, and the hull of a bent link fills its inner side. So it is cut at a
plane across an axis of its frame, the one that saves the most volume of hulls, and so are its parts, until no cut saves
a share of the hull that it began with (greedy bisection as in K. Mamou and F. Ghorbel, ICIP 2009, and X. Wei et al.,
"Approximate convex decomposition", ACM Transactions on Graphics 41, 2022, with the volume as the measure of concavity).

The hulls of the parts hold all of the mesh. An extreme point of a body cut off by a plane is one of the surface or of
the section, and the section lies in the hull of its outline, which joins both parts as their cap.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

SAVED = 0.03
"""Share of a mesh's hull that a cut has to save."""
PLANES = 31
"""Tried across each axis, evenly over a part."""
DENSE, CELLS = 1000, 48
"""The plane is chosen on a mesh of more corners than this with one corner for each cell of a grid, so many along its
longest side; cut, and judged by its volume, is the mesh itself.
"""


def convex_parts(triangles: np.ndarray) -> list[np.ndarray]:
    """Triangles (T, 3, 3) of the hulls of a mesh's parts, of triangles (T, 3, 3) in whatever unit.

    A mesh that is nearly convex is one part.

    Raises
    ------
    ValueError : it is flat.
    """
    try:
        whole = ConvexHull(triangles.reshape(-1, 3)).volume
    except QhullError as error:
        raise ValueError("it is flat") from error
    finished, parts = [], [triangles]
    while parts:
        part = parts.pop()
        saved, halves = _best_cut(part, SAVED * whole)
        if saved < SAVED * whole:
            finished.append(hull_triangles(part.reshape(-1, 3)))
        else:
            parts += halves
    return finished


def hull_triangles(points: np.ndarray) -> np.ndarray:
    """Triangles (T, 3, 3) of the convex hull of points (n, 3), seen from outside counterclockwise."""
    hull = ConvexHull(points)
    triangles = points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0.0
    triangles[inward] = triangles[inward, ::-1]
    return triangles


def _best_cut(triangles: np.ndarray, least: float) -> tuple[float, list[np.ndarray]]:
    """The volume that the best of the planes saves, and both parts; 0 and none where no plane can save `least`."""
    corners, faces = _distinct(triangles.reshape(-1, 3))
    volume = _volume(corners)
    if volume < least:
        return 0.0, []
    best, across, at = np.inf, 0, 0.0
    lowest, highest = corners.min(axis=0), corners.max(axis=0)
    corners, edges = _coarse_edges(corners, faces.reshape(-1, 3))
    for axis in range(3):
        planes = np.linspace(lowest[axis], highest[axis], PLANES + 2)[1:-1]
        left = _volumes_of_halves(corners, edges, axis, planes)
        if (smallest := float(np.min(left))) < best:
            best, across, at = smallest, axis, float(planes[np.argmin(left)])
    halves = _cut(triangles, across, at)
    return volume - sum(_volume(half.reshape(-1, 3)) for half in halves), halves


def _distinct(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct ones of points (n, 3), in rising order, and the number of each point among them (n,).

    As of `np.unique` along an axis, which takes ten times as long.
    """
    numbers = np.zeros(len(points), dtype=np.int64)
    for values in points.T:
        distinct, order = np.unique(values, return_inverse=True)
        numbers = numbers * len(distinct) + order
    _, kept, number_of = np.unique(numbers, return_index=True, return_inverse=True)
    return points[kept], number_of


def _coarse_edges(corners: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners (V, 3) and edges (E, 2) of faces (T, 3); of a mesh with more than DENSE corners, one for each cell of
    a grid of CELLS along its longest side.
    """
    if len(corners) > DENSE:
        cells = np.floor((corners - corners.min(axis=0)) * (CELLS / np.max(np.ptp(corners, axis=0)))).astype(int)
        _, kept, cell_of = np.unique(cells @ [1, 1 << 20, 1 << 40], return_index=True, return_inverse=True)
        corners, faces = corners[kept], cell_of[faces]
    ends = np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1)
    numbers = np.unique(ends @ [len(corners), 1])
    edges = np.column_stack([numbers // len(corners), numbers % len(corners)])
    return corners, edges[edges[:, 0] != edges[:, 1]]


def _volumes_of_halves(corners: np.ndarray, edges: np.ndarray, axis: int, planes: np.ndarray) -> np.ndarray:
    """Volumes (n,) of the hulls below and above each of rising planes (n,), added, of corners (V, 3) and edges (E, 2).

    The hull below a plane holds that below the plane before and its section: so each is the hull of the corners of the
    one before, of those between the two planes, and of its own section.
    """
    sections = [_section(corners, edges, axis, plane) for plane in planes]
    total = np.zeros(len(planes))
    numbers = np.searchsorted(planes, corners[:, axis])  # the planes below each corner; one on a plane counts below it
    for order in (range(len(planes)), range(len(planes) - 1, -1, -1)):
        rising, hull = order.step > 0, np.empty((0, 3))
        for number in order:
            between = corners[numbers == (number if rising else number + 1)]
            points = np.concatenate([hull, between, sections[number]])
            try:
                found = ConvexHull(points)
            except (QhullError, ValueError):
                hull, total[number] = points, np.inf  # flat so far: there is none to cover
                continue
            hull = points[found.vertices]
            total[number] += found.volume
    return total


def _section(corners: np.ndarray, edges: np.ndarray, axis: int, plane: float) -> np.ndarray:
    """The outermost points (n, 3) of those in which edges cross a plane."""
    heights = corners[:, axis] - plane
    one, other = edges[(heights[edges[:, 0]] > 0.0) != (heights[edges[:, 1]] > 0.0)].T
    share = (heights[one] / (heights[one] - heights[other]))[:, None]
    points = corners[one] + share * (corners[other] - corners[one])
    points[:, axis] = plane
    return points[_outline(points, axis)]


def _outline(points: np.ndarray, axis: int) -> np.ndarray:
    """Numbers of the corners of the hull of points (n, 3) in a plane across an axis, in their order; all of flat ones.
    """
    try:
        return ConvexHull(np.delete(points, axis, axis=1)).vertices
    except (QhullError, ValueError):
        return np.arange(len(points))


def _volume(points: np.ndarray) -> float:
    """Of the hull; infinite where there is none to cover."""
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return np.inf


def _cut(triangles: np.ndarray, axis: int, plane: float) -> list[np.ndarray]:
    """The parts below and above a plane, capped."""
    heights = triangles[:, :, axis] - plane
    count = np.sum(heights > 0.0, axis=1)
    sides = [[triangles[count == 0]], [triangles[count == 3]]]
    outline = [np.empty((0, 3))]
    for above in (1, 2):
        # its corner that is alone on one side of the plane first, which turns no triangle over
        cut, high = triangles[count == above], heights[count == above]
        alone = np.argmax((high > 0.0) == (above == 1), axis=1)
        order = (alone[:, None] + np.arange(3)) % 3
        rows = np.arange(len(cut))[:, None]
        corner, high = cut[rows, order], high[rows, order]
        share = (high[:, :1] / (high[:, :1] - high[:, 1:]))[..., None]
        one, other = np.moveaxis(corner[:, :1] + share * (corner[:, 1:] - corner[:, :1]), 1, 0)
        for crossing in (one, other):
            crossing[:, axis] = plane
        tip = np.stack([corner[:, 0], one, other], axis=1)
        rest = [np.stack([one, corner[:, 1], corner[:, 2]], axis=1), np.stack([one, corner[:, 2], other], axis=1)]
        sides[above % 2].append(tip)
        sides[1 - above % 2] += rest
        outline += [one, other]
    cap = _cap(np.concatenate(outline), axis)
    return [np.concatenate([*side, cap]) for side in sides]


def _cap(outline: np.ndarray, axis: int) -> np.ndarray:
    """Triangles (T, 3, 3) of the hull of points (n, 3) in a plane across an axis."""
    try:
        ring = outline[ConvexHull(np.delete(outline, axis, axis=1)).vertices]
    except (QhullError, ValueError):
        return np.empty((0, 3, 3))
    return np.stack([np.broadcast_to(ring[0], ring[2:].shape), ring[1:-1], ring[2:]], axis=1)
