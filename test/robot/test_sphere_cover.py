"""Covers hold their meshes and stick out no more than they may."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geodesic_motion_ros.robot.sphere_cover import MESH_MARGIN, cover, file_spheres
from geodesic_motion_ros.utils.errors import ParameterError


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


def test_rounding_takes_nothing_away() -> None:
    exact, rounded = cover(blob(3), 0.015), file_spheres(blob(3), 0.015)
    moved = np.linalg.norm(exact[:, :3] - rounded[:, :3], axis=1)
    assert np.all(rounded[:, 3] >= exact[:, 3] + moved + MESH_MARGIN - 1e-12)
    assert np.all(rounded[:, 3] <= exact[:, 3] + MESH_MARGIN + 3e-4)
