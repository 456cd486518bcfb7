"""The latent space of a whole-arm skill as a picture: of its three dimensions the one along which the demonstrations
spread least is looked along. Fast enough for a few frames a second; as `latent_view`.

Drawn are how sure the decoder is, the demonstrations' codes, the footprint of the obstacles and the present path, all
of them as they are seen along that dimension.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from geodesic_motion_ros.manifold.ambient_metric import obstacle_clearances
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.visualization.latent_view import FOOTPRINT, LatentPicture

_COVERED = 0.75


class ArmView(LatentPicture):
    """Draws one skill of the whole arm.

    A column of nodes, one behind the other, is as dark as its surest node, and bright without any; red as the share of
    its nodes in which obstacles cover the arm.

    Parameters
    ----------
    graph : the skill's latent graph. collision : the arm's spheres.
    size : as of `LatentPicture`.
    """

    def __init__(self, skill: Skill, graph: ConfigurationGraph, collision: CollisionModel, size: int = 320) -> None:
        spread = np.ptp(skill.codes.reshape(-1, skill.codes.shape[-1]), axis=0)
        self._axes = np.sort(np.argsort(spread)[-2:])
        lower, upper, shape = (
            np.asarray(of)[self._axes] for of in (graph.grid.lower, graph.grid.upper, graph.grid.shape)
        )
        cells = np.rint((graph.latent[:, self._axes] - lower) / (upper - lower) * (shape - 1)).astype(int)
        # rows from the top: the second axis points up
        self._shape = int(shape[1]), int(shape[0])
        self._column = (shape[1] - 1 - cells[:, 1]) * shape[0] + cells[:, 0]
        self._nodes = np.maximum(np.bincount(self._column, minlength=shape[0] * shape[1]), 1)
        unsure = np.full(shape[0] * shape[1], np.max(graph.sigma))
        np.minimum.at(unsure, self._column, graph.sigma)
        super().__init__(lower, upper, unsure.reshape(self._shape), skill.codes, size)
        self._graph, self._points, self._moving = graph, collision.points, collision.moving
        self._radii = collision.radii[self._moving]

    @cached_property
    def _spheres(self) -> np.ndarray:
        """Where the nodes have the moving spheres (n, S, 3) [m]: hundreds of megabytes of an arm with many. Placed when
        the first picture is drawn, for mostly nobody looks.
        """
        points, moving = self._points, self._moving
        return place_body_points(
            self._graph.configurations, points.frames[moving], points.offsets[moving], self._graph.robot.chain
        )

    def _pixels(self, latent: np.ndarray) -> np.ndarray:
        """Pixel (column, row) of latent points (n, 3)."""
        return super()._pixels(latent[:, self._axes])

    def _with_footprint(self, obstacles: Obstacles) -> np.ndarray:
        touched = obstacle_clearances(self._spheres, self._radii, obstacles, 0.0) <= 0.0
        share = np.bincount(self._column, touched, len(self._nodes)) / self._nodes
        rows, columns = (np.arange(self._size) * count // self._size for count in self._shape)
        opaque = _COVERED * share.reshape(self._shape)[np.ix_(rows, columns)][:, :, None]
        return ((1.0 - opaque) * self._background + opaque * FOOTPRINT).astype(np.uint8)
