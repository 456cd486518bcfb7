"""The ambient factor: at least 1, exactly 1 far away, continuous, and blind to the order of obstacles."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.shapes import solid_rows
from geodesic_motion_ros.manifold.ambient_metric import (
    CUTOFF,
    ambient_factor,
    clearances,
    cloud_factor,
    completion,
    obstacle_clearances,
    solid_factor,
)
from geodesic_motion_ros.obstacles.obstacles import Obstacles

POINT_RADII = np.array([0.03, 0.0])


def points(seed: int = 0, count: int = 500) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2, 3))


def factors(where: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    return np.array(
        [
            [ambient_factor(*x, r, centres, radii, 1e3, 0.5) for x, r in zip(row, POINT_RADII, strict=True)]
            for row in where
        ]
    )


def test_without_obstacles_every_factor_is_exactly_one():
    assert np.all(factors(points(), np.empty((0, 3)), np.empty(0)) == 1.0)


def test_an_obstacle_changes_what_is_near_and_nothing_else():
    where, centre, radius = points(), np.array([[0.1, 0.2, 0.3]]), np.array([0.2])
    result = factors(where, centre, radius)
    reach = CUTOFF * 0.5 * (0.2 + POINT_RADII)
    near = np.linalg.norm(where - centre[0], axis=-1) < reach
    assert 0 < np.count_nonzero(near) < near.size
    assert np.all(result[near] > 1.0)
    assert np.all(result[~near] == 1.0)


def test_it_is_the_shifted_gaussian_of_the_docstring():
    where, radius = points(), 0.4
    result = factors(where, np.zeros((1, 3)), np.array([radius]))
    width = 0.5 * (radius + POINT_RADII)
    shift = np.exp(-0.5 * CUTOFF**2)
    gaussian = np.exp(-0.5 * (np.linalg.norm(where, axis=-1) / width) ** 2)
    np.testing.assert_allclose(result, 1.0 + 1e3 * np.maximum(gaussian - shift, 0.0) / (1.0 - shift), rtol=1e-10)


def test_the_order_of_obstacles_does_not_matter():
    random = np.random.default_rng(1)
    centres, radii, order = random.uniform(-1, 1, (8, 3)), random.uniform(0.1, 0.4, 8), random.permutation(8)
    first, second = factors(points(), centres, radii), factors(points(), centres[order], radii[order])
    np.testing.assert_allclose(first, second, rtol=1e-12)


def test_clearance_is_the_gap_between_surfaces():
    where = np.array([[[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]]])
    result = clearances(where, POINT_RADII, np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 2.0]]), np.array([0.2, 0.1]), np.inf)
    assert result[0] == pytest.approx(0.5 - 0.2 - 0.03)
    assert clearances(where, POINT_RADII, np.empty((0, 3)), np.empty(0), np.inf)[0] == np.inf


def test_what_is_further_than_asked_for_is_not_computed():
    where, centres, radii = points(), np.random.default_rng(2).uniform(-1, 1, (5, 3)), np.full(5, 0.2)
    everything = clearances(where, POINT_RADII, centres, radii, np.inf)
    near = clearances(where, POINT_RADII, centres, radii, 0.05)
    assert 0 < np.count_nonzero(everything < 0.05) < len(where)
    np.testing.assert_array_equal(near, np.where(everything < 0.05, everything, np.inf))


STRENGTH, RATIO = 1e3, 0.5


def solid_factors(where: np.ndarray, radius: float, solids: np.ndarray) -> np.ndarray:
    return np.array([1.0 + solid_factor(*x, radius, solids, STRENGTH, RATIO) for x in where])


def cloud_factors(where: np.ndarray, radius: float, field: DistanceField) -> np.ndarray:
    return np.array([1.0 + cloud_factor(*x, radius, *field, STRENGTH, RATIO) for x in where])


def some_solids(seed: int = 3) -> np.ndarray:
    random = np.random.default_rng(seed)
    turns = Rotation.random(4, random_state=seed).as_matrix()
    return solid_rows(random.uniform(-0.5, 0.5, (4, 3)), turns, random.uniform(0.05, 0.3, (4, 3)), np.full(4, 0.02))


def on_a_sphere(centre: np.ndarray, radius: float, count: int = 20_000) -> np.ndarray:
    directions = np.random.default_rng(4).normal(size=(count, 3))
    return centre + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_a_solid_that_is_a_sphere_weighs_as_much_as_that():
    where, centre = points()[:, 0], np.array([[0.1, 0.2, 0.3]])
    ball = solid_rows(centre, np.eye(3)[None], np.zeros((1, 3)), np.array([0.3]))
    expected = [ambient_factor(*x, 0.05, centre, np.array([0.3]), STRENGTH, RATIO) for x in where]
    np.testing.assert_allclose(solid_factors(where, 0.05, ball), expected, rtol=1e-9)


def test_a_cloud_seen_on_a_sphere_weighs_as_much_as_the_sphere():
    """Given the sphere's radius for its thickness: as much as that sphere a little nearer, by the points' radius, at
    most the diagonal of a cube, and what interpolation loses."""
    centre, radius, point, body = np.array([0.4, 0.0, 0.5]), 0.15, 0.001, 0.05
    field = DistanceField.of(on_a_sphere(centre, radius), 0.01, point, radius)
    where = centre + np.random.default_rng(5).uniform(-0.5, 0.5, (4000, 3))
    away = np.linalg.norm(where - centre, axis=1)
    where, away = where[away > radius + 3.0 * field.edge], away[away > radius + 3.0 * field.edge]
    seen = cloud_factors(where, body, field)
    sphere = np.array([ambient_factor(*x, body, centre[None], np.array([radius]), STRENGTH, RATIO) for x in where])
    assert np.all(seen >= sphere - 1e-9)
    width, shift = RATIO * (radius + body), np.exp(-0.5 * CUTOFF**2)
    felt = seen > 1.0
    gaussian = (seen[felt] - 1.0) / STRENGTH * (1.0 - shift) + shift
    nearer = away[felt] - width * np.sqrt(-2.0 * np.log(gaussian))
    assert np.count_nonzero(felt) > 200
    assert np.max(nearer) <= point + (np.sqrt(3.0) + 0.15) * field.edge
    assert np.median(nearer) <= point + 1.5 * field.edge


@pytest.mark.parametrize("kind", ["solids", "cloud"])
def test_factors_of_solids_and_clouds_are_continuous_at_least_one_and_one_far_away(kind):
    field = DistanceField.of(np.random.default_rng(6).uniform(-0.4, 0.4, (30, 3)), 0.02, 0.02, 0.05)

    def factors_at(where: np.ndarray) -> np.ndarray:
        return solid_factors(where, 0.05, some_solids()) if kind == "solids" else cloud_factors(where, 0.05, field)

    random = np.random.default_rng(7)
    for _ in range(10):
        begin, end = random.uniform(-1.0, 1.0, (2, 3))
        found = [factors_at(begin + np.linspace(0.0, 1.0, n)[:, None] * (end - begin)) for n in (1001, 8001)]
        assert np.all(found[1] >= 1.0)
        # A jump would be as large however fine the steps are.
        coarse, fine = (np.max(np.abs(np.diff(each)), initial=0.0) for each in found)
        assert fine <= 0.5 * coarse + 1e-9
    assert np.all(factors_at(np.array([[2.0, 0.0, 0.0], [0.0, -3.0, 1.0]])) == 1.0)


def test_a_cloud_whose_field_ends_before_its_influence_still_fades_to_one():
    field = DistanceField.of(np.zeros((1, 3)), 0.02, 0.02, 0.2)
    found = cloud_factors(np.linspace(0.0, 0.6, 2001)[:, None] * [1.0, 0.0, 0.0], 0.3, field)
    assert found[0] > 0.5 * STRENGTH
    assert np.all(np.diff(found) <= 1e-9)
    assert np.all(found[-500:] == 1.0)
    assert np.max(-np.diff(found)) < 0.05 * STRENGTH


def test_clearance_is_the_smallest_of_all_kinds():
    where, ball = points(), np.array([[0.0, 0.0, 0.0]])
    spheres = Obstacles.of_spheres(ball, np.array([0.1]))
    solids = replace(Obstacles.none(), solids=some_solids(), solid_velocities=np.zeros((4, 3)))
    cloud = replace(Obstacles.none(), cloud=DistanceField.of(some_solids()[:, :3] - 0.3, 0.02, 0.02, 0.05))
    each = [obstacle_clearances(where, POINT_RADII, obstacles, 0.05) for obstacles in (spheres, solids, cloud)]
    np.testing.assert_array_equal(each[0], clearances(where, POINT_RADII, ball, np.array([0.1]), 0.05))
    together = replace(solids, centres=ball, radii=spheres.radii, velocities=np.zeros((1, 3)), cloud=cloud.cloud)
    np.testing.assert_array_equal(obstacle_clearances(where, POINT_RADII, together, 0.05), np.min(each, axis=0))
    assert all(0 < np.count_nonzero(np.isfinite(found)) < len(where) for found in each)


def _kinds(strength: float) -> dict:
    """The completed factor of what is 0.2 m thick around the origin, at places (n, 3), for a body of 5 cm."""
    slab = solid_rows(np.zeros((1, 3)), np.eye(3)[None], np.array([[0.2, 0.3, 2.0]]), np.zeros(1))
    return {
        "sphere": lambda x: ambient_factor(*x, 0.05, np.zeros((1, 3)), np.array([0.2]), strength, 0.5, True),
        "solid": lambda x: 1.0 + solid_factor(*x, 0.05, slab, strength, 0.5, True),
    }


@pytest.mark.parametrize("kind", ["sphere", "solid"])
def test_the_completed_factor_falls_from_infinity_at_the_surface_to_one(kind):
    factor = _kinds(1e3)[kind]
    away = np.linspace(-0.15, 0.4, 2201)
    found = np.array([factor((0.2 + d, 0.0, 0.0)) for d in away])
    assert np.all(np.isinf(found[away <= -1e-9]))
    outside = away > 1e-9
    assert np.all(np.isfinite(found[outside]))
    assert np.all(found[outside] >= 1.0)
    assert np.all(np.diff(found[outside]) <= 0.0)
    reach = CUTOFF * 0.5 * 0.25 - 0.2
    assert np.all(found[away >= reach] == 1.0)
    near = outside & (away < reach - 1e-9)
    expected = 1.0 + 1e3 * ((0.2 / away[near]) ** 2 - (0.2 / reach) ** 2)
    np.testing.assert_allclose(found[near], expected, rtol=1e-6, atol=1e-6)


def test_the_completed_surface_is_infinitely_far_away():
    """The length of the path to it, the integral of sqrt(m), grows by as much with every halving of what is left."""

    def length(first: float, last: float) -> float:
        at = np.geomspace(last, first, 4001)
        middles = 0.5 * (at[1:] + at[:-1])
        return float(sum(np.sqrt([completion(d, 0.2, 0.125, 1e3) for d in middles]) * np.diff(at)))

    halvings = [length(0.02 / 2**i, 0.02 / 2 ** (i + 1)) for i in range(12)]
    np.testing.assert_allclose(halvings, np.sqrt(1e3) * 0.2 * np.log(2.0), rtol=0.01)


def test_the_completed_factor_of_a_cloud_is_continuous_and_falls():
    field = DistanceField.of(np.zeros((1, 3)), 0.02, 0.02, 0.05)
    line = np.linspace(0.0, 0.6, 3001)[:, None] * [1.0, 0.0, 0.0]
    found = np.array([1.0 + cloud_factor(*x, 0.05, *field, 1e3, 0.5, True) for x in line])
    assert np.isinf(found[0])
    assert found[-1] == 1.0
    assert np.all(found >= 1.0)
    finite = found[np.isfinite(found) & (found < 1e4)]
    assert np.all(np.diff(finite) <= 1e-9)
    assert np.max(np.abs(np.diff(np.sqrt(finite)))) < 5.0
