"""Canonical demonstrations: the ends are taken out and come back exactly, and blends stay between what was shown."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.canonical import along_arc, canonical_form, mean_pose, offsets_between
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.quaternions import angle_between, normalise, rotate_by

SAMPLES, ROTATION_LENGTH = 80, 0.1


@pytest.fixture(scope="module")
def form(varying_fan):
    return canonical_form(varying_fan, SAMPLES, ROTATION_LENGTH)


def with_offsets(form, start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Canonical curves with offsets (N, 6) put in."""
    s = np.linspace(0.0, 1.0, form.positions.shape[1])[:, None]
    blend = (1.0 - s) * start[:, None] + s * goal[:, None]
    return form.positions + blend[..., :3], rotate_by(blend[..., 3:], form.quaternions)


def test_offsets_put_in_again_give_the_demonstrations_back(varying_fan, form):
    positions, quaternions = with_offsets(form, form.start_offsets, form.goal_offsets)
    for i, item in enumerate(varying_fan):
        expected = along_arc(item, SAMPLES, ROTATION_LENGTH)
        np.testing.assert_allclose(positions[i], expected[0], atol=1e-12)
        assert angle_between(quaternions[i], expected[1]).max() < 1e-7


def test_every_canonical_curve_runs_from_the_mean_start_to_the_mean_goal(varying_fan, form):
    for at, pose in ((0, form.start), (-1, form.goal)):
        np.testing.assert_allclose(form.positions[:, at], np.tile(pose[:3], (len(varying_fan), 1)), atol=1e-12)
        assert angle_between(form.quaternions[:, at], pose[3:]).max() < 1e-7
        np.testing.assert_allclose(pose[:3], np.mean([item.positions[at] for item in varying_fan], axis=0))
    assert np.abs(form.start_offsets.sum(axis=0)[:3]).max() < 1e-12
    assert np.ptp(form.start_offsets, axis=0).min() > 0.005


def test_all_quaternions_at_equal_fractions_lie_in_one_hemisphere(varying_fan, form):
    assert np.sum(form.quaternions * form.quaternions[:1], axis=-1).min() > 0.0
    flipped = Demonstrations(
        tuple(
            Demonstration(item.positions, -item.quaternions if i % 2 else item.quaternions, item.times, item.name)
            for i, item in enumerate(varying_fan)
        )
    )
    same = canonical_form(flipped, SAMPLES, ROTATION_LENGTH)
    np.testing.assert_allclose(same.positions, form.positions, atol=1e-12)
    assert angle_between(same.quaternions, form.quaternions).max() < 1e-6
    np.testing.assert_allclose(same.goal_offsets, form.goal_offsets, atol=1e-9)


def test_a_demonstration_carried_elsewhere_has_the_same_canonical_curve_and_other_offsets(form):
    """Offsets that blend over the arc: put in, they are found again."""
    random = np.random.default_rng(4)
    start, goal = random.normal(scale=[0.02] * 3 + [0.1] * 3, size=(2, len(form.positions), 6))
    positions, quaternions = with_offsets(form, start, goal)
    found_start = offsets_between(form.start, positions[:, 0], quaternions[:, 0])
    found_goal = offsets_between(form.goal, positions[:, -1], quaternions[:, -1])
    np.testing.assert_allclose(found_start, start, atol=1e-7)
    np.testing.assert_allclose(found_goal, goal, atol=1e-7)


def test_a_single_demonstration_has_no_offsets(varying_fan):
    one = canonical_form(Demonstrations((varying_fan[2],)), SAMPLES, ROTATION_LENGTH)
    np.testing.assert_allclose(one.start_offsets, 0.0, atol=1e-7)
    np.testing.assert_allclose(one.goal_offsets, 0.0, atol=1e-7)
    np.testing.assert_allclose(one.positions[0], along_arc(varying_fan[2], SAMPLES, ROTATION_LENGTH)[0], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_blends_stay_in_the_hull_and_a_corner_of_it_is_a_demonstration(form, seed):
    count = len(form.positions)
    weights = np.random.default_rng(seed).dirichlet(np.full(count, 0.7), 20)
    positions, quaternions = form.blended(weights)
    assert np.all(positions <= form.positions.max(axis=0) + 1e-12)
    assert np.all(positions >= form.positions.min(axis=0) - 1e-12)
    widest = max(angle_between(form.quaternions, other).max() for other in form.quaternions)
    nearest = np.min([angle_between(quaternions, other) for other in form.quaternions], axis=0)
    assert nearest.max() <= widest + 1e-9
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=-1), 1.0, atol=1e-12)
    corners = form.blended(np.eye(count))
    np.testing.assert_allclose(corners[0], form.positions, atol=1e-12)
    assert angle_between(corners[1], form.quaternions).max() < 1e-7


def test_blended_quaternions_are_continuous_along_a_curve(form):
    weights = np.random.default_rng(1).dirichlet(np.ones(len(form.positions)), 30)
    _, quaternions = form.blended(weights)
    assert np.sum(quaternions[:, 1:] * quaternions[:, :-1], axis=-1).min() > 0.9


def test_the_mean_pose_of_turns_about_a_middle_is_that_middle():
    middle = normalise(np.array([0.3, -0.5, 0.7, 0.1]))
    turns = np.random.default_rng(0).normal(scale=0.2, size=(5, 3))
    quaternions = rotate_by(np.concatenate([turns, -turns]), np.tile(middle, (10, 1)))
    positions = np.arange(30.0).reshape(10, 3)
    pose = mean_pose(positions, quaternions)
    np.testing.assert_allclose(pose[:3], positions.mean(axis=0))
    assert angle_between(pose[3:], middle) < 1e-7
    assert pose[3:] @ quaternions[0] > 0.0


def test_samples_along_the_arc_are_evenly_spaced_with_turning_counted():
    turn = np.concatenate([np.zeros(50), np.linspace(0.0, np.pi, 50)])
    line = np.concatenate([np.linspace(0.0, 0.3, 50), np.full(50, 0.3)])
    quaternions = np.stack([np.cos(turn / 2), np.sin(turn / 2), 0.0 * turn, 0.0 * turn], axis=1)
    positions = np.stack([line, 0.0 * line, 0.0 * line], axis=1)
    shown = Demonstration(positions, quaternions, 0.01 * np.arange(100), "turn")
    moved, turned = along_arc(shown, 201, 0.1)
    steps = np.hypot(np.linalg.norm(np.diff(moved, axis=0), axis=1), 0.1 * angle_between(turned[1:], turned[:-1]))
    # The one step that changes from moving to turning cuts the corner.
    even = np.isclose(steps, (0.3 + 0.1 * np.pi) / 200, rtol=1e-6)
    assert np.count_nonzero(~even) == 1
    assert steps.max() < 1.01 * steps[0]
