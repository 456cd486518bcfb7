"""The cheapest path through the coordinates of a `DetourFrame` that keeps the whole arm clear.

On a lattice over progress, displacement and swivel the search is a lazy A*: what a node costs is worked out where it is
first taken from the queue (inverse kinematics from the node before, limits, self-collision, clearance, and the middle
of the edge), so that a path without obstacles evaluates no more nodes than it has. Progress does not decrease.

The heuristic is the cost that the *hand alone* would have without obstacles to the rest of the arm, from every progress
and displacement to the goal: what is fixed behind the last joint moves with the displacement, whatever the arm does, so
that this needs no inverse kinematics. It is a lower bound, as the arm is never clearer than its hand; and where it is
infinite, the hand cannot pass.

Near obstacles an edge costs more by the mean of the factors at both ends, 1 + 4 max(0, 1 - c / c_0)^2 at a clearance c.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.certification.arm_in_scene import (
    ArmInScene,
    clearance_at,
    distance_from_obstacles,
    place_spheres,
)
from geodesic_motion_ros.certification.seen_volume import is_inside
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.detours.detour_frame import DetourFrame
from geodesic_motion_ros.manifold.heap import TAKEN, WAITING, put, take
from geodesic_motion_ros.queries.posture import solve_displaced

#: A node is given up once this many neighbours do not reach it.
_MOST_REFUSALS = 8
#: Of costs.
_ROUNDING = 1e-12


class Lattice(NamedTuple):
    """Progress, displacements and swivels that a search steps through; compiled kernels read it.

    Attributes
    ----------
    samples : of progress. side : displacements along each axis, an odd number; spacing : between two of them [m].
    reach : longer displacements are none [m]. swivels : an odd number; swivel_spacing : between two of them [rad].
    moves : (k, 5) steps from a node to its neighbours: progress, x, y, z, swivel.
    """

    samples: int
    side: int
    spacing: float
    reach: float
    swivels: int
    swivel_spacing: float
    moves: np.ndarray

    @classmethod
    def of(cls, samples: int, reach: float, redundant: bool) -> Lattice:
        """Return the lattice over displacements up to a reach [m]; redundant : whether the arm has a swivel."""
        half = max(2, math.ceil(reach / constants.DETOUR_LATTICE_SPACING - 1e-9))
        swivels = 2 * constants.DETOUR_SWIVELS + 1 if redundant else 1
        around = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
        moves = [(ahead, *by, 0) for ahead in (0, 1) for by in around if ahead or any(by)]
        if redundant:
            moves += [(ahead, 0, 0, 0, turn) for ahead in (0, 1) for turn in (-1, 1)]
        return cls(
            samples, 2 * half + 1, reach / half, reach, swivels, constants.DETOUR_SWIVEL_SPACING,
            np.array(moves, dtype=np.int64),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class LatticePath:
    """A path of p nodes of a lattice.

    Attributes
    ----------
    samples : (p,) numbers of the frame's samples. displacements : (p, 3) [m]. swivels : (p,) [rad].
    configurations : (p, eta) [rad]. cost : of the path. evaluated : how many nodes were.
    """

    samples: np.ndarray
    displacements: np.ndarray
    swivels: np.ndarray
    configurations: np.ndarray
    cost: float
    evaluated: int


def cheapest_detour(frame: DetourFrame, arm: ArmInScene, reach: float, margin: float) -> LatticePath | Refusal:
    """Return the cheapest path along a frame from its start to its end with displacements up to `reach` [m] and a
    clearance of `margin` [m] at least; or why there is none: the hand cannot pass, or the arm cannot.
    """
    joints = frame.configurations.shape[1]
    lattice = Lattice.of(len(frame), reach, joints > 6)
    hand = np.flatnonzero(arm.joints[arm.moving] == joints)
    factors = _hand_factors(frame.configurations, arm, arm.moving[hand], lattice, margin)
    to_goal = _hand_field(frame.precisions, frame.step, factors, lattice)
    middle = lattice.side // 2
    if not math.isfinite(to_goal[0, middle, middle, middle]):
        return Refusal(VerdictCode.NO_FEASIBLE_PATH, "the hand cannot pass")
    nodes, configurations, cost, evaluated = _search(
        frame.positions, frame.quaternions, frame.configurations, frame.nulls, frame.precisions, frame.step, arm,
        factors, to_goal, lattice, margin,
    )  # fmt: skip
    if len(nodes) == 0:
        return Refusal(VerdictCode.NO_FEASIBLE_PATH, "the arm cannot pass")
    return LatticePath(
        nodes[:, 0], lattice.spacing * (nodes[:, 1:4] - middle),
        lattice.swivel_spacing * (nodes[:, 4] - lattice.swivels // 2), configurations, cost, int(evaluated),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def nearness_factor(clearance: float) -> float:
    """Return m, by how much a path is dearer at a clearance [m]; inside of obstacles no more than at a certain depth.
    """
    near = min(max(0.0, 1.0 - clearance / constants.DETOUR_FELT_CLEARANCE), 2.0)
    return 1.0 + constants.DETOUR_NEARNESS_STRENGTH * near * near


@numba.njit(cache=True, nogil=True)
def stretch(precision: np.ndarray, x: float, y: float, z: float, swivel: float) -> float:
    """Return phi at a displacement (x, y, z) [m] and a swivel [rad], for a precision (3, 3) [1/m^2]."""
    along = swivel / constants.DETOUR_SWIVEL_SPREAD
    return (
        1.0 + along * along + precision[0, 0] * x * x + precision[1, 1] * y * y + precision[2, 2] * z * z
        + 2.0 * (precision[0, 1] * x * y + precision[0, 2] * x * z + precision[1, 2] * y * z)
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _hand_factors(
    configurations: np.ndarray, arm: ArmInScene, hand: np.ndarray, lattice: Lattice, margin: float
) -> np.ndarray:
    """`nearness_factor` of the hand, whose spheres are `hand` (k,), at every progress and displacement (m, n, n, n);
    inf where it is less clear than a margin [m], not in what is seen, or beyond the lattice's reach.
    """
    side, middle, spacing = lattice.side, lattice.side // 2, lattice.spacing
    factors = np.full((lattice.samples, side, side, side), np.inf)
    radii, seen = arm.radii, arm.seen
    for t in range(lattice.samples):
        placed = place_spheres(configurations[t], arm)
        for i in range(side):
            x = spacing * (i - middle)
            for j in range(side):
                y = spacing * (j - middle)
                for k in range(side):
                    z = spacing * (k - middle)
                    if x * x + y * y + z * z > lattice.reach**2 * (1.0 + 1e-9):
                        continue
                    nearest = constants.DETOUR_FELT_CLEARANCE
                    for s in hand:
                        distance = distance_from_obstacles(placed[s, 0] + x, placed[s, 1] + y, placed[s, 2] + z, arm)
                        nearest = min(nearest, distance - radii[s])
                    if nearest >= margin and (seen.everything or is_inside(placed, x, y, z, radii, hand, seen)):
                        factors[t, i, j, k] = nearness_factor(nearest)
    return factors


@numba.njit(cache=True, nogil=True)
def _hand_field(precisions: np.ndarray, step: float, factors: np.ndarray, lattice: Lattice) -> np.ndarray:
    """Cost (m, n, n, n) from every progress and displacement of the hand to the goal, inf where it cannot pass:
    Dijkstra's algorithm from the goal, against the moves.
    """
    samples, side, middle, moves = lattice.samples, lattice.side, lattice.side // 2, lattice.moves
    cube = side**3
    count = samples * cube
    cost = np.full(count, np.inf)
    price = _optimistic_prices(precisions, factors, lattice)[lattice.swivels // 2 :: lattice.swivels]
    keys, items, place = np.empty(count), np.empty(count, dtype=np.int32), np.full(count, WAITING, dtype=np.int32)
    goal = (samples - 1) * cube + (middle * side + middle) * side + middle
    if price[goal] == np.inf:
        return cost.reshape(samples, side, side, side)
    cost[goal] = 0.0
    size = put(keys, items, place, 0, goal, 0.0)
    while size > 0:
        v = items[0]
        size = take(keys, items, place, size)
        t, i, j, k = v // cube, v // (side * side) % side, v // side % side, v % side
        for b in range(len(moves)):
            if moves[b, 4] != 0:
                continue
            s, x, y, z = t - moves[b, 0], i - moves[b, 1], j - moves[b, 2], k - moves[b, 3]
            if s < 0 or not (0 <= x < side and 0 <= y < side and 0 <= z < side):
                continue
            u = s * cube + (x * side + y) * side + z
            if place[u] == TAKEN or price[u] == np.inf:
                continue
            through = cost[v] + 0.5 * (price[u] + price[v]) * move_length(moves, b, step, lattice)
            if through < cost[u]:
                cost[u] = through
                size = put(keys, items, place, size, u, through)
    return cost.reshape(samples, side, side, side)


@numba.njit(cache=True, nogil=True)
def move_length(moves: np.ndarray, b: int, step: float, lattice: Lattice) -> float:
    """Return the length [m] of a move where phi is 1: sqrt(dl^2 + |d delta|^2 + lambda^2 de^2)."""
    ahead, spacing = step * moves[b, 0], lattice.spacing
    beside = spacing * spacing * (moves[b, 1] ** 2 + moves[b, 2] ** 2 + moves[b, 3] ** 2)
    turned = constants.DETOUR_METRES_PER_SWIVEL * lattice.swivel_spacing * moves[b, 4]
    return math.sqrt(ahead * ahead + beside + turned * turned)


@numba.njit(cache=True, nogil=True)
def _optimistic_prices(precisions: np.ndarray, factors: np.ndarray, lattice: Lattice) -> np.ndarray:
    """phi times the hand's `factors` (m, n, n, n) at every node, one after the other as of (m, n, n, n, swivels); inf
    where the hand does not pass.
    """
    samples, side, swivels, spacing = lattice.samples, lattice.side, lattice.swivels, lattice.spacing
    middle, upright = side // 2, swivels // 2
    prices = np.full((samples, side, side, side, swivels), np.inf)
    for t in range(samples):
        for i in range(side):
            for j in range(side):
                for k in range(side):
                    if factors[t, i, j, k] == np.inf:
                        continue
                    x, y, z = spacing * (i - middle), spacing * (j - middle), spacing * (k - middle)
                    for e in range(swivels):
                        phi = stretch(precisions[t], x, y, z, lattice.swivel_spacing * (e - upright))
                        prices[t, i, j, k, e] = factors[t, i, j, k] * phi
    return prices.reshape(-1)


@numba.njit(cache=True, nogil=True)
def _search(
    positions: np.ndarray,
    quaternions: np.ndarray,
    postures: np.ndarray,
    nulls: np.ndarray,
    precisions: np.ndarray,
    step: float,
    arm: ArmInScene,
    factors: np.ndarray,
    to_goal: np.ndarray,
    lattice: Lattice,
    margin: float,
) -> tuple[np.ndarray, np.ndarray, float, int]:
    """The lazy A* of the module: nodes (p, 5), configurations (p, eta), the cost, and how many nodes were evaluated.

    A node that is taken from the queue was offered by the neighbour through which it seemed cheapest. Where that one
    does not lead to it, or it is dearer than it seemed, the best of those taken before offers it again: no path is
    lost.
    """
    side, swivels, moves = lattice.side, lattice.swivels, lattice.moves
    middle, upright, spacing, joints = side // 2, swivels // 2, lattice.spacing, postures.shape[1]
    lengths = np.array([move_length(moves, b, step, lattice) for b in range(len(moves))])
    strides = np.array([side**3 * swivels, side * side * swivels, side * swivels, swivels, 1])
    offsets = np.array([np.sum(moves[b] * strides) for b in range(len(moves))])
    prices, ahead = _optimistic_prices(precisions, factors, lattice), to_goal.reshape(-1)
    count = len(prices)
    cost, arrival = np.full(count, np.inf), np.full(count, -1, dtype=np.int8)
    # Which moves do not lead to a node, as bits; whether its price is known; whether the arm cannot be there.
    refused, known, dead = np.zeros(count, dtype=np.uint64), np.zeros(count, dtype=np.bool_), np.zeros(count, np.bool_)
    found, evaluated = np.empty((count, joints)), 0
    keys, items, place = np.empty(count), np.empty(count, dtype=np.int32), np.full(count, WAITING, dtype=np.int32)
    source = middle * (strides[1] + strides[2] + strides[3]) + upright
    goal = source + (lattice.samples - 1) * strides[0]
    at, displaced, q = np.empty(5, dtype=np.int64), np.empty(3), np.empty(joints)
    cost[source], known[source], found[source] = 0.0, True, postures[0]
    size = put(keys, items, place, 0, source, ahead[source // swivels])
    while size > 0:
        v = items[0]
        size = take(keys, items, place, size)
        _coordinates(v, strides, at)
        before = v - offsets[arrival[v]]
        if v != source and not (known[v] and _leads(found[before], found[v], q, arm, margin)):
            offered = known[v]
            if not offered:
                evaluated += 1
                t = at[0]
                for a in range(3):
                    displaced[a] = positions[t, a] + spacing * (at[a + 1] - middle)
                swivel = lattice.swivel_spacing * (at[4] - upright)
                q[:] = found[before]
                if solve_displaced(displaced, quaternions[t], nulls[t], postures[t], swivel, q, arm.chain):
                    clearance = clearance_at(q, arm, constants.DETOUR_FELT_CLEARANCE)
                    known[v], dead[v], found[v] = True, clearance < margin, q
                    x, y, z = spacing * (at[1] - middle), spacing * (at[2] - middle), spacing * (at[3] - middle)
                    prices[v] = nearness_factor(clearance) * stretch(precisions[t], x, y, z, swivel)
                else:
                    offered = True
            if offered:
                refused[v] |= np.uint64(1) << np.uint64(arrival[v])
                dead[v] = not known[v] and _bits(refused[v]) >= _MOST_REFUSALS
            if not dead[v]:
                place[v] = WAITING
                if _offer(v, at, moves, offsets, lengths, prices, refused, dead, place, cost, arrival, lattice):
                    size = put(keys, items, place, size, v, cost[v] + ahead[v // swivels])
            continue
        if v == goal:
            break
        for b in range(len(moves)):
            w = v + offsets[b]
            if not _inside(at, moves, b, 1, lattice) or place[w] == TAKEN or refused[w] >> np.uint64(b) & np.uint64(1):
                continue
            through = cost[v] + 0.5 * (prices[v] + prices[w]) * lengths[b]
            if through < cost[w] - _ROUNDING and ahead[w // swivels] < np.inf:
                cost[w], arrival[w] = through, b
                size = put(keys, items, place, size, w, through + ahead[w // swivels])
    if place[goal] != TAKEN or dead[goal]:
        return np.empty((0, 5), dtype=np.int64), np.empty((0, joints)), np.inf, evaluated
    nodes, configurations = _traced(source, goal, strides, offsets, arrival, found)
    return nodes, configurations, cost[goal], evaluated


@numba.njit(cache=True, nogil=True)
def _traced(
    source: int, goal: int, strides: np.ndarray, offsets: np.ndarray, arrival: np.ndarray, found: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The nodes (p, 5) from the source to the goal by the moves of arrival, and their configurations (p, eta)."""
    chain = [goal]
    while chain[-1] != source:
        chain.append(chain[-1] - offsets[arrival[chain[-1]]])
    nodes, configurations = np.empty((len(chain), 5), dtype=np.int64), np.empty((len(chain), found.shape[1]))
    for row in range(len(chain)):
        v = chain[len(chain) - 1 - row]
        _coordinates(v, strides, nodes[row])
        configurations[row] = found[v]
    return nodes, configurations


