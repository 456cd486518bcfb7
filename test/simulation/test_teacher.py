"""The scripted teacher shows what it promises, and the arm can do it."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between, to_rotation
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation import teacher
from geodesic_motion_ros.simulation.tabletop import TabletopWorld
from geodesic_motion_ros.simulation.teacher import Motion, Performance
from geodesic_motion_ros.utils.errors import ParameterError

ROBOT = Robot.named("panda")
Shown = tuple[tuple[Motion, ...], list[Performance]]


def shown(motions: tuple[Motion, ...]) -> Shown:
    with TabletopWorld(rate_hz=200.0) as world:
        return motions, [teacher.perform(world, motion) for motion in motions]


@pytest.fixture(scope="module")
def pouring() -> Shown:
    return shown(teacher.multi_goal_motions(5, seed=4))


@pytest.fixture(scope="module")
def passing() -> Shown:
    return shown(teacher.two_mode_motions(3, seed=4))


@pytest.fixture(params=["pouring", "passing"])
def either(request: pytest.FixtureRequest) -> Shown:
    return request.getfixturevalue(request.param)


def mouth_of(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Where the mouth of the bottle in the hand is (3,) [m]: the upper end of its neck."""
    neck = teacher.multi_goal_motions(1, seed=0)[0].carried[1]
    end = np.array(neck.centre) + to_rotation(np.array(neck.quaternion)).apply([0.0, 0.0, 0.5 * neck.height])
    return position + to_rotation(quaternion).apply(end)


def test_the_arm_follows_the_wanted_curve(either: Shown) -> None:
    for motion, performance in zip(*either, strict=True):
        done = performance.demonstration
        np.testing.assert_allclose(np.diff(done.times), 0.01)
        assert np.max(np.linalg.norm(done.positions - motion.positions, axis=1)) < 4e-3
        assert np.linalg.norm(done.positions[-1] - motion.positions[-1]) < 2e-4
        assert np.max(angle_between(done.quaternions, motion.quaternions)) < np.radians(2.0)


def test_the_arm_stays_inside_its_limits_and_touches_nothing(either: Shown) -> None:
    for performance in either[1]:
        joints = performance.joint_positions
        velocities = np.diff(joints, axis=0) / 0.01
        assert np.all((joints > ROBOT.lower + 0.1) & (joints < ROBOT.upper - 0.1))
        assert np.all(np.abs(velocities) < ROBOT.velocity_limits)
        assert performance.clearance > 0.005


def test_the_same_seed_gives_the_same_arrays_and_another_seed_others() -> None:
    first, again, other = (teacher.multi_goal_demonstrations(1, seed) for seed in (7, 7, 8))
    for before, after in zip(first, again, strict=True):
        np.testing.assert_array_equal(before.positions, after.positions)
        np.testing.assert_array_equal(before.quaternions, after.quaternions)
        np.testing.assert_array_equal(before.times, after.times)
    assert np.linalg.norm(first[0].positions[0] - other[0].positions[0]) > 1e-3


def test_two_mode_sets_repeat_too() -> None:
    first, again = (teacher.two_mode_demonstrations(1, 7) for _ in range(2))
    assert [item.name for item in first] == ["left_0", "right_0"]
    for before, after in zip(first, again, strict=True):
        np.testing.assert_array_equal(before.positions, after.positions)


def test_bottles_and_cups_lie_in_their_regions_and_fill_them(pouring: Shown) -> None:
    motions, performances = pouring
    starts = np.array([performance.demonstration.positions[0] for performance in performances])
    mouths = np.array(
        [mouth_of(item.demonstration.positions[-1], item.demonstration.quaternions[-1]) for item in performances]
    )
    cups = np.array([motion.solid[-1].centre for motion in motions])
    np.testing.assert_allclose(mouths[:, :2], cups[:, :2], atol=1e-3)
    assert np.all((mouths[:, 2] - cups[:, 2] > 0.05) & (mouths[:, 2] - cups[:, 2] < 0.2))
    assert teacher.BOTTLE_REGION.contains(starts).all()
    assert teacher.CUP_REGION.contains(cups).all()
    # a fifth of either side to each of the five
    assert np.all(np.ptp(starts[:, :2], axis=0) > 0.6 * np.array([0.15, 0.25]))
    assert np.all(np.ptp(cups[:, :2], axis=0) > 0.6 * np.array([0.15, 0.25]))


