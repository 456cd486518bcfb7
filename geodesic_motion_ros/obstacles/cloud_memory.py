"""CloudMemory: what clouds have shown, cube by cube, so that the next one is understood.

**What stands.** A thing stands whose cubes have held points for `STOOD`, they or the ones beside them, but for a few.
One that comes out from behind something else was there before, as far as is known.

**What is not seen any more.** A cube of what does not move counts on for a `MOMENT`, and one that was seen for so long
as long as something is before it; but not any more where the camera sees through it.

**What flickers.** A cube that is seen seldom, beside one that is seen often, is noise of the surface in that one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.geometry.line_of_sight import LineOfSight
from geodesic_motion_ros.geometry.point_clouds import MOMENT, POINTS, VECTOR
from geodesic_motion_ros.geometry.voxels import NUMBERS, PLACES, WHOLE, VoxelGrid

#: What has held points for so long [s] stands, but for this share of its cubes: at 4 cm/s it moves by four cubes. What
#: has moved stands after so long [s].
STOOD, NEW_SHARE, STOPPED = 2.0, 0.1, 3.0
#: Over so long [s] places and shares of cubes are averaged; a cube that is seen in less than the first share of the
#: clouds, beside one that is seen in more than the second, is noise.
AVERAGED, SELDOM, OFTEN = 0.25, 0.3, 0.6


@dataclass(frozen=True, eq=False)
class Cubes:
    """Cubes that hold points, in a grid.

    Attributes
    ----------
    places : (m, 3) in the grid. means : (m, 3) [m] of their points of late, and spreads : (m, 6) [m^2] of these around
        them, as of `SortedCloud`.
    since : (m,) from when on they have held points without a pause, as far as is known [s]. first, last : (m,) when
        they were seen to, first and last [s].
    share : (m,) of the clouds of late in which it was seen. stands : (m,) whether what was last seen there stands.
    thing : (m,) the number of the small thing that was last seen there; 0 of what is large, -1 where it is unknown.
    """

    places: np.ndarray
    means: np.ndarray
    spreads: np.ndarray
    since: np.ndarray
    first: np.ndarray
    last: np.ndarray
    share: np.ndarray
    stands: np.ndarray
    thing: np.ndarray

    @classmethod
    def none(cls) -> Cubes:
        """Make none."""
        nothing = np.zeros(0)
        numbers = nothing, nothing, nothing, nothing
        places = np.zeros((0, 3), dtype=np.int64)
        return cls(places, np.zeros((0, 3)), np.zeros((0, 6)), *numbers, nothing > 0.0, places[:, 0])

    def __len__(self) -> int:
        return len(self.places)

    def only(self, chosen: np.ndarray) -> Cubes:
        """Take some of them, by their numbers or (m,) bool."""
        return Cubes(*(values[chosen] for values in self._arrays()))

    def beside(self, others: Cubes) -> Cubes:
        """Append others."""
        return Cubes(*map(np.concatenate, zip(self._arrays(), others._arrays(), strict=True)))

    def _arrays(self) -> tuple[np.ndarray, ...]:
        return (
            self.places, self.means, self.spreads, self.since, self.first, self.last, self.share, self.stands,
            self.thing,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class CloudMemory:
    """What clouds until a time [s] have shown, in cubes of a grid with this edge [m].

    sight : what the camera saw then. numbered : the highest number of a thing until now.
    """

    edge: float
    cubes: Cubes
    time: float
    sight: LineOfSight
    numbered: int

    @classmethod
    def nothing(cls, edge: float) -> CloudMemory:
        """Make one of no cloud."""
        return cls(edge, Cubes.none(), -math.inf, LineOfSight.blank(None), 0)

    def recall(
        self,
        places: np.ndarray,
        means: np.ndarray,
        spreads: np.ndarray,
        time: float,
        grid: VoxelGrid,
        sight: LineOfSight,
    ) -> Recalled:
        """Find what is known of the cubes that a cloud shows, and which others count on.

        Parameters
        ----------
        places : (v, 3) in a grid. means : (v, 3) [m] of their points, and spreads : (v, 6) [m^2] of these around them.
        time : of the cloud [s]. sight : what the camera sees then.
        """
        known = self.cubes
        numbered = grid.numbered(known.places)
        newest = np.where(known.last == self.time, known.thing, -1)
        nearest = _most_beside(places, means, numbered, grid.first, known.means, newest, self.edge)
        thing, moved = np.full(len(places), -1), np.zeros(len(places), dtype=bool)
        near = nearest >= 0
        thing[near] = known.thing[nearest[near]]
        moved[near] = (thing[near] > 0) & ~known.stands[nearest[near]]
        before = time - np.where(moved, STOPPED, STOOD)
        rows, stood = _stood(places, numbered, grid.first, known.since, before)
        again, rows = rows >= 0, rows[rows >= 0]
        weight = min(1.0, max(0.0, time - self.time) / AVERAGED)
        since, share = np.full(len(places), -math.inf), np.full(len(places), weight)
        if time - self.time <= MOMENT:
            since[moved | ~self.sight.hides_beside(means)] = time
        since[again], share[again] = known.since[rows], known.share[rows] + weight * (1.0 - known.share[rows])
        stood |= np.isinf(since)
        late = np.column_stack([means, spreads])
        before = np.column_stack([known.means[rows], known.spreads[rows]])
        late[again] = before + weight * (late[again] - before)
        late[~stood, :3], late[~stood, 3:] = means[~stood], spreads[~stood]
        now = np.full(len(places), time)
        first = now.copy()
        first[again] = known.first[rows]
        seen = Cubes(places, late[:, :3], late[:, 3:], since, first, now, share, stood, thing)
        absent = np.ones(len(known), dtype=bool)
        absent[rows] = False
        unseen = known.only(absent & (known.last <= time) & ~sight.sees_through(known.means))
        hidden = unseen.stands & (unseen.last - unseen.first >= MOMENT) & sight.hides(unseen.means)
        unseen.share[~hidden] *= 1.0 - weight
        kept = hidden | (unseen.last >= time - MOMENT)
        return Recalled(seen, unseen.only(kept), unseen.last[kept] < time - MOMENT)


@dataclass(frozen=True, eq=False)
class Recalled:
    """What is known of the cubes of a cloud, and of others that count on.

    Attributes
    ----------
    seen : v cubes of the cloud; `stands` where they, or those beside them, have held points for `STOOD`.
    unseen : u that it does not show. hidden : (u,) whether that is for longer than a `MOMENT`.
    """

    seen: Cubes
    unseen: Cubes
    hidden: np.ndarray


@numba.njit((PLACES, NUMBERS, WHOLE, VECTOR, VECTOR), cache=True, nogil=True)
def _stood(
    places: np.ndarray, cubes: np.ndarray, first: np.ndarray, since: np.ndarray, before: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the numbers (v,) of cubes at places (v, 3), -1 for none, and whether they or those beside them are from
    before times (v,) [s]: (v,).
    """
    rows, stood = np.full(len(places), -1), np.zeros(len(places), dtype=np.bool_)
    for n in range(len(places)):
        i, j, k = places[n, 0] - first[0], places[n, 1] - first[1], places[n, 2] - first[2]
        rows[n] = cubes[i, j, k] - 1
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                for c in range(k - 1, k + 2):
                    if cubes[a, b, c] > 0 and since[cubes[a, b, c] - 1] <= before[n]:
                        stood[n] = True
    return rows, stood


