"""What a joint-space skill knows of its demonstrations: checked, weighted within families, exact on the mean paths."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.skill.sheet import JointSheet
from geodesic_motion_ros.utils.errors import SkillError


@pytest.fixture
def sheet() -> JointSheet:
    """Four demonstrations in two families, of which each starts from its own configuration."""
    random = np.random.default_rng(0)
    return JointSheet(
        start_offsets=random.normal(size=(4, 7)), goal_offsets=random.normal(size=(4, 7)),
        modes=np.array([0, 0, 1, 1]), penalty=math.inf, configurations=random.normal(size=(4, 30, 7)),
        start_groups=np.array([0, 0, 1, 1]), goal_groups=np.zeros(4, dtype=int),
        start_poles=random.normal(size=(2, 7)), goal_poles=random.normal(size=(1, 7)),
    )  # fmt: skip


def test_a_sound_sheet_passes(sheet):
    sheet.check(4, 30)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("configurations", np.zeros((4, 29, 7))),
        ("configurations", np.full((4, 30, 7), np.nan)),
        ("start_offsets", np.zeros((4, 6))),
        ("goal_offsets", np.full((4, 7), np.inf)),
        ("modes", np.array([0, 0, 2, 2])),
        ("start_groups", np.array([0, 0, 2, 2])),
        ("start_groups", np.array([-1, 0, 0, 0])),
        ("goal_groups", np.zeros(3, dtype=int)),
        ("goal_groups", np.array([0.0, 0.5, 1.0, 1.0])),
        ("start_poles", np.zeros((1, 7))),
        ("goal_poles", np.zeros((1, 6))),
    ],
)
def test_broken_arrays_are_named(sheet, name, array):
    with pytest.raises(SkillError, match=name):
        replace(sheet, **{name: array}).check(4, 30)


@pytest.mark.parametrize(("count", "samples"), [(5, 30), (4, 31)])
def test_a_sheet_of_other_codes_is_refused(sheet, count, samples):
    with pytest.raises(SkillError):
        sheet.check(count, samples)


def test_families_are_never_mixed(sheet):
    weights = sheet.weights(np.zeros(7), np.zeros(7), conditioned=True)
    np.testing.assert_allclose(weights, [[0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, 0.5]])


def test_corrections_make_the_mean_paths_the_means_of_their_families(reach_skill):
    mean_paths, learned = reach_skill.mean_paths, reach_skill.canonical
    weights = learned.weights(np.zeros(7), np.zeros(7), conditioned=False)
    corrections = learned.corrections(reach_skill.decoder, mean_paths, weights)
    decoded = reach_skill.decoder.configurations(mean_paths.centres.reshape(-1, 3)).reshape(corrections.shape)
    for mode in range(2):
        mean = learned.configurations[learned.modes == mode].mean(axis=0)
        np.testing.assert_allclose(decoded[mode] + corrections[mode], mean, atol=1e-12)
