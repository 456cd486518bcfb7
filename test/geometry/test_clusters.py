"""Clusters of a cloud: what hangs together is separated, held by its spheres, and what is behind them is foreseen."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.ndimage import label
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.clusters import Cluster, ball_of_radius, cluster_radii, hanging_together
from geodesic_motion_ros.geometry.voxels import VoxelGrid

MOST, EDGE = 32, 0.02
EYE, HERE = np.array([1.4, -0.8, 1.2]), np.array([0.4, 0.1, 0.5])


def cover(points: np.ndarray, viewpoint: np.ndarray | None = EYE, most: int = MOST) -> Cluster:
    return Cluster.of(points, most, viewpoint)


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
    (sphere,) = cover(ball(HERE, radius)).spheres
    # A camera that is D away sees the ball from r^2 / D before its middle on: so much it is taken to be smaller.
    hidden = radius**2 / np.linalg.norm(EYE - HERE)
    np.testing.assert_allclose(sphere[:3], HERE, atol=hidden + 0.005)
    assert sphere[3] == pytest.approx(radius, abs=hidden + 0.005)


@pytest.mark.parametrize("part", [1.0, 0.5], ids=["front", "half of the front"])
def test_a_ball_of_a_known_radius_is_found_by_a_part_of_it(part):
    random, points = np.random.default_rng(0), ball(HERE, 0.05)
    points = points[points[:, 2] >= np.quantile(points[:, 2], 1.0 - part)]
    for _ in range(20):
        begin = HERE + random.uniform(-0.02, 0.02, 3)
        middle, deviation = ball_of_radius(points, begin, 0.05, 0.0)
        np.testing.assert_allclose(middle, HERE, atol=1e-6)
        assert deviation < 1e-6
    # The control: it has another one.
    assert ball_of_radius(points, HERE, 0.04, 0.0)[1] > 5e-4


def test_the_middle_of_a_ball_is_where_its_radius_says_it_is():
    """Along the line of sight a free fit errs more than one of a known radius."""
    random, line = np.random.default_rng(0), (EYE - HERE) / np.linalg.norm(EYE - HERE)
    points = ball(HERE, 0.05)
    # A part of its front, as where another thing is before it.
    points = points[points[:, 2] > HERE[2] + 0.01][::10]
    fitted, known = [], []
    for _ in range(50):
        noisy = points + random.normal(0.0, 0.001, (len(points), 1)) * line
        found = cover(noisy).ball
        assert found is not None
        fitted.append((found[:3] - HERE) @ line)
        known.append((ball_of_radius(noisy, HERE, 0.05, 0.0)[0] - HERE) @ line)
    assert np.std(known) < 0.8 * np.std(fitted)


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.004])
def test_however_noisy_the_front_of_a_ball_stays_one_sphere(noise):
    random = np.random.default_rng(1)
    line = (EYE - HERE) / np.linalg.norm(EYE - HERE)
    for radius in (0.03, 0.05, 0.08):
        for _ in range(10):
            points = ball(HERE, radius)
            # A camera errs along its line of sight.
            assert len(cover(points + random.normal(0.0, noise, (len(points), 1)) * line).spheres) == 1
    # The control: a rod of that width is of several.
    assert len(cover(np.concatenate([ball(HERE + [0.0, y, 0.0], 0.03) for y in np.linspace(0, 0.3, 20)])).spheres) > 2


def test_without_a_viewpoint_the_points_alone_are_held():
    points = ball(HERE, 0.05)
    cluster, toward = cover(points, None), EYE - HERE
    assert outside(points, cluster.spheres) <= 1e-12
    assert cluster.spheres[0, :3] @ toward > HERE @ toward
    assert np.linalg.norm(cluster.spheres[0, :3] - HERE) > 0.008


@pytest.mark.parametrize("viewpoint", [None, EYE, HERE], ids=["unknown", "before it", "within it"])
def test_spheres_hold_all_points_whatever_their_shape_and_are_no_more_than_allowed(viewpoint):
    random = np.random.default_rng(0)
    for number in range(30):
        points = HERE + random.uniform(-0.2, 0.2, 3) * random.uniform(-1.0, 1.0, (1 + 10 * number, 1))
        points += random.normal(0.0, 0.01, points.shape)
        kept, most = points.copy(), 2 ** (number % 6)
        cluster = cover(points, viewpoint, most)
        assert outside(points, cluster.spheres) <= 1e-12
        assert 1 <= len(cluster.spheres) <= most
        np.testing.assert_array_equal(cluster.points, kept)
        np.testing.assert_allclose(np.add(cluster.centre, cluster.half), points.max(axis=0), atol=1e-12)
        np.testing.assert_allclose(np.subtract(cluster.centre, cluster.half), points.min(axis=0), atol=1e-12)


def test_more_spheres_are_no_larger_together():
    random = np.random.default_rng(2)
    points = HERE + random.uniform(-1.0, 1.0, (500, 3)) * [0.2, 0.1, 0.02]
    volumes = [np.sum(cover(points, None, most).spheres[:, 3] ** 3) for most in (1, 2, 4, 8, 16, 32)]
    assert np.all(np.diff(volumes) <= 0.0)
    assert volumes[-1] < 0.2 * volumes[0]


def test_balls_that_touch_are_of_their_own_spheres():
    places = HERE + 0.1 * np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    spheres = cover(np.concatenate([ball(place, 0.05) for place in places])).spheres
    assert len(spheres) == len(places)
    apart = np.linalg.norm(places[:, None] - spheres[:, :3], axis=2)
    np.testing.assert_allclose(np.min(apart, axis=1), 0.0, atol=0.01)
    np.testing.assert_allclose(spheres[:, 3], 0.05, atol=0.01)


@pytest.mark.parametrize("share", [1.0, 0.6, 0.35])
def test_a_ball_is_where_it_is_however_little_of_it_is_seen(share):
    points = ball(HERE, 0.05)
    across = np.cross(EYE - HERE, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    (sphere,) = cover(points[(points - HERE) @ across >= 0.05 * (1.0 - 2.0 * share)]).spheres
    np.testing.assert_allclose(sphere, [*HERE, 0.05], atol=1e-6)


def patches(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means (m, 3) and spreads (m, 6) of the points in each cube."""
    _, of_cube = np.unique(np.rint(points / EDGE).astype(int), axis=0, return_inverse=True)
    own = [points[of_cube.ravel() == number] for number in range(of_cube.max() + 1)]
    spreads = [np.cov(one.T, bias=True)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]] for one in own]
    return np.array([np.mean(one, axis=0) for one in own]), np.array(spreads)


