"""Clearance of an arm in one configuration from obstacles: a robot knows nothing of its scene, so this stands here."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.geometry.distance_field import field_distances
from geodesic_motion_ros.geometry.shapes import solid_distances
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot


def configuration_clearance(
    model: CollisionModel, robot: Robot, configuration: np.ndarray, centres: np.ndarray, radii: np.ndarray
) -> tuple[float, int]:
    """Return the signed distance [m] of the moving spheres from obstacles, and the sphere that is nearest to one.

    Parameters
    ----------
    configuration : (eta,) [rad].
    centres, radii : (o, 3), (o,) spherical obstacles [m], base frame.

    Without obstacles (inf, -1).
    """
    return obstacle_clearance(model, robot, configuration, Obstacles.of_spheres(centres, radii))


def overlap(model: CollisionModel, robot: Robot, configuration: np.ndarray, obstacles: Obstacles) -> tuple[float, str]:
    """Return the clearance [m] of a configuration (eta,) [rad] from obstacles; and which link overlaps which one, ""
    where none does.
    """
    clearance, sphere = obstacle_clearance(model, robot, configuration, obstacles)
    if clearance > 0.0:
        return clearance, ""
    name = nearest_obstacle(model, robot, configuration, obstacles)
    return clearance, f"'{model.link_of(sphere)}' overlaps {name} by {-1000 * clearance:.0f} mm"


def nearest_obstacle(model: CollisionModel, robot: Robot, configuration: np.ndarray, obstacles: Obstacles) -> str:
    """Name the obstacle that is nearest to the moving spheres in a configuration (eta,) [rad]; one without a name by
    where it is.
    """
    placed, radii = model.positions(robot, configuration[None])[0, model.moving], model.radii[model.moving]
    gaps = np.linalg.norm(placed[:, None] - obstacles.centres, axis=-1) - obstacles.radii - radii[:, None]
    names = [
        (obstacles.names, "the sphere", obstacles.centres, gaps.min(axis=0, initial=np.inf)),
        (
            obstacles.solid_names, "the solid", obstacles.solids[:, :3],
            [np.min(solid_distances(placed, row[None]) - radii) for row in obstacles.solids],
        ),
    ]  # fmt: skip
    found = [
        (distance, named[i] if named else f"{kind} at {np.round(centres[i], 3).tolist()} m")
        for named, kind, centres, distances in names
        for i, distance in enumerate(distances)
    ]
    if obstacles.cloud.squares.size:
        distance = np.min(field_distances(placed, *obstacles.cloud) - radii)
        found.append((distance, obstacles.cloud_name or "the point cloud"))
    return min(found)[1]


def obstacle_clearance(
    model: CollisionModel, robot: Robot, configuration: np.ndarray, obstacles: Obstacles
) -> tuple[float, int]:
    """Return `configuration_clearance` from obstacles of every kind."""
    placed = model.positions(robot, configuration[None])[0, model.moving]
    distances = np.full(len(placed), np.inf)
    if len(obstacles.radii):
        gaps = np.linalg.norm(placed[:, None] - obstacles.centres, axis=-1) - obstacles.radii
        distances = gaps.min(axis=1)
    if len(obstacles.solids):
        distances = np.minimum(distances, solid_distances(placed, obstacles.solids))
    if obstacles.cloud.squares.size:
        distances = np.minimum(distances, field_distances(placed, *obstacles.cloud))
    distances -= model.radii[model.moving]
    nearest = int(np.argmin(distances))
    if distances[nearest] == np.inf:
        return np.inf, -1
    return float(distances[nearest]), int(np.flatnonzero(model.moving)[nearest])
