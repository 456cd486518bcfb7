"""Places and velocities of obstacles: exact where detections are, a line within its bounds where they are noisy."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.obstacles.velocity_filter import (
    BOUND,
    FASTEST,
    LONGEST,
    LONGEST_GAP,
    SAME_PLACE,
    SHORTEST,
    ObstacleMotion,
)

STAMP = 1.7e9
ZERO = (0.0, 0.0, 0.0)
Place = tuple[float, float, float]


def seen(centres: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Velocity (n, 3) after each of the positions (n, 3)."""
    motion, velocities = ObstacleMotion(), []
    for centre, time in zip(centres.tolist(), times.tolist(), strict=True):
        motion.see(tuple(centre), time)
        velocities.append(motion.velocity)
    return np.array(velocities)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rate=st.floats(3.0, 240.0))
def test_even_motion_is_recognised_from_the_second_position_on(seed: int, rate: float) -> None:
    generator = np.random.default_rng(seed)
    velocity = generator.uniform(-1.0, 1.0, 3)
    times = STAMP + np.cumsum(generator.uniform(0.5, 1.5, 40)) / rate
    times = times[np.append(True, np.diff(times) < LONGEST_GAP)]
    velocities = seen(generator.uniform(-1.0, 1.0, 3) + np.outer(times - STAMP, velocity), times)
    np.testing.assert_array_equal(velocities[0], ZERO)
    np.testing.assert_allclose(velocities[1:], np.broadcast_to(velocity, (len(times) - 1, 3)), atol=1e-3)


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_what_is_elsewhere_moves_on_as_the_other_did(noise: float) -> None:
    """As if all of its detections had been farther by a shift."""
    random, shift = np.random.default_rng(0), np.array([0.5, -0.2, 0.1])
    times = STAMP + np.arange(120) / 30.0
    centres = np.outer(times - STAMP, [0.2, 0.1, 0.0]) + random.normal(scale=noise, size=(120, 3))
    centres[60:] += np.outer(times[60:] - times[60], [0.0, 0.0, 0.3])
    whole, apart = ObstacleMotion(), ObstacleMotion()
    for centre, time in zip(centres[:70], times[:70].tolist(), strict=True):
        whole.see(tuple(centre.tolist()), time)
        apart.see(tuple((centre + shift).tolist()), time)
    before, part = (whole.velocity, whole.place, whole.newest), whole.moved(tuple(shift.tolist()))
    for centre, time in zip(centres[70:] + shift, times[70:].tolist(), strict=True):
        part.see(tuple(centre.tolist()), time)
        apart.see(tuple(centre.tolist()), time)
    np.testing.assert_allclose(part.velocity, apart.velocity, atol=1e-6)
    np.testing.assert_allclose(part.place, apart.place, atol=1e-6)
    assert part.error == pytest.approx(apart.error, abs=1e-6)
    assert part.noise.deviation == pytest.approx(apart.noise.deviation, abs=1e-6)
    # The other one is as it was.
    assert (whole.velocity, whole.place, whole.newest) == before


def camera(
    path: Callable[[float], Place], rate: float, noise: float, until: float, seed: int
) -> Iterator[tuple[float, ObstacleMotion, Place]]:
    """The motion after each detection of a path, one of twenty lost, with its time and the true place."""
    random, motion = np.random.default_rng(seed), ObstacleMotion(noise)
    for time in np.arange(0.0, until, 1.0 / rate).tolist():
        place = path(time)
        detected = place + random.normal(scale=noise, size=3)
        if random.random() > 0.05:
            motion.see(tuple(detected.tolist()), STAMP + time)
            yield time, motion, place


CAMERAS = pytest.mark.parametrize(("rate", "noise"), [(10.0, 1e-2), (30.0, 1e-2), (60.0, 1e-3), (100.0, 1e-2)])


@CAMERAS
def test_what_stands_has_no_velocity_and_is_within_its_bound(rate: float, noise: float) -> None:
    seen = [
        (any(motion.velocity), math.dist(motion.place, place), motion.place_error)
        for seed in range(10)
        for time, motion, place in camera(lambda time: (0.3, 0.2, 0.1), rate, noise, 10.0, seed)
        if time > 0.5
    ]
    moving, off, bound = np.array(seen).T
    # One in 900 at one time; and what was taken for motion once is so for a while.
    assert np.mean(moving) < 0.02
    assert np.mean(off > bound) < 0.03
    assert np.mean(off > 0.2 * bound) > 0.3
    assert bound[-1] < 2.2 * BOUND * noise / np.sqrt(0.9 * 3.0 * rate)


