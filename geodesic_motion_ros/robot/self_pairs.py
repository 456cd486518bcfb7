"""Which spheres of an arm are kept apart: chosen by configurations that are drawn at random.

Links that one joint moves against each other touch at that joint and are never compared. Of the others those are kept
apart whose bodies come nearer than a gap in a drawn configuration in which their spheres overlap (distance of convex
bodies: E. Gilbert, SIAM Journal on Control 4, 1966). Links that are always close, as a wrist and the forearm, have
spheres that always overlap: of their pairs of spheres the one that finds most of the contacts that are left, for the
false alarms that it adds, is taken until every drawn contact is found. Bodies that touch in every drawn configuration
overlap as they are modelled, and no posture would be left: their links are not kept apart. This is a sample and no
proof: what `geodesic-motion robot` prints is to be looked at.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.robot.collision_bodies import Body
from geodesic_motion_ros.robot.kinematics import Robot

DRAWS = 3000
NEAR, NEAR_OF_TWO = 0.02, 0.005
"""Gap [m] up to which bodies count as touching, as draws miss contacts; where two joints move them, draws are dense."""
OFTEN = 0.1
"""Spheres that overlap in more than this share of the draws are of links that are always close."""
STEPS = 200
"""Of the search for the distance of two bodies; those that it does not separate count as touching."""


@dataclass(frozen=True)
class LinkPair:
    """Two links that are kept apart, base first, or whose bodies always touch.

    Attributes
    ----------
    spheres : pairs of their spheres, each counted from 0; None for all, () where they always touch.
    touching, overlapping : shares of the draws in which their bodies touch, and the chosen spheres overlap.
    """

    links: tuple[str, str]
    spheres: tuple[tuple[int, int], ...] | None
    touching: float
    overlapping: float


def draw_self_pairs(
    robot: Robot, spheres: Mapping[str, np.ndarray], bodies: Sequence[Body], draws: int = DRAWS
) -> tuple[LinkPair, ...]:
    """The pairs of links, by their spheres (S, 4) [m] in the links' frames, whose bodies can meet."""
    configurations = robot.sample(draws, np.random.default_rng(0))
    placed = {}
    for link, rows in spheres.items():
        frames = np.full(len(rows), robot.link_names.index(link), dtype=np.int64)
        placed[link] = place_body_points(configurations, frames, np.ascontiguousarray(rows[:, :3]), robot.chain)
    turned = np.append(0, np.cumsum(robot.chain[3] >= 0))
    found = []
    for one, other in combinations(sorted(spheres, key=robot.link_names.index), 2):
        joints = turned[robot.link_names.index(other)] - turned[robot.link_names.index(one)]
        if joints < 2:
            continue
        radii = spheres[one][:, None, 3] + spheres[other][None, :, 3]
        apart = np.linalg.norm(placed[one][:, :, None] - placed[other][:, None], axis=-1)
        overlaps = (apart <= radii).reshape(draws, -1)
        gap = NEAR_OF_TWO if joints == 2 else NEAR
        some, others = ([body for body in bodies if body.link == link] for link in (one, other))
        touching = overlaps.any(axis=1)
        touching[touching] = [_touch(robot, q, some, others, gap) for q in configurations[touching]]
        if not touching.any():
            continue
        if touching.all():
            found.append(LinkPair((one, other), (), 1.0, 1.0))
            continue
        always_close = overlaps.mean(axis=0).max() > OFTEN
        chosen = telling_pairs(overlaps, touching) if always_close else np.arange(overlaps.shape[1])
        rows = [divmod(int(number), len(spheres[other])) for number in chosen]
        share = float(overlaps[:, chosen].any(axis=1).mean())
        found.append(LinkPair((one, other), tuple(rows) if always_close else None, float(touching.mean()), share))
    return tuple(found)


def telling_pairs(overlaps: np.ndarray, touching: np.ndarray) -> np.ndarray:
    """Columns of overlaps (n, P), bool, one of which is true wherever touching (n,) is, with few false alarms."""
    chosen: list[int] = []
    alarmed = np.zeros(len(touching), dtype=bool)
    while np.any(left := touching & ~alarmed):
        false = np.sum(overlaps & ~(touching | alarmed)[:, None], axis=0)
        chosen.append(int(np.argmax(np.sum(overlaps & left[:, None], axis=0) / (1.0 + false))))
        alarmed |= overlaps[:, chosen[-1]]
    return np.sort(chosen)


def separated(one: np.ndarray, other: np.ndarray, gap: float) -> bool:
    """Whether the convex hulls of points (n, 3), (m, 3) [m] are shown to be farther apart than a gap [m].

    Gilbert's steps towards the point x of least length in the difference of both: with s its farthest point against x,
    the distance is at least x . s / |x|; the next x is the nearest to the origin between x and s.
    """
    x = one.mean(axis=0) - other.mean(axis=0)
    for _ in range(STEPS):
        length = np.linalg.norm(x)
        if length <= gap:
            return False
        support = one[np.argmin(one @ x)] - other[np.argmax(other @ x)]
        if x @ support / length > gap:
            return True
        along = support - x
        x = x + np.clip(-(x @ along) / (along @ along), 0.0, 1.0) * along
    return False


def _touch(robot: Robot, q: np.ndarray, some: Sequence[Body], others: Sequence[Body], gap: float) -> bool:
    """Whether bodies of two links come nearer than a gap [m] in a configuration (eta,)."""
    rotations, origins = robot.link_frames(q)
    first, second = (robot.link_names.index(bodies[0].link) for bodies in (some, others))
    turned = rotations[first].T @ rotations[second]
    offset = rotations[first].T @ (origins[second] - origins[first])
    placed = [body.vertices @ turned.T + offset for body in others]
    return any(not separated(body.vertices, vertices, gap) for body in some for vertices in placed)
