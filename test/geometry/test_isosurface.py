"""Surfaces out of fields: where they are, and that they have no holes."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from geodesic_motion_ros.geometry.isosurface import isosurface

CENTRE = np.array([9.3, 10.1, 8.7])


def distances(shape: tuple[int, ...] = (20, 21, 19), centre: np.ndarray = CENTRE) -> np.ndarray:
    """Distance of every lattice point from a centre, in units of the lattice."""
    lattice = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    return np.linalg.norm(lattice - centre, axis=-1)


def edges_of(quads: np.ndarray) -> Counter:
    pairs = np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2)
    return Counter(map(tuple, np.sort(pairs, axis=1).tolist()))


@pytest.mark.parametrize("radius", [2.5, 4.0, 7.2])
def test_a_ball_has_a_closed_surface_at_its_radius(radius):
    vertices, quads = isosurface(distances(), radius)
    np.testing.assert_allclose(np.linalg.norm(vertices - CENTRE, axis=1), radius, atol=0.25)
    assert set(edges_of(quads).values()) == {2}
    # Euler characteristic of a sphere
    assert len(vertices) - len(edges_of(quads)) + len(quads) == 2


def test_its_area_is_that_of_the_ball():
    vertices, quads = isosurface(distances(), 7.0)
    a, b, c, d = (vertices[quads[:, i]] for i in range(4))
    area = 0.5 * np.linalg.norm(np.cross(c - a, d - b), axis=1).sum()
    assert area == pytest.approx(4.0 * np.pi * 7.0**2, rel=0.03)


def test_the_level_moves_the_surface_and_the_sign_does_not():
    field = distances()
    vertices, quads = isosurface(field, 5.0)
    turned, same = isosurface(-field, -5.0)
    np.testing.assert_allclose(turned, vertices)
    np.testing.assert_array_equal(same, quads)
    wider, _ = isosurface(field, 6.0)
    assert np.ptp(wider, axis=0).min() > np.ptp(vertices, axis=0).max()


def test_a_surface_that_leaves_the_lattice_is_open_and_one_outside_is_empty():
    _, quads = isosurface(distances(centre=np.zeros(3)), 5.0)
    assert 1 in edges_of(quads).values()
    vertices, quads = isosurface(distances(), 100.0)
    assert (len(vertices), len(quads)) == (0, 0)