@numba.njit(cache=True, nogil=True)
def _offer(
    v: int,
    at: np.ndarray,
    moves: np.ndarray,
    offsets: np.ndarray,
    lengths: np.ndarray,
    prices: np.ndarray,
    refused: np.ndarray,
    dead: np.ndarray,
    place: np.ndarray,
    cost: np.ndarray,
    arrival: np.ndarray,
    lattice: Lattice,
) -> bool:
    """Give a node, with coordinates (5,), the cost through the best of its neighbours that were taken and may lead to
    it; whether there is one.
    """
    cost[v] = np.inf
    for b in range(len(moves)):
        u = v - offsets[b]
        if refused[v] >> np.uint64(b) & np.uint64(1) or not _inside(at, moves, b, -1, lattice):
            continue
        if place[u] != TAKEN or dead[u]:
            continue
        through = cost[u] + 0.5 * (prices[u] + prices[v]) * lengths[b]
        if through < cost[v]:
            cost[v], arrival[v] = through, b
    return cost[v] < np.inf


@numba.njit(cache=True, nogil=True)
def _coordinates(node: int, strides: np.ndarray, at: np.ndarray) -> None:
    """Write the numbers (5,) along the axes of a node."""
    for axis in range(5):
        at[axis] = node // strides[axis]
        node -= at[axis] * strides[axis]


@numba.njit(cache=True, nogil=True)
def _inside(at: np.ndarray, moves: np.ndarray, b: int, sign: int, lattice: Lattice) -> bool:
    """Whether a move from (5,), or against it where the sign is -1, stays on the lattice."""
    for axis in range(5):
        size = lattice.samples if axis == 0 else lattice.swivels if axis == 4 else lattice.side
        if not 0 <= at[axis] + sign * moves[b, axis] < size:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def _leads(q: np.ndarray, other: np.ndarray, between: np.ndarray, arm: ArmInScene, margin: float) -> bool:
    """Whether the arm can go from one configuration (eta,) to another: near by, and clear in their middle."""
    for j in range(len(q)):
        if abs(q[j] - other[j]) > constants.DETOUR_LARGEST_JOINT_STEP:
            return False
        between[j] = 0.5 * (q[j] + other[j])
    return clearance_at(between, arm, margin) >= margin


@numba.njit(cache=True, nogil=True)
def _bits(word: np.uint64) -> int:
    count = 0
    while word:
        word &= word - np.uint64(1)
        count += 1
    return count
