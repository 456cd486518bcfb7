"""Simpler predictors of an arm's motions: each keeps what it promises of start and goal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_studies.experiments.baselines import SAMPLES
from geodesic_motion_studies.experiments.joint_baselines import JOINT_PREDICTORS, nearest

#: What a query asks beside the ends of a demonstration [rad].
BESIDE = 0.1 * np.random.default_rng(3).normal(size=(2, 7))


@pytest.fixture
def family(reach_demonstrations) -> JointDemonstrations:
    """Reaches with the elbow on one side."""
    return replace(reach_demonstrations, items=reach_demonstrations.items[:4])


def ends_off(row: str, family: JointDemonstrations, start: np.ndarray, goal: np.ndarray) -> float:
    """How far [rad] the prediction's ends are from the demanded ones, at most."""
    path = JOINT_PREDICTORS[row](family, start, goal)
    assert path.shape == (SAMPLES, 7)
    return float(np.abs(path[[0, -1]] - [start, goal]).max())


def test_a_dmp_begins_and_ends_where_it_was_asked_to(family):
    pytest.importorskip("movement_primitives")
    start, goal = family[1].configurations[[0, -1]] + BESIDE
    assert ends_off("dmp_nearest", family, start, goal) < 0.02
    # The control: nobody demonstrated these ends.
    assert ends_off("nearest_demonstration", family, start, goal) > 0.05


def test_a_promp_passes_through_the_ends_it_is_conditioned_on(family):
    """Ends among those demonstrated, for what never varied it cannot know, and within the noise of conditioning."""
    pytest.importorskip("movement_primitives")
    ends = np.stack([item.configurations[[0, -1]] for item in family])
    start, goal = 0.7 * ends[0] + 0.3 * ends[1]
    assert ends_off("promp", family, start, goal) < 0.02
    # The control: conditioned on the ends of another it is elsewhere.
    other = JOINT_PREDICTORS["promp"](family, *ends[3])
    assert np.abs(other[[0, -1]] - [start, goal]).max() > 0.05


def test_a_primitive_of_one_demonstration_repeats_it(family):
    pytest.importorskip("movement_primitives")
    only = replace(family, items=family.items[2:3])
    shown = only[0].resample(SAMPLES, by="time").configurations
    path = JOINT_PREDICTORS["dmp_nearest"](only, *shown[[0, -1]])
    assert np.abs(path - shown).max() < 0.05
    line = JOINT_PREDICTORS["joint_line"](only, *shown[[0, -1]])
    assert np.abs(line - shown).max() > 0.2


def test_the_nearest_is_one_of_the_demonstrations_and_for_its_own_ends_the_very_one(family):
    for item in family:
        assert nearest(family, *item.configurations[[0, -1]]) is item
    beside = family[2].configurations[[0, -1]] + 0.01 * BESIDE
    path = JOINT_PREDICTORS["nearest_demonstration"](family, *beside)
    np.testing.assert_array_equal(path, family[2].resample(SAMPLES).configurations)


def test_a_primitive_of_several_lies_between_them(family):
    """Conditioned on the ends of their mean it stays inside of what they demonstrated, but for its few weights."""
    pytest.importorskip("movement_primitives")
    shown = family.resample(SAMPLES, by="time").configurations_array()
    path = JOINT_PREDICTORS["promp"](family, *shown.mean(axis=0)[[0, -1]])
    beyond = np.maximum(path - shown.max(axis=0), shown.min(axis=0) - path)
    assert beyond.max() < 0.05
    line = JOINT_PREDICTORS["joint_line"](family, *shown.mean(axis=0)[[0, -1]])
    assert np.maximum(line - shown.max(axis=0), shown.min(axis=0) - line).max() > 0.1
