"""Clearances of moving spheres: from obstacles that move as well, and from each other, between knots too.

Between two knots a sphere's centre moves along a straight segment, but for a bulge: a bound of what it leaves it by.
Straight segments have exact distances from spheres, also relative to one that itself moves linearly, and distances from
solids and clouds that are a millimetre too small at most.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.geometry.distance_field import field_approach
from geodesic_motion_ros.geometry.shapes import bounding_radii, solid_approach
from geodesic_motion_ros.obstacles.obstacles import Obstacles

#: Pairs of spheres are compared over so many intervals between knots at once.
_BLOCK = 16


def clearances_in_motion(
    times: np.ndarray,
    placed: np.ndarray,
    bulges: np.ndarray,
    radii: np.ndarray,
    spheres: np.ndarray,
    obstacles: Obstacles,
    horizon: float,
) -> tuple[np.ndarray, np.ndarray]:
    """`sphere_clearances` from obstacles of every kind, which are where they are at time 0."""
    clearance, nearest = sphere_clearances(
        times, placed, bulges, radii, spheres, obstacles.centres, obstacles.radii, obstacles.velocities,
        obstacles.velocity_errors, horizon,
    )  # fmt: skip
    if len(obstacles.solids):
        lower_by_solids(
            times, placed, bulges, radii, spheres, obstacles.solids, bounding_radii(obstacles.solids),
            obstacles.solid_velocities, obstacles.solid_velocity_errors, horizon, clearance, nearest,
        )  # fmt: skip
    if obstacles.cloud.squares.size:
        lower_by_cloud(placed, bulges, radii, spheres, *obstacles.cloud, clearance, nearest)
    return clearance, nearest


def clearances_until(
    times: np.ndarray,
    placed: np.ndarray,
    bulges: np.ndarray,
    radii: np.ndarray,
    spheres: np.ndarray,
    obstacles: Obstacles,
    horizon: float,
) -> tuple[np.ndarray, np.ndarray]:
    """`clearances_in_motion` where what moves is not counted after the horizon; until then spheres that have come to
    rest stand there, and what is nearer then counts in the last interval.
    """
    clearance, nearest = clearances_in_motion(times, placed, bulges, radii, spheres, obstacles.static_subset, horizon)
    if times[-1] < horizon:
        times, placed = np.append(times, horizon), np.concatenate([placed, placed[-1:]])
        bulges = np.concatenate([bulges, np.zeros_like(bulges[-1:])])
    knots = max(2, int(np.searchsorted(times, horizon)) + 1)
    moving, by = clearances_in_motion(
        times[:knots], placed[:knots], bulges[: knots - 1], radii, spheres, obstacles.moving_subset, horizon
    )
    if len(moving) > len(clearance):
        last = len(moving) - 1 if moving[-1] < moving[-2] else len(moving) - 2
        moving, by = np.append(moving[:-2], moving[last]), np.append(by[:-2], by[last])
    nearer = np.flatnonzero(moving < clearance[: len(moving)])
    clearance[nearer], nearest[nearer] = moving[nearer], by[nearer]
    return clearance, nearest


@numba.njit(cache=True, nogil=True)
def _distance(point: np.ndarray, other: np.ndarray) -> float:
    dx, dy, dz = other[0] - point[0], other[1] - point[1], other[2] - point[2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@numba.njit(cache=True, nogil=True)
def _closest_approach(begin: np.ndarray, end: np.ndarray, other_begin: np.ndarray, other_end: np.ndarray) -> float:
    """Smallest distance of two points (3,) that move in the same time, each at constant velocity, from begin to end."""
    x, y, z = begin[0] - other_begin[0], begin[1] - other_begin[1], begin[2] - other_begin[2]
    dx, dy, dz = end[0] - other_end[0] - x, end[1] - other_end[1] - y, end[2] - other_end[2] - z
    squared, along = dx * dx + dy * dy + dz * dz, -(x * dx + y * dy + z * dz)
    share = 0.0 if along <= 0.0 or squared == 0.0 else min(1.0, along / squared)
    x, y, z = x + share * dx, y + share * dy, z + share * dz
    return math.sqrt(x * x + y * y + z * z)


@numba.njit(cache=True, nogil=True)
def sphere_clearances(
    times: np.ndarray,
    placed: np.ndarray,
    bulges: np.ndarray,
    radii: np.ndarray,
    spheres: np.ndarray,
    centres: np.ndarray,
    obstacle_radii: np.ndarray,
    obstacle_velocities: np.ndarray,
    velocity_errors: np.ndarray,
    horizon: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Guaranteed clearance [m] from obstacles between knots, (n - 1,), and the sphere that has it, (n - 1,).

    Parameters
    ----------
    times : (n,) of the knots [s]. placed : (n, S, 3) sphere centres [m] at the knots.
    bulges : (n - 1, S) how far [m] centres may leave the segments between knots.
    radii : (S,) [m]. spheres : numbers (k,) of those that are checked.
    centres, obstacle_radii, obstacle_velocities : (o, 3) [m], (o,) [m], (o, 3) [m/s] at time 0.
    velocity_errors : (o,) how far the velocities may be off [m/s]: obstacles grow so fast.
    horizon : obstacles move linearly for this long [s] and then stand: predictions are not trusted for longer.

    Without obstacles, or without spheres, the clearance is inf and the sphere -1.
    """
    intervals, obstacles = len(times) - 1, len(obstacle_radii)
    clearances, worst = np.full(intervals, np.inf), np.full(intervals, -1)
    if obstacles == 0 or len(spheres) == 0:
        return clearances, worst
    begins, ends = np.empty((obstacles, 3)), np.empty((obstacles, 3))
    middles, squared = np.empty((3, obstacles)), np.empty(obstacles)
    reaches, bounds = np.empty(obstacles), np.empty(obstacles)
    sphere, obstacle = spheres[0], 0
    for i in range(intervals):
        first, last = min(times[i], horizon), min(times[i + 1], horizon)
        # An obstacle that stops within the interval is this much, in seconds of its motion, off its straight segment.
        turn = (last - first) * (times[i + 1] - last) / (times[i + 1] - times[i])
        for o in range(obstacles):
            speed = 0.0
            for k in range(3):
                begins[o, k] = centres[o, k] + first * obstacle_velocities[o, k]
                ends[o, k] = centres[o, k] + last * obstacle_velocities[o, k]
                middles[k, o] = 0.5 * (begins[o, k] + ends[o, k])
                speed += obstacle_velocities[o, k] ** 2
            speed = math.sqrt(speed)
            reaches[o] = obstacle_radii[o] + turn * speed + max(0.0, last) * velocity_errors[o]
            bounds[o] = reaches[o] + 0.5 * (last - first) * speed
        # The pair that was nearest before is likely to be near: most others are then left out by their middles.
        best = _closest_approach(placed[i, sphere], placed[i + 1, sphere], begins[obstacle], ends[obstacle])
        best -= bulges[i, sphere] + radii[sphere] + reaches[obstacle]
        for s in spheres:
            begin, end = placed[i, s], placed[i + 1, s]
            inside = radii[s] + bulges[i, s]
            bound = inside + 0.5 * _distance(begin, end)
            x, y, z = 0.5 * (begin[0] + end[0]), 0.5 * (begin[1] + end[1]), 0.5 * (begin[2] + end[2])
            # In a loop of its own, which is compiled to vector instructions.
            for o in range(obstacles):
                dx, dy, dz = middles[0, o] - x, middles[1, o] - y, middles[2, o] - z
                squared[o] = dx * dx + dy * dy + dz * dz
            for o in range(obstacles):
                far = best + bound + bounds[o]
                if squared[o] > far * far:
                    continue
                clearance = _closest_approach(begin, end, begins[o], ends[o]) - inside - reaches[o]
                if clearance < best:
                    best, sphere, obstacle = clearance, s, o
        clearances[i], worst[i] = best, sphere
    return clearances, worst


