"""The ambient metric: how obstacles stretch the space around the robot's body points.

The paper's factor of an obstacle with radius r at o is m(p) = 1 + zeta exp(-|p - o|^2 / (2 r^2)); several obstacles
add. The Gaussian never ends, so it is shifted to reach zero, continuously, at CUTOFF widths:

    m(p) = 1 + zeta sum_o max(0, (exp(-|p - o|^2 / (2 s^2)) - c) / (1 - c)),   c = exp(-CUTOFF^2 / 2)

Beyond the cut m is exactly 1: an obstacle that leaves also leaves no trace in the weights.

Near an obstacle this hill has a top: a path through it costs much, and no more. The *completed* metric has none,

    m(p) = 1 + zeta sum_o max(0, r^2 / d^2 - r^2 / D^2),   d = |p - o| - r,   D = CUTOFF s - r,

infinite from the surface on. Lengths go with sqrt(m), so that the surface is infinitely far away, as boundaries of a
complete Riemannian manifold are, and removing the nodes inside is what remains of it on a graph. 1 / d^2 never ends
either; it is shifted to reach zero, continuously, where the Gaussian does. The *hard* law is m = 1: obstacles only
remove nodes.

A solid takes its place with its thickness R, the radius of the largest sphere inside it, for the radius, and with its
signed distance d from the point for |p - o| - R: |p - o| becomes d + R. For a solid that is a sphere it is the same. So
does all of a point cloud, with the thickness that it was given.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.geometry.distance_field import REACH, field_distance, field_distances
from geodesic_motion_ros.geometry.shapes import solid_distance, solid_distances
from geodesic_motion_ros.obstacles.obstacles import Obstacles

#: Distance, in Gaussian widths, at which an obstacle's influence has fallen to nothing (from 1.1 % before the shift).
CUTOFF = 3.0
_SHIFT = math.exp(-0.5 * CUTOFF**2)


@numba.njit(cache=True, nogil=True)
def gaussian(squared: float, width: float, strength: float) -> float:
    """What a sphere adds to the ambient factor at a squared distance [m^2] from its centre, for a width [m]."""
    if squared >= (CUTOFF * width) ** 2:
        return 0.0
    return strength * (math.exp(-0.5 * squared / (width * width)) - _SHIFT) / (1.0 - _SHIFT)


@numba.njit(cache=True, nogil=True)
def completion(distance: float, radius: float, width: float, strength: float) -> float:
    """What an obstacle of a radius adds to the completed factor at a distance from its surface; all lengths in [m].

    width : of the Gaussian in its place.
    """
    if distance <= 0.0:
        return math.inf
    reach = CUTOFF * width - radius
    if distance >= reach:
        return 0.0
    return strength * ((radius / distance) ** 2 - (radius / reach) ** 2)


@numba.njit(cache=True, nogil=True)
def ambient_factor(
    x: float,
    y: float,
    z: float,
    point_radius: float,
    centres: np.ndarray,
    radii: np.ndarray,
    strength: float,
    width_ratio: float,
    completed: bool = False,
) -> float:
    """Ambient factor m >= 1 of a body point (x, y, z) [m].

    Parameters
    ----------
    point_radius : of the sphere that the point carries [m].
    centres, radii : (o, 3), (o,) obstacles [m]. The Gaussian's width is s = width_ratio (radius + point radius):
        the obstacle grown by the body, as seen by the body's centre.
    strength : zeta. completed : by the completed law.
    """
    factor = 1.0
    for o in range(len(radii)):
        width = width_ratio * (radii[o] + point_radius)
        dx, dy, dz = x - centres[o, 0], y - centres[o, 1], z - centres[o, 2]
        squared = dx * dx + dy * dy + dz * dz
        if completed:
            factor += completion(math.sqrt(squared) - radii[o], radii[o], width, strength)
        else:
            factor += gaussian(squared, width, strength)
    return factor


@numba.njit(cache=True, nogil=True)
def solid_factor(
    x: float,
    y: float,
    z: float,
    point_radius: float,
    solids: np.ndarray,
    strength: float,
    width_ratio: float,
    completed: bool = False,
) -> float:
    """What solids (b, 16), rows as of `geometry/shapes.py`, add to the ambient factor of a body point (x, y, z) [m].

    The rest as in `ambient_factor`.
    """
    added = 0.0
    for b in range(len(solids)):
        thickness = min(solids[b, 3], solids[b, 4], solids[b, 5]) + solids[b, 6]
        width = width_ratio * (thickness + point_radius)
        distance = solid_distance(x, y, z, solids, b)
        away = distance + thickness
        if completed:
            added += completion(distance, thickness, width, strength)
        elif away < CUTOFF * width:
            added += strength * (math.exp(-0.5 * away * away / (width * width)) - _SHIFT) / (1.0 - _SHIFT)
    return added


@numba.njit(cache=True, nogil=True)
def cloud_factor(
    x: float,
    y: float,
    z: float,
    point_radius: float,
    squares: np.ndarray,
    placing: np.ndarray,
    strength: float,
    width_ratio: float,
    completed: bool = False,
) -> float:
    """What a point cloud, the parts of a `DistanceField`, adds to the ambient factor of a body point (x, y, z) [m].

    The rest as in `ambient_factor`. Both laws are cut where the field ends, if that is nearer than CUTOFF widths.
    """
    edge, surface, thickness = placing[12], placing[13], placing[14]
    width = width_ratio * (thickness + point_radius)
    cut = min(CUTOFF * width, REACH - edge - surface + thickness)
    distance = field_distance(x, y, z, squares, placing)
    if completed:
        return completion(distance, thickness, cut / CUTOFF, strength)
    away = max(0.0, distance + thickness)
    if away >= cut:
        return 0.0
    shift = math.exp(-0.5 * (cut / width) ** 2)
    return strength * (math.exp(-0.5 * (away / width) ** 2) - shift) / (1.0 - shift)


@numba.njit(cache=True, nogil=True)
def clearances(
    points: np.ndarray, point_radii: np.ndarray, centres: np.ndarray, radii: np.ndarray, within: float
) -> np.ndarray:
    """Smallest surface-to-surface distance [m] from each row of body points (n, K, 3) to any obstacle, (n,).

    Negative inside; inf where no obstacle is nearer than `within` [m].
    """
    result = np.full(len(points), np.inf)
    for o in range(len(radii)):
        for k in range(points.shape[1]):
            both = radii[o] + point_radii[k]
            reach = (both + within) ** 2
            for i in range(len(points)):
                dx = points[i, k, 0] - centres[o, 0]
                dy = points[i, k, 1] - centres[o, 1]
                dz = points[i, k, 2] - centres[o, 2]
                squared = dx * dx + dy * dy + dz * dz
                if squared < reach:
                    result[i] = min(result[i], math.sqrt(squared) - both)
    return result


def obstacle_clearances(points: np.ndarray, point_radii: np.ndarray, obstacles: Obstacles, within: float) -> np.ndarray:
    """`clearances` from obstacles of every kind."""
    result = clearances(points, point_radii, obstacles.centres, obstacles.radii, within)
    if len(obstacles.solids):
        distances = solid_distances(points.reshape(-1, 3), obstacles.solids).reshape(points.shape[:2])
        result = np.minimum(result, (distances - point_radii).min(axis=1))
    if obstacles.cloud.squares.size:
        distances = field_distances(points.reshape(-1, 3), *obstacles.cloud).reshape(points.shape[:2])
        result = np.minimum(result, (distances - point_radii).min(axis=1))
    return np.where(result < within, result, np.inf)
