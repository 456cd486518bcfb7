"""Modes: one where people differ evenly, two where they take two paths, whatever the order."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.canonical import PoseForm
from geodesic_motion_ros.demonstrations.modes import blend_weights, cluster_modes

S = np.linspace(0.0, 1.0, 50)[:, None]


def bundle(random: np.random.Generator, bulge: float, count: int, noise: float = 0.015) -> np.ndarray:
    """Curves (count, 50, 3) around one path past the middle, which differ by smooth waves."""
    path = np.hstack([0.6 * S, bulge * np.sin(np.pi * S), 0.3 + 0.0 * S])
    waves = np.stack([np.sin((k + 1) * np.pi * S) for k in range(3)])[:, :, 0]
    return path + np.einsum("nka,ks->nsa", random.normal(scale=noise, size=(count, 3, 3)), waves)


def test_a_fan_is_one_mode(varying_fan):
    np.testing.assert_array_equal(cluster_modes(PoseForm(varying_fan, 0.1).sheet(60).positions), 0)


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_never_split(seed):
    random = np.random.default_rng(seed)
    for count in (3, 5, 9, 15):
        np.testing.assert_array_equal(cluster_modes(bundle(random, 0.1, count)), 0)


def test_what_differs_in_size_alone_is_seldom_split():
    """The same shape, normally distributed in size: of such curves half reach the silhouette of a real split."""
    shape, split = bundle(np.random.default_rng(0), 0.15, 1, 0.0), 0
    for seed in range(40):
        sizes = 1.0 + 0.12 * np.random.default_rng(seed).normal(size=(8, 1, 1))
        split += int(cluster_modes(sizes * shape).max() > 0)
    assert split <= 8


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("sizes", [(2, 2), (3, 3), (3, 6), (5, 5)])
def test_two_paths_are_two_modes_in_any_order(seed, sizes):
    random = np.random.default_rng(seed)
    curves = np.concatenate([bundle(random, 0.15, sizes[0]), bundle(random, -0.15, sizes[1])])
    truth = np.repeat([0, 1], sizes)
    order = random.permutation(len(curves))
    found = cluster_modes(curves[order])
    assert found[0] == 0
    assert found.max() == 1
    assert len(set(zip(found.tolist(), truth[order].tolist(), strict=True))) == 2


def test_three_modes_are_numbered_as_they_appear():
    random = np.random.default_rng(0)
    curves = np.concatenate([bundle(random, bulge, 3, 0.005) for bulge in (0.2, -0.2, 0.0)])
    np.testing.assert_array_equal(cluster_modes(curves), [0, 0, 0, 1, 1, 1, 2, 2, 2])


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_demonstrations_are_one_mode(count):
    curves = bundle(np.random.default_rng(0), 0.1, count)
    curves[-1] += 5.0 * (count - 1)
    np.testing.assert_array_equal(cluster_modes(curves), 0)


def test_equal_curves_are_one_mode():
    np.testing.assert_array_equal(cluster_modes(np.tile(bundle(np.random.default_rng(0), 0.1, 1), (6, 1, 1))), 0)


@pytest.mark.parametrize("connected", [True, False])
def test_families_of_elbows_are_two_modes_whose_blends_stay_apart(
    reach_demonstrations, separated_demonstrations, connected
):
    """Even where all begin and end alike: a mean of both modes would be a third one that nobody showed."""
    demonstrations = reach_demonstrations if connected else separated_demonstrations
    curves = demonstrations.resample(60).configurations_array()
    modes = cluster_modes(curves)
    count = len(curves) // 2
    np.testing.assert_array_equal(modes, np.repeat([0, 1], count))
    weights = blend_weights(modes, 5, seed=0)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert not np.any((weights[:, :count].sum(axis=1) > 0.0) & (weights[:, count:].sum(axis=1) > 0.0))
    np.testing.assert_array_equal(weights, blend_weights(modes, 5, seed=0))
