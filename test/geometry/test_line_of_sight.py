"""What a cloud shows of what can be seen: behind it is hidden, before it seen through, and else nothing is known."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.geometry.line_of_sight import SQUARES, TOLERANCE, LineOfSight
from geodesic_motion_ros.geometry.voxels import VoxelGrid
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import SelfFilter

EYE = np.array([0.2, -0.3, 0.4])
#: The angle of a square at most [rad].
SQUARE = 2.0 / SQUARES


def see(points: np.ndarray, eye: np.ndarray | None = EYE) -> LineOfSight:
    """What a cloud of points (n, 3) [m] shows, with no arm in it."""
    nobody = SelfFilter(Robot.named("panda"), CollisionModel.named("panda"))
    grid = VoxelGrid.around(EYE, 0.1, 0.1)
    return nobody.sort(points, (np.zeros((0, 3)), np.zeros(0)), grid, eye).sight


def directions(count: int = 5000) -> np.ndarray:
    """Unit vectors (count, 3) to everywhere."""
    result = np.random.default_rng(0).normal(size=(count, 3))
    return result / np.linalg.norm(result, axis=1, keepdims=True)


def disc(direction: np.ndarray, distance: float, half_angle: float) -> np.ndarray:
    """Points (n, 3) [m] of a disc across a direction, dense enough to be in each square."""
    across = np.linalg.svd(direction[None])[2][1:]
    steps = np.arange(-half_angle, half_angle, 0.25 * SQUARE)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    offsets = offsets[np.linalg.norm(offsets, axis=1) < half_angle]
    return EYE + distance * (direction + offsets @ across)


@pytest.fixture(scope="module")
def surrounded() -> LineOfSight:
    """A ball of 1 m around the eye is seen."""
    # Dense along the sides of a cube, so that no square is left out.
    steps = (np.arange(2 * SQUARES) + 0.5) / SQUARES - 1.0
    u, v = (one.ravel() for one in np.meshgrid(steps, steps))
    sides = [
        np.roll(np.column_stack([np.full(u.size, sign), u, v]), axis, axis=1) for axis in range(3) for sign in (1, -1)
    ]
    around = np.concatenate(sides)
    return see(EYE + around / np.linalg.norm(around, axis=1, keepdims=True))


@pytest.mark.parametrize(
    ("distance", "hidden", "through"),
    [
        (0.3, False, True),
        (1.0 - 1.1 * TOLERANCE, False, True),
        (1.0 - 0.9 * TOLERANCE, False, False),
        (1.0 + 0.9 * TOLERANCE, False, False),
        (1.0 + 1.1 * TOLERANCE, True, False),
        (3.0, True, False),
    ],
)
def test_in_all_directions_behind_is_hidden_and_before_is_seen_through(surrounded, distance, hidden, through):
    points = EYE + distance * np.concatenate([directions(), np.eye(3), -np.eye(3)])
    assert np.all(surrounded.hides(points) == hidden)
    assert np.all(surrounded.hides_beside(points) == hidden)
    assert np.all(surrounded.sees_through(points) == through)


@pytest.mark.parametrize("direction", [*np.eye(3), *-np.eye(3), np.array([0.6, 0.0, -0.8])])
def test_where_a_direction_shows_no_point_nothing_is_known(direction):
    sight, elsewhere = see(disc(direction, 1.0, 0.1)), directions()
    assert sight.hides(EYE + 2.0 * direction[None]).all()
    assert sight.sees_through(EYE + 0.5 * direction[None]).all()
    elsewhere = elsewhere[elsewhere @ direction < np.cos(0.1 + 4.0 * SQUARE)]
    for distance in (0.5, 2.0):
        points = EYE + distance * elsewhere
        assert not sight.hides(points).any()
        assert not sight.hides_beside(points).any()
        assert not sight.sees_through(points).any()


def test_beside_what_is_near_nothing_is_seen_through_though_it_is_not_hidden():
    """The edge of something near before a wall."""
    ahead, sideways = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    near = disc(ahead, 0.5, 0.1)
    sight = see(np.concatenate([near, disc(ahead, 2.0, 0.5)]))
    # In the next square beyond the edge of the near one, and in the third.
    edge = np.max((near - EYE)[:, 1] / 0.5)
    beside, far = (EYE + 1.0 * (ahead + (edge + squares * SQUARE) * sideways)[None] for squares in (1.0, 3.0))
    assert sight.hides_beside(beside).all()
    assert not sight.sees_through(beside).any()
    assert not sight.hides(beside).any()
    assert not sight.hides_beside(far).any()
    assert sight.sees_through(far).all()


def test_the_nearest_point_of_a_direction_counts():
    """Whatever their order."""
    near, far = disc(np.array([0.0, 0.0, 1.0]), 1.0, 0.1), disc(np.array([0.0, 0.0, 1.0]), 2.0, 0.1)
    between = EYE + np.array([[0.0, 0.0, 1.5]])
    for both in ([near, far], [far, near]):
        assert see(np.concatenate(both)).hides(between).all()
    assert see(far).sees_through(between).all()


def test_from_an_unknown_place_nothing_is_hidden_and_nothing_seen_through():
    sight = see(disc(np.array([1.0, 0.0, 0.0]), 1.0, 0.1), None)
    points = EYE + np.array([[0.5, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for result in (sight.hides(points), sight.hides_beside(points), sight.sees_through(points)):
        assert result.shape == (3,)
        assert not result.any()


def test_what_is_where_the_eye_is_is_not_hidden():
    assert not see(disc(np.array([1.0, 0.0, 0.0]), 1.0, 0.1)).hides(EYE[None]).any()
    assert not LineOfSight.blank(EYE).sees_through(EYE + directions()).any()
    assert not LineOfSight.blank(EYE).hides(EYE + directions()).any()
