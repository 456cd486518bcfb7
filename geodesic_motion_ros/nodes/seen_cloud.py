"""What a point cloud shows: the arm taken out of it, what may move as clusters, and the rest as a distance field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.clusters import Cluster, split_cloud
from geodesic_motion_ros.geometry.distance_field import REACH, DistanceField
from geodesic_motion_ros.geometry.point_clouds import points_within
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import FilteredCloud, Remembered, SelfFilter

#: What hangs together and is larger than such a radius [m] stands; of so many clusters, the largest, motion is looked
#: for: planning takes its time for each.
LARGEST_CLUSTER, MOST_CLUSTERS = 0.25, 16
#: The arm's body extends so far beyond the tool's origin at most [m].
_BEYOND_TOOL = 0.2


@dataclass(frozen=True)
class CloudSettings:
    """How clouds are read, with the meaning of the planner's parameters `obstacle_cloud_...` [m]; `padding` of the
    self-filter [m], with the arm's tracking error.
    """

    voxel: float
    radius: float
    thickness: float
    padding: float


@dataclass(frozen=True, eq=False)
class SeenCloud:
    """What one cloud shows.

    Attributes
    ----------
    field : of what stands. clusters : of what may move, with spheres of a radius `around` their points [m].
    points : how many count. out_of_reach, of_arm : how many do not. remembered : how many are from before.
    memory : for the next cloud.
    """

    field: DistanceField
    clusters: tuple[Cluster, ...]
    around: float
    points: int
    out_of_reach: int
    of_arm: int
    remembered: int
    memory: Remembered


def points_near(points: np.ndarray, robot: Robot) -> np.ndarray:
    """Return those of points (n, 3) [m] in the base frame to which a distance field tells distances from the arm's
    body.
    """
    return points_within(np.ascontiguousarray(points), robot.shoulder, robot.reach + _BEYOND_TOOL + REACH)


def see_cloud(
    points: np.ndarray,
    robot: Robot,
    arm: SelfFilter,
    joints: np.ndarray | None,
    held: Sequence[HeldObject],
    settings: CloudSettings,
    time: float,
    before: Remembered,
    viewpoint: np.ndarray | None = None,
) -> SeenCloud:
    """Read a cloud.

    Parameters
    ----------
    points : (n, 3) [m], finite, in the base frame.
    joints : (eta,) [rad] measured when it was taken; None where it does not show the arm.
    held : what the hand holds.
    time : when it was taken [s]. before : what the cloud before has left in memory.
    viewpoint : (3,) [m] where the camera stands; None where that is unknown.
    """
    near = points_near(points, robot)
    filtered = FilteredCloud(near, 0, 0, Remembered.nothing())
    if joints is not None:
        filtered = arm.remove(near, joints, held, settings.padding, settings.voxel, time, before)
    # What is remembered stays where it was, whatever the cluster does that it may have been of.
    new = len(filtered.points) - filtered.remembered
    split = split_cloud(filtered.points[:new], settings.voxel, LARGEST_CLUSTER, MOST_CLUSTERS, viewpoint)
    standing = np.concatenate([split.rest, filtered.points[new:]]) if filtered.remembered else split.rest
    field = DistanceField.of(standing, settings.voxel, settings.radius, settings.thickness)
    return SeenCloud(
        field, split.clusters, settings.radius, len(filtered.points), len(points) - len(near), filtered.of_arm,
        filtered.remembered, filtered.memory,
    )  # fmt: skip
