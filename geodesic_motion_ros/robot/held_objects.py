"""HeldObject: what the hand holds, fixed in the tool frame, and the spheres that cover it.

A box or cylinder is cut into cells, one edge long at most in each direction of its axes. What is in a cell is convex
(of a cylinder: of the prism of `_SIDES` sides around it), so a sphere that holds its corners holds all of it, and all
spheres together hold the whole object. The edge is chosen for few spheres that stick out little (`PROTRUSION`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError

#: Shapes, and what their dimensions are [m].
SHAPES = {"sphere": ("radius",), "box": ("sides along x", "y", "z"), "cylinder": ("radius", "height along z")}
#: Spheres that stick out of no face by more than this [m] are fine enough, as those of the Panda's hand; there are no
#: more of them than this, however far they stick out.
PROTRUSION, MOST_SPHERES = 0.02, 64
#: No length of an object is shorter [m], and all that are held take no more spheres than this.
SHORTEST, MOST_IN_ALL = 1e-4, 256
#: Of the prism that stands for a cylinder: it sticks out by 0.9 % of the radius.
_SIDES = 24


@dataclass(frozen=True)
class HeldObject:
    """A sphere, box or cylinder fixed in the tool frame.

    Attributes
    ----------
    name : what it is called, in messages too.
    shape, dimensions : one of `SHAPES`, and as many lengths [m] as that has.
    position, quaternion : (3,) [m] of its centre, and (4,) of its axes, in the tool frame.

    Raises
    ------
    RobotError : the name is empty, the shape unknown, a dimension missing or not positive, the pose no pose.
    """

    name: str
    shape: str
    dimensions: tuple[float, ...]
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    quaternion: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("dimensions", "position", "quaternion"):
            try:
                object.__setattr__(self, name, tuple(float(number) for number in getattr(self, name)))
            except (TypeError, ValueError) as error:
                raise RobotError(f"held object '{self.name}': {name} are to be a few numbers ({error})") from error
        if not self.name:
            raise RobotError("a held object has no name: it is attached and detached by it")
        if not isinstance(self.name, str):
            raise RobotError(f"a held object has the name {self.name!r:.60}: a text is needed")
        subject = f"held object '{self.name}'"
        if self.shape not in SHAPES:
            raise RobotError(f"{subject} has the shape {self.shape!r}: expected one of {', '.join(SHAPES)}")
        wanted = SHAPES[self.shape]
        good = len(self.dimensions) == len(wanted) and all(SHORTEST <= length < math.inf for length in self.dimensions)
        if not good:
            raise RobotError(
                f"{subject}, a {self.shape}, has the dimensions {self.dimensions} m: expected {', '.join(wanted)}, "
                f"finite, and none shorter than {SHORTEST:g}"
            )
        if len(self.position) != 3 or not np.all(np.isfinite(self.position)):
            raise RobotError(f"{subject} is at {self.position} in the tool frame: expected finite (x, y, z) [m]")
        norm = float(np.linalg.norm(self.quaternion))
        if len(self.quaternion) != 4 or not abs(norm - 1.0) < 1e-3:
            raise RobotError(f"{subject} has the orientation {self.quaternion}: expected a unit quaternion")

    @property
    def sides(self) -> np.ndarray:
        """(3,) [m] of the box around it, along its axes."""
        return _sides(self.shape, self.dimensions)

    @property
    def extent(self) -> float:
        """No point of it is farther from the tool frame's origin [m]."""
        half_sides = 0.5 * self.sides
        around = half_sides[0] if self.shape == "sphere" else float(np.linalg.norm(half_sides))
        if self.shape == "cylinder":
            around = math.hypot(half_sides[0], half_sides[2])
        return float(np.linalg.norm(self.position)) + float(around)

    @property
    def spheres(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres (K, 3) in the tool frame and radii (K,) [m] of spheres that hold all of it."""
        centres, radii = _cover(self.shape, self.dimensions)
        return to_rotation(np.array(self.quaternion)).apply(centres) + np.array(self.position), radii

    @property
    def protrusion(self) -> float:
        """How far [m] these spheres stick out of its faces, at most."""
        return _protrusion(self.shape, self.dimensions, *_cover(self.shape, self.dimensions))


def check_held(objects: Sequence[HeldObject], robot: Robot) -> None:
    """Refuse objects that a robot's hand cannot hold at once.

    Raises
    ------
    RobotError : one is no HeldObject; two of them have one name; one is larger than the arm; they take too many
        spheres.
    """
    if isinstance(objects, str) or not isinstance(objects, Sequence):
        raise RobotError(f"what the hand holds is {objects!r:.60}: a sequence of HeldObject is needed, () for nothing")
    for held in objects:
        if not isinstance(held, HeldObject):
            raise RobotError(f"the hand is to hold {held!r:.60}: a HeldObject is needed")
    names = [held.name for held in objects]
    for held in objects:
        if names.count(held.name) > 1:
            raise RobotError(f"two held objects are called '{held.name}': each needs a name of its own")
        if not held.extent <= robot.reach:
            raise RobotError(
                f"held object '{held.name}' reaches {held.extent:.2f} m from '{robot.tool_link}', and the whole arm "
                f"{robot.reach:.2f} m: its dimensions and position are to be in metres, in the tool frame"
            )

    count = sum(len(held.spheres[1]) for held in objects)
    if count > MOST_IN_ALL:
        raise RobotError(f"{len(objects)} held objects take {count} spheres: no more than {MOST_IN_ALL} can be counted")


def _sides(shape: str, dimensions: tuple[float, ...]) -> np.ndarray:
    """Sides (3,) [m] of the box around a shape, along its axes."""
    if shape == "box":
        return np.array(dimensions)
    diameter = 2.0 * dimensions[0]
    return np.array([diameter, diameter, diameter if shape == "sphere" else dimensions[1]])


@lru_cache(maxsize=64)
def _cover(shape: str, dimensions: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Centres (K, 3) in the frame of a shape and radii (K,) [m]: the fewest spheres that are fine enough, or those that
    stick out least.
    """
    if shape == "sphere":
        return np.zeros((1, 3)), np.array(dimensions)
    sides = _sides(shape, dimensions)
    least, best = math.inf, None
    counts = {tuple(np.ceil(sides * number / side - 1e-9).astype(int).tolist())
              for side in sides for number in range(1, MOST_SPHERES + 1)}  # fmt: skip
    for cells in sorted((cells for cells in counts if math.prod(cells) <= MOST_SPHERES), key=math.prod):
        cover = _of_cells(shape, sides, cells)
        protrusion = _protrusion(shape, dimensions, *cover)
        if protrusion < least:
            least, best = protrusion, cover
        if least <= PROTRUSION:
            break
    assert best is not None  # one cell is always tried
    return best


def _of_cells(shape: str, sides: np.ndarray, cells: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The spheres around so many cells along each axis."""
    outline = 0.5 * sides[:2] * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    if shape == "cylinder":
        angles = 2.0 * math.pi * np.arange(_SIDES) / _SIDES
        outline = 0.5 * sides[0] / math.cos(math.pi / _SIDES) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    flat = []
    for strip in _strips(outline, 0, cells[0]):
        for piece in _strips(strip, 1, cells[1]):
            middle = 0.5 * (piece.min(axis=0) + piece.max(axis=0))
            flat.append([*middle, float(np.max(np.linalg.norm(piece - middle, axis=1)))])
    thick = sides[2] / cells[2]
    heights = thick * (np.arange(cells[2]) + 0.5) - 0.5 * sides[2]
    table = np.array([[x, y, height, math.hypot(radius, 0.5 * thick)] for x, y, radius in flat for height in heights])
    return table[:, :3], table[:, 3]


def _strips(outline: np.ndarray, axis: int, count: int) -> list[np.ndarray]:
    """A convex outline (V, 2) cut across an axis into so many parts of equal width."""
    edges = np.linspace(outline[:, axis].min(), outline[:, axis].max(), count + 1)
    return [
        _half(_half(outline, axis, lower, -1.0), axis, upper, 1.0)
        for lower, upper in pairwise(edges.tolist())
    ]


def _half(outline: np.ndarray, axis: int, limit: float, side: float) -> np.ndarray:
    """What of a convex outline (V, 2) does not lie beyond a limit on one side of an axis, 1.0 or -1.0."""
    beyond = side * (outline[:, axis] - limit)
    kept = []
    for i in range(len(outline)):
        before, here = beyond[i - 1], beyond[i]
        if before * here < 0.0:
            kept.append(outline[i - 1] + before / (before - here) * (outline[i] - outline[i - 1]))
        if here <= 1e-12:
            kept.append(outline[i])
    return np.array(kept)


def _protrusion(shape: str, dimensions: tuple[float, ...], centres: np.ndarray, radii: np.ndarray) -> float:
    """How far [m] spheres stick out of the faces of a shape, at most."""
    if shape == "sphere":
        return 0.0
    half_sides = 0.5 * _sides(shape, dimensions)
    depths = half_sides - np.abs(centres)
    if shape == "cylinder":
        depths = np.stack([dimensions[0] - np.hypot(centres[:, 0], centres[:, 1]), depths[:, 2]], axis=1)
    return float(np.max(radii - depths.min(axis=1)))
