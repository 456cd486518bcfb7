"""The arm is taken out of clouds, all of it and no more than the padding; what is left is sorted into cubes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import SelfFilter, SortedCloud
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

PADDING, EDGE, BEYOND = 0.02, 0.02, 0.3
BOTTLE = HeldObject("bottle", "cylinder", (0.04, 0.25), (0.0, 0.0, 0.05))
EYE = np.array([1.4, -0.8, 1.2])


@pytest.fixture(scope="module", params=["panda", "ur5"])
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def robot(name: str) -> Robot:
    return Robot.named(name)


@pytest.fixture(scope="module")
def arm(name: str, robot: Robot) -> SelfFilter:
    return SelfFilter(robot, CollisionModel.named(name))


@pytest.fixture(scope="module")
def geometry(name: str) -> Iterator[CollisionGeometry]:
    with CollisionGeometry(name) as geometry:
        yield geometry


def sort(
    arm: SelfFilter,
    points: np.ndarray,
    joints: np.ndarray,
    held: tuple[HeldObject, ...] = (),
    padding: float = PADDING,
    edge: float = EDGE,
    eye: np.ndarray | None = None,
) -> SortedCloud:
    centres, radii = arm.spheres(joints, held)
    return arm.sort(points, (centres, radii + padding), arm.grid(edge, BEYOND), eye)


def gaps(arm: SelfFilter, points: np.ndarray, joints: np.ndarray, held: tuple[HeldObject, ...] = ()) -> np.ndarray:
    """Signed distances (n,) [m] of points from the nearest sphere, without a cube."""
    centres, radii = arm.spheres(joints, held)
    return np.min(cdist(points, centres) - radii, axis=1)


def around(arm: SelfFilter, joints: np.ndarray, random: np.random.Generator, count: int = 20000) -> np.ndarray:
    """Points (count, 3) [m] on the arm, near it, far from it, and out of its reach."""
    centres, radii = arm.spheres(joints, ())
    chosen = random.integers(len(radii), size=count)
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    off = random.choice([-0.02, 0.0, PADDING, 0.1, 0.5, 2.0], count) + random.normal(0.0, 0.01, count)
    return centres[chosen] + (radii[chosen] + off)[:, None] * directions


def test_the_points_of_its_meshes_are_all_dropped(robot, arm, geometry):
    random = np.random.default_rng(0)
    for joints in robot.sample(10, random):
        rotations, origins = robot.link_frames(joints)
        points = []
        for part in geometry.parts:
            link = robot.link_names.index(part.link)
            points.append(part.vertices @ rotations[link].T + origins[link])
        result = sort(arm, np.concatenate(points), joints, padding=0.0)
        assert len(result.places) == 0
        assert (result.of_arm, result.out_of_reach) == (sum(map(len, points)), 0)


@pytest.mark.parametrize(("padding", "edge"), [(0.0, 0.02), (0.02, 0.02), (0.07, 0.02), (0.02, 0.01), (0.02, 0.15)])
@pytest.mark.parametrize("held", [(), (BOTTLE,)], ids=["empty hand", "bottle"])
def test_what_is_within_the_padding_is_dropped_and_all_else_is_in_its_cube(robot, arm, padding, edge, held):
    random = np.random.default_rng(1)
    for joints in robot.sample(5, random):
        points, grid = around(arm, joints, random), arm.grid(edge, BEYOND)
        in_reach = np.linalg.norm(points - grid.centre, axis=1) <= grid.radius
        kept = points[in_reach & (gaps(arm, points, joints, held) > padding)]
        places, cube_of, counts = np.unique(np.rint(kept / edge), axis=0, return_inverse=True, return_counts=True)
        means = np.zeros(places.shape)
        np.add.at(means, cube_of.ravel(), kept)

        result = sort(arm, points, joints, held, padding, edge)
        order = np.lexsort(result.places.T[::-1])
        np.testing.assert_array_equal(result.places[order], places)
        np.testing.assert_array_equal(result.counts[order], counts)
        means /= counts[:, None]
        np.testing.assert_allclose(result.means[order], means, atol=1e-9)
        off, spreads = kept - means[cube_of.ravel()], np.zeros((len(places), 6))
        np.add.at(spreads, cube_of.ravel(), off[:, [0, 1, 2, 0, 0, 1]] * off[:, [0, 1, 2, 1, 2, 2]])
        np.testing.assert_allclose(result.spreads[order], spreads / counts[:, None], atol=1e-12)
        assert result.out_of_reach == np.count_nonzero(~in_reach) > 0
        assert result.of_arm == np.count_nonzero(in_reach) - len(kept) > 0


def test_all_that_may_come_near_the_arm_is_within_reach(robot, arm):
    grid = arm.grid(EDGE, BEYOND)
    for joints in robot.sample(200, np.random.default_rng(2)):
        centres, radii = arm.spheres(joints, ())
        assert np.max(np.linalg.norm(centres - grid.centre, axis=1) + radii) + BEYOND <= grid.radius


def test_a_held_object_is_dropped_as_long_as_it_is_held(robot, arm):
    position, _ = robot.forward(robot.ready)
    centre = position + 0.15 * (robot.link_frames(robot.ready)[0][-1] @ np.array([0.0, 0.0, 1.0]))
    points = centre + np.random.default_rng(2).uniform(-0.01, 0.01, (500, 3))
    assert sort(arm, points, robot.ready).of_arm == 0
    assert sort(arm, points, robot.ready, (BOTTLE,)).of_arm == len(points)


def test_a_cloud_without_points_has_no_cubes(robot, arm):
    nothing = sort(arm, np.zeros((0, 3)), robot.ready, eye=EYE)
    assert (len(nothing.places), nothing.of_arm, nothing.out_of_reach) == (0, 0, 0)


def test_where_no_cloud_shows_the_arm_nothing_is_dropped(robot, arm):
    points = around(arm, robot.ready, np.random.default_rng(3))
    result = arm.sort(points, (np.zeros((0, 3)), np.zeros(0)), arm.grid(EDGE, BEYOND), None)
    assert result.of_arm == 0
    assert np.sum(result.counts) + result.out_of_reach == len(points)


def test_what_is_no_farther_from_the_spheres_touches_them(robot, arm):
    points = around(arm, robot.ready, np.random.default_rng(4))
    for by in (0.0, EDGE):
        touching = arm.touches(points, arm.spheres(robot.ready, ()), by)
        np.testing.assert_array_equal(touching, gaps(arm, points, robot.ready) <= by)
        assert 0 < np.count_nonzero(touching) < len(points)


def test_the_arm_hides_what_is_behind_it_though_its_points_are_dropped(robot, arm):
    centres, radii = arm.spheres(robot.ready, ())
    # The points of the largest sphere that are nearest to the camera.
    largest = np.argmax(radii)
    line = (EYE - centres[largest]) / np.linalg.norm(EYE - centres[largest])
    points = centres[largest] + radii[largest] * line + np.random.default_rng(5).uniform(-0.01, 0.01, (500, 3))
    result, behind = sort(arm, points, robot.ready, eye=EYE), centres[largest][None] - 0.3 * line
    assert len(result.places) == 0
    assert result.sight.hides(behind).all()
    assert not sort(arm, points, robot.ready).sight.hides(behind).any()
