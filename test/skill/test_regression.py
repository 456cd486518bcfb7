"""Regression on where a motion starts and ends: exact where there is a law, silent where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geodesic_motion_ros.skill import regression
from geodesic_motion_ros.skill.regression import LEVEL, PENALTIES, regression_penalty, regression_weights

S = np.linspace(0.0, 1.0, 40)


def lawful(random: np.random.Generator, count: int, features: int = 3, noise: float = 0.0):
    """Features (count, f) and curves (count, 40, 3) that depend on them linearly."""
    known = random.normal(scale=0.05, size=(count, features))
    law = random.normal(size=(features, 3))
    curves = np.sin(np.pi * S)[None, :, None] * (known @ law)[:, None]
    return known, curves + random.normal(scale=noise, size=(count, 1, 3)) * np.sin(np.pi * S)[:, None], law


def noise(random: np.random.Generator, count: int):
    known = random.normal(scale=0.05, size=(count, 12))
    waves = np.stack([np.sin((k + 1) * np.pi * S) for k in range(3)])
    return known, np.einsum("nka,ks->nsa", random.normal(scale=0.03, size=(count, 3, 3)), waves)


@pytest.mark.parametrize("penalty", [*PENALTIES, 1e-6, math.inf])
def test_weights_sum_to_one(penalty):
    random = np.random.default_rng(0)
    for count in (1, 2, 5, 12):
        known = random.normal(size=(count, 12))
        weights = regression_weights(known, random.normal(size=12), penalty)
        assert weights.shape == (count,)
        assert weights.sum() == pytest.approx(1.0, abs=1e-9)


def test_an_infinite_penalty_and_equal_features_and_the_mean_query_give_the_mean():
    random = np.random.default_rng(1)
    known = random.normal(size=(7, 12))
    mean = np.full(7, 1.0 / 7.0)
    np.testing.assert_allclose(regression_weights(known, random.normal(size=12), math.inf), mean)
    np.testing.assert_allclose(regression_weights(np.ones((7, 12)), random.normal(size=12), 0.1), mean)
    np.testing.assert_allclose(regression_weights(known, known.mean(axis=0), 0.1), mean, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_linear_law_is_recovered_with_a_small_penalty(seed):
    random = np.random.default_rng(seed)
    known, curves, law = lawful(random, 9)
    query = random.normal(scale=0.05, size=3)
    predicted = np.tensordot(regression_weights(known, query, 1e-9), curves, axes=1)
    np.testing.assert_allclose(predicted, np.sin(np.pi * S)[:, None] * (query @ law), atol=1e-6)


def test_a_larger_penalty_stays_closer_to_the_mean():
    random = np.random.default_rng(2)
    known, query = random.normal(size=(8, 12)), random.normal(size=12)
    away = [np.linalg.norm(regression_weights(known, query, penalty) - 0.125) for penalty in PENALTIES]
    assert np.all(np.diff(away) < 0.0)


@pytest.mark.parametrize("count", [5, 9])
def test_noise_is_regressed_on_as_often_as_the_level_allows(count):
    """Ends that determine nothing, 60 times; three standard deviations of so many draws are allowed."""
    found = [math.isfinite(regression_penalty(*noise(np.random.default_rng(seed), count))) for seed in range(60)]
    assert np.mean(found) <= LEVEL + 3.0 * math.sqrt(LEVEL * (1.0 - LEVEL) / 60)


@pytest.mark.parametrize("seed", range(10))
def test_a_strong_law_is_found(seed):
    known, curves, _ = lawful(np.random.default_rng(seed), 9, noise=0.002)
    assert regression_penalty(known, curves) in PENALTIES


@pytest.mark.parametrize("count", [1, 2, 3])
def test_fewer_than_four_demonstrations_say_nothing(count):
    known, curves, _ = lawful(np.random.default_rng(0), count)
    assert regression_penalty(known, curves) == math.inf


def test_four_demonstrations_may_say_something():
    known, curves, _ = lawful(np.random.default_rng(0), 4, features=1)
    assert math.isfinite(regression_penalty(known, curves))


def test_a_law_under_noise_is_regressed_on_with_a_larger_penalty_than_a_clear_one():
    clear, noisy = (lawful(np.random.default_rng(3), 9, noise=noise)[:2] for noise in (0.0, 0.03))
    assert regression_penalty(*clear) < regression_penalty(*noisy)


def test_the_order_of_the_demonstrations_does_not_matter_where_the_law_is_strong():
    known, curves, _ = lawful(np.random.default_rng(4), 9, noise=0.002)
    assert regression_penalty(known[::-1], curves[::-1]) == regression_penalty(known, curves)


@pytest.mark.parametrize(("count", "dimension"), [(5, 12), (9, 14), (30, 6)])
def test_what_is_left_out_is_predicted_with_the_weights_of_the_others(count, dimension):
    random = np.random.default_rng(3)
    features, curves = random.normal(size=(count, dimension)), random.normal(size=(count, 7, 3))
    penalties, order = [0.03, 1.0, math.inf], random.permutation(count)
    found = regression._LeftOut.of(features, penalties).shuffled(order).distances(curves)
    shuffled = features[order]
    for row, penalty in zip(found, penalties, strict=True):
        for i in range(count):
            others = np.arange(count) != i
            weights = regression_weights(shuffled[others], shuffled[i], penalty)
            off = np.tensordot(weights, curves[others], axes=1) - curves[i]
            # sums of tens of numbers of about 10 at most, and matrices of a condition below 1e4
            assert row[i] == pytest.approx(np.linalg.norm(off, axis=-1).mean(), rel=1e-9)


def test_features_that_are_all_the_same_leave_the_mean():
    left_out = regression._LeftOut.of(np.ones((7, 12)), PENALTIES)
    assert not left_out.slopes.any()
