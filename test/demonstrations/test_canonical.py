"""Canonical demonstrations: the ends are taken out and come back exactly, and blends stay between what was shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.canonical import PoseForm, mean_pose, offsets_between, sample_pose_arc
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.quaternions import angle_between, normalise, rotate_by

SAMPLES, ROTATION_LENGTH = 80, 0.1


@pytest.fixture(scope="module")
def canonical(varying_fan):
    return PoseForm(varying_fan, ROTATION_LENGTH)


@pytest.fixture(scope="module")
def sheet(canonical):
    return canonical.sheet(SAMPLES)


def with_offsets(sheet, start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Canonical curves with offsets (N, 6) put in."""
    s = np.linspace(0.0, 1.0, sheet.positions.shape[1])[:, None]
    blend = (1.0 - s) * start[:, None] + s * goal[:, None]
    return sheet.positions + blend[..., :3], rotate_by(blend[..., 3:], sheet.quaternions)


def test_offsets_put_in_again_give_the_demonstrations_back(varying_fan, sheet):
    positions, quaternions = with_offsets(sheet, sheet.start_offsets, sheet.goal_offsets)
    for i, item in enumerate(varying_fan):
        expected = sample_pose_arc(item, SAMPLES, ROTATION_LENGTH)
        np.testing.assert_allclose(positions[i], expected[0], atol=1e-12)
        assert angle_between(quaternions[i], expected[1]).max() < 1e-7


def test_every_canonical_curve_runs_from_the_mean_start_to_the_mean_goal(varying_fan, canonical, sheet):
    for at, pose in ((0, canonical.start), (-1, canonical.goal)):
        np.testing.assert_allclose(sheet.positions[:, at], np.tile(pose[:3], (len(varying_fan), 1)), atol=1e-12)
        assert angle_between(sheet.quaternions[:, at], pose[3:]).max() < 1e-7
        np.testing.assert_allclose(pose[:3], np.mean([item.positions[at] for item in varying_fan], axis=0))
    assert np.abs(sheet.start_offsets.sum(axis=0)[:3]).max() < 1e-12
    assert np.ptp(sheet.start_offsets, axis=0).min() > 0.005


def test_all_quaternions_at_equal_fractions_lie_in_one_hemisphere(varying_fan, sheet):
    assert np.sum(sheet.quaternions * sheet.quaternions[:1], axis=-1).min() > 0.0
    flipped = Demonstrations(
        tuple(
            Demonstration(item.positions, -item.quaternions if i % 2 else item.quaternions, item.times, item.name)
            for i, item in enumerate(varying_fan)
        )
    )
    same = PoseForm(flipped, ROTATION_LENGTH).sheet(SAMPLES)
    np.testing.assert_allclose(same.positions, sheet.positions, atol=1e-12)
    assert angle_between(same.quaternions, sheet.quaternions).max() < 1e-6
    np.testing.assert_allclose(same.goal_offsets, sheet.goal_offsets, atol=1e-9)


def test_a_demonstration_carried_elsewhere_has_the_same_canonical_curve_and_other_offsets(canonical, sheet):
    """Offsets that blend over the arc: put in, they are found again."""
    random = np.random.default_rng(4)
    start, goal = random.normal(scale=[0.02] * 3 + [0.1] * 3, size=(2, len(sheet.positions), 6))
    positions, quaternions = with_offsets(sheet, start, goal)
    found_start = offsets_between(canonical.start, positions[:, 0], quaternions[:, 0])
    found_goal = offsets_between(canonical.goal, positions[:, -1], quaternions[:, -1])
    np.testing.assert_allclose(found_start, start, atol=1e-7)
    np.testing.assert_allclose(found_goal, goal, atol=1e-7)


def test_times_are_those_of_the_motion_from_where_it_sets_out(varying_fan):
    """The same motion, after a second in which the hand stands, and before three."""
    times = PoseForm(varying_fan, ROTATION_LENGTH).times(SAMPLES)
    waiting = Demonstrations(
        tuple(
            Demonstration(
                item.positions[[0, *range(len(item)), -1]], item.quaternions[[0, *range(len(item)), -1]],
                np.concatenate([[item.times[0] - 1.0], item.times, [item.times[-1] + 3.0]]), item.name,
            )
            for item in varying_fan
        )
    )  # fmt: skip
    np.testing.assert_allclose(PoseForm(waiting, ROTATION_LENGTH).times(SAMPLES), times, atol=1e-9)
    assert np.all(times[:, 0] == 0.0)
    assert np.all(np.diff(times, axis=1) >= 0.0)
    for row, item in zip(times, varying_fan, strict=True):
        assert row[-1] == pytest.approx(item.times[-1] - item.times[0], rel=0.05)
        # Samples lie where they were at these times.
        positions, _ = sample_pose_arc(item, SAMPLES, ROTATION_LENGTH)
        passed = [np.interp(row + item.times[0], item.times, column) for column in item.positions.T]
        np.testing.assert_allclose(np.stack(passed, axis=1)[1:-1], positions[1:-1], atol=2e-3)


def test_nobody_knows_the_times_of_recordings_that_have_none(varying_fan):
    assert PoseForm(varying_fan, ROTATION_LENGTH).sheet(SAMPLES).times is not None
    assert PoseForm(replace(varying_fan, has_times=False), ROTATION_LENGTH).sheet(SAMPLES).times is None


