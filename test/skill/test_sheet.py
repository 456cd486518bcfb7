"""What a canonical skill knows of its demonstrations: how far their ends went, their means, what the decoder lacks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.skill.sheet import METRES_PER_RADIAN, RotationCurves, beyond_demonstrated
from geodesic_motion_ros.utils.errors import SkillError

SCALE = np.repeat([1.0, METRES_PER_RADIAN], 3)


@pytest.fixture
def sheet(canonical_fan_skill):
    return canonical_fan_skill.canonical


@pytest.mark.parametrize("seed", range(20))
def test_nothing_inside_the_hull_is_beyond_it(seed):
    random = np.random.default_rng(seed)
    shown = random.normal(scale=0.03, size=(random.integers(1, 12), 6)) / SCALE
    inside = random.dirichlet(np.ones(len(shown))) @ shown
    np.testing.assert_allclose(SCALE * beyond_demonstrated(inside, shown), 0.0, atol=1e-6)
    for corner in shown:
        np.testing.assert_allclose(SCALE * beyond_demonstrated(corner, shown), 0.0, atol=1e-6)


def test_beyond_a_box_is_the_distance_to_its_side():
    corners = 0.02 * np.array([[x, y, z, 0, 0, 0] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    offset = np.array([0.05, 0.01, -0.06, 0.0, 0.0, 0.3])
    expected = [0.03, 0.0, -0.04, 0.0, 0.0, 0.3]
    np.testing.assert_allclose(beyond_demonstrated(offset, corners), expected, atol=1e-6)


def test_beyond_a_segment_and_a_single_point_is_the_plain_distance():
    segment = np.zeros((2, 6))
    segment[1, 0] = 0.1
    for offset, expected in ((0.05, 0.0), (0.13, 0.03), (-0.02, -0.02)):
        found = beyond_demonstrated(np.array([offset, 0.04, 0.0, 0.0, 0.0, 0.0]), segment)
        np.testing.assert_allclose(found, [expected, 0.04, 0.0, 0.0, 0.0, 0.0], atol=1e-6)
    offset = np.random.default_rng(0).normal(scale=0.1, size=6)
    np.testing.assert_allclose(beyond_demonstrated(offset, np.zeros((1, 6))), offset, atol=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_no_point_of_the_hull_is_nearer_than_what_is_said(seed):
    random = np.random.default_rng(seed)
    shown = random.normal(scale=0.03, size=(8, 6)) / SCALE
    offset = random.normal(scale=0.1, size=6) / SCALE
    beyond = np.linalg.norm(SCALE * beyond_demonstrated(offset, shown))
    hull = random.dirichlet(np.full(8, 0.3), 5000) @ shown
    assert beyond <= np.linalg.norm(SCALE * (offset - hull), axis=1).min() + 1e-9


@pytest.mark.parametrize("count", [10, 12, 15])
def test_a_demonstrated_end_among_ends_of_widely_different_sizes_is_not_beyond(count):
    for seed in range(1000):
        random = np.random.default_rng(seed)
        shown = random.normal(size=(count, 7)) * 10.0 ** random.uniform(-8.0, 0.0, (count, 1))
        np.testing.assert_allclose(beyond_demonstrated(shown[0], shown, np.ones(7)), 0.0, atol=1e-7 * np.ptp(shown))


def test_each_modes_weights_are_its_own_and_sum_to_one(sheet):
    modes = np.array([0, 0, 1, 0, 1, 1, 1])
    weights = replace(sheet, modes=modes).weights(np.zeros(6), np.zeros(6), conditioned=True)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert np.all(weights[0, modes == 1] == 0.0)
    assert np.all(weights[1, modes == 0] == 0.0)


def test_only_one_mode_with_a_finite_penalty_regresses(sheet):
    regressing = replace(sheet, penalty=0.1)
    offset = sheet.goal_offsets[2]
    mean = np.full((1, 7), 1.0 / 7.0)
    assert regressing.regresses
    assert not np.allclose(regressing.weights(sheet.start_offsets[2], offset, True), mean)
    np.testing.assert_allclose(regressing.weights(sheet.start_offsets[2], offset, False), mean)
    np.testing.assert_allclose(replace(sheet, penalty=math.inf).weights(sheet.start_offsets[2], offset, True), mean)
    assert not replace(regressing, modes=np.array([0, 1, 0, 1, 0, 1, 0])).regresses


def test_where_no_mode_has_two_demonstrations_there_is_no_spread(sheet):
    assert sheet.has_mean_paths
    assert replace(sheet, modes=np.array([0, 1, 2, 3, 4, 5, 5])).has_mean_paths
    assert not replace(sheet, modes=np.arange(7)).has_mean_paths


def test_corrections_make_the_decoder_the_weighted_mean_on_the_mean_paths(canonical_fan_skill, sheet):
    skill = canonical_fan_skill
    weights = np.random.default_rng(0).dirichlet(np.ones(7), 1)
    mean_paths = skill.mean_paths.moved_to(np.einsum("kn,nsd->ksd", weights, skill.codes))
    corrections = sheet.corrections(skill.decoder, mean_paths, weights)
    decoded = skill.decoder.decode(mean_paths.centres[0])
    positions, quaternions = carried(decoded.positions, decoded.quaternions, corrections[0])
    expected = sheet.mean_curves(weights)
    np.testing.assert_allclose(positions, expected[0][0], atol=1e-12)
    assert angle_between(quaternions, expected[1][0]).max() < 1e-6
    assert np.linalg.norm(corrections[..., :3], axis=-1).max() < 0.03


def test_blends_do_not_depend_on_signs(sheet):
    weights = np.random.default_rng(0).dirichlet(np.ones(7), 4)
    signs = np.random.default_rng(1).choice([-1.0, 1.0], size=(7, 1, 1))
    expected = RotationCurves.of(sheet.quaternions).blend(weights)
    found = RotationCurves.of(signs * sheet.quaternions).blend(weights)
    assert angle_between(found, expected).max() < 1e-6


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"positions": np.zeros((7, 99, 3))}, r"positions has shape \(7, 99, 3\); it must have shape \(7, 100, 3\)"),
        ({"quaternions": np.full((7, 100, 4), np.nan)}, "quaternions holds nan; its numbers must be finite"),
        ({"start_offsets": np.zeros((7, 3))}, r"start_offsets has shape \(7, 3\); it must have shape \(7, 6\)"),
        ({"goal_offsets": np.full((7, 6), np.inf)}, "goal_offsets holds inf"),
        ({"modes": np.zeros(6, dtype=int)}, r"modes must be whole numbers of shape \(7,\)"),
        ({"modes": np.array([0, 0, 2, 2, 0, 0, 0])}, "without gaps"),
        ({"modes": np.full(7, 1)}, "without gaps"),
        ({"penalty": 0.0}, "regression_penalty is 0.0"),
        ({"penalty": -1.0}, "regression_penalty is -1.0"),
        ({"penalty": math.nan}, "regression_penalty is nan"),
    ],
)
def test_what_does_not_belong_together_is_refused(sheet, changes, words):
    sheet.check(7, 100)
    with pytest.raises(SkillError, match=words):
        replace(sheet, **changes).check(7, 100)
