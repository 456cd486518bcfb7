"""What is left of a reference is the same motion, and one that goes over into another is both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.stopping import bridge_to_rest
from geodesic_motion_ros.trajectory.trajectory import PERIOD, interpolated, joined

ROBOT = Robot.named("panda")
LIMITS = JointLimits.of(ROBOT)


def test_the_rest_of_a_reference_is_the_same_motion(motions):
    for random, reference in motions.references(10):
        for time in (*random.uniform(0.0, reference.duration, 5), reference.times[3], 0.0):
            rest = reference.rest(time)
            at = np.linspace(0.0, rest.duration, 300)
            expected, found = reference.samples(time + at), rest.samples(at)
            np.testing.assert_allclose(found[0], expected[0], atol=1e-12)
            np.testing.assert_allclose(found[1], expected[1], atol=1e-8)
            np.testing.assert_allclose(found[2], expected[2], atol=1e-3)
            assert len(rest.times) == len(rest.latent)
            assert rest.duration == pytest.approx(reference.duration - time, abs=1e-5)


def test_after_its_end_a_reference_stands(motions):
    _, reference = next(motions.references(1))
    standing = reference.rest(reference.duration + 1.0)
    np.testing.assert_array_equal(standing.positions, reference.positions[[-1, -1]])
    assert standing.keeps(LIMITS)
    position, velocity, acceleration = reference.sample(reference.duration + 1.0)
    np.testing.assert_array_equal(position, reference.positions[-1])
    assert not np.any(velocity)
    assert not np.any(acceleration)


@pytest.mark.parametrize(
    ("since", "until"),
    [(20, 23), (20, 20), (20, 22.4), (20, 22.03), (-4, -1), (-4, -1.5), (-3, 5), (3, 6), (4, 4)],
)
def test_an_old_reference_is_repeated_until_a_new_one_takes_over(motions, since, until):
    """Periods from the old one's begin, or (where it is over by then, or soon) from its end; also between knots."""
    old = motions.timed(motions.random_path(np.random.default_rng(0)))
    begin, switch = (PERIOD * number if number >= 20 else old.duration + PERIOD * number for number in (since, until))
    if begin < old.duration:
        begin = old.times[np.searchsorted(old.times, begin + 1e-9) - 1]
    state = old.sample(switch)
    home = np.linspace(state[0], ROBOT.ready, 50)
    new = bridge_to_rest(*state, LIMITS) if switch < old.duration else motions.timed(home)
    new = replace(new, latent=np.zeros((len(new.times), 2)))
    whole = joined(old, begin, new, switch)
    at = np.linspace(0.0, switch - begin, 50)
    np.testing.assert_allclose(whole.samples(at)[0], old.samples(begin + at)[0], atol=1e-9)
    at = np.linspace(1e-9, new.duration, 50)
    np.testing.assert_allclose(whole.samples(switch - begin + at)[0], new.samples(at)[0], atol=1e-7)
    assert whole.times[0] == pytest.approx(0.0, abs=1e-9)
    assert len(whole.times) == len(whole.latent)
    assert whole.keeps(LIMITS)


def test_values_are_interpolated_as_by_numpy_also_between_equal_knots_and_beyond_the_ends() -> None:
    random = np.random.default_rng(0)
    knots = np.sort(random.integers(0, 10, 30) / 10.0)
    values, at = random.normal(size=(30, 3)), np.append(random.uniform(-0.5, 1.5, 200), [-1.0, 2.0])
    expected = np.stack([np.interp(at, knots, column) for column in values.T], axis=1)
    np.testing.assert_allclose(interpolated(at, knots, values), expected, atol=1e-12)


def test_jerks_are_those_of_the_accelerations_and_none_where_nothing_moves(motions):
    for _, reference in motions.references(5):
        times = np.arange(0.0, 0.5 * reference.duration, 1e-3)
        jerks = np.abs(np.diff(reference.samples(times)[2], axis=0)).max(axis=1) / 1e-3
        np.testing.assert_allclose(reference.jerks(0.0, 0.5 * reference.duration), jerks)
        assert not np.any(reference.rest(reference.duration + 1.0).jerks(0.0, 1.0))
        assert not np.any(reference.jerks(0.1, 0.1))
