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

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numba
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
    robot: Robot, spheres: Mapping[str, np.ndarray], bodies: Sequence[Body], draws: int = DRAWS,
    progress: Callable[[str, int, int], None] = lambda stage, step, steps: None,
) -> tuple[LinkPair, ...]:  # fmt: skip
    """The pairs of links, by their spheres (S, 4) [m] in the links' frames, whose bodies can meet."""
    configurations = robot.sample(draws, np.random.default_rng(0))
    placed = {}
    for link, rows in spheres.items():
        frames = np.full(len(rows), robot.link_names.index(link), dtype=np.int64)
        placed[link] = place_body_points(configurations, frames, np.ascontiguousarray(rows[:, :3]), robot.chain)
    turned = np.append(0, np.cumsum(robot.chain[3] >= 0))
    found = []
    pairs = list(combinations(sorted(spheres, key=robot.link_names.index), 2))
    for number, (one, other) in enumerate(pairs):
        progress("drawing postures", number, len(pairs))
        joints = turned[robot.link_names.index(other)] - turned[robot.link_names.index(one)]
        if joints < 2:
            continue
        radii = spheres[one][:, None, 3] + spheres[other][None, :, 3]
        overlaps = _overlaps(placed[one], placed[other], radii).reshape(draws, -1)
        gap = NEAR_OF_TWO if joints == 2 else NEAR
        some, others = (_corners([body.vertices for body in bodies if body.link == link]) for link in (one, other))
        touching = overlaps.any(axis=1)
        touching[touching] = [_touch(robot, q, (one, other), some, others, gap) for q in configurations[touching]]
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
    able = np.flatnonzero(overlaps[touching].any(axis=0))
    overlaps, chosen = overlaps[:, able], []
    alarmed = np.zeros(len(touching), dtype=bool)
    while np.any(left := touching & ~alarmed):
        false = np.sum(overlaps & ~(touching | alarmed)[:, None], axis=0)
        chosen.append(int(np.argmax(np.sum(overlaps & left[:, None], axis=0) / (1.0 + false))))
        alarmed |= overlaps[:, chosen[-1]]
    return np.sort(able[chosen])


@numba.njit(cache=True, nogil=True)
def separated(one: np.ndarray, other: np.ndarray, gap: float) -> bool:
    """Whether the convex hulls of points (n, 3), (m, 3) [m] are shown to be farther apart than a gap [m].

    Gilbert's steps towards the point x of least length in the difference of both: with s its farthest point against x,
    the distance is at least x . s / |x|; the next x is the nearest to the origin between x and s.
    """
    x = np.array([np.mean(one[:, axis]) - np.mean(other[:, axis]) for axis in range(3)])
    for _ in range(STEPS):
        length = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        if length <= gap:
            return False
        support = one[_farthest(one, -x)] - other[_farthest(other, x)]
        if (x[0] * support[0] + x[1] * support[1] + x[2] * support[2]) / length > gap:
            return True
        along = support - x
        squared = along[0] * along[0] + along[1] * along[1] + along[2] * along[2]
        share = -(x[0] * along[0] + x[1] * along[1] + x[2] * along[2]) / squared
        x = x + min(max(share, 0.0), 1.0) * along
    return False


@numba.njit(cache=True, nogil=True)
def _farthest(points: np.ndarray, along: np.ndarray) -> int:
    """The number of the one of points (n, 3) that is farthest along a direction (3,)."""
    best, most = 0, -np.inf
    for i in range(len(points)):
        reached = points[i, 0] * along[0] + points[i, 1] * along[1] + points[i, 2] * along[2]
        if reached > most:
            best, most = i, reached
    return best


@numba.njit(cache=True, nogil=True)
def _overlaps(one: np.ndarray, other: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Whether spheres at (n, S, 3) [m] overlap with spheres at (n, R, 3), whose radii (S, R) [m] are added: (n, S, R).
    """
    found = np.empty((len(one), *radii.shape), dtype=np.bool_)
    for draw in range(len(one)):
        for i in range(radii.shape[0]):
            for j in range(radii.shape[1]):
                x, y, z = one[draw, i] - other[draw, j]
                found[draw, i, j] = x * x + y * y + z * z <= radii[i, j] ** 2
    return found


@numba.njit(cache=True, nogil=True)
def _any_touch(
    one: np.ndarray, firsts: np.ndarray, other: np.ndarray, other_firsts: np.ndarray, gap: float
) -> bool:
    """Whether bodies of corners (n, 3) [m], each from its first one on, (B + 1,), come nearer to others than a gap [m].
    """
    for i in range(len(firsts) - 1):
        for j in range(len(other_firsts) - 1):
            if not separated(
                one[firsts[i] : firsts[i + 1]], other[other_firsts[j] : other_firsts[j + 1]], gap
            ):
                return True
    return False


def _corners(bodies: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The corners (n, 3) [m] of several bodies one after the other, and the number of each one's first, (B + 1,)."""
    return np.concatenate(bodies), np.append(0, np.cumsum([len(body) for body in bodies]))


def _touch(
    robot: Robot, q: np.ndarray, links: tuple[str, str], some: tuple[np.ndarray, np.ndarray],
    others: tuple[np.ndarray, np.ndarray], gap: float,
) -> bool:  # fmt: skip
    """Whether bodies of two links, as of `_corners`, come nearer than a gap [m] in a configuration (eta,)."""
    rotations, origins = robot.link_frames(q)
    first, second = map(robot.link_names.index, links)
    turned = rotations[first].T @ rotations[second]
    offset = rotations[first].T @ (origins[second] - origins[first])
    return _any_touch(*some, others[0] @ turned.T + offset, others[1], gap)
