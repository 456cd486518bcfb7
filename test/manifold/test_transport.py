"""Transport: both ends exactly, blends between, corrections along the mean paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between, normalise, rotate_by
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.manifold.transport import Offsets, blended, corrections_at, faded


def some_offsets(seed: int = 0, mean_paths: int = 2, samples: int = 7) -> Offsets:
    random = np.random.default_rng(seed)
    scale = np.repeat([0.05, 0.3], 3)
    corrections = random.normal(scale=0.1 * scale, size=(mean_paths, samples, 6))
    return Offsets(*random.normal(scale=scale, size=(2, 6)), 0.1, 0.9, corrections)


def some_poses(count: int = 40, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    return random.normal(size=(count, 3)), normalise(random.normal(size=(count, 4)))


def test_carrying_adds_translations_and_turns_in_the_base_frame():
    positions, quaternions = some_poses()
    displacements = np.random.default_rng(1).normal(scale=0.4, size=(40, 6))
    displacements[0] = 0.0
    displacements[1, 3:] = [1e-12, 0.0, 0.0]
    before = positions.copy(), quaternions.copy()
    moved, turned = carried(positions, quaternions, displacements)
    np.testing.assert_array_equal(positions, before[0])
    np.testing.assert_array_equal(quaternions, before[1])
    np.testing.assert_allclose(moved, positions + displacements[:, :3], atol=1e-15)
    assert angle_between(turned, rotate_by(displacements[:, 3:], quaternions)).max() < 1e-7
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1.0, atol=1e-12)
    np.testing.assert_array_equal(turned[0], quaternions[0])


@pytest.mark.parametrize("seed", range(5))
def test_without_corrections_each_end_is_carried_by_its_own_offset_exactly(seed):
    offsets = some_offsets(seed, mean_paths=0)
    none = np.empty((1, 0))
    for progress, expected in ((0.1, offsets.start), (0.9, offsets.goal), (0.0, offsets.start), (1.0, offsets.goal)):
        np.testing.assert_allclose(offsets.displacements(np.array([progress]), none)[0], expected, atol=1e-15)
    between = offsets.displacements(np.array([0.3]), none)[0]
    np.testing.assert_allclose(between, 0.75 * offsets.start + 0.25 * offsets.goal, atol=1e-15)


@pytest.mark.parametrize("fade", [1.0, 2.0, 4.0])
def test_the_start_fades_as_a_power_and_the_goal_has_the_rest(fade):
    offsets, none = replace(some_offsets(1, mean_paths=0), fade=fade), np.empty((2, 0))
    ends = offsets.displacements(np.array([0.1, 0.9]), none)
    np.testing.assert_allclose(ends, np.stack([offsets.start, offsets.goal]), atol=1e-15)
    left = 0.75**fade
    between = offsets.displacements(np.array([0.3]), none[:1])[0]
    np.testing.assert_allclose(between, left * offsets.start + (1.0 - left) * offsets.goal, atol=1e-15)


def test_a_fade_of_one_rounds_nothing():
    t = np.random.default_rng(0).uniform(size=1000)
    np.testing.assert_array_equal(faded(t, 1.0), t)


def displaced(fade, start_progress, start, goal, progress, shares) -> np.ndarray:
    none = np.zeros((0, 2, 6))
    return Offsets(start, goal, start_progress, 1.0, none, fade).displacements(progress, shares)


@pytest.mark.parametrize("fade", [1.0, 2.0, 4.0])
def test_offsets_planned_again_from_half_of_the_path_keep_the_rest_of_it(fade):
    start, goal = np.random.default_rng(2).normal(size=(2, 6))
    progress, shares = np.array([0.4, 0.55, 0.8, 1.0]), np.empty((4, 0))
    whole = displaced(fade, 0.0, start, goal, progress, shares)
    again = displaced(fade, 0.4, whole[0], goal, progress, shares)
    np.testing.assert_allclose(again, whole, atol=1e-14)
    # The control: what goes on with another fade leaves the path.
    other = displaced(3.0, 0.4, whole[0], goal, progress, shares)
    assert np.abs(other - whole).max() > 0.01


@pytest.mark.parametrize("mean_paths", [0, 1, 3])
def test_no_offsets_are_the_identity(mean_paths):
    progress = np.linspace(0.0, 1.0, 40)
    shares = np.full((40, mean_paths), 1.0 / max(mean_paths, 1))
    displacements = Offsets.none(mean_paths).displacements(progress, shares)
    np.testing.assert_array_equal(displacements, 0.0)
    positions, quaternions = some_poses()
    moved, turned = carried(positions, quaternions, displacements)
    np.testing.assert_array_equal(moved, positions)
    np.testing.assert_array_equal(turned, quaternions)


def test_corrections_are_interpolated_over_progress_and_blended_by_the_shares():
    offsets = some_offsets(3)
    at = np.linspace(0.0, 1.0, offsets.corrections.shape[1])
    progress = np.random.default_rng(0).uniform(0.0, 1.0, 50)
    shares = np.random.default_rng(1).dirichlet(np.ones(2), 50)
    each = np.stack([[np.interp(progress, at, column) for column in table.T] for table in offsets.corrections])
    expected = np.einsum("nk,kjn->nj", shares, each)
    np.testing.assert_allclose(corrections_at(offsets.corrections, progress, shares), expected, atol=1e-12)
    tau = np.clip((progress - 0.1) / 0.8, 0.0, 1.0)[:, None]
    expected += (1.0 - tau) * offsets.start + tau * offsets.goal
    np.testing.assert_allclose(offsets.displacements(progress, shares), expected, atol=1e-12)


def test_corrections_are_held_beyond_the_ends_of_progress():
    offsets = some_offsets(5, mean_paths=1)
    found = corrections_at(offsets.corrections, np.array([-0.3, 0.0, 1.0, 1.4]), np.ones((4, 1)))
    np.testing.assert_allclose(found, offsets.corrections[0][[0, 0, -1, -1]], atol=1e-15)


def test_displacements_keep_the_shape_of_progress():
    offsets = some_offsets()
    progress = np.random.default_rng(0).uniform(size=(5, 3))
    shares = np.random.default_rng(1).dirichlet(np.ones(2), (5, 3))
    found = offsets.displacements(progress, shares)
    assert found.shape == (5, 3, 6)
    for i in range(5):
        np.testing.assert_allclose(found[i], offsets.displacements(progress[i], shares[i]), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize(("start", "goal"), [(0.9, 0.1), (0.5, 0.5)])
def test_progress_may_run_backwards_or_stand_still(start, goal):
    tau = blended(np.array([start, goal]), start, goal)
    assert tau[1] == 1.0
    assert tau[0] == (0.0 if start != goal else 1.0)
    assert np.all(np.isfinite(blended(np.linspace(0.0, 1.0, 20), start, goal)))