def test_a_bottle_is_upright_at_first_and_tilted_by_100_degrees_in_the_end(pouring: Shown) -> None:
    upright = pouring[0][0].carried[0]
    axis = to_rotation(np.array(upright.quaternion)).apply([0.0, 0.0, 1.0])
    for performance in pouring[1]:
        up = to_rotation(performance.demonstration.quaternions).apply(axis)[:, 2]
        tilt = np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))
        assert tilt[0] < 0.5
        assert tilt[-1] == pytest.approx(100.0, abs=0.5)
        assert np.max(performance.demonstration.positions[:, 2]) > performance.demonstration.positions[0, 2] + 0.08


def test_drawn_passings_start_and_end_like_those_shown(passing: Shown) -> None:
    generator = np.random.default_rng(11)
    shown_ends = [(motion.positions[end], motion.quaternions[end]) for end in (0, -1) for motion in passing[0][:1]]
    middles = (teacher.PASS_START, teacher.PASS_GOAL)
    for _ in range(50):
        for drawn, shown_end, middle in zip(teacher.draw_passing_query(generator), shown_ends, middles, strict=True):
            assert np.all(np.abs(drawn[0] - middle) <= teacher.PASS_SPREAD)
            assert angle_between(drawn[1], shown_end[1]) < 1e-6


def test_no_two_demonstrations_of_one_place_are_alike() -> None:
    """The hidden style and the hand, not only start and goal, differ: the same place, shown twice."""
    place = np.full(6, 0.5)
    generator = np.random.default_rng(3)
    first, second = (teacher.pouring_motion("same", place, generator) for _ in range(2))
    np.testing.assert_allclose(first.positions[[0, -1]], second.positions[[0, -1]], atol=1e-12)
    fractions = np.linspace(0.0, 1.0, 50)
    resampled = [
        np.stack([np.interp(fractions, np.linspace(0.0, 1.0, len(item.times)), column) for column in item.positions.T])
        for item in (first, second)
    ]
    apart = np.linalg.norm(resampled[0] - resampled[1], axis=0)
    assert 0.003 < np.max(apart) < 0.08


def test_left_and_right_are_far_apart_and_each_is_narrow(passing: Shown) -> None:
    motions, performances = passing
    assert [motion.group for motion in motions] == [0, 0, 0, 1, 1, 1]
    pillar = np.array(teacher.PILLAR.centre)
    beside = []
    for performance in performances:
        positions = performance.demonstration.positions
        beside.append(positions[np.argmin(np.abs(positions[:, 1] - pillar[1])), 0] - pillar[0])
    left, right = np.array(beside[:3]), np.array(beside[3:])
    # the motion leads along y, so that its left is towards the robot
    assert np.max(left) < -0.1
    assert np.min(right) > 0.1
    assert np.min(right) - np.max(left) > 0.2
    assert max(np.ptp(left), np.ptp(right)) < 0.045


def test_starts_goals_and_turn_of_passing(passing: Shown) -> None:
    for performance in passing[1]:
        done = performance.demonstration
        assert np.all(np.abs(done.positions[0] - teacher.PASS_START) < teacher.PASS_SPREAD + 1e-3)
        assert np.all(np.abs(done.positions[-1] - teacher.PASS_GOAL) < teacher.PASS_SPREAD + 1e-3)
        turn = angle_between(done.quaternions[0], done.quaternions[-1])
        assert turn == pytest.approx(np.radians(60.0), abs=np.radians(0.5))


@pytest.mark.parametrize("make", [teacher.multi_goal_motions, teacher.two_mode_motions])
def test_no_demonstration_at_all_is_refused(make) -> None:
    with pytest.raises(ParameterError, match="at least one"):
        make(0, seed=0)


def test_a_world_of_another_rate_is_refused() -> None:
    with TabletopWorld(rate_hz=240.0) as world, pytest.raises(ParameterError, match="needs 200"):
        teacher.perform(world, teacher.two_mode_motions(1, seed=0)[0])


def test_the_picture_shows_the_paths(passing: Shown) -> None:
    motions, performances = passing
    demonstrations = teacher.Demonstrations(tuple(item.demonstration for item in performances))
    with_paths = teacher.picture(motions, demonstrations, width=160, height=120)
    assert with_paths.shape == (120, 160, 3)
    red, _, blue = np.moveaxis(with_paths.astype(int), 2, 0)
    assert np.sum(blue > red + 60) > 30
    assert np.sum(red > blue + 80) > 30
