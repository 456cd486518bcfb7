"""Things: what hangs together in a cloud, and in what is remembered of clouds before, and whether it stands.

What is small becomes a cluster, of spheres, whether it moves or not: what is seen of it is taken to be as deep as it is
wide. The rest stands, cube by cube, as a table does, with what stands and touches it.

**What was apart stays apart.** A cube is of the small thing that most cubes there, or beside there, were of in the
cloud before, which has a number. Cubes of which that is not known are of what they touch. So two that meet are two all
the same, and one that falls in two is two from then on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.geometry.clusters import Cluster, cluster_radii, hanging_together
from geodesic_motion_ros.geometry.voxels import NUMBERS, PLACES, WHOLE, VoxelGrid
from geodesic_motion_ros.obstacles.cloud_memory import NEW_SHARE, SELDOM, Cubes, flickering

#: What has a cube farther [m] from its middle is not small; what is of fewer cubes may be an error of the camera.
LARGEST, FEWEST_CUBES = 0.25, 4
#: So many cubes or more, of which nothing is known, are apart from others where the means of their points are farther
#: apart than so many edges, if they are small together. Fewer, as those of a thin rod are, hang together with what they
#: touch.
APART_CUBES, GAP = 8, 1.25
#: What has parted is still the same thing if it is more than this share of its cubes.
WHOLE_SHARE = 0.75
#: So many clusters, those that move and the largest, are made of so many spheres together, and no more than that each:
#: planning takes its time for them. Powers of two.
MOST_CLUSTERS, MOST_SPHERES, MOST_PARTS = 16, 128, 32
# The thing of a cube is unknown, as of `Cubes`; the first of those that are apart.
_UNKNOWN, _APART = -1, -2


@dataclass(frozen=True, eq=False)
class Things:
    """The things that cubes are of.

    Attributes
    ----------
    cubes : v that a cloud shows, and u that are remembered besides.
    of_cube : (v + u,) which of m things each one is of; -1 of what is noise of those beside it. of_seen : (v,) of those
        that the cloud shows.
    chosen : which things become clusters. moves : (m + 1,) whether a thing moves; noise, the last one, does not.
    numbers : (m + 1,) of those that become clusters, the same in every cloud; 0 of what is large, -1 of others.
    part_of : (m,) as of `Cluster`. numbered : the highest number until now.
    """

    cubes: Cubes
    of_cube: np.ndarray
    of_seen: np.ndarray
    chosen: np.ndarray
    moves: np.ndarray
    numbers: np.ndarray
    part_of: np.ndarray
    numbered: int

    def field_places(self, clusters: Sequence[Cluster], edge: float) -> np.ndarray:
        """Find the places (n, 3) of cubes, with an edge [m], that are in none of the clusters made of these things; of
        what moves now, those where it was and is not any more.
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
        """Make clusters: of the means (v, 3) [m] and spreads (v, 6) [m^2] of cubes in this cloud alone; what stands is
        covered by all that is known of it; eye : as of `Cluster.of`.
        """
        if not len(self.chosen):
            return ()
        most = min(MOST_PARTS, MOST_SPHERES >> int(len(self.chosen) - 1).bit_length())
        made: list[Cluster] = []
        for one in self.chosen:
            own, known = self.of_seen == one, None
            if not self.moves[one]:
                all_of = self.cubes.only(self.of_cube == one)
                known = all_of.means, all_of.spreads
            points, around = (means[own], spreads[own]) if np.any(own) or known is None else known
            cluster = Cluster.of(points, most, eye, around, known)
            made.append(cluster._replace(number=int(self.numbers[one]), part_of=int(self.part_of[one])))
        return tuple(made)


def find_things(seen: Cubes, counts: np.ndarray, remembered: Cubes, grid: VoxelGrid, numbered: int) -> Things:
    """Find the things of cubes that a cloud shows, of so many points each (v,), and of those that are remembered and
    stand.

    A thing stands where the cubes that are seen of it have stood but for `NEW_SHARE`.

    numbered : the highest number of a thing in the clouds before.
    """
    cubes = seen.beside(remembered)
    noise = flickering(cubes.places, grid.numbered(cubes.places), grid.first, cubes.share)
    places, means = cubes.places[~noise], cubes.means[~noise]
    in_grid, first = grid.numbered(places), grid.first
    before = _things_before(cubes.thing[~noise], places, means, in_grid, grid)
    of_steady, sizes = hanging_together(places, in_grid, first, before, means, np.inf)
    of_cube = np.full(len(cubes), -1)
    of_cube[~noise] = of_steady
    # One point by itself may be an error of the camera, until it is seen again.
    alone = (sizes == 1)[of_cube[: len(seen)]] & (counts == 1) & (seen.share < SELDOM)
    of_cube[: len(seen)][alone] = -1
    of_seen = of_cube[: len(seen)]
    count, new = (np.bincount(of[of >= 0], minlength=len(sizes)) for of in (of_seen, of_seen[~seen.stands]))
    large = cluster_radii(means, of_steady, len(sizes)) > LARGEST
    small = ~large & (sizes >= FEWEST_CUBES)
    moves = small & (new > NEW_SHARE * count)
    # What stands and touches what is large is of it.
    large |= ~moves & _touching(places, in_grid, first, of_steady, large)
    chosen = np.flatnonzero(small & ~large)
    chosen = chosen[np.lexsort((-sizes[chosen], ~moves[chosen]))][:MOST_CLUSTERS]
    is_chosen = np.isin(np.arange(len(sizes)), chosen)
    moves &= is_chosen
    part_of = np.zeros(len(sizes), dtype=np.int64)
    part_of[of_steady] = np.maximum(before, 0)
    numbers, numbered = _numbers(is_chosen, sizes, part_of, numbered)
    numbers = np.append(np.where(is_chosen, numbers, np.where(large, 0, -1)), -1)
    return Things(cubes, of_cube, of_seen, chosen, np.append(moves, False), numbers, part_of, numbered)


