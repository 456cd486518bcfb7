"""A task frame or a goal that is received again and again, as what tracks an object sends it: no reason to stop."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.nodes.cycle import CycleInputs
from geodesic_motion_ros.nodes.planner_cycle import PlannerCycle
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill

PERIOD = 0.02
NOTHING = ObstacleTracker().current(0.0)
#: A camera's 25 Hz in cycles, and the noise of its poses [m].
EVERY, NOISE = 2, 2e-4
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
SKILL = Skill.load("panda_pouring")
START, GOAL = np.split(SKILL.start_pose, [3]), np.split(SKILL.goal_pose, [3])


@pytest.fixture(scope="module")
def planner() -> ReactivePlanner:
    return ReactivePlanner(SKILL)


def start_of(planner: ReactivePlanner) -> np.ndarray:
    """The configuration (7,) in which a plan from the skill's own start begins."""
    planned = planner.plan(*START, *GOAL).reference
    assert planned is not None
    return planned.positions[0]


def played(planner: ReactivePlanner, received: Callable[[int], dict], count: int) -> Iterator[np.ndarray]:
    """Where the tool (3,) is commanded to be in each of so many cycles [m]; fails where one says anything but OK.

    received : from the number of a cycle, what is new of its inputs.
    """
    planner.clear_goal()
    planner.set_task_frame(np.zeros(3), UPRIGHT)
    planner.stand_at(start_of(planner), 0.0)
    cycle = PlannerCycle(planner, 0.1, 1.0, tracking_tolerance=0.1, horizon=3.0, clock=lambda: 0.0)
    inputs = CycleInputs(
        measured=start_of(planner), state_age=0.0, goal=GoalRequest(Pose(*GOAL), True), goal_number=1,
        obstacles=NOTHING,
    )  # fmt: skip
    for number in range(count):
        now = PERIOD * number
        inputs = dataclasses.replace(inputs, now=now, heard=now, **received(number))
        output = cycle.run(inputs, PERIOD)
        assert output.verdict.ok, (number, output.verdict.reason)
        commanded = planner.commanded_state(now + PERIOD)
        assert commanded is not None
        inputs = dataclasses.replace(inputs, measured=commanded[0])
        yield planner.robot.forward(commanded[0])[0]


def arrival(planner: ReactivePlanner, received: Callable[[int], dict] = lambda cycle: {}) -> float:
    """When the tool has come within 1 mm of the goal to stay [s]."""
    sent = (received(number) if number % EVERY == 0 else {} for number in itertools.count())
    tool = np.array(list(played(planner, lambda cycle: next(sent), round(7.0 / PERIOD))))
    distances = np.linalg.norm(tool - GOAL[0], axis=1)
    assert distances[-1] < 1e-3
    return PERIOD * (1 + np.flatnonzero(distances >= 1e-3)[-1])


def goals(random: np.random.Generator, noise: float):
    return lambda cycle: {
        "goal": GoalRequest(Pose(GOAL[0] + random.normal(size=3) * noise, GOAL[1]), True),
        "goal_number": cycle + 1,
    }


def frames(random: np.random.Generator, noise: float, goal_in_task_frame: bool):
    return lambda cycle: {
        "task_frame": (random.normal(size=3) * noise, UPRIGHT.copy()),
        "goal": GoalRequest(Pose(*GOAL), goal_in_task_frame),
    }


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_what_is_received_again_neither_stops_nor_delays_the_tool(planner: ReactivePlanner, noise: float) -> None:
    undisturbed = arrival(planner)
    random = np.random.default_rng(0)
    for received in (goals(random, noise), frames(random, noise, False), frames(random, noise, True)):
        assert arrival(planner, received) <= undisturbed + 0.1


@pytest.mark.parametrize("moved", ["goal", "task_frame"])
def test_a_small_move_is_made_exactly_once_the_tool_rests(planner: ReactivePlanner, moved: str) -> None:
    shift = np.array([1.5e-3, 0.0, 0.0])
    goal = GoalRequest(Pose(GOAL[0] + shift, GOAL[1]), True)
    new = {"task_frame": (shift, UPRIGHT), "goal": goal}[moved]
    received = {round(2.0 / PERIOD): {"goal_number": 2, moved: new}}
    *_, last = played(planner, lambda cycle: received.get(cycle, {}), round(8.0 / PERIOD))
    np.testing.assert_allclose(last, GOAL[0] + shift, atol=1e-6)
