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
        saved, halves = _best_cut(part)
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


def _best_cut(triangles: np.ndarray) -> tuple[float, list[np.ndarray]]:
    """The volume that the best of the planes saves, and both parts."""
    points = triangles.reshape(-1, 3)
    lowest, highest, volume = points.min(axis=0), points.max(axis=0), _volume(triangles)
    best: tuple[float, list[np.ndarray]] = (0.0, [])
    for axis in range(3):
        for plane in np.linspace(lowest[axis], highest[axis], PLANES + 2)[1:-1]:
            halves = _cut(triangles, axis, float(plane))
            saved = volume - sum(map(_volume, halves))
            if saved > best[0]:
                best = saved, halves
    return best


def _volume(triangles: np.ndarray) -> float:
    """Of the hull; infinite where there is none to cover."""
    try:
        return float(ConvexHull(triangles.reshape(-1, 3)).volume)
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
