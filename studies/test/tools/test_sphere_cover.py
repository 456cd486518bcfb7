"""The shipped spheres of the Panda stick out no more than they may, and are as few as those made here."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.sphere_cover import MESH_MARGIN, PROTRUSION, file_spheres
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry
from geodesic_motion_studies.tools.sphere_cover import PANDA_PROTRUSIONS


@pytest.fixture(scope="module")
def geometry() -> Iterator[CollisionGeometry]:
    with CollisionGeometry("panda") as geometry:
        yield geometry


def protrusion(name: str) -> float:
    """How far [m] the spheres of a part may stick out."""
    return PANDA_PROTRUSIONS.get(name, PROTRUSION)


def test_the_shipped_spheres_stick_out_no_more_than_they_may(geometry: CollisionGeometry) -> None:
    """Beyond the protrusion there is PyBullet's margin, and rounding of centre and radius. They hold the meshes:
    see the tests of the model.
    """
    model = CollisionModel.named("panda")
    for link in dict.fromkeys(model.points.names):
        spheres = model.of_link(link)
        beyond = []
        for part in geometry.parts:
            if part.link == link:
                planes = ConvexHull(part.vertices).equations
                depths = np.min(-(spheres.points.offsets @ planes[:, :3].T) - planes[:, 3], axis=1)
                beyond.append(spheres.radii - depths - protrusion(part.name) - MESH_MARGIN)
        assert np.min(beyond, axis=0).max() <= 3e-4, link


@pytest.mark.parametrize("link", ["panda_link7", "panda_hand"])
def test_a_cover_that_is_made_here_is_about_as_large_as_the_shipped_one(
    geometry: CollisionGeometry, link: str
) -> None:
    """Its spheres are others: on a symmetric mesh several candidates cover equally much, and rounding decides."""
    made = sum(len(file_spheres(part.vertices, protrusion(part.name))) for part in geometry.parts if part.link == link)
    assert 0.5 * made <= len(CollisionModel.named("panda").of_link(link)) <= 2.0 * made
