"""Convex parts hold the mesh that they are of, and fill less of its inner sides than its hull."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from geodesic_motion_ros.robot.convex_parts import convex_parts, hull_triangles

CORNERS = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def box(lower: tuple[float, float, float], upper: tuple[float, float, float]) -> np.ndarray:
    return hull_triangles(np.array(lower) + CORNERS * np.subtract(upper, lower))


def volumes(parts: list[np.ndarray]) -> float:
    return sum(ConvexHull(part.reshape(-1, 3)).volume for part in parts)


def held(parts: list[np.ndarray], points: np.ndarray) -> np.ndarray:
    """Whether points (n, 3) are in one of the hulls, up to rounding."""
    planes = [ConvexHull(part.reshape(-1, 3)).equations for part in parts]
    return np.any([(points @ rows[:, :3].T + rows[:, 3]).max(axis=1) < 1e-9 for rows in planes], axis=0)


def test_a_bent_body_is_cut_at_its_bend() -> None:
    """The control: its hull is a third larger, and a body that is convex is not cut."""
    bent = np.concatenate([box((0, 0, 0), (4, 1, 1)), box((0, 0, 1), (1, 1, 4))])
    parts = convex_parts(bent)
    assert len(parts) == 2
    assert volumes(parts) == pytest.approx(7.0, rel=0.05)
    assert ConvexHull(bent.reshape(-1, 3)).volume == pytest.approx(11.5)
    assert len(convex_parts(box((0, 0, 0), (4, 1, 1)))) == 1


def test_between_two_tines_nothing_is_filled() -> None:
    fork = [box((0, 0, 0), (3, 1, 1)), box((0, 0, 1), (1, 1, 4)), box((2, 0, 1), (3, 1, 4))]
    parts = convex_parts(np.concatenate(fork))
    assert not held(parts, np.array([[1.5, 0.5, 2.5]])).any()
    assert held(parts, np.array([[0.5, 0.5, 2.5], [2.5, 0.5, 2.5], [1.5, 0.5, 0.5]])).all()


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_parts_hold_all_of_the_body(seed: int) -> None:
    """Of bodies of overlapping boxes, turned: within, where cuts across several axes meet, as on the surface."""
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    body = [random.uniform(-1.0, 1.0, 3) + CORNERS * random.uniform(0.3, 2.0, 3) for _ in range(3)]
    body = [corners @ turn.T for corners in body]
    parts = convex_parts(np.concatenate([hull_triangles(corners) for corners in body]))
    inside = np.concatenate([random.dirichlet(np.full(8, 0.3), 300) @ corners for corners in body])
    assert held(parts, inside).all()
    hull = ConvexHull(np.concatenate(body))
    assert held([np.concatenate(body)], np.concatenate(parts).reshape(-1, 3)).all()
    assert volumes(parts) <= hull.volume * (1.0 + 1e-9)


def test_triangles_of_a_hull_face_outwards() -> None:
    triangles = hull_triangles(np.random.default_rng(0).normal(size=(60, 3)))
    signed = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))
    assert np.all(signed > 0.0)


def test_a_flat_mesh_is_no_body() -> None:
    with pytest.raises(ValueError, match="flat"):
        convex_parts(box((0, 0, 0), (1, 1, 1))[:1].repeat(4, axis=0))
