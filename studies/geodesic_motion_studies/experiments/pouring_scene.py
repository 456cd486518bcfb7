"""The pouring experiments: where bottles and cups stand, the bottle that the tool holds, pictures of the arm.

Of the bottle: spheres for the planner that hold it, and exact distances to judge paths by.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.geometry.shapes import cylinder_distances
from geodesic_motion_ros.simulation.joint_teacher import BOTTLE_PLACES, CUP_PLACES
from geodesic_motion_ros.simulation.tabletop import Cylinder, TabletopWorld, fixed_to
from geodesic_motion_ros.simulation.teacher import (
    BOTTLE_REGION,
    BOTTLE_YAW,
    CUP_REGION,
    CUP_YAW,
    Pose,
    bottle_in_hand,
    grasp_pose,
    pouring_pose,
    pouring_stands,
)
from geodesic_motion_studies.experiments.posture_strip import evenly

PLACES = range(len(BOTTLE_PLACES))


def at_bottle(bottle: int) -> Pose:
    """Tool pose that grasps a bottle in the middle of where it was shown."""
    return grasp_pose(BOTTLE_REGION.at(np.array(BOTTLE_PLACES[bottle])), float(np.mean(BOTTLE_YAW)))


def at_cup(cup: int) -> Pose:
    """Tool pose that pours into a cup in the middle of where it was shown."""
    return pouring_pose(CUP_REGION.at(np.array(CUP_PLACES[cup])), float(np.mean(CUP_YAW)))


def standing_there(bottle: int) -> list[Cylinder]:
    """The stand of one bottle, which is in the hand, and all cups with theirs."""
    bodies: list[Cylinder] = []
    for cup in CUP_PLACES:
        stands = pouring_stands(BOTTLE_REGION.at(np.array(BOTTLE_PLACES[bottle])), CUP_REGION.at(np.array(cup)))
        bodies += stands if not bodies else stands[1:]
    return bodies


def pouring_strip(
    joints: np.ndarray, bottle: int, width: int = 400, height: int = 270, postures: int = 5
) -> np.ndarray:
    """Picture, uint8: the arm with a bottle at even shares of the time of a motion (n, eta) [rad], side by side.

    A posture is (height, width, 3) pixels.
    """
    pictures = []
    with TabletopWorld() as world:
        for configuration in joints[evenly(len(joints), postures)]:
            world.reset(configuration)
            held = (fixed_to(*world.tool_pose(), part) for part in bottle_in_hand())
            world.furnish((), [*standing_there(bottle), *held])
            pictures.append(world.render(width, height, "front", oversampling=2))
    return np.concatenate(pictures, axis=1)


#: Distance of the spheres along the bottle [m].
_SPACING = 0.03
#: Radius of spheres on the bottle's path, and how deep in it they are [m].
SPHERE_RADIUS, DEPTH = 0.04, 0.01
#: Where they are, seen from the bottle: under it, and beside it.
SIDES = ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))


def bottle_settings() -> PlannerSettings:
    """Tool spheres that hold the bottle in the hand, besides the one at the tool's origin."""
    points, radii = [(0.0, 0.0, 0.0)], [PlannerSettings().tool_radii[0]]
    for part in bottle_in_hand():
        along = to_rotation(np.array(part.quaternion)).apply([0.0, 0.0, 1.0])
        count = math.ceil(part.height / _SPACING) + 1
        for place in np.linspace(-0.5, 0.5, count) * part.height:
            points.append(tuple((np.array(part.centre) + place * along).tolist()))
            # Halfway between two spheres the cylinder's surface is held just so.
            radii.append(math.hypot(part.radius, 0.5 * part.height / (count - 1)))
    return PlannerSettings(tool_points=tuple(points), tool_radii=tuple(radii))


def bottle_distance(positions: np.ndarray, quaternions: np.ndarray, centres: np.ndarray, radius: float) -> float:
    """Least signed distance [m] of the bottle from a sphere, the tool at poses (n, 3), (n, 4), the sphere at (n, 3)."""
    least = math.inf
    local = to_rotation(quaternions).inv().apply(centres - positions)
    for part in bottle_in_hand():
        seen = to_rotation(np.array(part.quaternion)).inv().apply(local - part.centre)
        least = min(least, float(np.min(cylinder_distances(seen, part.radius, part.height))))
    return least - radius


def bottle_mouth(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Where the bottle's mouth is (3,) [m], the tool at a pose (3,), (4,)."""
    neck = fixed_to(position, quaternion, bottle_in_hand()[1])
    return np.array(neck.centre) + 0.5 * neck.height * to_rotation(np.array(neck.quaternion)).apply([0.0, 0.0, 1.0])


def sphere_beside(position: np.ndarray, quaternion: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Centre (3,) of a sphere, `DEPTH` deep in the bottle from a direction (3,), the tool at a pose (3,), (4,)."""
    middle = np.array(fixed_to(position, quaternion, bottle_in_hand()[0]).centre)

    def depth(away: float) -> float:
        centre = middle + away * direction
        return -bottle_distance(position[None], quaternion[None], centre[None], SPHERE_RADIUS) - DEPTH

    return middle + brentq(depth, 0.0, 0.5) * direction
