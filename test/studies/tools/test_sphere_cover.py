"""Covers hold their meshes and stick out no more than they may, and so do the shipped spheres, which are as few."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.studies.tools.collision_geometry import CollisionGeometry
from geodesic_motion_ros.studies.tools.sphere_cover import (
    MESH_MARGIN,
    PANDA_PROTRUSIONS,
    PROTRUSION,
    cover,
    file_spheres,
)
from geodesic_motion_ros.utils.errors import ParameterError


@pytest.fixture(scope="module")
def geometry() -> Iterator[CollisionGeometry]:
    with CollisionGeometry("panda") as geometry:
        yield geometry


def blob(seed: int) -> np.ndarray:
    """Vertices of a random convex body, 6 to 12 cm across and a different shape each time."""
    generator = np.random.default_rng(seed)
    return generator.normal(size=(30, 3)) * generator.uniform(0.01, 0.02, 3)


@pytest.mark.parametrize("seed", range(3))
def test_all_of_a_convex_body_is_covered(seed: int) -> None:
    vertices = blob(seed)
    spheres = cover(vertices, 0.015)
    generator = np.random.default_rng(seed)
    corners = vertices[generator.integers(len(vertices), size=(20000, 4))]
    points = np.concatenate([vertices, np.einsum("nk,nkj->nj", generator.dirichlet(np.full(4, 0.3), 20000), corners)])
    gaps = np.linalg.norm(points[:, None] - spheres[:, :3], axis=-1) - spheres[:, 3]
    assert gaps.min(axis=1).max() <= 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_spheres_stick_out_no_more_than_they_may(seed: int) -> None:
    vertices = blob(seed)
    spheres = cover(vertices, 0.015)
    planes = ConvexHull(vertices).equations
    depths = np.min(-(spheres[:, :3] @ planes[:, :3].T) - planes[:, 3], axis=1)
    assert np.all(depths > 0.0)
    assert np.all(spheres[:, 3] - depths <= 0.015 + 1e-12)


def test_a_tighter_cover_takes_more_spheres_and_less_room() -> None:
    coarse, fine = cover(blob(1), 0.02), cover(blob(1), 0.012)
    assert len(fine) > len(coarse)
    assert fine[:, 3].max() < coarse[:, 3].max()


def test_the_same_body_gives_the_same_spheres() -> None:
    np.testing.assert_array_equal(cover(blob(2), 0.015), cover(blob(2), 0.015))


def test_a_slanted_sheet_thinner_than_the_grid_is_refused() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.1], [0.0, 0.1, 0.03], [0.0, 0.0, 1e-4]])
    with pytest.raises(ParameterError, match=r"protrusion is 0\.015 m.*0\.1, 0\.1, 0\.1"):
        cover(corners, 0.015)


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


def test_rounding_takes_nothing_away() -> None:
    exact, rounded = cover(blob(3), 0.015), file_spheres(blob(3), 0.015)
    moved = np.linalg.norm(exact[:, :3] - rounded[:, :3], axis=1)
    assert np.all(rounded[:, 3] >= exact[:, 3] + moved + MESH_MARGIN - 1e-12)
    assert np.all(rounded[:, 3] <= exact[:, 3] + MESH_MARGIN + 3e-4)