def _things_before(
    known: np.ndarray, places: np.ndarray, means: np.ndarray, in_grid: np.ndarray, grid: VoxelGrid
) -> np.ndarray:
    """Tell the things (v,), as of `Cubes`, of cubes at places (v, 3): what is known, else that of what they touch. The
    others are apart (`APART_CUBES`, `GAP`), with negative numbers.

    means : (v, 3) [m]. in_grid : as of `hanging_together`.
    """
    things = known.copy()
    _spread(places, in_grid, grid.first, things)
    unknown = things == _UNKNOWN
    if np.any(unknown):
        others, of_others = np.ascontiguousarray(places[unknown]), np.ascontiguousarray(means[unknown])
        numbers, kinds = grid.numbered(others), np.zeros(len(others), dtype=np.int64)
        wholes, sizes = hanging_together(others, numbers, grid.first, kinds, of_others, np.inf)
        # What is large, as a table is, may be of points that are few.
        large = cluster_radii(of_others, wholes, len(sizes)) > LARGEST
        pieces, sizes = hanging_together(others, numbers, grid.first, kinds, of_others, GAP * grid.edge)
        apart = (sizes[pieces] >= APART_CUBES) & ~large[wholes]
        things[unknown] = np.where(apart, _APART - pieces, _UNKNOWN)
        _spread(places, in_grid, grid.first, things)
    return things


def _numbers(chosen: np.ndarray, sizes: np.ndarray, part_of: np.ndarray, numbered: int) -> tuple[np.ndarray, int]:
    """Number chosen ones of things (m,): what is one thing, or all of it but for little, keeps its number."""
    whole = np.bincount(part_of, sizes, minlength=numbered + 1)
    same = chosen & (part_of > 0) & (sizes > WHOLE_SHARE * whole[part_of])
    new = chosen & ~same
    numbers = np.where(same, part_of, 0)
    numbers[new] = numbered + 1 + np.arange(np.sum(new))
    return numbers, numbered + int(np.sum(new))


@numba.njit((PLACES, NUMBERS, WHOLE, WHOLE), cache=True, nogil=True)
def _spread(places: np.ndarray, cubes: np.ndarray, first: np.ndarray, thing: np.ndarray) -> None:
    """Write things (v,), as of `Cubes`, of cubes where they are known into those that hang together with them."""
    waiting = np.empty(len(places), dtype=np.int64)
    queued = 0
    for n in range(len(places)):
        if thing[n] != _UNKNOWN:
            waiting[queued] = n
            queued += 1
    at = 0
    while at < queued:
        cube = waiting[at]
        at += 1
        i, j, k = places[cube, 0] - first[0], places[cube, 1] - first[1], places[cube, 2] - first[2]
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                for c in range(k - 1, k + 2):
                    other = cubes[a, b, c] - 1
                    if other >= 0 and thing[other] == _UNKNOWN:
                        thing[other] = thing[cube]
                        waiting[queued] = other
                        queued += 1


@numba.njit((PLACES, NUMBERS, WHOLE, WHOLE, numba.boolean[::1]), cache=True, nogil=True)
def _touching(
    places: np.ndarray, cubes: np.ndarray, first: np.ndarray, of_cube: np.ndarray, large: np.ndarray
) -> np.ndarray:
    """Tell which things (m,) have a cube beside one of a large thing."""
    touching = np.zeros(len(large), dtype=np.bool_)
    for n in range(len(places)):
        i, j, k = places[n, 0] - first[0], places[n, 1] - first[1], places[n, 2] - first[2]
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                for c in range(k - 1, k + 2):
                    other = cubes[a, b, c] - 1
                    if other >= 0 and large[of_cube[other]]:
                        touching[of_cube[n]] = True
    return touching
