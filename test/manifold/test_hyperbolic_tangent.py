"""The vectorised tanh is numpy's to a few units in the last place, everywhere, and does not depend on neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.hyperbolic_tangent import tanh

TINY, HUGE = np.finfo(float).smallest_subnormal, np.finfo(float).max


def arguments() -> np.ndarray:
    """Dense where tanh bends, of all magnitudes, and where the integer part of 2 x / ln 2 changes."""
    random = np.random.default_rng(0)
    changes = (np.arange(60) + 0.5) * np.log(2.0) / 2.0
    positive = np.concatenate(
        [np.linspace(0.0, 25.0, 400_001), 10.0 ** random.uniform(-323.0, 308.0, 200_000), changes, [TINY, HUGE]]
    )
    return np.concatenate([positive, -positive, np.nextafter(changes, 0.0), np.nextafter(changes, 100.0)])


def test_it_is_numpys_to_a_few_units_in_the_last_place():
    x = arguments()
    expected = np.tanh(x)
    assert np.max(np.abs(tanh(x) - expected) / np.spacing(np.abs(expected))) <= 4.0


@pytest.mark.parametrize(("x", "expected"), [(np.inf, 1.0), (-np.inf, -1.0), (HUGE, 1.0), (0.0, 0.0), (TINY, TINY)])
def test_at_the_ends_it_is_exact(x, expected):
    assert tanh(np.array([x]))[0] == expected
    assert tanh(np.array([-x]))[0] == -expected


def test_not_a_number_stays_one_and_zero_keeps_its_sign():
    found = tanh(np.array([np.nan, -0.0, 0.5]))
    np.testing.assert_array_equal(np.isnan(found), [True, False, False])
    np.testing.assert_array_equal(np.signbit(found[1:]), [True, False])


def test_it_is_odd_stays_within_one_and_does_not_fall():
    x = np.sort(np.abs(arguments()))
    found = tanh(x)
    np.testing.assert_array_equal(tanh(-x), -found)
    assert found[-1] == 1.0 == found.max()
    # By no more than rounding.
    assert np.all(np.diff(found) >= -4.0 * np.spacing(found[1:]))


@pytest.mark.parametrize("length", [1, 2, 3, 5, 31])
def test_neighbours_in_the_array_do_not_matter(length):
    """As many at once as the processor takes, or the rest one by one: the same bytes."""
    x = np.random.default_rng(1).normal(size=1000)
    found = np.concatenate([tanh(x[begin : begin + length]) for begin in range(0, len(x), length)])
    np.testing.assert_array_equal(found, tanh(x))


def test_any_shape_and_memory_layout_is_taken_and_stays_as_it_is():
    x = np.random.default_rng(2).normal(size=(6, 10))[::2, 1::3].T
    before = x.copy()
    found = tanh(x)
    assert found.shape == x.shape
    np.testing.assert_allclose(found, np.tanh(x), rtol=1e-15)
    np.testing.assert_array_equal(x, before)
