"""The rules of joint_trajectory_controller, one by one; SciPy's polynomials are the oracles of what is interpolated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import joined
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints, TrajectoryPlayer
from geodesic_motion_ros.utils.errors import RobotError

STAMP = 1.7e9
GIVEN = ("positions", "velocities", "accelerations")


def random_waypoints(seed: int, given: int = 3, count: int = 6, joints: int = 3) -> JointWaypoints:
    """Waypoints about 0.2 s apart with so many of positions, velocities and accelerations, at rest at the end."""
    generator = np.random.default_rng(seed)
    rows = generator.normal(size=(given, count, joints))
    rows[1:, -1] = 0.0
    return JointWaypoints(np.cumsum(generator.uniform(0.1, 0.3, count)), *rows)


def resting(joints: int = 3) -> TrajectoryPlayer:
    return TrajectoryPlayer(np.zeros(joints), np.zeros(joints))


def polynomials(waypoints: JointWaypoints) -> BPoly:
    given = [getattr(waypoints, name) for name in GIVEN if getattr(waypoints, name) is not None]
    return BPoly.from_derivatives(waypoints.times, np.stack(given, axis=1))


def leap(player: TrajectoryPlayer, time: float, order: int, step: float = 1e-6) -> float:
    """How much a derivative of what is desired changes at a time, beyond what it changes in a step anyway."""
    return float(np.max(np.abs(player.sample(time + step) - player.sample(time - step))[order]))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), given=st.sampled_from([1, 2, 3]))
def test_positions_give_lines_velocities_cubics_accelerations_quintics(seed: int, given: int) -> None:
    waypoints = random_waypoints(seed, given)
    player, expected = resting(), polynomials(waypoints)
    player.replace(waypoints, 0.0, waypoints.times[0])
    for time in np.random.default_rng(seed).uniform(waypoints.times[0], waypoints.times[-1], 20):
        sampled = player.sample(time)
        for order in range(3):
            np.testing.assert_allclose(sampled[order], expected.derivative(order)(time), rtol=1e-7, atol=1e-7)


def test_the_segment_that_contains_now_is_played_however_much_is_over() -> None:
    waypoints = random_waypoints(1)
    player = resting()
    player.replace(waypoints, STAMP, STAMP + waypoints.times[3] + 0.01)
    np.testing.assert_allclose(
        player.sample(STAMP + waypoints.times[3] + 0.01)[0],
        polynomials(waypoints)(waypoints.times[3] + 0.01),
        atol=1e-5,
    )


def test_a_trajectory_without_a_begin_begins_when_it_is_received() -> None:
    waypoints = random_waypoints(2)
    player, late = resting(), resting()
    player.replace(waypoints, None, 5.0)
    late.replace(waypoints, 5.0, 5.0)
    for time in (5.0, 5.3, 6.0):
        np.testing.assert_array_equal(player.sample(time), late.sample(time))


@pytest.mark.parametrize("given", [1, 2, 3])
def test_before_the_first_waypoint_it_goes_there_from_what_was_desired_at_replacement(given: int) -> None:
    old, new = random_waypoints(3), random_waypoints(4, given)
    player = resting()
    player.replace(old, 0.0, 0.0)
    now = float(old.times[2]) + 0.05
    desired = player.sample(now)
    player.replace(new, now, now)
    kept = [values[None] for values in desired[:given]]
    led = [np.concatenate([first, getattr(new, name)]) for first, name in zip(kept, GIVEN, strict=False)]
    expected = polynomials(JointWaypoints(np.append(0.0, new.times), *led))
    for elapsed in np.linspace(0.0, new.times[1], 9)[:-1]:
        np.testing.assert_allclose(player.sample(now + elapsed)[0], expected(elapsed), atol=1e-9)


def test_one_that_begins_later_replaces_the_old_at_once_too() -> None:
    old, new = random_waypoints(11), random_waypoints(12)
    player = resting()
    player.replace(old, 0.0, 0.0)
    desired = player.sample(0.3)
    player.replace(new, 1.0, 0.3)
    np.testing.assert_allclose(player.sample(0.3), desired, atol=1e-9)
    first = 1.0 + float(new.times[0])
    rows = [np.stack([before, getattr(new, name)[0]]) for before, name in zip(desired, GIVEN, strict=True)]
    expected = BPoly.from_derivatives(np.array([0.3, first]), np.stack(rows, axis=1))
    for time in np.linspace(0.3, first, 7):
        np.testing.assert_allclose(player.sample(time)[0], expected(time), atol=1e-8)


def test_a_first_waypoint_at_the_begin_is_not_led_to() -> None:
    """The controller jumps there; a sender must begin where the arm is."""
    new = random_waypoints(13)
    new = JointWaypoints(new.times - new.times[0], new.positions, new.velocities, new.accelerations)
    player = resting()
    player.replace(new, 5.0, 5.0)
    np.testing.assert_allclose(player.sample(5.0)[0], new.positions[0], atol=1e-9)


def test_a_last_velocity_of_single_precision_zero_is_rest() -> None:
    times, positions, velocities = np.array([0.1, 0.2]), np.zeros((2, 2)), np.zeros((2, 2))
    velocities[-1] = 0.9 * np.finfo(np.float32).eps
    JointWaypoints(times, positions, velocities)
    velocities[-1] *= -2.0
    with pytest.raises(RobotError, match="the last ones must be zero"):
        JointWaypoints(times, positions, velocities)


def test_the_newest_replaces_the_old_at_once() -> None:
    old, new = random_waypoints(5), random_waypoints(6)
    player = resting()
    player.replace(old, 0.0, 0.0)
    player.replace(new, -new.times[0], 0.1)
    np.testing.assert_allclose(player.sample(0.1)[0], polynomials(new)(new.times[0] + 0.1), atol=1e-9)


def test_after_the_end_the_last_waypoint_is_kept() -> None:
    waypoints = random_waypoints(7)
    player = resting()
    player.replace(waypoints, 0.0, 0.0)
    for time in (waypoints.times[-1], waypoints.times[-1] + 100.0):
        np.testing.assert_array_equal(player.sample(time), [waypoints.positions[-1], np.zeros(3), np.zeros(3)])


def test_overdue_counts_from_the_end_and_ends_with_the_next_trajectory() -> None:
    waypoints, player = random_waypoints(7), resting()
    assert not player.overdue(STAMP, 0.5)
    player.replace(waypoints, STAMP + 1.0, STAMP)
    end = STAMP + 1.0 + waypoints.times[-1]
    assert not player.overdue(end + 0.4, 0.5)
    assert player.overdue(end + 0.6, 0.5)
    player.replace(waypoints, None, end + 0.6)
    assert not player.overdue(end + 0.7, 0.5)


def test_what_is_kept_is_desired_at_rest_until_the_next_begins_there() -> None:
    waypoints, player, here = random_waypoints(7), resting(), np.array([0.1, -0.2, 0.3])
    player.replace(waypoints, 0.0, 0.0)
    player.hold(here)
    np.testing.assert_array_equal(player.sample(5.0), [here, np.zeros(3), np.zeros(3)])
    assert not player.overdue(1e6, 0.5)
    player.replace(waypoints, 5.0, 5.0)
    np.testing.assert_allclose(player.sample(5.0), [here, np.zeros(3), np.zeros(3)], atol=1e-12)


def test_one_that_ends_in_the_past_is_refused_and_the_old_one_goes_on() -> None:
    old, new = random_waypoints(8), random_waypoints(9)
    player, undisturbed = resting(), resting()
    for one in (player, undisturbed):
        one.replace(old, STAMP, STAMP)
    with pytest.raises(RobotError, match=r"ends in the past, 0\.250 s ago"):
        player.replace(new, STAMP - new.times[-1], STAMP + 0.25)
    np.testing.assert_array_equal(player.sample(STAMP + 0.3), undisturbed.sample(STAMP + 0.3))
    player.replace(new, STAMP + 0.25 - new.times[-1] + 1e-3, STAMP + 0.25)


def test_a_single_waypoint_is_reached_in_its_time() -> None:
    goal = np.array([0.3, -0.2, 0.1])
    player = TrajectoryPlayer(np.zeros(3), np.array([0.5, 0.0, 0.0]))
    player.replace(JointWaypoints(np.array([2.0]), goal[None], np.zeros((1, 3))), None, 1.0)
    np.testing.assert_allclose(player.sample(1.0)[1], [0.5, 0.0, 0.0])
    np.testing.assert_allclose(player.sample(3.0 - 1e-9)[0], goal, atol=1e-8)


def test_a_reference_replanned_in_motion_is_played_without_a_leap() -> None:
    """As the planner sends it: old knots up to the switch, the new ones after it, the stamp of an old knot."""
    limits = JointLimits(np.full(2, -3.0), np.full(2, 3.0), np.full(2, 2.0), np.full(2, 8.0), np.full(2, 400.0))
    latent = np.zeros((2, 1))
    old = timed_joint_reference(np.array([[0.0, 0.0], [1.0, -1.0]]), latent, limits)
    state = old.sample(old.times[15])
    new = timed_joint_reference(np.array([state[0], [0.2, -1.2]]), latent, limits, state[1], state[2])
    sent = joined(old, old.times[12], new, old.times[15])
    player = TrajectoryPlayer(np.zeros(2), np.zeros(2))
    waypoints = JointWaypoints(old.times, old.positions, old.velocities, old.accelerations)
    assert player.replace(waypoints, 100.0, 100.0) is None
    now = 100.0 + old.times[12] + 0.013
    before = player.sample(now)
    waypoints = JointWaypoints(sent.times, sent.positions, sent.velocities, sent.accelerations)
    assert player.replace(waypoints, 100.0 + old.times[12], now) is None
    np.testing.assert_allclose(player.sample(now), before, atol=1e-8)
    switch = 100.0 + old.times[15]
    assert leap(player, switch, 0) < 1e-5
    assert leap(player, switch, 1) < 1e-4
    assert leap(player, switch, 2) < 1e-2
    np.testing.assert_allclose(player.sample(switch + new.duration)[0], [0.2, -1.2], atol=1e-9)


@pytest.mark.parametrize(
    ("offset", "late", "steps"),
    [(0.0, 0.0, False), (0.9e-5, 0.0, False), (1.1e-5, 0.0, True), (0.0, 0.09, True), (0.0, -0.05, False)],
)
def test_a_takeover_that_steps_is_found_with_joint_and_size(offset: float, late: float, steps: bool) -> None:
    """A trajectory from rest, off by an offset, or received after its begin: then the arm is behind it at once."""
    limits = JointLimits(np.full(2, -3.0), np.full(2, 3.0), np.full(2, 2.0), np.full(2, 8.0), np.full(2, 400.0))
    start = np.array([0.0, offset])
    motion = timed_joint_reference(np.array([start, [0.0, 1.0]]), np.zeros((2, 1)), limits)
    player = TrajectoryPlayer(np.zeros(2), np.zeros(2))
    waypoints = JointWaypoints(motion.times, motion.positions, motion.velocities, motion.accelerations)
    found = player.replace(waypoints, STAMP, STAMP + late)
    assert (found is not None) is steps
    if found is not None:
        at = np.stack(motion.sample(max(0.0, late)))
        assert found.joint == 1
        assert found.late == pytest.approx(late, abs=1e-6)
        np.testing.assert_allclose([found.position, found.velocity], at[:2, 1], atol=1e-6)


def test_the_order_in_memory_makes_no_difference_and_compiles_nothing_anew() -> None:
    waypoints = random_waypoints(10)
    rows = [np.asfortranarray(getattr(waypoints, name)) for name in GIVEN]
    player, other = resting(), resting()
    player.replace(waypoints, 0.0, 0.0)
    player.sample(0.5)
    compiled = len(quintic_samples.signatures)
    other.replace(JointWaypoints(waypoints.times, *rows), 0.0, 0.0)
    np.testing.assert_array_equal(other.sample(0.5), player.sample(0.5))
    assert len(quintic_samples.signatures) == compiled


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"times": np.zeros(0)}, "n at least 1"),
        ({"times": np.array([0.0, 0.2, 0.2])}, "waypoint 1 is at 0.2000 s, the next one at 0.2000 s"),
        ({"times": np.array([0.0, np.nan, 0.2])}, "times of a trajectory hold nan"),
        ({"positions": np.full((3, 2), np.inf)}, "positions of a trajectory hold inf"),
        ({"velocities": np.zeros((2, 2))}, r"velocities of a trajectory have shape \(2, 2\): expected \(3, 2\)"),
        ({"velocities": np.full((3, 2), 0.1)}, "the last ones must be zero"),
        ({"velocities": None}, "accelerations but no velocities"),
    ],
)
def test_what_is_no_trajectory_is_refused_with_the_reason(change: dict[str, np.ndarray | None], message: str) -> None:
    good = {"times": np.array([0.0, 0.1, 0.2]), **{name: np.zeros((3, 2)) for name in GIVEN}}
    JointWaypoints(**good)
    with pytest.raises(RobotError, match=message):
        JointWaypoints(**(good | change))
