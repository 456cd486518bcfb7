"""Things: what hangs together in a cloud, and in what is remembered of clouds before, and whether it stands.

What is small becomes a cluster, of spheres, whether it moves or not: what is seen of it is taken to be as deep as it is
wide. The rest stands, cube by cube, as a table does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.geometry.clusters import Cluster, cluster_radii, hanging_together
from geodesic_motion_ros.geometry.voxels import VoxelGrid
from geodesic_motion_ros.obstacles.cloud_memory import NEW_SHARE, SELDOM, Cubes, flickering

#: What has a cube farther [m] from its middle is not small; what is of fewer cubes may be an error of the camera.
LARGEST, FEWEST_CUBES = 0.25, 4
#: So many clusters, those that move and the largest, are made of so many spheres together, and no more than that each:
#: planning takes its time for them. Powers of two.
MOST_CLUSTERS, MOST_SPHERES, MOST_PARTS = 16, 128, 32


@dataclass(frozen=True, eq=False)
class Things:
    """The things that cubes are of.

    Attributes
    ----------
    cubes : v that a cloud shows, and those that are remembered besides. of_cube : (v + u,) the number of each one's
        thing; -1 of what is noise of those beside it. of_seen : (v,) of those that the cloud shows.
    chosen : numbers of the things that become clusters. moves : (m + 1,) which things move; noise does not.
    """

    cubes: Cubes
    of_cube: np.ndarray
    of_seen: np.ndarray
    chosen: np.ndarray
    moves: np.ndarray

    def field_places(self, clusters: Sequence[Cluster], edge: float) -> np.ndarray:
        """Places (n, 3) of the cubes, with an edge [m], that are in none of the clusters made of these things; of what
        moves now, those where it was and is not any more.
        """
        in_cluster = np.isin(self.of_cube, self.chosen)
        before = np.arange(len(self.cubes)) >= len(self.of_seen)
        before &= self.moves[self.of_cube]
        moving = [one.spheres for one in clusters if not one.stands]
        if moving and np.any(before):
            spheres = np.concatenate(moving)
            gaps = np.linalg.norm(edge * self.cubes.places[before, None] - spheres[:, :3], axis=2) - spheres[:, 3]
            in_cluster[before] = np.min(gaps, axis=1) <= edge
        return self.cubes.places[(self.of_cube >= 0) & ~in_cluster]

    def clusters(self, means: np.ndarray, spreads: np.ndarray, eye: np.ndarray | None) -> tuple[Cluster, ...]:
        """Make clusters: of what moves by the means (v, 3) [m] and spreads (v, 6) [m^2] of its cubes in this cloud
        alone, of what stands by all that is known of them; eye : as of `Cluster.of`.
        """
        if not len(self.chosen):
            return ()
        most = min(MOST_PARTS, MOST_SPHERES >> int(len(self.chosen) - 1).bit_length())
        made: list[Cluster] = []
        for one in self.chosen:
            if self.moves[one]:
                own = self.of_seen == one
                made.append(Cluster.of(means[own], most, False, eye, spreads[own]))
            else:
                known = self.cubes.only(self.of_cube == one)
                made.append(Cluster.of(known.means, most, True, eye, known.spreads))
        return tuple(made)


def find_things(seen: Cubes, counts: np.ndarray, remembered: Cubes, grid: VoxelGrid) -> Things:
    """Find the things of cubes that a cloud shows, of so many points each (v,), and of those that are remembered and
    stand.

    A thing stands where the cubes that are seen of it have stood but for `NEW_SHARE`.
    """
    cubes = seen.beside(remembered)
    noise = flickering(cubes.places, grid.numbered(cubes.places), grid.first, cubes.share)
    places, means = cubes.places[~noise], cubes.means[~noise]
    of_steady, sizes = hanging_together(places, grid.numbered(places), grid.first)
    of_cube = np.full(len(cubes), -1)
    of_cube[~noise] = of_steady
    # One point by itself may be an error of the camera, until it is seen again.
    alone = (sizes == 1)[of_cube[: len(seen)]] & (counts == 1) & (seen.share < SELDOM)
    of_cube[: len(seen)][alone] = -1
    of_seen = of_cube[: len(seen)]
    count, new = (np.bincount(of[of >= 0], minlength=len(sizes)) for of in (of_seen, of_seen[~seen.stands]))
    small = (cluster_radii(means, of_steady, len(sizes)) <= LARGEST) & (sizes >= FEWEST_CUBES)
    moves = small & (new > NEW_SHARE * count)
    chosen = np.flatnonzero(small)
    chosen = chosen[np.lexsort((-sizes[chosen], ~moves[chosen]))][:MOST_CLUSTERS]
    moves &= np.isin(np.arange(len(sizes)), chosen)
    return Things(cubes, of_cube, of_seen, chosen, np.append(moves, False))
