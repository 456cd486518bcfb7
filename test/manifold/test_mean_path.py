"""Mean paths: never cheaper than 1, 1 on the path most people took, dearer with every step off it."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.mean_path import LARGEST_EXPONENT, SMALLEST_DEVIATION, MeanPaths

SAMPLES = 60


def strip(random: np.random.Generator, count: int, across: float = 0.0) -> np.ndarray:
    """Codes (count, SAMPLES, 2) along the first axis that differ by smooth waves across it."""
    s = np.linspace(0.0, 1.0, SAMPLES)
    height = across + random.normal(scale=0.3, size=(count, 1)) * np.sin(np.pi * s)
    return np.stack([np.tile(6.0 * s - 3.0, (count, 1)), height], axis=-1)


def two_modes(seed: int = 0, sizes: tuple[int, int] = (5, 3)) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    return np.concatenate([strip(random, sizes[0], 2.0), strip(random, sizes[1], -2.0)]), np.repeat([0, 1], sizes)


@pytest.mark.parametrize("seed", range(5))
def test_the_conformal_factor_is_one_on_the_largest_modes_mean_path_and_nowhere_below(seed):
    codes, modes = two_modes(seed)
    mean_paths = MeanPaths.of_codes(codes, modes)
    everywhere = np.random.default_rng(seed).uniform(-6.0, 6.0, (2000, 2))
    for strength in (0.3, 1.0, 4.0):
        factors = mean_paths.conformal_factors(everywhere, strength)
        assert factors.min() >= 1.0
        assert factors.max() <= np.exp(LARGEST_EXPONENT) * (1.0 + 1e-12)
        np.testing.assert_allclose(mean_paths.conformal_factors(mean_paths.centres[0], strength), 1.0, rtol=1e-10)
        dearer = (5.0 / 3.0) ** (2.0 * strength)
        np.testing.assert_allclose(mean_paths.conformal_factors(mean_paths.centres[1], strength), dearer, rtol=1e-9)


def test_the_factor_grows_with_the_distance_from_the_mean_path():
    mean_paths = MeanPaths.of_codes(strip(np.random.default_rng(1), 6), np.zeros(6, dtype=int))
    for s in (5, 30, 55):
        away = mean_paths.centres[0, s] + np.linspace(0.0, 1.5, 40)[:, None] * [0.0, 1.0]
        assert np.all(np.diff(mean_paths.conformal_factors(away, 1.0)) >= 0.0)
        assert mean_paths.conformal_factors(away, 1.0)[-1] > 2.0


def test_the_factor_is_that_of_the_docstring():
    codes, modes = two_modes(2)
    mean_paths = MeanPaths.of_codes(codes, modes)
    latent = np.random.default_rng(3).uniform(-4.0, 4.0, (50, 2))
    gap = latent[:, None, None] - mean_paths.centres
    squared = np.einsum("nksa,ksab,nksb->nks", gap, mean_paths.precisions, gap).min(axis=-1)
    expected = np.exp(np.minimum(0.7 * np.min(squared + 2.0 * np.log([1.0, 5.0 / 3.0]), axis=1), LARGEST_EXPONENT))
    np.testing.assert_allclose(mean_paths.conformal_factors(latent, 0.7), expected, rtol=1e-9)


def test_a_mean_path_is_the_mean_of_its_own_modes_codes_only():
    codes, modes = two_modes(1)
    mean_paths = MeanPaths.of_codes(codes, modes)
    np.testing.assert_allclose(mean_paths.centres, [codes[:5].mean(axis=0), codes[5:].mean(axis=0)])
    assert np.linalg.eigvalsh(mean_paths.precisions).min() > 0.0
    assert np.linalg.eigvalsh(mean_paths.precisions).max() <= SMALLEST_DEVIATION**-2 * (1.0 + 1e-9)


def test_progress_of_a_point_on_the_mean_path_is_its_fraction():
    codes, modes = two_modes(3)
    mean_paths = MeanPaths.of_codes(codes, modes)
    for mode in (0, 1):
        progress, shares = mean_paths.coordinates(mean_paths.centres[mode])
        assert np.abs(progress - np.linspace(0.0, 1.0, SAMPLES)).max() < 0.02
        assert shares[:, mode].min() > 0.9


@pytest.mark.parametrize("seed", range(5))
def test_shares_sum_to_one_and_progress_stays_in_range(seed):
    mean_paths = MeanPaths.of_codes(*two_modes(seed))
    progress, shares = mean_paths.coordinates(np.random.default_rng(seed).uniform(-30.0, 30.0, (500, 2)))
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=1e-12)
    assert shares.min() >= 0.0
    assert progress.min() >= 0.0
    assert progress.max() <= 1.0


def test_a_mode_of_one_demonstration_has_the_others_width():
    codes, modes = two_modes(4, sizes=(6, 1))
    mean_paths = MeanPaths.of_codes(codes, modes)
    assert np.all(np.isfinite(mean_paths.precisions))
    np.testing.assert_allclose(mean_paths.precisions[1], mean_paths.precisions[0], rtol=1e-9)


def test_moved_mean_paths_keep_their_widths():
    mean_paths = MeanPaths.of_codes(*two_modes(5))
    shift = np.array([0.2, -0.4])
    moved = mean_paths.moved_to(mean_paths.centres + shift)
    latent = np.random.default_rng(0).uniform(-3.0, 3.0, (40, 2))
    expected = mean_paths.conformal_factors(latent, 1.0)
    np.testing.assert_allclose(moved.conformal_factors(latent + shift, 1.0), expected, rtol=1e-9)


def test_three_latent_dimensions_work_too():
    codes = np.random.default_rng(0).normal(size=(5, 20, 3)).cumsum(axis=1)
    mean_paths = MeanPaths.of_codes(codes, np.zeros(5, dtype=int))
    np.testing.assert_allclose(mean_paths.conformal_factors(mean_paths.centres[0], 1.0), 1.0, rtol=1e-12)