def test_a_single_demonstration_has_no_offsets(varying_fan):
    one = PoseForm(Demonstrations((varying_fan[2],)), ROTATION_LENGTH).sheet(SAMPLES)
    np.testing.assert_allclose(one.start_offsets, 0.0, atol=1e-7)
    np.testing.assert_allclose(one.goal_offsets, 0.0, atol=1e-7)
    positions, _ = sample_pose_arc(varying_fan[2], SAMPLES, ROTATION_LENGTH)
    np.testing.assert_allclose(one.positions[0], positions, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_blends_stay_in_the_hull_and_a_corner_of_it_is_a_demonstration(sheet, seed):
    count = len(sheet.positions)
    weights = np.random.default_rng(seed).dirichlet(np.full(count, 0.7), 20)
    positions, quaternions = sheet.mean_curves(weights)
    assert np.all(positions <= sheet.positions.max(axis=0) + 1e-12)
    assert np.all(positions >= sheet.positions.min(axis=0) - 1e-12)
    widest = max(angle_between(sheet.quaternions, other).max() for other in sheet.quaternions)
    nearest = np.min([angle_between(quaternions, other) for other in sheet.quaternions], axis=0)
    assert nearest.max() <= widest + 1e-9
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=-1), 1.0, atol=1e-12)
    corners = sheet.mean_curves(np.eye(count))
    np.testing.assert_allclose(corners[0], sheet.positions, atol=1e-12)
    assert angle_between(corners[1], sheet.quaternions).max() < 1e-7


def test_blended_quaternions_are_continuous_along_a_curve(sheet):
    weights = np.random.default_rng(1).dirichlet(np.ones(len(sheet.positions)), 30)
    _, quaternions = sheet.mean_curves(weights)
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
    moved, turned = sample_pose_arc(shown, 201, 0.1)
    steps = np.hypot(np.linalg.norm(np.diff(moved, axis=0), axis=1), 0.1 * angle_between(turned[1:], turned[:-1]))
    # The one step that changes from moving to turning cuts the corner.
    even = np.isclose(steps, (0.3 + 0.1 * np.pi) / 200, rtol=1e-6)
    assert np.count_nonzero(~even) == 1
    assert steps.max() < 1.01 * steps[0]


def circles(ease: float) -> Demonstrations:
    """Three rounds of different places, at even speed, but for a share of their time in which they set out and rest."""
    arc = np.linspace(0.0, 1.0, 200)
    angle, quaternions = 2.0 * np.pi * arc, np.tile([1.0, 0.0, 0.0, 0.0], (200, 1))
    shape = 0.1 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    # slow at both ends: dt / ds is large there
    times = np.append(0.0, np.cumsum(0.02 * (1.0 + ease * (np.minimum(arc, 1.0 - arc) < 0.04))[1:]))
    items = [
        Demonstration([0.5, 0.01 * number, 0.3] + (1.0 + 0.1 * number) * shape, quaternions, times, f"{number}")
        for number in range(3)
    ]
    return Demonstrations(tuple(items), frame="base")


def test_rounds_are_displaced_as_a_whole_and_their_mean_is_not() -> None:
    sheet = PoseForm(circles(0.0), ROTATION_LENGTH, closed=True).sheet(SAMPLES)
    np.testing.assert_array_equal(sheet.start_offsets, sheet.goal_offsets)
    np.testing.assert_allclose(sheet.start_offsets.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(sheet.start_offsets[:, 1], [-0.01, 0.0, 0.01], atol=1e-6)
    # no place of the round is more alike than another: circles of several sizes stay apart where they begin
    apart = sheet.positions.std(axis=0)
    np.testing.assert_allclose(np.linalg.norm(apart[0]), np.linalg.norm(apart[SAMPLES // 2]), rtol=1e-2)
    unrolled = sheet.unrolled()
    assert unrolled.positions.shape[1] == 3 * (SAMPLES - 1) + 1
    for number in range(3):
        part = slice(number * (SAMPLES - 1), (number + 1) * (SAMPLES - 1) + 1)
        np.testing.assert_allclose(unrolled.positions[:, part], sheet.positions, rtol=0.0, atol=1e-12)
        lasting = sheet.times[:, -1:]
        np.testing.assert_allclose(unrolled.times[:, part], sheet.times + number * lasting)


def test_a_round_that_was_shown_from_rest_to_rest_runs_through_its_seam_and_another_stays_as_it_was() -> None:
    even = PoseForm(circles(0.0), ROTATION_LENGTH, closed=True).sheet(SAMPLES).times
    rests = PoseForm(circles(9.0), ROTATION_LENGTH, closed=True).sheet(SAMPLES).times
    rates = np.diff(even, axis=1)
    np.testing.assert_allclose(rates, np.broadcast_to(np.median(rates), rates.shape), rtol=0.1)
    np.testing.assert_allclose(np.diff(rests, axis=1), np.broadcast_to(np.median(rates), rates.shape), rtol=0.1)
    open_times = PoseForm(circles(9.0), ROTATION_LENGTH).sheet(SAMPLES).times
    assert np.diff(open_times, axis=1).max() > 5.0 * np.median(rates)
