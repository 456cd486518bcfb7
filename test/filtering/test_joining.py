"""When and where an arm joins what is offered: paths that come back, chunks stamped ahead, turns counted otherwise."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.robot.description import RobotDescription
from test.filtering.conftest import BEGIN, DURATION, MOVED, Filtering, offered

#: There and back, or to one side and the other twice: shares of `MOVED` (151,) at times [s].
TIMES = np.linspace(0.0, 5.0, 151)
PATHS = {"back": np.sin(np.pi * TIMES / 5.0) ** 2, "twice": 0.5 * np.sin(2.0 * np.pi * TIMES / 2.5) ** 3}


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_a_path_that_comes_back_to_its_begin_is_played_as_a_whole_though_at_once(
    filtering: Filtering, path: str, seed: int | None
) -> None:
    """An arm is never where a path begins to the last digit, nor does that come back there."""
    noise = np.zeros((2, 7)) if seed is None else np.random.default_rng(seed).normal(0.0, 1e-3, (2, 7))
    positions = BEGIN + PATHS[path][:, None] * MOVED
    positions[[0, -1]] += noise
    assert filtering.filter.offer(TIMES, positions).ok
    filtering.run(5.5)
    passed = (filtering.positions - BEGIN)[:, 0] / MOVED[0]
    assert np.max(passed) == pytest.approx(np.max(PATHS[path]), abs=0.02)
    highest = np.flatnonzero(passed > 0.9 * np.max(PATHS[path]))
    assert np.count_nonzero(np.diff(highest) > 1) == (path == "twice")


def test_an_arm_that_is_ahead_of_a_chunk_joins_it_where_it_is(filtering: Filtering) -> None:
    """The control: what was planned from where the arm was a moment ago does not lead it back."""
    filtering.run(0.05)
    times = np.arange(16) / 30.0

    def send(now: float) -> None:
        if round(100 * now) % 10 == 0:
            filtering.filter.offer(times, offered(now - 0.1 + times)[0])

    filtering.run(DURATION + 1.0, send)
    assert np.all(np.diff(filtering.positions @ MOVED) > -1e-6)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + MOVED, atol=1e-3)


def test_chunks_that_are_stamped_ahead_are_played_one_after_the_other(filtering: Filtering) -> None:
    """Ten a second, each for a quarter of a second later: the next ones come before it begins."""
    times, ahead = np.arange(16) / 30.0, 0.25

    def send(now: float) -> None:
        if round(100 * now) % 10 == 0:
            assert filtering.filter.offer(times, offered(now + times)[0], begin=now + ahead).ok

    filtering.run(DURATION + 0.8, send)
    asked = offered(0.01 * np.arange(len(filtering.positions)) - ahead)[0]
    assert np.max(np.abs(filtering.positions - asked)) < 0.01


def test_a_later_trajectory_is_judged_by_where_the_arm_is_to_be_then(filtering: Filtering) -> None:
    times = np.linspace(0.0, DURATION, 76)
    there, back = offered(times)[0], offered(DURATION - times)[0]
    assert filtering.filter.offer(times, there, begin=0.0).ok
    filtering.run(0.1)
    refused = filtering.filter.offer(times, there, begin=DURATION)
    assert refused.code is VerdictCode.BAD_INPUT
    assert "is commanded, at most 0.3 may be: a jump" in refused.reason
    assert filtering.filter.offer(times, back, begin=DURATION).ok
    filtering.run(DURATION)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + MOVED, atol=0.01)
    filtering.run(DURATION)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN, atol=1e-6)


def test_a_newer_trajectory_takes_the_place_of_those_that_begin_after_it(filtering: Filtering) -> None:
    times = np.linspace(0.0, DURATION, 76)
    assert filtering.filter.offer(times, offered(times)[0], begin=0.5).ok
    assert filtering.filter.offer(np.zeros(1), BEGIN[None] + 0.1, begin=0.3).ok
    filtering.run(3.0)
    np.testing.assert_allclose(filtering.positions[-1], BEGIN + 0.1, atol=1e-6)


def test_an_arm_at_a_joints_end_comes_back_by_points_that_are_a_hundredth_inside_it(filtering: Filtering) -> None:
    robot, times = filtering.filter.robot, np.linspace(0.0, 1.0, 31)
    begin = BEGIN.copy()
    begin[1] = robot.lower[1] + 0.005
    filtering.filter.stand_at(begin, 0.0)
    inwards = begin + 0.3 * (np.sin(0.5 * np.pi * times) ** 2)[:, None] * np.eye(7)[1]
    refused = filtering.filter.offer(times, inwards)
    assert refused.code is VerdictCode.BAD_INPUT
    assert "point 0 takes 'panda_joint2'" in refused.reason
    inside = np.maximum(inwards, robot.lower + 0.011)
    assert filtering.filter.offer(times, inside).ok
    filtering.run(2.0)
    np.testing.assert_allclose(filtering.positions[-1], inwards[-1], atol=1e-6)


def test_to_withdraw_before_anything_was_handed_out_changes_nothing() -> None:
    motion_filter = MotionFilter("panda", DeclaredScene.empty())
    motion_filter.withdraw()
    motion_filter.stand_at(BEGIN, 0.0)
    motion_filter.withdraw()
    assert motion_filter.tick(0.01).verdict.code is VerdictCode.NO_GOAL
    np.testing.assert_array_equal(motion_filter.commanded_state(0.01)[0], BEGIN)


@pytest.fixture(scope="module")
def endless(tmp_path_factory: pytest.TempPathFactory) -> MotionFilter:
    """A filter of an arm whose last joint turns without an end."""
    folder = Path(shutil.copytree(RobotDescription.named("ur5").folder, tmp_path_factory.mktemp("arm") / "ur5"))
    urdf = (folder / "ur5.urdf").read_text()
    joint = '<joint name="wrist_3_joint" type="'
    assert urdf.count(joint + 'revolute"') == 1
    (folder / "ur5.urdf").write_text(urdf.replace(joint + 'revolute"', joint + 'continuous"'))
    made = MotionFilter(str(folder), DeclaredScene.empty())
    assert made.robot.is_continuous.tolist() == [False] * 5 + [True]
    return made


@pytest.mark.parametrize("turns", [-1, 0, 3])
def test_turns_that_are_counted_otherwise_or_wrapped_are_the_same_places(endless: MotionFilter, turns: int) -> None:
    begin, times = endless.robot.ready.copy(), np.linspace(0.0, 1.0, 31)
    begin[-1] = 3.0
    path = np.tile(begin, (31, 1))
    path[:, -1] += 0.4 * np.sin(0.5 * np.pi * times) ** 2
    wrapped = path.copy()
    wrapped[:, -1] = (path[:, -1] + np.pi) % (2.0 * np.pi) - np.pi + 2.0 * np.pi * turns
    assert np.ptp(wrapped[:, -1]) > 6.0
    endless.clear_goal()
    endless.stand_at(begin, 0.0)
    turning = Filtering(endless)
    assert endless.offer(times, wrapped).ok
    turning.run(1.3)
    np.testing.assert_allclose(turning.positions[-1], path[-1], atol=1e-6)
