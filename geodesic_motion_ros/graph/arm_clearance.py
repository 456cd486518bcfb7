"""How near the arm comes to obstacles at every node of a graph: link by link first, then sphere by sphere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np

from geodesic_motion_ros.robot.body_points import place_body_points
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


@dataclass(frozen=True)
class ArmSpheres:
    """The arm's moving collision spheres in n configurations, (n, S, 3) [m], and the bounds of its links, (n, G, 3)."""

    spheres: np.ndarray
    links: np.ndarray
    radii: np.ndarray
    bounds: LinkBounds

    @classmethod
    def at(cls, configurations: np.ndarray, model: CollisionModel, bounds: LinkBounds, robot: Robot) -> ArmSpheres:
        """In configurations (n, eta) [rad]."""
        placed, moving = contiguous(configurations), model.moving
        frames, offsets = model.points.frames[moving], model.points.offsets[moving]
        return cls(
            place_body_points(placed, frames, offsets, robot.chain),
            place_body_points(placed, bounds.frames, bounds.centres, robot.chain),
            model.radii[moving],
            bounds,
        )

    def clearances(self, centres: np.ndarray, radii: np.ndarray, within: float) -> np.ndarray:
        """Smallest distance [m] from the arm's surface to obstacles (o, 3), (o,), for each configuration, (n,).

        Negative inside; inf where no obstacle is nearer than `within` [m].
        """
        return _clearances(
            self.spheres, self.links, self.radii, self.bounds.radii, self.bounds.first, centres, radii, within
        )


@numba.njit(cache=True, nogil=True)
def _clearances(
    spheres: np.ndarray,
    links: np.ndarray,
    sphere_radii: np.ndarray,
    link_radii: np.ndarray,
    first: np.ndarray,
    centres: np.ndarray,
    radii: np.ndarray,
    within: float,
) -> np.ndarray:
    result = np.full(len(spheres), np.inf)
    for i in range(len(spheres)):
        for g in range(len(link_radii)):
            for o in range(len(radii)):
                x, y, z = centres[o, 0], centres[o, 1], centres[o, 2]
                dx, dy, dz = links[i, g, 0] - x, links[i, g, 1] - y, links[i, g, 2] - z
                reach = link_radii[g] + radii[o] + min(within, result[i])
                if reach <= 0.0 or dx * dx + dy * dy + dz * dz >= reach * reach:
                    continue
                for s in range(first[g], first[g + 1]):
                    both = sphere_radii[s] + radii[o]
                    dx, dy, dz = spheres[i, s, 0] - x, spheres[i, s, 1] - y, spheres[i, s, 2] - z
                    squared = dx * dx + dy * dy + dz * dz
                    if squared < (both + within) ** 2:
                        result[i] = min(result[i], math.sqrt(squared) - both)
    return result
