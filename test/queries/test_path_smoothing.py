"""Smoothing keeps the ends of a path, takes its corners, and both ends can be moved to where they are requested."""

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between, normalise, slerp
from geodesic_motion_ros.queries.path_smoothing import correct_ends, resample_latent, smooth_latent, smooth_poses


def staircase(count: int = 12) -> np.ndarray:
    steps = np.tile([[1.0, 0.0], [0.0, 1.0]], (count, 1))
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def test_a_path_of_one_point_stays_there() -> None:
    point = np.array([[0.3, -0.2]])
    np.testing.assert_array_equal(resample_latent(point, 0.1, 5), np.repeat(point, 5, axis=0))


def test_resampling_is_even_and_keeps_the_ends():
    points = resample_latent(staircase(), 0.1)
    np.testing.assert_array_equal(points[[0, -1]], staircase()[[0, -1]])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= 0.1 + 1e-12


def test_smoothing_straightens_a_staircase_between_fixed_ends():
    points = resample_latent(staircase(), 0.25)
    smooth = smooth_latent(points, 8.0)
    np.testing.assert_array_equal(smooth[[0, -1]], points[[0, -1]])
    inner = smooth[5:-5]
    assert np.abs(inner[:, 0] - inner[:, 1]).max() < 0.6
    assert np.linalg.norm(np.diff(smooth, axis=0), axis=1).sum() < np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    turns = np.linalg.norm(np.diff(smooth, 2, axis=0), axis=1)
    assert turns.max() < np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max()


def test_smoothing_a_straight_line_changes_nothing():
    line = np.linspace([0.0, 1.0], [2.0, 3.0], 50)
    np.testing.assert_allclose(smooth_latent(line, 4.0), line, atol=1e-12)


def test_smoothing_works_on_a_path_shorter_than_the_filter():
    line = np.linspace([0.0, 1.0], [0.1, 1.1], 5)
    np.testing.assert_allclose(smooth_latent(line, 4.0), line, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_corrected_curves_meet_both_ends_and_fade_between(seed):
    random = np.random.default_rng(seed)
    positions = np.cumsum(random.normal(size=(50, 3)), axis=0)
    quaternions = slerp(normalise(random.normal(size=4)), normalise(random.normal(size=4)), np.linspace(0, 1, 50))
    start, goal = (
        (positions[i] + random.normal(scale=0.1, size=3), normalise(quaternions[i] + random.normal(scale=0.1, size=4)))
        for i in (0, -1)
    )
    moved, turned = correct_ends(positions, quaternions, start, goal)
    for i, (position, quaternion) in ((0, start), (-1, goal)):
        np.testing.assert_allclose(moved[i], position, atol=1e-12)
        assert angle_between(turned[i], quaternion) < 1e-7
    largest = max(np.linalg.norm(start[0] - positions[0]), np.linalg.norm(goal[0] - positions[-1]))
    assert np.linalg.norm(moved - positions, axis=1).max() <= largest + 1e-12


def test_smoothed_poses_keep_their_ends_and_lose_their_kinks():
    share = np.linspace(0.0, 1.0, 60)
    positions = np.stack([share, np.abs(share - 0.5), 0.0 * share], axis=1)
    quaternions = normalise(np.stack([1.0 + 0.0 * share, np.abs(share - 0.5), 0.0 * share, 0.0 * share], axis=1))
    moved, turned = smooth_poses(positions, quaternions, 3.0)
    np.testing.assert_array_equal(moved[[0, -1]], positions[[0, -1]])
    np.testing.assert_allclose(turned[[0, -1]], quaternions[[0, -1]], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1.0)
    for smooth, raw in ((moved, positions), (turned, quaternions)):
        assert np.abs(np.diff(smooth, 2, axis=0)).max() < 0.3 * np.abs(np.diff(raw, 2, axis=0)).max()