@numba.njit((PLACES, POINTS, NUMBERS, WHOLE, POINTS, WHOLE, numba.float64), cache=True, nogil=True)
def _most_beside(
    places: np.ndarray,
    means: np.ndarray,
    cubes: np.ndarray,
    first: np.ndarray,
    known: np.ndarray,
    things: np.ndarray,
    edge: float,
) -> np.ndarray:
    """Find what most of the known cubes in or beside those at places (v, 3) are of, nearer ones counting more: the
    number (v,) of the nearest of known means (m, 3) [m] of that, -1 for none.

    things : (m,) as of `Cubes`; cubes of an unknown one do not count.
    """
    found, votes, near = np.full(len(places), -1), np.empty(27), np.empty(27, dtype=np.int64)
    for n in range(len(places)):
        i, j, k = places[n, 0] - first[0], places[n, 1] - first[1], places[n, 2] - first[2]
        count, nearest, alike = 0, 0, True
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                for c in range(k - 1, k + 2):
                    other = cubes[a, b, c] - 1
                    if other >= 0 and things[other] >= 0:
                        near[count] = other
                        square = edge**2
                        for axis in range(3):
                            square += (means[n, axis] - known[other, axis]) ** 2
                        votes[count] = 1.0 / square
                        nearest = count if votes[count] > votes[nearest] else nearest
                        alike = alike and things[other] == things[near[0]]
                        count += 1
        if count == 0:
            continue
        found[n] = near[nearest]
        if alike:
            continue
        most = 0.0
        for one in range(count):
            vote, is_nearest = 0.0, True
            for other in range(count):
                if things[near[other]] == things[near[one]]:
                    vote += votes[other]
                    is_nearest = is_nearest and votes[other] <= votes[one]
            if is_nearest and vote > most:
                most, found[n] = vote, near[one]
    return found


@numba.njit((PLACES, NUMBERS, WHOLE, VECTOR), cache=True, nogil=True)
def flickering(places: np.ndarray, cubes: np.ndarray, first: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Tell which cubes at places (v, 3) are seen seldom beside one that is seen often: (v,) bool.

    cubes : 1 + their numbers in a grid. first : (3,) place of its lower corner. share : (v,) as of `Cubes`.
    """
    noise = np.zeros(len(places), dtype=np.bool_)
    for n in range(len(places)):
        if share[n] >= SELDOM:
            continue
        i, j, k = places[n, 0] - first[0], places[n, 1] - first[1], places[n, 2] - first[2]
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                for c in range(k - 1, k + 2):
                    if cubes[a, b, c] > 0 and share[cubes[a, b, c] - 1] > OFTEN:
                        noise[n] = True
    return noise
