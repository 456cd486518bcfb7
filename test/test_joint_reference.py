"""What is played keeps all limits between knots too, never jumps at a replan, ends at rest and can be stopped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geodesic_motion_ros.errors import PlanningError
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_reference import (
    PERIOD,
    JointReference,
    bridge_to_rest,
    joined,
    stopping_reference,
    timed_joint_reference,
)
from geodesic_motion_ros.robot.kinematics import Robot

ROBOT = Robot.panda()
LIMITS = JointLimits.of(ROBOT)


def inside(path: np.ndarray) -> bool:
    return bool(np.all(path > LIMITS.lower) and np.all(path < LIMITS.upper))


def random_path(random: np.random.Generator) -> np.ndarray:
    """A smooth path (100, 7) through four configurations inside the limits."""
    while True:
        through = ROBOT.ready + random.normal(scale=0.5, size=(4, 7))
        path = CubicSpline(np.linspace(0.0, 1.0, 4), through)(np.linspace(0.0, 1.0, 100))
        if inside(path):
            return path


def timed(path: np.ndarray, velocity=None, acceleration=None) -> JointReference | None:
    share = np.linspace(0.0, 1.0, len(path))
    return timed_joint_reference(path, np.stack([share, 1.0 - share], axis=1), LIMITS, velocity, acceleration)


def references(count: int, seed: int = 0) -> Iterator[tuple[np.random.Generator, JointReference]]:
    """Seeded generators and references from rest."""
    for number in range(count):
        random = np.random.default_rng([seed, number])
        yield random, timed(random_path(random))


def detour(random: np.random.Generator, reference: JointReference, time: float, kink: float) -> np.ndarray | None:
    """What is left of a reference's path from `time` on, bent aside, with another goal; it begins at an angle [rad]."""
    rest = reference.rest(time)
    dense = rest.samples(np.linspace(0.0, rest.duration, 400))[0]
    passed = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1)))
    share = np.linspace(0.0, 1.0, 100)
    path = np.stack([np.interp(share * passed[-1], passed, joint) for joint in dense.T], axis=1)
    sideways = random.normal(size=7)
    sideways /= np.linalg.norm(sideways)
    path += np.outer(np.sin(np.pi * share) ** 2, random.normal(scale=0.1, size=7))
    path += np.outer(share**2 * (3.0 - 2.0 * share), random.normal(scale=0.05, size=7))
    path += np.outer(share * (1.0 - share) ** 2, sideways * np.tan(kink) * passed[-1])
    return path if passed[-1] > 0.3 and inside(path) else None


def assert_plays_within_limits(reference: JointReference) -> None:
    """At 20 times between knots, by differences of what is played, not by the bounds that the package trusts."""
    assert reference.keeps(LIMITS)
    fine = np.unique(np.concatenate([np.linspace(a, b, 21) for a, b in pairwise(reference.times)]))
    positions, velocities, accelerations = reference.samples(fine)
    assert np.all((positions >= LIMITS.lower - 1e-6) & (positions <= LIMITS.upper + 1e-6))
    assert np.all(np.abs(velocities) <= LIMITS.velocity * 1.00001)
    assert np.all(np.abs(accelerations) <= LIMITS.acceleration * 1.00001)
    steps = np.diff(fine)[:, None]
    # Rounding of accelerations over a step of 0.2 ms.
    assert np.all(np.abs(np.diff(accelerations, axis=0)) <= (LIMITS.jerk * 1.00001) * steps + 1e-6)
    np.testing.assert_allclose(np.diff(positions, axis=0) / steps, 0.5 * (velocities[1:] + velocities[:-1]), atol=2e-3)
    assert not np.any(reference.velocities[-1])
    assert not np.any(reference.accelerations[-1])
    assert np.all(np.diff(reference.times) > 0.0)


def test_from_rest_every_reference_keeps_its_limits_and_its_path():
    for seed in range(60):
        path = random_path(np.random.default_rng(seed))
        reference = timed(path)
        np.testing.assert_array_equal(reference.positions[0], path[0])
        np.testing.assert_allclose(reference.positions[-1], path[-1], atol=1e-9)
        assert_plays_within_limits(reference)
        share = np.linspace(0.0, 1.0, 5000)
        dense = CubicSpline(np.linspace(0.0, 1.0, 100), path)(share)
        played = reference.samples(np.linspace(0.0, reference.duration, 50))[0]
        gaps = np.linalg.norm(played[:, None] - dense, axis=2).min(axis=1)
        # As near as samples of the path can tell.
        assert gaps.max() < 0.5 * np.linalg.norm(np.diff(dense, axis=0), axis=1).max() + 1e-4


