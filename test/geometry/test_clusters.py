"""Clusters of a cloud: what hangs together is separated, held by its spheres, and what is behind them is foreseen."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.geometry.clusters import FEWEST_CUBES, MOST_PARTS, SplitCloud, split_cloud

EDGE, LARGEST, MOST = 0.02, 0.25, 16
EYE, HERE = np.array([1.4, -0.8, 1.2]), np.array([0.4, 0.1, 0.5])


def split(points: np.ndarray, viewpoint: np.ndarray | None = EYE) -> SplitCloud:
    return split_cloud(points, EDGE, LARGEST, MOST, viewpoint)


def ball(centre: np.ndarray, radius: float, front: bool = True) -> np.ndarray:
    """Points all over a ball, or where it can be seen, 5 mm apart at most."""
    count = round(16.0 * np.pi * radius**2 / 0.005**2)
    # A spiral from pole to pole: as dense everywhere.
    heights, turns = 1.0 - (2.0 * np.arange(count) + 1.0) / count, np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - heights**2)
    directions = np.column_stack([flat * np.cos(turns), flat * np.sin(turns), heights])
    points = centre + radius * directions
    return points[np.sum(directions * (EYE - points), axis=1) > 0.0] if front else points


def outside(points: np.ndarray, spheres: np.ndarray) -> float:
    """How far the farthest of points is outside of all spheres [m]."""
    return float(np.max(np.min(np.linalg.norm(points[:, None] - spheres[:, :3], axis=2) - spheres[:, 3], axis=1)))


@pytest.mark.parametrize("radius", [0.025, 0.05, 0.1])
def test_of_the_front_of_a_ball_the_ball_is_made(radius):
    (cluster,) = split(ball(HERE, radius)).clusters
    (sphere,) = cluster.spheres
    # A camera that is D away sees the ball from r^2 / D before its middle on: so much it is taken to be smaller.
    hidden = radius**2 / np.linalg.norm(EYE - HERE)
    np.testing.assert_allclose(sphere[:3], HERE, atol=hidden + 0.005)
    assert sphere[3] == pytest.approx(radius, abs=hidden + 0.005)


def test_without_a_viewpoint_the_points_alone_are_held():
    points = ball(HERE, 0.05)
    (cluster,) = split(points, None).clusters
    assert outside(points, cluster.spheres) <= 1e-12
    assert cluster.spheres[0] @ [*(EYE - HERE), 0.0] > [*HERE, 0.0] @ np.array([*(EYE - HERE), 0.0])
    assert np.linalg.norm(cluster.spheres[0, :3] - HERE) > 0.008


@pytest.mark.parametrize("viewpoint", [None, EYE, HERE], ids=["unknown", "before it", "within it"])
def test_spheres_hold_all_points_whatever_their_shape(viewpoint):
    random = np.random.default_rng(0)
    for _ in range(20):
        points = HERE + random.uniform(-0.1, 0.1, 3) * random.uniform(-1.0, 1.0, (3000, 1))
        points += random.normal(0.0, 0.01, points.shape)
        found = split(points, viewpoint)
        held = np.concatenate([cluster.spheres for cluster in found.clusters])
        in_rest = np.min(np.linalg.norm(points[:, None] - found.rest, axis=2), axis=1, initial=np.inf) == 0.0
        assert outside(points[~in_rest], held) <= 1e-12
        for cluster in found.clusters:
            assert 1 <= len(cluster.spheres) <= MOST_PARTS


def test_balls_that_touch_are_one_cluster_of_their_own_spheres():
    places = HERE + 0.1 * np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    (cluster,) = split(np.concatenate([ball(place, 0.05) for place in places])).clusters
    assert len(cluster.spheres) == len(places)
    apart = np.linalg.norm(places[:, None] - cluster.spheres[:, :3], axis=2)
    np.testing.assert_allclose(np.min(apart, axis=1), 0.0, atol=0.01)
    np.testing.assert_allclose(cluster.spheres[:, 3], 0.05, atol=0.01)


def test_two_things_an_empty_cube_apart_are_two():
    # Farther apart than two edges there is one between them wherever the grid lies.
    points = np.concatenate([ball(HERE, 0.04, False), ball(HERE + [0.0, 0.08 + 2.01 * EDGE, 0.0], 0.04, False)])
    found = split(points)
    assert [tuple(np.round(cluster.half, 2)) for cluster in found.clusters] == [(0.04, 0.04, 0.04)] * 2
    assert len(found.rest) == 0


def test_what_is_large_and_what_is_tiny_stands():
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 101), np.linspace(-0.5, 0.5, 101))
    table = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    specks = np.array([[0.0, 0.0, 0.3], [0.2, 0.0, 0.3]])
    found = split(np.concatenate([table, ball(HERE, 0.05), specks]))
    assert len(found.clusters) == 1
    assert {tuple(point) for point in found.rest} == {tuple(point) for point in np.concatenate([table, specks])}
    few = HERE + EDGE * np.arange(FEWEST_CUBES)[:, None] * [1.0, 0.0, 0.0]
    assert len(split(few).clusters) == 1
    assert len(split(few[:-1]).clusters) == 0


def test_of_many_the_largest_are_taken():
    places = HERE + 0.15 * np.arange(4)[:, None] * [0.0, 0.0, 1.0]
    clouds = [ball(place, radius) for place, radius in zip(places, (0.03, 0.05, 0.02, 0.04), strict=True)]
    found = split_cloud(np.concatenate(clouds), EDGE, LARGEST, 2, EYE)
    assert [round(max(cluster.half), 2) for cluster in found.clusters] == [0.05, 0.04]
    assert len(found.rest) == len(clouds[0]) + len(clouds[2])


def test_a_cloud_without_points_has_none():
    found = split(np.zeros((0, 3)))
    assert (found.clusters, len(found.rest)) == ((), 0)
