"""The body at every node of a graph: what feels obstacles there, and what must not touch them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.robot.body_points import BodyPoints, place_three_sets
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot, contiguous


@dataclass(frozen=True)
class LinkBounds:
    """One sphere around all collision spheres of each of G links that joints move.

    Attributes
    ----------
    frames : (G,) row of the link. centres : (G, 3) [m] in its frame; radii : (G,) [m].
    first : (G + 1,) link g has the moving spheres first[g] to first[g + 1].
    """

    frames: np.ndarray
    centres: np.ndarray
    radii: np.ndarray
    first: np.ndarray

    @classmethod
    def of(cls, model: CollisionModel) -> LinkBounds:
        """The model's spheres stand link by link."""
        frames, offsets = model.points.frames[model.moving], model.points.offsets[model.moving]
        radii = model.radii[model.moving]
        first = np.append(np.flatnonzero(np.diff(frames, prepend=-1)), len(frames))
        links = list(pairwise(first))
        centres = np.stack([offsets[a:b].mean(axis=0) for a, b in links])
        around = [
            float(np.max(np.linalg.norm(offsets[a:b] - centre, axis=1) + radii[a:b]))
            for (a, b), centre in zip(links, centres, strict=True)
        ]
        return cls(frames[first[:-1]], centres, np.array(around), first)


class NodeBody(NamedTuple):
    """Where the arm, or the tool, is at each of n nodes: the spheres that kernels check against obstacles there.

    Attributes
    ----------
    points, point_radii : (n, K, 3), (K,) [m] body points, at which the ambient metric is evaluated.
    spheres, sphere_radii : (n, S, 3), (S,) [m] collision spheres, which must stay clear of obstacles.
    links, link_radii : (n, G, 3), (G,) [m] spheres around the spheres first[g] to first[g + 1], first (G + 1,).
    lower, upper : (3,) [m] corners of a box that holds all of it.
    """

    points: np.ndarray
    point_radii: np.ndarray
    spheres: np.ndarray
    sphere_radii: np.ndarray
    links: np.ndarray
    link_radii: np.ndarray
    first: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of_tool(cls, points: np.ndarray, radii: np.ndarray) -> NodeBody:
        """Spheres (n, K, 3), (K,) fixed to a tool, which feel the metric and must stay clear."""
        alone = np.arange(len(radii) + 1)
        return cls(points, radii, points, radii, points, radii, alone, *_box(points, radii))

    @classmethod
    def of_arm(
        cls,
        configurations: np.ndarray,
        body: BodyPoints,
        point_radii: np.ndarray,
        model: CollisionModel,
        bounds: LinkBounds,
        robot: Robot,
    ) -> NodeBody:
        """An arm in configurations (n, eta) [rad]: its body points and their radii (K,) [m], and the model's moving
        collision spheres.
        """
        placed, moving = contiguous(configurations), model.moving
        points, spheres, links = place_three_sets(
            placed,
            (body.frames, body.offsets),
            (model.points.frames[moving], model.points.offsets[moving]),
            (bounds.frames, bounds.centres),
            robot.chain,
        )
        boxes = _box(points, point_radii), _box(links, bounds.radii)
        return cls(
            points, point_radii, spheres, model.radii[moving], links, bounds.radii, bounds.first,
            np.minimum(boxes[0][0], boxes[1][0]), np.maximum(boxes[0][1], boxes[1][1]),
        )  # fmt: skip

    def felt_at(self, points: np.ndarray, radii: np.ndarray) -> NodeBody:
        """Return the same body, which feels obstacles at other points (n, K, 3), (K,) [m]."""
        lower, upper = _box(points, radii)
        return self._replace(
            points=points, point_radii=radii, lower=np.minimum(self.lower, lower), upper=np.maximum(self.upper, upper)
        )


@numba.njit(cache=True, nogil=True)
def _box(centres: np.ndarray, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (3,) around spheres (n, k, 3), (k,)."""
    lower, upper = np.empty(3), np.empty(3)
    # Axis by axis: least and most stay in registers.
    for axis in range(3):
        least, most = np.inf, -np.inf
        for i in range(centres.shape[0]):
            for k in range(centres.shape[1]):
                least = min(least, centres[i, k, axis] - radii[k])
                most = max(most, centres[i, k, axis] + radii[k])
        lower[axis], upper[axis] = least, most
    return lower, upper
