"""What a point cloud shows: the arm and the declared scene taken out of it, what moves as clusters, and what stands as
a distance field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.geometry.clusters import Cluster
from geodesic_motion_ros.geometry.distance_field import REACH, DistanceField
from geodesic_motion_ros.geometry.shapes import solid_distances
from geodesic_motion_ros.obstacles.cloud_memory import CloudMemory
from geodesic_motion_ros.obstacles.things import find_things
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.self_filter import SelfFilter

#: Of no arm.
NO_SPHERES = np.zeros((0, 3)), np.zeros(0)


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
    field : of what stands. clusters : what hangs together and is small, with spheres of a radius `around` their points
        [m] where it moves.
    points : how many count. out_of_reach, of_arm, of_scene : how many do not. remembered : of how many cubes is known
        from before.
    memory : for the next cloud. held : what the hand held.
    """

    field: DistanceField
    clusters: tuple[Cluster, ...]
    around: float
    points: int
    out_of_reach: int
    of_arm: int
    of_scene: int
    remembered: int
    memory: CloudMemory
    held: tuple[HeldObject, ...]


def see_cloud(
    points: np.ndarray,
    arm: SelfFilter,
    joints: np.ndarray | None,
    held: Sequence[HeldObject],
    solids: np.ndarray,
    settings: CloudSettings,
    time: float,
    before: SeenCloud | None,
    eye: np.ndarray | None = None,
) -> SeenCloud:
    """Read a cloud.

    Parameters
    ----------
    points : (n, 3) [m], finite, in the base frame.
    joints : (eta,) [rad] measured when it was taken; None where it does not show the arm.
    held : what the hand holds. Where it held something else before, nothing is remembered: what was an obstacle may be
        in the hand.
    solids : (b, 16) of the declared scene, which is known without a camera.
    time : when it was taken [s]. before : what the cloud before has shown.
    eye : (3,) [m] where the camera stands; None where that is unknown.
    """
    edge, held = settings.voxel, tuple(held)
    grid, spheres = arm.grid(edge, REACH), NO_SPHERES
    if joints is not None:
        centres, radii = arm.spheres(joints, held)
        spheres = centres, radii + settings.padding
    cloud = arm.sort(points, spheres, grid, eye)
    unknown = solid_distances(cloud.means, solids) > settings.padding
    places, means, spreads = cloud.places[unknown], cloud.means[unknown], cloud.spreads[unknown]

    memory = CloudMemory.nothing(edge)
    if before is not None and (before.memory.edge, before.held) == (edge, held) and before.memory.time <= time:
        memory = before.memory
    recalled = memory.recall(places, means, spreads, time, grid, cloud.sight)
    # What touches the arm may be of the arm, which hides it from the camera as long as it stays.
    of_arm = recalled.hidden & arm.touches(recalled.unseen.means, spheres, edge)
    unseen = recalled.unseen.only(~of_arm)
    things = find_things(recalled.seen, cloud.counts[unknown], unseen.only(unseen.stands), grid, memory.numbered)
    clusters = things.clusters(means, spreads, eye)

    stands = (things.of_seen >= 0) & ~things.moves[things.of_seen]
    seen = replace(recalled.seen, stands=stands, thing=things.numbers[things.of_seen])
    field = DistanceField.of_cubes(things.field_places(clusters, edge), edge, settings.radius, settings.thickness)
    return SeenCloud(
        field, clusters, settings.radius, int(np.sum(cloud.counts[unknown])),
        cloud.out_of_reach, cloud.of_arm, int(np.sum(cloud.counts[~unknown])), len(things.cubes) - len(seen),
        CloudMemory(edge, seen.beside(unseen), time, cloud.sight, things.numbered), held,
    )  # fmt: skip