def test_it_is_fast_some_limit_is_nearly_used_at_most_times():
    shares = [np.mean(reference.strain(LIMITS)[:2].max(axis=0) > 0.8) for _, reference in references(20)]
    assert np.mean(shares) > 0.7


def test_the_latent_points_go_along():
    for _, reference in references(5):
        np.testing.assert_allclose(reference.latent[[0, -1]], [[0.0, 1.0], [1.0, 0.0]], atol=1e-9)
        assert np.all(np.diff(reference.latent[:, 0]) >= -1e-12)
        np.testing.assert_allclose(reference.latent.sum(axis=1), 1.0)


def test_half_the_speed_takes_about_twice_the_time():
    path = random_path(np.random.default_rng(1))
    slow = JointLimits.of(ROBOT, speed_scale=0.3, acceleration_scale=0.09)
    latent = np.zeros((100, 1))
    duration = timed_joint_reference(path, latent, slow).duration
    assert duration == pytest.approx(timed_joint_reference(path, latent, LIMITS).duration / 0.3, rel=0.1)


def test_the_rest_of_a_reference_is_the_same_motion():
    for random, reference in references(10):
        for time in (*random.uniform(0.0, reference.duration, 5), reference.times[3], 0.0):
            rest = reference.rest(time)
            at = np.linspace(0.0, rest.duration, 300)
            expected, found = reference.samples(time + at), rest.samples(at)
            np.testing.assert_allclose(found[0], expected[0], atol=1e-12)
            np.testing.assert_allclose(found[1], expected[1], atol=1e-8)
            np.testing.assert_allclose(found[2], expected[2], atol=1e-3)
            assert len(rest.clearance) == len(rest.times) - 1 == len(rest.latent) - 1
            assert rest.duration == pytest.approx(reference.duration - time, abs=1e-5)


def test_after_its_end_a_reference_stands():
    _, reference = next(references(1))
    standing = reference.rest(reference.duration + 1.0)
    np.testing.assert_array_equal(standing.positions, reference.positions[[-1, -1]])
    assert standing.keeps(LIMITS)
    position, velocity, acceleration = reference.sample(reference.duration + 1.0)
    np.testing.assert_array_equal(position, reference.positions[-1])
    assert not np.any(velocity)
    assert not np.any(acceleration)


@pytest.mark.parametrize("kink", [0.0, 10.0, 30.0])
def test_a_replan_in_motion_never_jumps_and_keeps_all_limits(kink):
    accepted = tried = 0
    for random, reference in references(60, seed=int(kink)):
        time = random.uniform(0.05, 0.7) * reference.duration
        path = detour(random, reference, time, np.radians(kink))
        if path is None:
            continue
        position, velocity, acceleration = reference.sample(time)
        tried += 1
        found = timed(path, velocity, acceleration)
        if found is None:
            continue
        accepted += 1
        for value, wanted in zip(found.sample(0.0), (position, velocity, acceleration), strict=True):
            np.testing.assert_allclose(value, wanted, atol=1e-9)
        np.testing.assert_allclose(found.positions[-1], path[-1], atol=1e-9)
        assert_plays_within_limits(found)
    assert tried > 30
    assert accepted >= 0.97 * tried


def test_chains_of_replans_play_as_one_smooth_motion():
    """Replanned 12 times at odd instants; where there is no new reference the old one goes on. Sampled at 1 kHz."""
    replans = 0
    for random, reference in references(12, seed=7):
        played = []
        for _ in range(12):
            span = random.uniform(0.03, 0.15)
            steps = np.arange(0.0, span, 0.001)
            played.append(reference.samples(steps))
            time = float(steps[-1]) + 0.001
            path = detour(random, reference, time, np.radians(random.uniform(0.0, 10.0)))
            found = None if path is None else timed(path, *reference.sample(time)[1:])
            replans += found is not None
            reference = reference.rest(time) if found is None else found
        played.append(reference.samples(np.arange(0.0, reference.duration + 0.01, 0.001)))
        positions, velocities, accelerations = np.concatenate(played, axis=1)
        assert np.abs(np.diff(positions, axis=0)).max() <= 0.02
        assert np.all(np.abs(np.diff(positions, axis=0)) <= LIMITS.velocity * 0.00101)
        assert np.all(np.abs(np.diff(velocities, axis=0)) <= LIMITS.acceleration * 0.00101)
        assert np.all(np.abs(np.diff(accelerations, axis=0)) <= LIMITS.jerk * 0.00101)
        assert not np.any(velocities[-1])
    assert replans > 60


