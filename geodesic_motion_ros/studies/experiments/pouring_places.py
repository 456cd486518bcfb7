"""Where bottles and cups stand in the pouring experiments, the tool's poses there, pictures of the arm among them."""

from __future__ import annotations

import numpy as np

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
from geodesic_motion_ros.studies.experiments.posture_strip import evenly

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