@CAMERAS
def test_the_errors_of_what_moves_straight_on_are_within_their_bounds(rate: float, noise: float) -> None:
    """97 % of them; the control are bounds half as large: 48 %."""
    velocity = np.array([0.3, -0.2, 0.1])
    shares = []
    for seed in range(40):
        *_, (_, motion, place) = camera(lambda time: tuple(velocity * time), rate, noise, 3.0, seed)
        off = math.dist(motion.place, place), math.dist(motion.velocity, velocity)
        shares.append((off[0] / motion.place_error, off[1] / motion.error))
    assert np.all(np.mean(np.array(shares) > 1.0, axis=0) < 0.15)
    assert np.all(np.mean(np.array(shares) > 0.5, axis=0) > 0.25)


def test_a_line_is_the_one_of_least_squares_and_so_are_its_errors() -> None:
    """But where noise makes older and newer half differ by more than it does in 97 % of all cases."""
    detected: list[float] = []
    ratios = []
    for time, motion, _ in camera(lambda time: (0.5 * time, -0.2 * time, 0.4), 30.0, 5e-3, 20.0, 3):
        detected.append(time)
        if time < 2.0:
            continue
        count = sum(time - before <= LONGEST + 1e-6 for before in detected)
        times = np.array(detected[-count:]) - time
        spread = np.sum((times - times.mean()) ** 2)
        deviation = motion.noise.deviation
        expected = BOUND * deviation * np.sqrt(1.0 / count + times.mean() ** 2 / spread)
        ratios.append((motion.place_error / expected, motion.error / (BOUND * deviation / np.sqrt(spread))))
    assert np.min(ratios) >= 1.0 - 1e-6
    assert np.mean(np.array(ratios) <= 1.0 + 1e-6) > 0.9


