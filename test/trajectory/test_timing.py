"""What is played keeps all limits between knots too, never jumps at a replan, and ends at rest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.stopping import bridge_to_rest, stopping_reference
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import PERIOD
from geodesic_motion_ros.utils.errors import PlanningError

ROBOT = Robot.named("panda")
LIMITS = JointLimits.of(ROBOT)


def test_from_rest_every_reference_keeps_its_limits_and_its_path(motions):
    for seed in range(60):
        path = motions.random_path(np.random.default_rng(seed))
        reference = motions.timed(path)
        np.testing.assert_array_equal(reference.positions[0], path[0])
        np.testing.assert_allclose(reference.positions[-1], path[-1], atol=1e-9)
        motions.assert_plays_within_limits(reference)
        share = np.linspace(0.0, 1.0, 5000)
        dense = CubicSpline(np.linspace(0.0, 1.0, 100), path)(share)
        played = reference.samples(np.linspace(0.0, reference.duration, 50))[0]
        gaps = np.linalg.norm(played[:, None] - dense, axis=2).min(axis=1)
        # As near as samples of the path can tell.
        assert gaps.max() < 0.5 * np.linalg.norm(np.diff(dense, axis=0), axis=1).max() + 1e-4


def test_it_is_fast_some_limit_is_nearly_used_at_most_times(motions):
    shares = [np.mean(reference.limit_ratio(LIMITS)[:2].max(axis=0) > 0.8) for _, reference in motions.references(20)]
    assert np.mean(shares) > 0.7


def test_the_latent_points_go_along(motions):
    for _, reference in motions.references(5):
        np.testing.assert_allclose(reference.latent[[0, -1]], [[0.0, 1.0], [1.0, 0.0]], atol=1e-9)
        assert np.all(np.diff(reference.latent[:, 0]) >= -1e-12)
        np.testing.assert_allclose(reference.latent.sum(axis=1), 1.0)


def test_half_the_speed_takes_about_twice_the_time(motions):
    path = motions.random_path(np.random.default_rng(1))
    slow = JointLimits.of(ROBOT, speed_scale=0.3, acceleration_scale=0.09)
    latent = np.zeros((100, 1))
    duration = timed_joint_reference(path, latent, slow).duration
    assert duration == pytest.approx(timed_joint_reference(path, latent, LIMITS).duration / 0.3, rel=0.1)


def test_no_point_of_a_path_is_passed_sooner_than_was_shown_and_limits_still_count(motions):
    """Where the limits allow it takes as long as was shown; a motion that was shown too fast is as fast as can be."""
    share = np.linspace(0.0, 1.0, 100)
    for seed in range(20):
        path = motions.random_path(np.random.default_rng(seed))
        fastest = timed_joint_reference(path, share[:, None], LIMITS)
        # Begun slowly, ended fast.
        shown = 4.0 * fastest.duration * np.sqrt(share)
        paced = timed_joint_reference(path, share[:, None], LIMITS, shown=shown)
        motions.assert_plays_within_limits(paced)
        np.testing.assert_allclose(paced.positions[[0, -1]], path[[0, -1]], atol=1e-9)
        passed = np.interp(share, paced.latent[:, 0], paced.times)
        # It gathers speed, is averaged over time, and brakes at the end: later than was shown, hardly ever sooner.
        assert np.all(passed > shown - 0.02 * shown[-1])
        assert passed[-1] < shown[-1] + 2.0 * fastest.duration
        hurried = timed_joint_reference(path, share[:, None], LIMITS, shown=0.01 * shown)
        assert hurried.duration == pytest.approx(fastest.duration, rel=1e-6)


def test_a_motion_that_is_faster_than_was_shown_slows_down_to_it(motions):
    """Taken over in fast motion, on its own path: it is joined as it is, and the pace is that shown a while later."""
    share, slowed = np.linspace(0.0, 1.0, 100), 0
    for seed in range(10):
        path = motions.random_path(np.random.default_rng(seed))
        fastest = timed_joint_reference(path, share[:, None], LIMITS)
        begin = 0.3 * fastest.duration
        rest = np.concatenate([fastest.sample(begin)[:1], path[share > fastest.latent_at(begin)[0] + 0.02]])
        along = np.linspace(0.0, 1.0, len(rest))
        shown = 5.0 * fastest.duration * along
        paced = timed_joint_reference(rest, along[:, None], LIMITS, *fastest.sample(begin)[1:], shown=shown)
        if paced is None:
            continue
        motions.assert_plays_within_limits(paced)
        for found, expected in zip(paced.sample(0.0), fastest.sample(begin), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-9)
        half, whole = np.interp([0.5, 1.0], paced.latent[:, 0], paced.times)
        assert whole - half > 0.9 * 0.5 * shown[-1]
        slowed += 1
    assert slowed >= 8


@pytest.mark.parametrize("kink", [0.0, 10.0, 30.0])
def test_a_replan_in_motion_never_jumps_and_keeps_all_limits(motions, kink):
    accepted = tried = 0
    for random, reference in motions.references(60, seed=int(kink)):
        time = random.uniform(0.05, 0.7) * reference.duration
        path = motions.detour(random, reference, time, np.radians(kink))
        if path is None:
            continue
        position, velocity, acceleration = reference.sample(time)
        tried += 1
        found = motions.timed(path, velocity, acceleration)
        if found is None:
            continue
        accepted += 1
        for value, wanted in zip(found.sample(0.0), (position, velocity, acceleration), strict=True):
            np.testing.assert_allclose(value, wanted, atol=1e-9)
        np.testing.assert_allclose(found.positions[-1], path[-1], atol=1e-9)
        motions.assert_plays_within_limits(found)
    assert tried > 30
    assert accepted >= 0.97 * tried


def test_chains_of_replans_play_as_one_smooth_motion(motions):
    """Replanned 12 times at odd instants; where there is no new reference the old one goes on. Sampled at 1 kHz."""
    replans = 0
    for random, reference in motions.references(12, seed=7):
        played = []
        for _ in range(12):
            span = random.uniform(0.03, 0.15)
            steps = np.arange(0.0, span, 0.001)
            played.append(reference.samples(steps))
            time = float(steps[-1]) + 0.001
            path = motions.detour(random, reference, time, np.radians(random.uniform(0.0, 10.0)))
            found = None if path is None else motions.timed(path, *reference.sample(time)[1:])
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


def test_replanning_an_unchanged_path_at_every_knot_costs_no_time(motions):
    delays = []
    for seed in range(6):
        path = motions.random_path(np.random.default_rng(seed))
        reference = motions.timed(path)
        planned, passed = reference.duration, 0.0
        while reference.duration > 0.3:
            passed += PERIOD
            rest = reference.rest(PERIOD)
            ahead = np.linalg.norm(path - rest.positions[0], axis=1)
            left = np.concatenate([rest.positions[:1], path[np.argmin(ahead) + 2 :]])
            found = motions.timed(left, rest.velocities[0], rest.accelerations[0])
            reference = rest if found is None else found
        delays.append((passed + reference.duration) / planned - 1.0)
    assert np.median(delays) < 0.02
    assert max(delays) < 0.1


def test_what_takes_longer_than_is_asked_for_is_not_worked_out_and_nothing_else_changes(motions):
    left_out = 0
    for seed in range(40):
        path = motions.random_path(np.random.default_rng(seed))
        latent = np.zeros((len(path), 1))
        reference = timed_joint_reference(path, latent, LIMITS)
        asked = timed_joint_reference(path, latent, LIMITS, longest=reference.duration)
        np.testing.assert_array_equal(asked.positions, reference.positions)
        for share in (0.5, 0.9, 0.99):
            left_out += timed_joint_reference(path, latent, LIMITS, longest=share * reference.duration) is None
    assert left_out > 60


def test_knots_are_a_period_apart(motions):
    path = motions.random_path(np.random.default_rng(0))
    for period in (0.01, 0.02):
        reference = timed_joint_reference(path, np.zeros((100, 1)), LIMITS, period=period)
        np.testing.assert_allclose(np.diff(reference.times), period)
        motions.assert_plays_within_limits(reference)


def test_without_the_state_of_motion_a_replan_would_jump(motions):
    """The control: the same replans, planned as if from rest."""
    jumps = []
    for random, reference in motions.references(10):
        time = 0.4 * reference.duration
        path = motions.detour(random, reference, time, 0.0)
        if path is not None:
            jumps.append(np.abs(motions.timed(path).sample(0.0)[1] - reference.sample(time)[1]).max())
    assert np.median(jumps) > 0.3


def test_what_cannot_be_led_onto_the_path_is_none(motions):
    path = np.linspace(ROBOT.ready, ROBOT.ready + 0.02, 50)
    assert motions.timed(path) is not None
    assert motions.timed(path, -0.9 * LIMITS.velocity, np.zeros(7)) is None


def test_the_path_of_an_arm_that_stands_at_its_goal_is_stillness(motions):
    reference = motions.timed(np.tile(ROBOT.ready, (10, 1)))
    assert reference.duration <= 0.2
    np.testing.assert_array_equal(reference.positions, np.tile(ROBOT.ready, (len(reference.times), 1)))


def test_an_arm_outside_its_position_limits_may_come_back_but_not_leave(motions):
    start = ROBOT.ready.copy()
    start[1] = LIMITS.upper[1] + 0.005
    back, away = start.copy(), start.copy()
    back[1] -= 0.3
    away[1] += 0.005
    assert motions.timed(np.linspace(start, back, 50)) is not None
    assert motions.timed(np.linspace(start, away, 50)) is None


def test_a_path_with_repeated_points_is_the_path_without_them(motions):
    path = motions.random_path(np.random.default_rng(2))
    plain, repeated = motions.timed(path), motions.timed(np.repeat(path, 3, axis=0))
    assert repeated.duration == pytest.approx(plain.duration, abs=2.0 * PERIOD)
    motions.assert_plays_within_limits(repeated)


@pytest.mark.parametrize(
    ("path", "velocity", "message"),
    [
        (np.zeros((1, 7)), np.zeros(7), "m at least 2"),
        (np.zeros((5, 6)), np.zeros(7), r"\(m, 7\)"),
        (np.zeros((5, 7)), np.zeros(6), r"velocity has shape \(6,\)"),
        (np.full((5, 7), np.nan), np.zeros(7), "finite"),
    ],
)
def test_what_makes_no_path_is_refused(motions, path, velocity, message):
    with pytest.raises(PlanningError, match=message):
        motions.timed(path, velocity, np.zeros(7))


def test_jerk_may_be_limited_much_harder(motions):
    soft = JointLimits(LIMITS.lower, LIMITS.upper, LIMITS.velocity, LIMITS.acceleration, 20.0 * LIMITS.acceleration)
    for seed in range(10):
        path = motions.random_path(np.random.default_rng(seed))
        reference = timed_joint_reference(path, np.zeros((100, 1)), soft)
        assert reference.keeps(soft)
        assert not motions.timed(path).keeps(soft)
        stop = stopping_reference(reference, 0.4 * reference.duration, soft)
        assert stop.keeps(soft)
        assert np.all(bridge_to_rest(*reference.sample(0.5), soft).limit_ratio(soft) <= 1.0 + 1e-6)
