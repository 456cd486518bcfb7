"""Which parts of an arm can meet, and which of their spheres tell it: how the self-collision pairs in robot/ are made.

That two parts never meet is proved, not sampled: with joint j turned by less than h_j from a configuration where they
are a distance d apart they stay apart as long as d > sum_j l_j h_j, l_j the lever of the farthest point that joint j
moves against the other part. Boxes of joint positions for which that does not hold are halved until it does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from geodesic_motion_ros.robot.body_points import lever_bounds, place_body_points
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry, Part

SAMPLES = 2000
"""Random configurations in which parts are tested for contact, before a proof of the contrary is tried."""
BOXES = 100_000
"""How many boxes of joint positions a proof may take; parts without one are taken to meet."""
GRID_STEP = 0.02
"""Step [rad] of the grid over two joints on which sphere pairs are chosen."""


def pairs_that_can_meet(geometry: CollisionGeometry) -> list[tuple[Part, Part]]:
    """Pairs of parts, base first, that can touch within the joint limits; neighbours and rigid pairs do not count.

    Neighbours are links with one moving joint and no other part between them, as their meshes overlap at that joint.
    """
    found = []
    for one, other in combinations(geometry.parts, 2):
        rigid = len(joints_between(geometry, one, other)) == 0
        if not rigid and not _neighbours(geometry, one, other) and not never_meet(geometry, one, other):
            found.append((one, other))
    return found


def never_meet(geometry: CollisionGeometry, one: Part, other: Part) -> bool:
    """Whether no configuration within the limits, which must be finite, brings two parts together, base first: proved.

    False where they meet, and where `BOXES` boxes are not enough for the proof.
    """
    robot = geometry.robot
    for configuration in robot.sample(SAMPLES, np.random.default_rng(0)):
        geometry.place(configuration)
        if geometry.distance(one, other, cutoff=0.0) <= 0.0:
            return False
    joints = joints_between(geometry, one, other)
    levers = _levers(geometry, other)[joints]
    configuration = robot.ready.copy()
    boxes = [(0.5 * (robot.lower + robot.upper)[joints], 0.5 * (robot.upper - robot.lower)[joints])]
    for _ in range(BOXES):
        if not boxes:
            return True
        centre, half = boxes.pop()
        configuration[joints] = centre
        geometry.place(configuration)
        distance = geometry.distance(one, other)
        if distance <= 0.0:
            return False
        if distance > levers @ half:
            continue
        widest = np.arange(len(joints)) == np.argmax(levers * half)
        half = np.where(widest, 0.5 * half, half)
        boxes += [(centre - widest * half, half), (centre + widest * half, half)]
    return False


def joints_between(geometry: CollisionGeometry, one: Part, other: Part) -> np.ndarray:
    """The moving joints, as indices, that move one part against another."""
    index, (first, last) = geometry.robot.chain[3], sorted(_rows(geometry, one, other))
    return index[first:last][index[first:last] >= 0]


def telling_sphere_pairs(
    geometry: CollisionGeometry, group: Sequence[tuple[Part, Part]], spheres: Mapping[str, np.ndarray]
) -> list[tuple[tuple[str, int], tuple[str, int]]]:
    """Pairs of spheres, each as (part name, number), one of which overlaps wherever two parts of a group touch.

    Parameters
    ----------
    group : pairs of parts that the same two joints move against each other.
    spheres : (S, 4) centres and radii [m] of each part's spheres, by its name, in its link's frame.

    Parts that are always close, as a wrist and the forearm, have spheres that always overlap. All configurations of
    two joints can be evaluated: every pair is weighed on a grid by the contacts that only it has found so far and by
    the false alarms that it adds, and the best is taken until all contacts are found. Parts count as touching as long
    as they might between the points of the grid, so that nothing is missed there either.
    """
    robot = geometry.robot
    joints = joints_between(geometry, *group[0])
    limits = zip(robot.lower[joints], robot.upper[joints], strict=True)
    axes = [np.append(np.arange(lower, upper, GRID_STEP), upper) for lower, upper in limits]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(joints))
    configurations = np.tile(robot.ready, (len(grid), 1))
    configurations[:, joints] = grid
    margins = [0.5 * GRID_STEP * np.sum(_levers(geometry, other)[joints]) for _, other in group]
    touching = np.empty(len(configurations), dtype=bool)
    for number, configuration in enumerate(configurations):
        geometry.place(configuration)
        touching[number] = any(
            geometry.distance(*pair, cutoff=margin) <= margin for pair, margin in zip(group, margins, strict=True)
        )
    pairs = [
        ((one.name, i), (other.name, j))
        for one, other in group
        for i in range(len(spheres[one.name]))
        for j in range(len(spheres[other.name]))
    ]
    links = {part.name: part.link for pair in group for part in pair}
    overlaps = np.array([_overlap(geometry, configurations, pair, links, spheres) for pair in pairs])
    chosen: list[int] = []
    alarmed = np.zeros(len(configurations), dtype=bool)
    while np.any(touching & ~alarmed):
        found = np.sum(overlaps & (touching & ~alarmed), axis=1)
        false = np.sum(overlaps & ~(touching | alarmed), axis=1)
        chosen.append(int(np.argmax(found / (1.0 + false))))
        alarmed |= overlaps[chosen[-1]]
    return [pairs[number] for number in sorted(chosen)]


def _levers(geometry: CollisionGeometry, part: Part) -> np.ndarray:
    """Levers (n,) of the farthest vertex of a part."""
    frames = np.full(len(part.vertices), geometry.robot.link_names.index(part.link))
    return lever_bounds(geometry.robot, frames, part.vertices).max(axis=1)


def _rows(geometry: CollisionGeometry, *parts: Part) -> list[int]:
    return [geometry.robot.link_names.index(part.link) for part in parts]


def _neighbours(geometry: CollisionGeometry, one: Part, other: Part) -> bool:
    """Whether a single moving joint and no further part lie between two parts."""
    first, last = sorted(_rows(geometry, one, other))
    between = [row for row in _rows(geometry, *geometry.parts) if first < row < last]
    return len(joints_between(geometry, one, other)) == 1 and not between


def _overlap(
    geometry: CollisionGeometry,
    configurations: np.ndarray,
    pair: tuple[tuple[str, int], tuple[str, int]],
    links: Mapping[str, str],
    spheres: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Whether two spheres overlap in each of the configurations (n, eta)."""
    robot = geometry.robot
    both = np.array([spheres[name][number] for name, number in pair])
    frames = np.array([robot.link_names.index(links[name]) for name, _ in pair])
    placed = place_body_points(configurations, frames, np.ascontiguousarray(both[:, :3]), robot.chain)
    return np.linalg.norm(placed[:, 0] - placed[:, 1], axis=1) <= both[0, 3] + both[1, 3]
