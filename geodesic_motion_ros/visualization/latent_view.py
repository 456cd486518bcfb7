"""The latent space as a picture, fast enough for a few frames a second: numpy and Pillow, no ROS, no
matplotlib.

Drawn are the magnification factor log sqrt det M(z), the demonstrations' codes, the footprint of the
obstacles (latent points whose decoded tool would touch one) and the present path.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from PIL import Image, ImageDraw

from geodesic_motion_ros.manifold.ambient_metric import obstacle_clearances
from geodesic_motion_ros.manifold.decoder import Decoded
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import PlanningError

# Perceptually even, dark to bright: blue-black over teal to pale yellow.
_COLOUR_STOPS = np.array(
    [[13, 17, 40], [29, 53, 92], [32, 101, 122], [66, 149, 127], [149, 190, 120], [241, 230, 158]],
    dtype=float,
)
_COARSE = 110
_BLOCK = 2048
FOOTPRINT = np.array([224.0, 72.0, 62.0])
_DEMONSTRATION, _PATH, _DETOUR, _GOAL = (120, 130, 165), (255, 255, 255), (255, 140, 60), (255, 196, 0)


class LatentPicture(ABC):
    """A latent box of two dimensions with what is in it; what never changes is drawn once.

    Parameters
    ----------
    lower, upper : (2,) corners of the box.
    background : (r, c) values, the first row at the top: dark where they are small.
    codes : (demonstrations, samples, 2) latent points.
    size : edge of the square picture [pixels].
    """

    def __init__(
        self, lower: np.ndarray, upper: np.ndarray, background: np.ndarray, codes: np.ndarray, size: int
    ) -> None:
        self._lower, self._upper, self._size = lower, upper, size
        # what is drawn is smooth: a coarse picture, enlarged, shows the same
        image = Image.fromarray(_colours(background)).resize((size, size), Image.Resampling.BICUBIC)
        draw = ImageDraw.Draw(image)
        for code in codes:
            draw.line([tuple(point) for point in self._pixels(code).tolist()], fill=_DEMONSTRATION, width=1)
        self._background = np.array(image)

    def render(
        self, obstacles: Obstacles, path: np.ndarray | None = None, caption: str = "", is_detour: bool = False
    ) -> np.ndarray:
        """The picture (size, size, 3) uint8.

        Parameters
        ----------
        obstacles : in the frame of the skill.
        path : latent points (m, d) of the present reference, None without one.
        caption : a line of text.
        is_detour : whether the arm goes beside that path, which is drawn in another colour then.
        """
        pixels = self._with_footprint(obstacles)
        image = Image.fromarray(pixels)
        draw = ImageDraw.Draw(image)
        if path is not None and len(path) > 1:
            line = [tuple(point) for point in self._pixels(path).tolist()]
            colour = _DETOUR if is_detour else _PATH
            draw.line(line, fill=colour, width=3)
            _dot(draw, line[0], 4, colour)
            _dot(draw, line[-1], 5, _GOAL)
        if caption:
            draw.rectangle((0, self._size - 16, self._size, self._size), fill=(0, 0, 0))
            draw.text((4, self._size - 14), caption, fill=(255, 255, 255))
        return np.asarray(image)

    def _pixels(self, latent: np.ndarray) -> np.ndarray:
        """Pixel (column, row) of latent points (n, 2); the second latent axis points up."""
        share = (latent - self._lower) / (self._upper - self._lower)
        share = np.stack([share[:, 0], 1.0 - share[:, 1]], axis=1)
        return np.clip(np.rint(share * (self._size - 1)), -self._size, 2 * self._size).astype(int)

    @abstractmethod
    def _with_footprint(self, obstacles: Obstacles) -> np.ndarray:
        """A copy of the background with what obstacles cover."""


class LatentView(LatentPicture):
    """Draws one skill of the tool.

    Parameters
    ----------
    graph : the skill's latent graph; its decoded nodes give the footprint of obstacles.
    points, radii : spheres (K, 3), (K,) [m] fixed in the tool frame.
    size : as of `LatentPicture`.
    """

    def __init__(self, skill: Skill, graph: PoseGraph, points: np.ndarray, radii: np.ndarray, size: int = 320) -> None:
        if len(skill.latent_lower) != 2:
            raise PlanningError(f"a latent view shows two dimensions, this skill has {len(skill.latent_lower)}")
        # log det M is smooth on the scale of the kernels
        factor = magnification_factor(skill, _COARSE)
        super().__init__(skill.latent_lower, skill.latent_upper, factor, skill.codes, size)
        self._radii = radii
        self._body = tool_points(graph.decoded.positions, graph.decoded.quaternions, points)
        self._node_pixels = self._pixels(graph.latent)
        self._cell = int(np.ceil(size / (min(graph.grid.shape) - 1))) + 1

    def _with_footprint(self, obstacles: Obstacles) -> np.ndarray:
        pixels = self._background.copy()
        touched = self._node_pixels[obstacle_clearances(self._body, self._radii, obstacles, 0.0) <= 0.0]
        mask = np.zeros(pixels.shape[:2], dtype=bool)
        reach = np.arange(self._cell) - self._cell // 2
        columns, rows = (touched[:, :1] + reach), (touched[:, 1:] + reach)
        mask[np.clip(rows[:, :, None], 0, self._size - 1), np.clip(columns[:, None, :], 0, self._size - 1)] = True
        pixels[mask] = (0.45 * pixels[mask] + 0.55 * FOOTPRINT).astype(np.uint8)
        return pixels


def magnification_factor(
    skill: Skill, size: int, ambient: Callable[[np.ndarray], np.ndarray] | None = None
) -> np.ndarray:
    """log sqrt det M(z) on a (size, size) picture of the latent box, first row at the top.

    M = J^T A J of the decoded features, with Jacobians by central differences on the picture's own grid.

    ambient : factors (n,) >= 1 at positions (n, 3) [m], by which obstacles stretch position and sigma; None: 1.
    """
    axes = [np.linspace(low, high, size) for low, high in zip(skill.latent_lower, skill.latent_upper, strict=True)]
    first, second = np.meshgrid(axes[0], axes[1][::-1])
    latent = np.stack([first.ravel(), second.ravel()], axis=1)
    blocks = [latent[begin : begin + _BLOCK] for begin in range(0, len(latent), _BLOCK)]
    features = np.concatenate([_features(skill, skill.decoder.decode(block)) for block in blocks])
    picture = features.reshape(size, size, -1)
    along_second, along_first = np.gradient(picture, axes[1][::-1], axes[0], axis=(0, 1))
    weights = np.ones_like(picture)
    if ambient is not None:
        # The first of the features, positions and their deviations, are lengths in space, which obstacles stretch.
        weights[..., : 9 if skill.decoder.full else 6] = ambient(features[:, :3]).reshape(size, size, 1)
    a = np.sum(weights * along_first**2, axis=-1)
    b = np.sum(weights * along_first * along_second, axis=-1)
    c = np.sum(weights * along_second**2, axis=-1)
    return 0.5 * np.log(np.maximum(a * c - b * b, 1e-300))


def _features(skill: Skill, decoded: Decoded) -> np.ndarray:
    return np.concatenate(
        [
            decoded.positions, skill.metric.sigma_weight * decoded.root, decoded.quaternions,
            skill.metric.orientation_features(decoded),
        ],
        axis=1,
    )


def _colours(values: np.ndarray) -> np.ndarray:
    low, high = np.percentile(values, [2.0, 98.0])
    share = np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_COLOUR_STOPS))
    return np.stack([np.interp(share, stops, _COLOUR_STOPS[:, i]) for i in range(3)], axis=-1).astype(np.uint8)


def _dot(draw: ImageDraw.ImageDraw, at: tuple[int, int], radius: int, colour: tuple[int, int, int]) -> None:
    draw.ellipse((at[0] - radius, at[1] - radius, at[0] + radius, at[1] + radius), fill=colour)