def test_replanning_an_unchanged_path_at_every_knot_costs_no_time():
    delays = []
    for seed in range(6):
        path = random_path(np.random.default_rng(seed))
        reference = timed(path)
        planned, passed = reference.duration, 0.0
        while reference.duration > 0.3:
            passed += PERIOD
            rest = reference.rest(PERIOD)
            ahead = np.linalg.norm(path - rest.positions[0], axis=1)
            left = np.concatenate([rest.positions[:1], path[np.argmin(ahead) + 2 :]])
            found = timed(left, rest.velocities[0], rest.accelerations[0])
            reference = rest if found is None else found
        delays.append((passed + reference.duration) / planned - 1.0)
    assert np.median(delays) < 0.02
    assert max(delays) < 0.1


def test_knots_are_a_period_apart():
    path = random_path(np.random.default_rng(0))
    for period in (0.01, 0.02):
        reference = timed_joint_reference(path, np.zeros((100, 1)), LIMITS, period=period)
        np.testing.assert_allclose(np.diff(reference.times), period)
        assert_plays_within_limits(reference)


def test_without_the_state_of_motion_a_replan_would_jump():
    """The control: the same replans, planned as if from rest."""
    jumps = []
    for random, reference in references(10):
        time = 0.4 * reference.duration
        path = detour(random, reference, time, 0.0)
        if path is not None:
            jumps.append(np.abs(timed(path).sample(0.0)[1] - reference.sample(time)[1]).max())
    assert np.median(jumps) > 0.3


def test_what_cannot_be_led_onto_the_path_is_none():
    path = np.linspace(ROBOT.ready, ROBOT.ready + 0.02, 50)
    assert timed(path) is not None
    assert timed(path, -0.9 * LIMITS.velocity, np.zeros(7)) is None


def test_the_path_of_an_arm_that_stands_at_its_goal_is_stillness():
    reference = timed(np.tile(ROBOT.ready, (10, 1)))
    assert reference.duration <= 0.2
    np.testing.assert_array_equal(reference.positions, np.tile(ROBOT.ready, (len(reference.times), 1)))


def test_an_arm_outside_its_position_limits_may_come_back_but_not_leave():
    start = ROBOT.ready.copy()
    start[1] = LIMITS.upper[1] + 0.005
    back, away = start.copy(), start.copy()
    back[1] -= 0.3
    away[1] += 0.005
    assert timed(np.linspace(start, back, 50)) is not None
    assert timed(np.linspace(start, away, 50)) is None


def test_a_path_with_repeated_points_is_the_path_without_them():
    path = random_path(np.random.default_rng(2))
    plain, repeated = timed(path), timed(np.repeat(path, 3, axis=0))
    assert repeated.duration == pytest.approx(plain.duration, abs=2.0 * PERIOD)
    assert_plays_within_limits(repeated)


@pytest.mark.parametrize(
    ("path", "velocity", "message"),
    [
        (np.zeros((1, 7)), np.zeros(7), "m at least 2"),
        (np.zeros((5, 6)), np.zeros(7), r"\(m, 7\)"),
        (np.zeros((5, 7)), np.zeros(6), r"velocity has shape \(6,\)"),
        (np.full((5, 7), np.nan), np.zeros(7), "finite"),
    ],
)
def test_what_makes_no_path_is_refused(path, velocity, message):
    with pytest.raises(PlanningError, match=message):
        timed(path, velocity, np.zeros(7))


def test_every_motion_can_be_stopped_along_its_own_path():
    """From rest or replanned, at any time: continuous, within limits, on the path, sooner than by playing on."""
    stops = []
    for random, reference in references(60, seed=3):
        for _ in range(2):
            time = random.uniform(0.0, 0.9) * reference.duration
            stop = stopping_reference(reference, time, LIMITS)
            for value, wanted in zip(stop.sample(0.0), reference.sample(time), strict=True):
                np.testing.assert_allclose(value, wanted, atol=1e-9)
            assert_plays_within_limits(stop)
            left = reference.samples(np.linspace(time, reference.duration, 2000))[0]
            halt = stop.samples(np.linspace(0.0, stop.duration, 20))[0]
            assert np.linalg.norm(halt[:, None] - left, axis=2).min(axis=1).max() < 3e-3
            assert stop.duration <= reference.duration - time + PERIOD
            stops.append(stop.duration)
            path = detour(random, reference, time, 0.0)
            reference = (path is not None and timed(path, *reference.sample(time)[1:])) or reference
    assert len(stops) >= 100
    assert np.median(stops) < 0.35
    assert max(stops) < 0.8


