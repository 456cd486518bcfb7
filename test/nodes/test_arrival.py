"""The log says once of each goal that the arm has come to rest there, and how far from it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.nodes.arm_watch import REST_TIME
from geodesic_motion_ros.nodes.arrival import ArrivalWatch
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.planning.mission import GoalRequest

PERIOD = 0.01
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
OK, REFUSED = Verdict(), Refusal(VerdictCode.GOAL_OUT_OF_SUPPORT, "too far")


class Bench:
    """A watch, and an arm that carries its tool along a path of one metre along x, its end being the goal: an arm of
    three sliding joints.
    """

    def __init__(self) -> None:
        path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.stack([UPRIGHT, UPRIGHT])
        self.watch = ArrivalWatch(lambda joints: (joints, UPRIGHT), lambda reference: path)
        self.now = 100.0

    def cycles(
        self, seconds: float, goal: int, place: float = 0.0, left: float = 0.0, speed: float = 0.0, off: float = 0.0,
        verdict: Verdict = OK, of_goal: Verdict = OK,
    ) -> Iterator[str]:  # fmt: skip
        """What is logged in some seconds with the tool at x = place [m], which moves on by `off` [m] in each cycle."""
        for _ in range(round(seconds / PERIOD)):
            joints = np.array([place, 0.0, 0.0])
            seen, times = ObstacleTracker().current(0.0), {"now": self.now, "heard": self.now}
            inputs = CycleInputs(joints, 0.0, GoalRequest(Pose(joints, UPRIGHT)), goal, seen, **times)
            line = self.watch.observe(inputs, CycleOutput(verdict, of_goal, time_to_goal=left, speed=speed))
            self.now, place = self.now + PERIOD, place + off
            if line:
                yield line


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_one_line_for_each_goal_with_time_and_distance(bench):
    assert not [*bench.cycles(2.0, goal=1, left=2.0, speed=0.5)]
    assert [*bench.cycles(5.0, goal=1, place=0.999)] == ["at the goal after 2.0 s, 1.0 mm and 0.0 deg from it"]
    assert not [*bench.cycles(1.0, goal=2, left=1.0, speed=0.5)]
    assert [*bench.cycles(5.0, goal=2, place=1.0)] == ["at the goal after 1.0 s, 0.0 mm and 0.0 deg from it"]


def test_an_arm_that_lags_is_waited_for(bench):
    assert not [*bench.cycles(1.0, goal=1, place=0.2, off=0.008)]
    assert [*bench.cycles(REST_TIME + 0.1, goal=1, place=1.0)] == [
        "at the goal after 1.0 s, 0.0 mm and 0.0 deg from it"
    ]


def test_neither_a_stop_nor_a_refused_goal_is_an_arrival(bench):
    stopped = Refusal(VerdictCode.NO_FEASIBLE_PATH, "blocked")
    assert not [*bench.cycles(2.0, goal=1, verdict=stopped, left=np.nan)]
    assert not [*bench.cycles(2.0, goal=1, left=1.0, speed=0.2)]
    assert len([*bench.cycles(2.0, goal=1, place=1.0)]) == 1
    assert not [*bench.cycles(2.0, goal=2, place=1.0, of_goal=REFUSED)]


def test_a_refused_goal_leaves_the_arrival_at_the_one_before(bench):
    assert not [*bench.cycles(1.0, goal=1, left=1.0, speed=0.2)]
    assert len([*bench.cycles(2.0, goal=2, place=1.0, of_goal=REFUSED)]) == 1