CHANGES: dict[str, Callable[[float], Place]] = {
    "starts": lambda passed: (max(0.0, passed), 0.0, 0.0),
    "stops": lambda passed: (min(0.0, passed), 0.0, 0.0),
    "turns": lambda passed: (min(0.0, passed), max(0.0, passed), 0.0),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize(
    ("rate", "noise", "speed", "duration"),
    [(30.0, 1e-2, 0.3, 0.5), (30.0, 1e-2, 0.1, 1.0), (60.0, 1e-3, 0.3, 0.2), (60.0, 1e-3, 0.1, 0.25)],
)
def test_a_change_is_known_soon(change: str, rate: float, noise: float, speed: float, duration: float) -> None:
    """So long after it the velocity is right within 20 %, and just before it is the one before."""
    before, after = (np.subtract(CHANGES[change](t), CHANGES[change](t - 0.1)) * 10.0 * speed for t in (-0.1, 0.2))
    right = []
    for seed in range(20):
        off = np.full(2, np.inf)
        path = lambda time: tuple(speed * part for part in CHANGES[change](time - 2.0))  # noqa: E731
        for time, motion, _ in camera(path, rate, noise, 2.0 + duration, seed):
            if time < 2.0:
                off[0] = math.dist(motion.velocity, before)
            else:
                off[1] = min(off[1], math.dist(motion.velocity, after))
        right.append(off <= 0.2 * speed)
    assert np.all(np.mean(right, axis=0) > 0.7)


def test_exact_detections_are_taken_as_they_are() -> None:
    """Of a circle at 62 Hz, with the line of least squares over the shortest time; the control is a noisy one."""
    times = np.arange(300) / 62.0
    centres = 0.1 * np.stack([np.cos(3.0 * times), np.sin(3.0 * times), 0.0 * times], axis=1)
    for noise in (0.0, 1e-3):
        motion = ObstacleMotion(noise)
        for index, (time, centre) in enumerate(zip(times.tolist(), centres.tolist(), strict=True)):
            motion.see(tuple(centre), time)
            if noise:
                break
            assert (motion.place, motion.place_error) == (tuple(centre), 0.0)
            chosen = slice(max(0, index - 9), index + 1)
            if index:
                slope, _ = np.polyfit(times[chosen], centres[chosen], 1)
                np.testing.assert_allclose(motion.velocity, slope, atol=1e-9)
        assert (motion.place_error > 0.0) == (noise > 0.0)


def test_noise_makes_no_jump() -> None:
    """At 100 Hz 1 cm of noise alone is faster than anything is: what was taken for another would begin again."""
    *_, (_, motion, _) = camera(lambda time: ZERO, 100.0, 1e-2, 3.0, 0)
    assert motion.place_error < 2.2 * BOUND * 1e-2 / np.sqrt(0.9 * 300.0)


def errors(centres: np.ndarray, times: np.ndarray, noise: float) -> np.ndarray:
    """Errors of the velocity (n,) after each of the positions (n, 3) with noise [m]."""
    noisy = centres + np.random.default_rng(0).normal(scale=noise, size=centres.shape)
    motion, result = ObstacleMotion(), []
    for centre, time in zip(noisy.tolist(), times.tolist(), strict=True):
        motion.see(tuple(centre), time)
        result.append(motion.error)
    return np.array(result)


@pytest.mark.parametrize("rate", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("noise", [1e-3, 5e-3, 1e-2])
@pytest.mark.parametrize("speed", [0.0, 0.2])
def test_noise_is_no_turn(rate: float, noise: float, speed: float) -> None:
    """Whatever its size: how noisy positions are is found out."""
    times = STAMP + np.arange(int(60.0 * rate)) / rate
    error = errors(np.outer(times - STAMP, [speed, 0.0, 0.0]), times, noise)
    assert np.quantile(error, 0.95) <= 10.0 * noise


@pytest.mark.parametrize("rate", [10.0, 30.0, 60.0])
def test_a_turn_is_no_noise_until_the_obstacle_is_lost(rate: float) -> None:
    times = np.arange(0.0, 6.0, 1.0 / rate)
    angle = np.maximum(0.0, times - 3.0)
    velocities = 0.2 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    centres = np.cumsum(velocities / rate, axis=0)
    assert np.all(errors(centres, STAMP + times, 1e-3)[times > 4.5] > 0.1)
    gap = np.append(times, times[-1] + LONGEST_GAP + 0.1)
    assert errors(np.append(centres, centres[-1:], axis=0), STAMP + gap, 1e-3)[-1] == 0.0


def test_what_turns_too_slowly_for_a_new_line_is_larger_in_the_prediction() -> None:
    """As a sphere does that follows a hand: 0.12 m/s, turning by 0.4 rad/s. The control: straight on."""

    def circling(time: float) -> Place:
        return 0.3 * math.sin(0.4 * time), 0.3 - 0.3 * math.cos(0.4 * time), 0.4

    def straight(time: float) -> Place:
        return 0.12 * time, 0.0, 0.4

    turning, going = (
        np.mean([motion.error for time, motion, _ in camera(path, 30.0, 1e-2, 30.0, 4) if time > 2.0])
        for path in (circling, straight)
    )
    assert turning > 3.0 * going


def test_late_and_early_arrivals_of_an_even_motion_hardly_matter() -> None:
    generator = np.random.default_rng(1)
    times = np.arange(300) / 60.0
    centres = np.outer(times, [0.5, 0.0, 0.0])
    velocities = seen(centres, times + generator.uniform(0.0, 5e-3, 300))
    np.testing.assert_allclose(velocities[20:], np.tile([0.5, 0.0, 0.0], (280, 1)), atol=0.05)


@pytest.mark.parametrize("rate", [5.0, 60.0, 200.0])
def test_what_stops_has_velocity_zero_after_the_window(rate: float) -> None:
    times = np.arange(200) / rate
    centres = np.outer(np.minimum(times, times[100]), [0.4, -0.3, 0.2])
    velocities = seen(centres, STAMP + times)
    stopped = times > times[100] + max(SHORTEST, 1.0 / rate) + 1e-6
    assert np.any(velocities[100] != 0.0)
    np.testing.assert_array_equal(velocities[stopped], 0.0)


def test_a_change_of_velocity_is_there_within_the_window() -> None:
    times = np.arange(100) / 60.0
    centres = np.zeros((100, 3))
    centres[:, 0] = 0.8 * np.abs(times - times[50])
    velocities = seen(centres, times)
    assert velocities[50, 0] == pytest.approx(-0.8)
    assert np.all(np.diff(velocities[50:61, 0]) > -1e-9)
    assert velocities[60, 0] == pytest.approx(0.8)


def test_after_a_gap_it_begins_again() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.2 + LONGEST_GAP + 0.01, 0.3 + LONGEST_GAP + 0.01])
    velocities = seen(np.outer(times, [0.5, 0.0, 0.0]), times)
    np.testing.assert_allclose(velocities[:, 0], [0.0, 0.5, 0.5, 0.0, 0.5], atol=1e-9)


def test_a_jump_is_another_object() -> None:
    for rate, longest in ((60.0, SAME_PLACE), (10.0, FASTEST / 10.0)):
        times = np.arange(6) / rate
        centres = np.zeros((6, 3))
        centres[3:, 1] = 1.1 * longest
        np.testing.assert_array_equal(seen(centres, times), 0.0)
        centres[3:, 1] = 0.9 * longest
        assert seen(centres, times)[3, 1] > 0.0


def test_messages_that_arrive_together_after_a_stall_are_no_jump() -> None:
    times = np.array([0.0, 0.016, 0.032, 0.08, 0.0801, 0.0802, 0.096])
    centres = np.outer(np.arange(7) * 0.016, [1.0, 0.0, 0.0])
    velocities = seen(centres, times)
    assert np.all(velocities[1:, 0] > 0.5)
    assert np.all(velocities[1:, 0] < 1.2)


def test_a_clock_that_is_set_back_begins_again_and_one_that_stands_still_counts_once() -> None:
    back = seen(np.array([[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]]), np.array([10.0, 10.1, 5.0]))
    np.testing.assert_array_equal(back[2], ZERO)
    still = seen(np.array([[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]]), np.array([10.0, 10.1, 10.1]))
    np.testing.assert_allclose(still[2], [0.2, 0.0, 0.0], atol=1e-9)
