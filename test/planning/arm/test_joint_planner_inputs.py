"""What enters a planner: it is taken as it is, or refused by name, and then nothing changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.motion.tracking import Tracking
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.utils.errors import PlanningError

HERE, TURN = np.array([0.4, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0])
NOT_TIMES = [np.nan, np.inf, -np.inf, 1e300, 1.8e18, "now", None, True, np.zeros(3)]


def refused(answer) -> str:
    verdict = answer if isinstance(answer, Verdict) else answer.verdict
    assert verdict.code is VerdictCode.BAD_INPUT
    return verdict.reason


@pytest.mark.parametrize("time", NOT_TIMES)
@pytest.mark.parametrize("velocity", [0.0, 0.1])
def test_obstacles_of_no_time_are_refused_and_the_old_ones_stay(stream, on_elbow, time, velocity) -> None:
    planner = stream.planner
    planner.set_obstacles(*on_elbow)
    before = planner.obstacles
    centres, radii = on_elbow[0] + [0.0, 0.0, 0.1], on_elbow[1]
    velocities = np.full((1, 3), velocity)
    assert planner.set_obstacles(centres, radii, velocities, time=1.8e9).ok
    assert planner.set_obstacles(*on_elbow).ok
    before = planner.obstacles
    moving = replace(Obstacles.of_spheres(centres, radii, velocities, 0.0), time=time)
    assert "time of the obstacles [s]" in refused(planner.take_obstacles(moving))
    if time is not None:
        assert "time of the obstacles" in refused(planner.set_obstacles(centres, radii, velocities, time))
    assert planner.obstacles is before


def test_obstacles_that_move_need_a_time_and_those_that_stand_do_not(stream, on_elbow) -> None:
    planner, (centres, radii) = stream.planner, on_elbow
    assert planner.set_obstacles(centres, radii, np.zeros((1, 3))).ok
    before = planner.obstacles
    assert "the time [s] at which they are there is not given" in refused(
        planner.set_obstacles(centres, radii, np.full((1, 3), 0.1))
    )
    assert refused(planner.take_obstacles(None)) == "obstacles are None: Obstacles are needed"
    assert planner.obstacles is before


@pytest.mark.parametrize("kind", ["f2", ">f4", ">f8", "g", "i4", "F"])
def test_obstacles_in_any_kind_of_number_are_those_in_doubles(stream, nominal, kind) -> None:
    """Kernels are compiled for doubles, row by row: others would be compiled anew in the control loop, or not at all.
    """
    planner, centres = stream.planner, np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    other = np.asfortranarray(centres) if kind == "F" else centres.astype(kind)
    plain = Obstacles.of_spheres(centres, [1.0, 1.0])
    assert planner.take_obstacles(replace(plain, centres=other, radii=np.ones(2).astype(other.dtype))).ok
    taken = planner.obstacles
    assert taken.centres.dtype == taken.radii.dtype == np.dtype(float)
    assert taken.centres.flags.c_contiguous
    assert taken.same_places(plain)


@pytest.mark.parametrize(
    ("centres", "radii", "velocities", "said"),
    [
        (np.zeros((3, 4)), np.full(4, 0.05), None, "obstacle centres has shape (3, 4): expected (o, 3)"),
        (np.zeros(6), np.full(2, 0.05), None, "obstacle centres has shape (6,)"),
        (np.zeros(3), 0.05, None, "obstacle centres has shape (3,)"),
        (np.zeros((2, 3)), np.full((2, 1), 0.05), None, "radii has shape (2, 1): expected (o,)"),
        (np.zeros((2, 3)), np.full(2, 0.05), np.zeros((3, 2)), "obstacle velocities has shape (3, 2)"),
        (np.zeros((2, 3)), np.full(3, 0.05), None, "as many of each"),
        (np.zeros((2, 3)), np.full(2, 0.05), np.zeros((1, 3)), "as many of each"),
        ([[0.0, 0.0]], [0.05], None, "obstacle centres has shape (1, 2)"),
        ([[0.0, 0.0, 0.0], [0.0]], [0.05, 0.05], None, "obstacle centres cannot be read as numbers"),
        ("here", [0.05], None, "obstacle centres is 'here'"),
        (torch.zeros(1, 3, requires_grad=True), [0.05], None, "obstacle centres cannot be read as numbers"),
    ],
)
def test_obstacles_of_another_shape_are_refused_not_made_to_fit(stream, on_elbow, centres, radii, velocities, said):
    planner = stream.planner
    planner.set_obstacles(*on_elbow)
    before = planner.obstacles
    assert said in refused(planner.set_obstacles(centres, radii, velocities, time=0.0))
    assert planner.obstacles is before
    assert planner.set_obstacles([], []).ok
    assert planner.set_obstacles(torch.zeros(1, 3), [0.05]).ok


@pytest.mark.parametrize("now", NOT_TIMES)
def test_a_tick_at_no_time_is_refused_and_changes_nothing(stream, nominal, now) -> None:
    planner = stream.planner
    stream.run(0.5)
    expected = planner.commanded_state(stream.now + 0.2)
    answers = planner.tick(now), planner.stop(now, Refusal(VerdictCode.HOLD_REQUESTED, "hold"))
    for answer in (*answers, planner.stand_at(nominal.positions[0], now)):
        assert refused(answer).startswith("now [s] is ")
        assert answer.reference is None
    np.testing.assert_array_equal(planner.commanded_state(stream.now + 0.2), expected)
    late = Refusal(VerdictCode.DEADLINE_MISSED, "late")
    for ask in (
        planner.commanded_state, planner.remaining_motion, lambda time: planner.record_braking(nominal, time, late)
    ):  # fmt: skip
        with pytest.raises(PlanningError, match=r"\[s\] is "):
            ask(now)
    assert all(plan.verdict.ok for plan in stream.run(0.1))


def test_what_is_no_deadline_is_refused(stream) -> None:
    for answer in (
        stream.planner.tick(stream.now, 0.0),
        stream.planner.tick(stream.now, handover_deadline=5),
        stream.planner.stop(stream.now, Refusal(VerdictCode.HOLD_REQUESTED, "hold"), None),
    ):
        assert "a Deadline is needed" in refused(answer)
    assert all(plan.verdict.ok for plan in stream.run(0.05))


@pytest.mark.parametrize(
    "position",
    ["here", None, [0.4, 0.0], [[0.4, 0.0, 0.5]], [0.4, [0.0], 0.5], torch.zeros(3, requires_grad=True), [np.nan] * 3],
)
def test_a_pose_that_is_none_is_refused(stream, position) -> None:
    planner = stream.planner
    for answer in (
        planner.set_goal(position, TURN),
        planner.set_task_frame(position, TURN),
        planner.plan(HERE, TURN, position, TURN),
        planner.plan(position, TURN, HERE, TURN),
    ):
        assert "position" in refused(answer)
    assert "quaternion" in refused(planner.set_goal(HERE, position))
    assert all(plan.verdict.ok for plan in stream.run(0.05))


@pytest.mark.parametrize("configuration", ["ready", None, [0.0], [[0.0] * 7], [[0.0]] * 6 + [0.0], [True] * 7])
def test_a_configuration_that_is_none_is_refused(stream, configuration) -> None:
    assert "panda_joint1" in refused(stream.planner.set_goal_configuration(configuration))
    assert "panda_joint1" in refused(stream.planner.stand_at(configuration, 0.0))


@pytest.mark.parametrize("objects", [[1], ["cup"], 1, 0, "cup", [HeldObject("cup", "sphere", (0.02,)), None]])
def test_what_is_no_object_is_not_held(stream, objects) -> None:
    assert "HeldObject is needed" in refused(stream.planner.hold(objects))
    assert stream.planner.held == ()


@pytest.mark.parametrize("value", ["fast", True, np.nan, [0.1]])
def test_a_setting_that_changes_is_judged_as_at_the_start(stream, value) -> None:
    before = stream.planner.settings
    for name in ("speed_scale", "obstacle_margin", "obstacle_position_error"):
        assert f"setting {name} is " in refused(stream.planner.change_settings(**{name: value}))
    assert stream.planner.settings == before


@pytest.mark.parametrize("reach", [np.nan, "far", None, True, -0.1, 1.0])
def test_a_detour_that_is_no_length_is_refused(stream, reach) -> None:
    assert "detour [m] is " in refused(stream.planner.set_detour(reach))
    assert stream.planner.set_detour(0.0).ok


@pytest.mark.parametrize("tracking", [Tracking(np.nan, 0.0), Tracking(0.0, np.inf), Tracking("late", 0.0)])
def test_a_tracking_that_is_not_finite_is_refused(stream, tracking) -> None:
    before = stream.planner.tracking
    with pytest.raises(PlanningError, match=r"lag|tracking error"):
        stream.planner.set_tracking(tracking)
    assert stream.planner.tracking == before
