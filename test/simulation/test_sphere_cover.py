"""Covers hold their meshes and stick out no more than they may; the shipped file is what the code makes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.simulation.collision_geometry import CollisionGeometry
from geodesic_motion_ros.simulation.sphere_cover import (
    MESH_MARGIN,
    PANDA_PROTRUSIONS,
    PROTRUSION,
    cover,
    file_spheres,
)


@pytest.fixture(scope="module")
def geometry() -> Iterator[CollisionGeometry]:
    with CollisionGeometry.panda() as geometry:
        yield geometry


def blob(seed: int) -> np.ndarray:
    """Vertices of a random convex body, 6 to 12 cm across and a different shape each time."""
    generator = np.random.default_rng(seed)
    return generator.normal(size=(30, 3)) * generator.uniform(0.01, 0.02, 3)


@pytest.mark.parametrize("seed", range(3))
def test_all_of_a_convex_body_is_held(seed: int) -> None:
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


@pytest.mark.parametrize("name", ["panda_link7", "panda_hand", "panda_leftfinger"])
def test_the_shipped_file_is_what_is_made_here(geometry: CollisionGeometry, name: str) -> None:
    part = next(part for part in geometry.parts if part.name == name)
    made = file_spheres(part.vertices, PANDA_PROTRUSIONS.get(name, PROTRUSION))
    model = CollisionModel.panda()
    shipped = np.column_stack([model.points.offsets, model.radii])
    for sphere in made:
        assert np.any(np.all(np.abs(shipped - sphere) <= 2e-4, axis=1))


def test_rounding_takes_nothing_away() -> None:
    exact, rounded = cover(blob(3), 0.015), file_spheres(blob(3), 0.015)
    moved = np.linalg.norm(exact[:, :3] - rounded[:, :3], axis=1)
    assert np.all(rounded[:, 3] >= exact[:, 3] + moved + MESH_MARGIN - 1e-12)
    assert np.all(rounded[:, 3] <= exact[:, 3] + MESH_MARGIN + 3e-4)