def test_spheres_hold_the_corners_of_boxes_of_whose_cubes_means_and_spreads_are_known():
    random, grid = np.random.default_rng(5), np.linspace(-1.0, 1.0, 40)
    flat = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    without = []
    for turn in Rotation.random(10, random_state=0):
        half, faces = random.uniform(0.03, 0.09, 3), []
        for axis, side in itertools.product(range(3), (-1.0, 1.0)):
            face = np.insert(flat, axis, side, axis=1) * half
            if turn.apply(np.eye(3)[axis] * side) @ (EYE - HERE - turn.apply(np.eye(3)[axis] * side * half)) > 0.0:
                faces.append(HERE + turn.apply(face))
        points = np.concatenate(faces)
        means, spreads = patches(points)
        cluster = Cluster.of(means, MOST, EYE, spreads)
        assert outside(points, cluster.spheres) <= 0.005
        cluster = Cluster.of(means, MOST, EYE)
        without.append(outside(points, cluster.spheres))
    assert max(without) > 0.005


def test_cubes_hang_together_that_touch_with_a_corner_too():
    random, grid = np.random.default_rng(3), VoxelGrid.around(HERE, 0.2, EDGE)
    for share in (0.0, 0.01, 0.05, 0.1, 0.5):
        occupied = np.zeros(grid.shape, dtype=bool)
        occupied[1:-1, 1:-1, 1:-1] = random.random(np.subtract(grid.shape, 2)) < share
        places = random.permutation(np.argwhere(occupied) + grid.first)
        kinds, means = np.zeros(len(places), dtype=np.int64), np.zeros((len(places), 3))
        of_cube, sizes = hanging_together(places, grid.numbered(places), grid.first, kinds, means, 0.0)
        numbers, count = label(occupied, np.ones((3, 3, 3)))
        expected = numbers[tuple((places - grid.first).T)] - 1
        # The same sets, whatever their numbers are.
        assert len(sizes) == count == len(set(zip(of_cube.tolist(), expected.tolist(), strict=True)))
        np.testing.assert_array_equal(sizes, np.bincount(of_cube, minlength=count))


@pytest.mark.parametrize(
    ("kinds", "gap", "things"), [((1, 1), 0.03, 1), ((1, 1), 0.02, 2), ((1, 2), 0.03, 2)], ids=["near", "far", "others"]
)
def test_cubes_hang_together_that_are_near_and_of_a_kind(kinds, gap, things):
    places, means = np.array([[0, 0, 0], [1, 0, 0]]), np.array([[0.0, 0.0, 0.0], [0.025, 0.0, 0.0]])
    grid = VoxelGrid.around(np.zeros(3), 0.2, EDGE)
    of_cube, _ = hanging_together(places, grid.numbered(places), grid.first, np.array(kinds), means, gap)
    assert len(set(of_cube.tolist())) == things


def test_a_radius_is_that_of_the_farthest_point_from_the_middle_of_the_box():
    random = np.random.default_rng(4)
    points, of_point = random.normal(size=(300, 3)), random.integers(0, 5, 300)
    of_point[:5] = np.arange(5)
    radii = cluster_radii(points, of_point, 5)
    for number in range(5):
        own = points[of_point == number]
        middle = 0.5 * (own.min(axis=0) + own.max(axis=0))
        assert radii[number] == pytest.approx(np.max(np.linalg.norm(own - middle, axis=1)), abs=1e-12)
    assert cluster_radii(points[:1], np.zeros(1, dtype=np.int64), 1).tolist() == [0.0]
