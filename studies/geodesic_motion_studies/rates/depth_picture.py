"""What a depth camera sees of an arm and a ball before a table and two walls, fast enough for thirty pictures a second
beside a planner.

The arm is the spheres of its collision model. What is behind them is hidden, and a cloud has one point of each pixel,
row by row. Table and walls never move: how deep they are in each pixel is worked out once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import MATRIX, VECTOR, Robot
from geodesic_motion_ros.simulation.depth_camera import DepthCameraSettings

#: Standard deviation of a depth [m]; of the noise so much more is drawn than one picture needs.
NOISE, _SPARE = 0.003, 65_537
#: Radius of the ball [m].
BALL = 0.025
#: The plane that the arm stands above, and the walls beside it: axis, and where they are along it [m].
_PLANES = ((2, -0.05), (0, -0.6), (1, 0.9))
#: Width over height of a picture; where the camera stands and looks so that a quarter of its pixels show the arm.
_SHAPE = 4.0 / 3.0
_PLACE, _TARGET, _FIELD_OF_VIEW = (1.3, -0.75, 0.95), (0.34, -0.06, 0.34), 32.5
_FLOATS = numba.types.Array(numba.float32, 1, "C", readonly=True)
_PICTURE = numba.types.Array(numba.float32, 2, "C", readonly=True)
_POINTS = numba.types.Array(numba.float32, 2, "C")


class Seen(NamedTuple):
    """Points (n, 3) [m] of single precision in the frame of the camera, which the next picture overwrites; how many are
    of the arm and of the ball.
    """

    points: np.ndarray
    of_arm: int
    of_ball: int


def camera(points: int) -> DepthCameraSettings:
    """A camera with so many pixels, or a few more."""
    height = max(1, round(math.sqrt(points / _SHAPE)))
    return DepthCameraSettings(_PLACE, _TARGET, math.ceil(points / height), height, _FIELD_OF_VIEW)


class DepthPicture:
    """Takes pictures of an arm, and of a ball at a place (3,) [m] or none."""

    def __init__(self, robot: Robot, model: CollisionModel, points: int, ball: np.ndarray | None) -> None:
        self._robot, self._model = robot, model
        settings = camera(points)
        self._place, self._turn = np.array(settings.place), settings.turn
        tangent = math.tan(math.radians(0.5 * settings.field_of_view))
        width, height = settings.width, settings.height
        self._across = tangent * width / height * (2.0 * (np.arange(width) + 0.5) / width - 1.0)
        self._down = tangent * (2.0 * (np.arange(height) + 0.5) / height - 1.0)
        rays = np.stack([*np.meshgrid(self._across, self._down), np.ones((height, width))], axis=-1) @ self._turn.T
        depths = np.array([(at - self._place[axis]) / rays[..., axis] for axis, at in _PLANES])
        # A ray that meets none of them has no return.
        self._behind = np.min(np.where(depths > 0.0, depths, np.inf), axis=0).astype(np.float32)
        self._random = np.random.default_rng(0)
        self._noise = self._random.normal(0.0, NOISE, width * height + _SPARE).astype(np.float32)
        self._points = np.empty((width * height, 3), dtype=np.float32)
        self._ball = np.zeros((0, 3)) if ball is None else ball[None]
        self._radii = np.append(model.radii, np.full(len(self._ball), BALL))

    def take(self, joints: np.ndarray) -> Seen:
        """Take a picture of an arm at joints (eta,) [rad]."""
        centres = np.concatenate([self._model.positions(self._robot, joints[None])[0], self._ball])
        first = int(self._random.integers(_SPARE))
        of_arm, of_ball = _take(
            self._behind, self._across, self._down, self._noise[first:], (centres - self._place) @ self._turn,
            self._radii, len(self._model), self._points,
        )  # fmt: skip
        return Seen(self._points, of_arm, of_ball)


# A written signature: compiled at the first import, not with the first picture.
@numba.njit((_PICTURE, VECTOR, VECTOR, _FLOATS, MATRIX, VECTOR, numba.int64, _POINTS), cache=True, nogil=True)
def _take(behind, across, down, noise, centres, radii, of_arm, points):
    """Write a point of each pixel, and count those of the first `of_arm` spheres and of the others.

    behind : (h, w) depth of what stands [m]. across (w,), down (h,) : slopes of the pixels' rays.
    centres (S, 3), radii (S,) : of the spheres [m], in the frame of the camera.
    """
    depth, whose = behind.copy(), np.zeros(behind.shape, dtype=np.int64)
    for s in range(len(radii)):
        x, y, z, r = centres[s, 0], centres[s, 1], centres[s, 2], radii[s]
        near, far = z - r, z + r
        if near <= 0.0:
            continue
        left = np.searchsorted(across, min((x - r) / near, (x - r) / far))
        right = np.searchsorted(across, max((x + r) / near, (x + r) / far))
        top = np.searchsorted(down, min((y - r) / near, (y - r) / far))
        bottom = np.searchsorted(down, max((y + r) / near, (y + r) / far))
        rest = x * x + y * y + z * z - r * r
        for i in range(top, bottom):
            for j in range(left, right):
                along = across[j] * x + down[i] * y + z
                square = across[j] * across[j] + down[i] * down[i] + 1.0
                root = along * along - square * rest
                if root >= 0.0:
                    at = (along - math.sqrt(root)) / square
                    if at < depth[i, j]:
                        depth[i, j], whose[i, j] = at, 1 if s < of_arm else 2
    counts, n = np.zeros(3, dtype=np.int64), 0
    for i in range(behind.shape[0]):
        for j in range(behind.shape[1]):
            at = depth[i, j] + noise[n]
            points[n, 0], points[n, 1], points[n, 2] = across[j] * at, down[i] * at, at
            counts[whose[i, j]] += 1
            n += 1
    return counts[1], counts[2]
