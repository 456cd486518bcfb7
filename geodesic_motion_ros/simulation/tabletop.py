"""A table with things on it: bodies of simple shape that stand around the arm of an `ArmWorld`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.utils.errors import ParameterError

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Region:
    """A rectangle on the table, between the corners `lower` and `upper` (x, y) [m], base frame."""

    lower: tuple[float, float]
    upper: tuple[float, float]

    def __post_init__(self) -> None:
        if not np.all(np.subtract(self.upper, self.lower) > 0.0):
            raise ParameterError(f"a region from {self.lower} to {self.upper} is empty: lower must be below upper")

    def at(self, fractions: np.ndarray) -> np.ndarray:
        """Points (..., 2) [m] at fractions (..., 2) in [0, 1] from the lower to the upper corner."""
        return self.lower + np.asarray(fractions) * np.subtract(self.upper, self.lower)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Whether points (..., 2 or more) [m] lie in it, seen from above; boolean (...)."""
        ground = np.asarray(points)[..., :2]
        return np.all((ground >= self.lower) & (ground <= self.upper), axis=-1)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder of `radius` and `height` [m] about `centre` (3,) [m], its axis turned from z by `quaternion`."""

    centre: tuple[float, float, float]
    radius: float
    height: float
    colour: Colour
    quaternion: tuple[float, float, float, float] = UPRIGHT


def standing(place: np.ndarray, radius: float, height: float, colour: Colour, on: float = 0.0) -> Cylinder:
    """A cylinder that stands upright at a place (2,) [m], `on` [m] above the table."""
    return Cylinder((float(place[0]), float(place[1]), on + 0.5 * height), radius, height, colour)


def fixed_to(position: np.ndarray, quaternion: np.ndarray, part: Cylinder) -> Cylinder:
    """A cylinder given in a frame, seen from the base: the frame is at position (3,) [m], quaternion (4,)."""
    frame = to_rotation(np.asarray(quaternion))
    turned = (frame * to_rotation(np.asarray(part.quaternion))).as_quat()
    centre = np.asarray(position) + frame.apply(part.centre)
    return Cylinder(tuple(centre), part.radius, part.height, part.colour, tuple(np.roll(turned, 1)))


class TabletopWorld(ArmWorld):
    """An `ArmWorld` with the table of config/scenes, on which cylinders stand: solid ones, which the arm can hit, and
    ones only to look at.
    """

    def __init__(self, gui: bool = False, rate_hz: float = 240.0, robot: str | Path = DEFAULT_ROBOT) -> None:
        super().__init__(gui, rate_hz, DeclaredScene.from_name("table"), robot)
        self._solid: list[int] = []
        self._seen: list[int] = []

    def furnish(self, solid: Iterable[Cylinder], seen: Iterable[Cylinder] = ()) -> None:
        """Put these bodies on the table instead of those that stood there; `seen` ones touch nothing."""
        for body in self._solid + self._seen:
            self._client.removeBody(body)
        self._solid = [self._add_cylinder(cylinder, solid=True) for cylinder in solid]
        self._seen = [self._add_cylinder(cylinder, solid=False) for cylinder in seen]

    def furniture_clearance(self, cutoff: float = 0.5) -> float:
        """Smallest signed distance [m] from the arm's geometry to a solid body; inf beyond `cutoff` [m]."""
        distances = [
            point[8] for body in self._solid for point in self._client.getClosestPoints(self._arm, body, cutoff)
        ]
        return min(distances, default=np.inf)

    def _add_cylinder(self, cylinder: Cylinder, solid: bool) -> int:
        client = self._client
        shape = -1
        if solid:
            shape = client.createCollisionShape(client.GEOM_CYLINDER, radius=cylinder.radius, height=cylinder.height)
        look = client.createVisualShape(
            client.GEOM_CYLINDER, radius=cylinder.radius, length=cylinder.height, rgbaColor=(*cylinder.colour, 1.0)
        )
        # scalar last, as PyBullet wants it
        turn = np.roll(cylinder.quaternion, -1).tolist()
        return client.createMultiBody(0.0, shape, look, basePosition=cylinder.centre, baseOrientation=turn)