@numba.njit(cache=True, nogil=True)
def lower_by_solids(
    times: np.ndarray,
    placed: np.ndarray,
    bulges: np.ndarray,
    radii: np.ndarray,
    spheres: np.ndarray,
    solids: np.ndarray,
    sizes: np.ndarray,
    solid_velocities: np.ndarray,
    velocity_errors: np.ndarray,
    horizon: float,
    clearances: np.ndarray,
    worst: np.ndarray,
) -> None:
    """Take account of solids (b, 16), with velocities (b, 3) and what these may be off (b,) [m/s], in what
    `sphere_clearances` has returned.

    sizes : (b,) radii of spheres around the solids [m]; the rest as in `sphere_clearances`.
    """
    count = len(spheres)
    if count == 0:
        return
    begin, end = np.empty(3), np.empty(3)
    middles, reaches = np.empty((count, 3)), np.empty(count)
    nearest, nearest_solid = 0, 0
    for i in range(len(times) - 1):
        first, last = min(times[i], horizon), min(times[i + 1], horizon)
        turn = (last - first) * (times[i + 1] - last) / (times[i + 1] - times[i])
        for n in range(count):
            s = spheres[n]
            length = 0.0
            for k in range(3):
                middles[n, k] = 0.5 * (placed[i, s, k] + placed[i + 1, s, k])
                length += (placed[i + 1, s, k] - placed[i, s, k]) ** 2
            reaches[n] = radii[s] + bulges[i, s] + 0.5 * math.sqrt(length)
        # As in `sphere_clearances`, the pair that was nearest before comes first.
        for b in range(-1, len(solids)):
            solid = nearest_solid if b < 0 else b
            vx, vy, vz = solid_velocities[solid, 0], solid_velocities[solid, 1], solid_velocities[solid, 2]
            speed, middle_time = math.sqrt(vx * vx + vy * vy + vz * vz), 0.5 * (first + last)
            x, y, z = (
                solids[solid, 0] + middle_time * vx,
                solids[solid, 1] + middle_time * vy,
                solids[solid, 2] + middle_time * vz,
            )
            off = turn * speed + max(0.0, last) * velocity_errors[solid]
            bound = sizes[solid] + off + 0.5 * (last - first) * speed
            for n in range(nearest if b < 0 else 0, nearest + 1 if b < 0 else count):
                dx, dy, dz = middles[n, 0] - x, middles[n, 1] - y, middles[n, 2] - z
                far = clearances[i] + reaches[n] + bound
                if far <= 0.0 or dx * dx + dy * dy + dz * dz > far * far:
                    continue
                # The solid stands, and the sphere moves relative to it.
                s = spheres[n]
                for k in range(3):
                    begin[k] = placed[i, s, k] - first * solid_velocities[solid, k]
                    end[k] = placed[i + 1, s, k] - last * solid_velocities[solid, k]
                inside = radii[s] + bulges[i, s] + off
                clearance = solid_approach(begin, end, solids, solid, clearances[i] + inside) - inside
                if clearance < clearances[i]:
                    clearances[i], worst[i] = clearance, s
                    nearest, nearest_solid = n, solid


