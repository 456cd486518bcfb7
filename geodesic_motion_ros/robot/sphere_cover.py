"""Spheres that cover an arm's collision meshes, as the sphere file of a robot's folder has them.

A convex mesh is covered by few spheres by greedy set cover (Chvatal 1979): of all candidate spheres take the one that
covers most of what is still bare, until nothing is. Candidates have their centres on a grid inside the mesh and stick
out of none of its planes by more than a given protrusion. What has to be covered are small triangles of the surface,
each by one sphere, and the grid points inside; a sphere that holds the corners of a triangle holds all of it, so
nothing of the surface stays bare between samples. At last every sphere shrinks as far as the others allow.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from geodesic_motion_ros.utils.errors import ParameterError

PROTRUSION = 0.03
"""How far [m] spheres may stick out of the planes of a mesh, unless set otherwise."""
TRIANGLE = 0.4
"""Longest edge, in protrusions, of the surface triangles that one sphere has to cover."""
SPACING = 1.0 / 3.0
"""Distance, in protrusions, between the grid points that centres are chosen from."""
MESH_MARGIN = 0.001
"""Radius [m] that PyBullet adds to a mesh."""
DECIMALS = 4
"""Digits [m] to which a sphere file is rounded, radii upwards."""


def file_spheres(vertices: np.ndarray, protrusion: float) -> np.ndarray:
    """Spheres (S, 4) as a file has them: those of `cover` with PyBullet's margin, rounded without losing anything."""
    spheres = cover(vertices, protrusion)
    centres = np.round(spheres[:, :3], DECIMALS)
    moved = np.linalg.norm(centres - spheres[:, :3], axis=1)
    radii = np.ceil((spheres[:, 3] + moved + MESH_MARGIN) * 10**DECIMALS) / 10**DECIMALS
    return np.column_stack([centres, radii]) + 0.0  # which turns -0.0 into 0.0


def cover(vertices: np.ndarray, protrusion: float = PROTRUSION) -> np.ndarray:
    """Spheres (S, 4), centre and radius [m], that hold the whole convex hull of vertices (V, 3) [m].

    No sphere sticks out of a plane of the hull by more than `protrusion` [m]. The same vertices give the same spheres
    on the same machine; on another one, rounding may choose between candidates that cover equally much differently.

    Raises
    ------
    ParameterError : the hull is so thin, compared with the protrusion, that no grid point lies inside near enough.
    """
    hull = ConvexHull(vertices)
    centres = _grid(vertices, SPACING * protrusion)
    depths = np.min(-(centres @ hull.equations[:, :3].T) - hull.equations[:, 3], axis=1)
    centres, depths = centres[depths > 0.0], depths[depths > 0.0]
    triangles = _subdivided(vertices[hull.simplices], TRIANGLE * protrusion)
    edges = triangles[:, 1:] - triangles[:, :1]
    sizes = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    # far less than the surface, yet enough to decide between spheres that cover no more of it
    sizes = np.concatenate([sizes, np.full(len(centres), 1e-9 * np.sum(sizes))])
    radii = depths + protrusion
    corners, corner_of = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corner_of = np.ascontiguousarray(corner_of.reshape(-1, 3).T)

    def reaches(centre: np.ndarray) -> np.ndarray:
        """Radii (T + G,) [m] from which on a sphere about a centre holds each triangle, and each grid point."""
        around = np.linalg.norm(corners - centre, axis=1)[corner_of].max(axis=0)
        return np.concatenate([around, np.linalg.norm(centres - centre, axis=1)])

    inside = np.empty((len(centres), len(sizes)), dtype=bool)
    for row, centre, radius in zip(inside, centres, radii, strict=True):
        row[:] = reaches(centre) <= radius
    if not np.all(np.any(inside, axis=0)):
        raise ParameterError(
            f"protrusion is {protrusion} m: with centres {SPACING * protrusion:.4f} m apart that do not cover a body "
            f"of {np.round(np.ptp(vertices, axis=0), 3).tolist()} m; take another one"
        )
    gains = np.array([np.sum(row * sizes) for row in inside])
    chosen: list[int] = []
    bare = np.ones(len(sizes), dtype=bool)
    while np.any(bare):
        chosen.append(int(np.argmax(gains)))
        gained = bare & inside[chosen[-1]]
        gains -= inside[:, gained] @ sizes[gained]
        bare &= ~gained
    return _shrunk(centres[chosen], radii[chosen], np.array([reaches(centre) for centre in centres[chosen]]))


def _grid(vertices: np.ndarray, spacing: float) -> np.ndarray:
    """Grid points (G, 3) in the box of vertices, symmetric about its middle."""
    lowest, highest = vertices.min(axis=0), vertices.max(axis=0)
    counts = np.floor(0.5 * (highest - lowest) / spacing).astype(int)
    steps = [spacing * np.arange(-count, count + 1) for count in counts]
    return np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5 * (lowest + highest)


def _subdivided(triangles: np.ndarray, longest: float) -> np.ndarray:
    """Triangles (T, 3, 3) halved at their longest edges until none is longer than `longest`."""
    finished = []
    while len(triangles):
        lengths = np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)
        long = lengths.max(axis=1) > longest
        finished.append(triangles[~long])
        rows, first = np.arange(np.sum(long)), np.argmax(lengths[long], axis=1)
        one, other, opposite = (triangles[long][rows, (first + number) % 3] for number in range(3))
        middle = 0.5 * (one + other)
        triangles = np.concatenate([np.stack([one, middle, opposite], 1), np.stack([middle, other, opposite], 1)])
    return np.concatenate(finished)


def _shrunk(centres: np.ndarray, radii: np.ndarray, reaches: np.ndarray) -> np.ndarray:
    """Spheres (S, 4) that hold the same together: each, the largest first, keeps what no other holds."""
    radii = radii.copy()
    for sphere in np.argsort(-radii, kind="stable"):
        others = np.arange(len(radii)) != sphere
        alone = ~np.any(reaches[others] <= radii[others, None], axis=0)
        radii[sphere] = np.max(reaches[sphere, alone], initial=0.0)
    return np.column_stack([centres, radii])[radii > 0.0]
