"""ArmInScene: how far an arm in a configuration is from obstacles that stand, for searches in compiled code."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.certification.seen_volume import SeenVolume, is_inside
from geodesic_motion_ros.geometry.distance_field import field_distance
from geodesic_motion_ros.geometry.shapes import solid_distance
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.body_points import joint_terms, mounted, place_joints
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Chain, Robot


class ArmInScene(NamedTuple):
    """An arm of eta joints, covered by S spheres, among obstacles; compiled kernels read it.

    Attributes
    ----------
    chain : of the `Robot`; lower, upper : (eta,) limits [rad].
    terms, translations, slides : of `body_points.joint_terms`.
    joints, points : (S,), (S, 3) of `body_points.mounted`; radii : (S,) [m].
    moving : (k,) numbers of the spheres that are kept from obstacles; pairs : (P, 2) of those kept from each other.
    centres, obstacle_radii, solids, squares, placing : of `Obstacles`, at the places where they are.
    seen : where the moving spheres may be.
    """

    chain: Chain
    lower: np.ndarray
    upper: np.ndarray
    terms: np.ndarray
    translations: np.ndarray
    slides: np.ndarray
    joints: np.ndarray
    points: np.ndarray
    radii: np.ndarray
    moving: np.ndarray
    pairs: np.ndarray
    centres: np.ndarray
    obstacle_radii: np.ndarray
    solids: np.ndarray
    squares: np.ndarray
    placing: np.ndarray
    seen: SeenVolume

    @classmethod
    def of(
        cls, robot: Robot, collision: CollisionModel, obstacles: Obstacles, seen: SeenVolume | None = None
    ) -> ArmInScene:
        """Return the arm of a robot; obstacles are taken to stand where they are. seen : None: everything is."""
        terms, translations, slides, mounts, mount_origins, carriers = joint_terms(robot.chain)
        body = collision.points
        joints, points = mounted(body.frames, body.offsets, mounts, mount_origins, carriers)
        return cls(
            robot.chain, robot.lower, robot.upper, terms, translations, slides, joints, points, collision.radii,
            np.flatnonzero(collision.moving), collision.self_pairs, np.ascontiguousarray(obstacles.centres),
            np.ascontiguousarray(obstacles.radii), np.ascontiguousarray(obstacles.solids), *obstacles.cloud,
            seen or SeenVolume.unbounded(),
        )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def distance_from_obstacles(x: float, y: float, z: float, arm: ArmInScene) -> float:
    """Return the distance [m] of a point from the nearest obstacle, negative inside; inf without any."""
    centres, radii, solids, squares, placing = arm.centres, arm.obstacle_radii, arm.solids, arm.squares, arm.placing
    nearest = math.inf
    for o in range(len(radii)):
        dx, dy, dz = x - centres[o, 0], y - centres[o, 1], z - centres[o, 2]
        nearest = min(nearest, math.sqrt(dx * dx + dy * dy + dz * dz) - radii[o])
    for b in range(len(solids)):
        nearest = min(nearest, solid_distance(x, y, z, solids, b))
    if squares.size > 0:
        nearest = min(nearest, field_distance(x, y, z, squares, placing))
    return nearest


@numba.njit(cache=True, nogil=True)
def place_spheres(q: np.ndarray, arm: ArmInScene) -> np.ndarray:
    """Return centres (S, 3) [m] of the arm's spheres in a configuration (eta,)."""
    joints, points = arm.joints, arm.points
    rotations, origins = np.zeros((len(q) + 1, 3, 3)), np.zeros((len(q) + 1, 3))
    for a in range(3):
        rotations[0, a, a] = 1.0
    place_joints(q, arm.terms, arm.translations, arm.slides, rotations, origins)
    placed = np.empty((len(joints), 3))
    for s in range(len(joints)):
        j = joints[s]
        for a in range(3):
            placed[s, a] = (
                origins[j, a] + rotations[j, a, 0] * points[s, 0] + rotations[j, a, 1] * points[s, 1]
                + rotations[j, a, 2] * points[s, 2]
            )  # fmt: skip
    return placed


@numba.njit(cache=True, nogil=True)
def clearance_at(q: np.ndarray, arm: ArmInScene, within: float) -> float:
    """Return the clearance [m] of the arm in a configuration (eta,), no more than `within`; -inf where a joint is
    outside its limits, the arm touches itself, or not all of it is in what is seen.
    """
    lower, upper, radii, pairs = arm.lower, arm.upper, arm.radii, arm.pairs
    for j in range(len(q)):
        if not lower[j] <= q[j] <= upper[j]:
            return -math.inf
    placed = place_spheres(q, arm)
    for p in range(len(pairs)):
        one, other = pairs[p, 0], pairs[p, 1]
        dx, dy = placed[one, 0] - placed[other, 0], placed[one, 1] - placed[other, 1]
        dz = placed[one, 2] - placed[other, 2]
        if dx * dx + dy * dy + dz * dz <= (radii[one] + radii[other]) ** 2:
            return -math.inf
    nearest = within
    for s in arm.moving:
        nearest = min(nearest, distance_from_obstacles(placed[s, 0], placed[s, 1], placed[s, 2], arm) - radii[s])
    if not arm.seen.everything and not is_inside(placed, 0.0, 0.0, 0.0, radii, arm.moving, arm.seen):
        return -math.inf
    return nearest