@numba.njit(cache=True, nogil=True)
def lower_by_cloud(
    placed: np.ndarray,
    bulges: np.ndarray,
    radii: np.ndarray,
    spheres: np.ndarray,
    squares: np.ndarray,
    placing: np.ndarray,
    clearances: np.ndarray,
    worst: np.ndarray,
) -> None:
    """Take account of a cloud, the parts of a `DistanceField`, in what `sphere_clearances` has returned.

    The cloud stands; the rest as in `sphere_clearances`.
    """
    if len(spheres) == 0:
        return
    nearest = spheres[0]
    for i in range(len(placed) - 1):
        # As in `sphere_clearances`, the sphere that was nearest before comes first.
        for n in range(-1, len(spheres)):
            sphere = nearest if n < 0 else spheres[n]
            inside = radii[sphere] + bulges[i, sphere]
            worth = clearances[i] + inside
            clearance = field_approach(placed[i, sphere], placed[i + 1, sphere], squares, placing, worth) - inside
            if clearance < clearances[i]:
                clearances[i], worst[i] = clearance, sphere
                nearest = sphere


@numba.njit(cache=True, nogil=True)
def self_clearances(
    placed: np.ndarray, bulges: np.ndarray, radii: np.ndarray, pairs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Guaranteed clearance [m] of pairs of spheres between knots, (n - 1,), and the pair that has it, (n - 1,).

    pairs : (P, 2) of spheres that are checked against each other; the rest as in `sphere_clearances`. Without pairs the
    clearance is inf and the pair -1.
    """
    intervals, spheres = len(bulges), len(radii)
    clearances, worst = np.full(intervals, np.inf), np.full(intervals, -1)
    # How far from its middle in the block each sphere comes, with its radius.
    extents, bounds = np.empty(spheres), np.empty(len(pairs))
    for begin in range(0, intervals if len(pairs) > 0 else 0, _BLOCK):
        end = min(begin + _BLOCK, intervals)
        middle = (begin + end) // 2
        for s in range(spheres):
            far, bulge = 0.0, 0.0
            for i in range(begin, end + 1):
                far = max(far, _distance(placed[i, s], placed[middle, s]))
            for i in range(begin, end):
                bulge = max(bulge, bulges[i, s])
            extents[s] = far + bulge + radii[s]
        for p in range(len(pairs)):
            a, b = pairs[p, 0], pairs[p, 1]
            bounds[p] = _distance(placed[middle, a], placed[middle, b]) - extents[a] - extents[b]
        # The pair that may be nearest is; most others cannot be nearer than it anywhere in the block.
        nearest = np.argmin(bounds)
        for i in range(begin, end):
            clearances[i] = _pair_clearance(i, pairs[nearest], placed, bulges, radii)
            worst[i] = nearest
        most = np.max(clearances[begin:end])
        for p in range(len(pairs)):
            if bounds[p] >= most:
                continue
            for i in range(begin, end):
                clearance = _pair_clearance(i, pairs[p], placed, bulges, radii)
                if clearance < clearances[i]:
                    clearances[i], worst[i] = clearance, p
    return clearances, worst


@numba.njit(cache=True, nogil=True)
def _pair_clearance(i: int, pair: np.ndarray, placed: np.ndarray, bulges: np.ndarray, radii: np.ndarray) -> float:
    a, b = pair[0], pair[1]
    distance = _closest_approach(placed[i, a], placed[i + 1, a], placed[i, b], placed[i + 1, b])
    return distance - bulges[i, a] - bulges[i, b] - radii[a] - radii[b]
