"""Noise of detections: found out whatever the motion, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.obstacles.detection_noise import EXACT, DetectionNoise


def noise_of(centres: np.ndarray, times: np.ndarray, known: float = 0.0) -> float:
    noise = DetectionNoise(known)
    for centre, time in zip(centres.tolist(), times.tolist(), strict=True):
        noise.see(tuple(centre), time)
    return noise.deviation


def falling(times: np.ndarray) -> np.ndarray:
    return np.outer(times, [0.3, -0.2, 0.5]) + np.outer(times**2, [0.0, 0.0, -4.9])


@pytest.mark.parametrize("deviation", [1e-3, 1e-2])
def test_it_is_the_one_of_the_detections_however_unevenly_they_come(deviation: float) -> None:
    """200 differences leave 5 % (standard deviation), the mean of 100 draws 0.5 %."""
    random = np.random.default_rng(0)
    found = []
    for _ in range(100):
        times = 1.7e9 + np.cumsum(random.uniform(0.01, 0.06, 220))
        found.append(noise_of(falling(times - times[0]) + random.normal(scale=deviation, size=(220, 3)), times))
    assert np.mean(found) == pytest.approx(deviation, rel=0.02)
    assert np.std(found) < 0.08 * deviation


def test_what_accelerates_evenly_is_exact() -> None:
    times = 0.01 + np.arange(80) / 30.0
    assert noise_of(falling(times), times) == 0.0


def test_starts_turns_and_outliers_are_no_noise() -> None:
    """The control is one at every fourth detection."""
    times = np.arange(200) / 30.0
    for every, exact in ((20, True), (4, False)):
        centres = np.zeros((200, 3))
        centres[::every, 0] += 0.1
        assert (noise_of(centres, times) == 0.0) == exact


def test_a_new_obstacle_has_the_noise_that_is_known_of_others_until_its_own_is_known() -> None:
    random = np.random.default_rng(1)
    times = np.arange(30) / 30.0
    detected = random.normal(scale=2e-3, size=(30, 3))
    assert noise_of(detected[:5], times[:5], known=1e-2) == pytest.approx(1e-2)
    assert noise_of(detected, times, known=1e-2) == pytest.approx(2e-3, rel=0.5)
    assert noise_of(detected[:5], times[:5]) == 0.0


def test_noise_of_less_than_a_tenth_of_a_millimetre_is_none() -> None:
    random = np.random.default_rng(2)
    times = np.arange(100) / 60.0
    detected = random.normal(size=(100, 3))
    assert noise_of(0.5 * EXACT * detected, times) == 0.0
    assert noise_of(2.0 * EXACT * detected, times) > EXACT


def test_what_is_another_row_is_no_difference() -> None:
    noise = DetectionNoise()
    for row in range(40):
        noise.begin_again()
        for number in range(3):
            noise.see((1.0 * (row % 2), 0.1 * (number % 2), 0.0), 0.1 * number)
    assert noise.deviation == 0.0


def test_it_is_not_less_than_it_is_said_to_be_at_least():
    random, times = np.random.default_rng(0), np.arange(250) / 30.0
    noise = DetectionNoise(least=0.002)
    assert noise.deviation == 0.002
    for centre, time in zip(falling(times) + random.normal(scale=0.0005, size=(250, 3)), times, strict=True):
        noise.see(tuple(centre.tolist()), float(time))
    assert noise.deviation == noise.moved((0.1, 0.0, 0.0)).deviation == 0.002
    for centre, time in zip(falling(times) + random.normal(scale=0.005, size=(250, 3)), times + 10.0, strict=True):
        noise.see(tuple(centre.tolist()), float(time))
    assert noise.deviation > 0.003