def test_a_motion_in_which_joints_brake_as_hard_as_they_may_is_stopped_soon():
    """Braking along the path would brake these harder still, at first: that is no reason to go on to the path's end."""
    limits = JointLimits.of(ROBOT, 0.3, 0.2)
    for seed in range(40):
        random = np.random.default_rng([6, seed])
        goal = np.clip(ROBOT.ready + random.normal(scale=0.5, size=7), limits.lower + 0.1, limits.upper - 0.1)
        path = ROBOT.ready + np.linspace(0.0, 1.0, 100)[:, None] * (goal - ROBOT.ready)
        velocity = random.uniform(-0.1, 0.1, 7) * limits.velocity
        acceleration = -0.997 * np.sign(velocity) * limits.acceleration * (random.uniform(size=7) < 0.4)
        reference = timed_joint_reference(path, np.zeros((100, 1)), limits, velocity, acceleration)
        assert reference is not None
        for time in (0.0, 0.01, 0.02, 0.04):
            stop = stopping_reference(reference, time, limits)
            assert stop.keeps(limits)
            assert stop.duration < 0.3


def test_every_state_of_motion_can_be_bridged_to_rest():
    durations = []
    for random, reference in references(60, seed=4):
        for time in random.uniform(0.0, reference.duration, 2):
            state = reference.sample(time)
            bridge = bridge_to_rest(*state, LIMITS)
            for value, wanted in zip(bridge.sample(0.0), state, strict=True):
                np.testing.assert_allclose(value, wanted, atol=1e-9)
            assert np.all(bridge.strain(LIMITS) <= 1.0 + 1e-6)
            assert np.diff(bridge.times).max() <= PERIOD + 1e-12
            assert not np.any(bridge.velocities[-1])
            assert not np.any(bridge.accelerations[-1])
            # No joint can be at rest sooner than its acceleration limit allows; jerk costs little more.
            least = np.max(np.abs(state[1]) / LIMITS.acceleration)
            assert least - 1e-9 <= bridge.duration <= least + 0.02
            durations.append(bridge.duration)
    assert max(durations) > 0.15


def test_jerk_may_be_limited_much_harder():
    soft = JointLimits(LIMITS.lower, LIMITS.upper, LIMITS.velocity, LIMITS.acceleration, 20.0 * LIMITS.acceleration)
    for seed in range(10):
        path = random_path(np.random.default_rng(seed))
        reference = timed_joint_reference(path, np.zeros((100, 1)), soft)
        assert reference.keeps(soft)
        assert not timed(path).keeps(soft)
        stop = stopping_reference(reference, 0.4 * reference.duration, soft)
        assert stop.keeps(soft)
        assert np.all(bridge_to_rest(*reference.sample(0.5), soft).strain(soft) <= 1.0 + 1e-6)


@pytest.mark.parametrize(
    ("since", "until"),
    [(20, 23), (20, 20), (20, 22.4), (20, 22.03), (-4, -1), (-4, -1.5), (-3, 5), (3, 6), (4, 4)],
)
def test_an_old_reference_is_repeated_until_a_new_one_takes_over(since, until):
    """Periods from the old one's begin, or (where it is over by then, or soon) from its end; also between knots."""
    old = timed(random_path(np.random.default_rng(0)))
    begin, switch = (PERIOD * number if number >= 20 else old.duration + PERIOD * number for number in (since, until))
    if begin < old.duration:
        begin = old.times[np.searchsorted(old.times, begin + 1e-9) - 1]
    state = old.sample(switch)
    new = bridge_to_rest(*state, LIMITS) if switch < old.duration else timed(np.linspace(state[0], ROBOT.ready, 50))
    new = replace(new, latent=np.zeros((len(new.times), 2)))
    whole = joined(old, begin, new, switch)
    at = np.linspace(0.0, switch - begin, 50)
    np.testing.assert_allclose(whole.samples(at)[0], old.samples(begin + at)[0], atol=1e-9)
    at = np.linspace(1e-9, new.duration, 50)
    np.testing.assert_allclose(whole.samples(switch - begin + at)[0], new.samples(at)[0], atol=1e-7)
    assert whole.times[0] == pytest.approx(0.0, abs=1e-9)
    assert len(whole.clearance) == len(whole.times) - 1 == len(whole.latent) - 1
    assert whole.keeps(LIMITS)
