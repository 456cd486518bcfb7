"""What every scripted teacher relies on."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.simulation.gestures import (
    DOWN,
    about,
    check_count,
    hand,
    outwards,
    pacing,
    smooth_step,
    style,
)
from geodesic_motion_ros.utils.errors import ParameterError


def test_a_count_below_one_is_refused_by_its_name() -> None:
    check_count("count", 1)
    with pytest.raises(ParameterError, match="families is 0"):
        check_count("families", 0)


@pytest.mark.parametrize("gentle", [False, True])
def test_a_smooth_step_rises_from_zero_to_one_and_stays_there(gentle: bool) -> None:
    step = smooth_step(np.linspace(-0.5, 1.5, 401), gentle)
    assert step[0] == step[100] == 0.0
    np.testing.assert_allclose(step[300:], 1.0, atol=1e-12)
    assert np.all(np.diff(step) >= -1e-12)
    np.testing.assert_allclose(step + step[::-1], 1.0, atol=1e-12)


def test_the_pace_is_that_of_a_sample_every_10_ms_from_rest_to_rest() -> None:
    times, phase = pacing(4.0, np.random.default_rng(1))
    np.testing.assert_allclose(np.diff(times), 0.01)
    assert 4.0 * np.exp(-0.17) < times[-1] < 4.0 * np.exp(0.17)
    assert phase[0] == 0.0
    assert phase[-1] == 1.0
    assert np.all(np.diff(phase) >= 0.0)
    assert max(phase[1], 1.0 - phase[-2]) < 1e-5


def test_the_hand_is_still_at_both_ends_and_has_its_size_in_between() -> None:
    generator = np.random.default_rng(2)
    waves = np.array([hand(np.linspace(0.0, 1.0, 101), 0.002, generator) for _ in range(300)])
    assert waves.shape == (300, 101, 3)
    np.testing.assert_allclose(waves[:, [0, -1]], 0.0, atol=1e-15)
    assert 0.0015 < waves[:, 50].std() < 0.0025
    assert hand(np.linspace(0.0, 1.0, 5), 1.0, generator, components=1).shape == (5, 1)


def test_a_style_is_never_extreme() -> None:
    generator = np.random.default_rng(3)
    styles = np.array([style(generator) for _ in range(1000)])
    assert np.max(np.abs(styles)) <= 2.0
    assert styles.std() == pytest.approx(1.0, abs=0.1)


def test_directions() -> None:
    np.testing.assert_allclose(outwards(np.zeros(3), np.array([0.0, 2.0, 1.0])), [1.0, 0.0, 0.0])
    np.testing.assert_allclose(DOWN.apply([0.0, 0.0, 1.0]), [0.0, 0.0, -1.0], atol=1e-15)
    turned = about("z", np.radians([0.0, 90.0])).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(turned, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], atol=1e-15)
