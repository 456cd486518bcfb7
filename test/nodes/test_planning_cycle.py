"""One cycle: which input is judged first, what is commanded meanwhile, and that nothing ever jumps."""

from __future__ import annotations

import dataclasses
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from geodesic_motion_ros.nodes.faults.judge import LARGEST_STEP, LARGEST_STEP_POSITION
from geodesic_motion_ros.nodes.obstacle_tracker import ObstacleSet
from geodesic_motion_ros.nodes.planning_cycle import PlanningCycle
from geodesic_motion_ros.nodes.stream_cycle import LONGEST_ADVANCE, PREPARING, REST_TIME, CycleInputs, CycleOutput
from geodesic_motion_ros.planner import PlannerSettings, ReactivePlanner
from geodesic_motion_ros.pose_smoothing import SMOOTHING
from geodesic_motion_ros.query import QueryBuilder
from geodesic_motion_ros.verdict import Verdict, VerdictCode

PERIOD = 0.01
NOTHING = ObstacleSet(np.zeros((0, 3)), np.zeros(0), (), 0, np.zeros((0, 3)), np.zeros(0))


def spheres(*items: tuple[np.ndarray, float], version: int = 1) -> ObstacleSet:
    centres, radii = zip(*items, strict=True)
    labels, still = tuple("" for _ in items), np.zeros((len(items), 3))
    return ObstacleSet(np.array(centres), np.array(radii), labels, version, still, np.zeros(len(items)))


@pytest.fixture(scope="module")
def planner(flat_skill) -> ReactivePlanner:
    return ReactivePlanner(flat_skill, PlannerSettings(grid_shape=(40, 40)))


@pytest.fixture
def cycle(planner) -> PlanningCycle:
    planner.clear_goal()
    planner.set_obstacles(np.zeros((0, 3)), np.zeros(0))
    return PlanningCycle(
        planner,
        state_timeout=0.1,
        resume_timeout=1.0,
        tracking_tolerance=0.05,
        tracking_tolerance_angle=0.3,
        clock=lambda: 0.0,
    )


@pytest.fixture
def start(flat_skill) -> tuple[np.ndarray, np.ndarray]:
    return flat_skill.start_pose[:3], flat_skill.start_pose[3:]


@pytest.fixture
def goal(flat_skill) -> tuple[np.ndarray, np.ndarray]:
    return flat_skill.goal_pose[:3], flat_skill.goal_pose[3:]


@pytest.fixture
def inputs(start, goal) -> CycleInputs:
    return CycleInputs(measured=start, state_age=0.005, goal=goal, goal_number=1, obstacles=NOTHING)


def follow(cycle: PlanningCycle, inputs: CycleInputs, count: int) -> list[np.ndarray]:
    """Run cycles with an arm that is where it was sent; the commanded positions."""
    positions = []
    for _ in range(count):
        output = cycle.run(inputs, PERIOD)
        positions.append(output.commanded[0].copy())
        inputs = dataclasses.replace(inputs, measured=output.commanded)
    return positions


def test_nothing_is_commanded_before_the_arm_is_known(cycle, inputs):
    output = cycle.run(dataclasses.replace(inputs, measured=None), PERIOD)
    assert output.verdict.code is VerdictCode.STALE_STATE
    assert output.commanded is None


def test_goes_to_the_goal_in_steps_no_longer_than_speed_allows(cycle, inputs, start, goal):
    positions = np.array([start[0], *follow(cycle, inputs, 500)])
    np.testing.assert_allclose(positions[-1], goal[0], atol=1e-3)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    assert steps.max() <= 1.001 * cycle.planner.settings.speed * PERIOD
    assert np.count_nonzero(steps) > 100


@pytest.mark.parametrize(
    ("change", "code", "reason"),
    [
        ({"state_age": 0.11}, VerdictCode.STALE_STATE, "joint_states"),
        ({"hold": True}, VerdictCode.HOLD_REQUESTED, "hold"),
        ({"silent_sources": {"obstacle_point": 0.7}}, VerdictCode.STALE_OBSTACLES, "obstacle_point for 0.70 s"),
        ({"late_sources": {"obstacles": 2.0}}, VerdictCode.STALE_OBSTACLES, "stamps lag: obstacles by 2.00 s; sync"),
        (
            {"unusable_sources": {"obstacles": "received, never usable: frame 'camera_link' is unknown here"}},
            VerdictCode.STALE_OBSTACLES,
            "obstacles: received, never usable: frame 'camera_link' is unknown here",
        ),
    ],
    ids=["old state", "hold", "silent obstacles", "late obstacles", "unusable obstacles"],
)
def test_a_reason_to_hold_brakes_and_its_end_resumes(cycle, inputs, change, code, reason):
    settings = cycle.planner.settings
    positions = follow(cycle, inputs, 60)
    here = cycle.follower.position
    for _ in range(60):
        output = cycle.run(dataclasses.replace(inputs, measured=cycle.follower.commanded, **change), PERIOD)
        assert output.verdict.code is code
        assert reason in output.verdict.reason
        assert output.reference is None
        positions.append(output.commanded[0])
    assert output.speed == 0.0
    assert_smooth(np.array(positions), settings)
    held_at = positions[-1]
    assert np.linalg.norm(held_at - here) <= 1.01 * settings.speed**2 / (2.0 * settings.acceleration)
    resumed = cycle.run(dataclasses.replace(inputs, measured=cycle.follower.commanded), PERIOD)
    assert resumed.verdict.ok
    assert np.linalg.norm(resumed.commanded[0] - held_at) <= settings.speed * PERIOD


def assert_smooth(positions: np.ndarray, settings: PlannerSettings) -> None:
    """What is commanded, positions (n, 3), keeps the limits of acceleration and of jerk and ends at rest."""
    acceleration, jerk = (
        np.max(np.linalg.norm(np.diff(positions, order, axis=0), axis=1)) / PERIOD**order for order in (2, 3)
    )
    assert acceleration <= 1.01 * settings.acceleration
    assert jerk <= 1.01 * 2.0 * settings.acceleration / SMOOTHING
    assert np.all(positions[-5:] == positions[-1])


def test_an_old_state_outweighs_everything_else(cycle, inputs):
    all_wrong = dataclasses.replace(inputs, state_age=1.0, hold=True, silent_sources={"obstacles": 1.0}, goal=None)
    assert cycle.run(all_wrong, PERIOD).verdict.code is VerdictCode.STALE_STATE


def test_no_goal_and_a_refused_first_goal(cycle, inputs):
    none = dataclasses.replace(inputs, goal=None, goal_number=0)
    assert cycle.run(none, PERIOD).verdict.code is VerdictCode.NO_GOAL
    refused = dataclasses.replace(inputs, goal=Verdict(VerdictCode.BAD_INPUT, "frame 'map'"))
    output = cycle.run(refused, PERIOD)
    assert output.verdict.code is VerdictCode.BAD_INPUT
    assert output.verdict.reason == "frame 'map'"


def test_a_refused_later_goal_keeps_the_old_one(cycle, inputs, goal):
    follow(cycle, inputs, 10)
    far = (goal[0] + np.array([0.0, 0.0, 0.6]), goal[1])
    arm = (cycle.follower.position, cycle.follower.quaternion)
    output = cycle.run(dataclasses.replace(inputs, measured=arm, goal=far, goal_number=2), PERIOD)
    assert output.verdict.ok
    assert output.goal_verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    np.testing.assert_allclose(output.reference.positions[-1], goal[0], atol=1e-6)


def test_the_same_goal_is_not_set_twice(cycle, inputs):
    cycle.run(inputs, PERIOD)
    cycle.planner.clear_goal()
    assert cycle.run(inputs, PERIOD).verdict.code is VerdictCode.NO_GOAL
    assert cycle.run(dataclasses.replace(inputs, goal_number=2), PERIOD).verdict.ok


def test_no_cycle_carries_the_graph_to_goals_that_move(planner, inputs, goal, monkeypatch):
    """A thread of its own does, and the stream goes on smoothly from goal to goal."""
    carried_by = []
    between = QueryBuilder._between

    def recorded(builder: QueryBuilder, *ends: object) -> object:
        carried_by.append(threading.current_thread())
        return between(builder, *ends)

    monkeypatch.setattr(QueryBuilder, "_between", recorded)
    planner.clear_goal()
    with ThreadPoolExecutor(1) as background:
        cycle = PlanningCycle(planner, 0.1, 1.0, 0.05, 0.3, clock=lambda: 0.0, background=background)
        steps, arm = [], inputs.measured
        for number in range(1, 13):
            shifted = goal[0] + 0.01 * np.array([np.cos(number), np.sin(number), 0.0])
            asked = dataclasses.replace(inputs, goal=(shifted, goal[1]), goal_number=number)
            for _ in range(10):
                output = cycle.run(dataclasses.replace(asked, measured=arm), PERIOD)
                background.submit(lambda: None).result()
                steps.append(np.linalg.norm(output.commanded[0] - arm[0]))
                arm = output.commanded[0].copy(), output.commanded[1].copy()
            assert output.goal_verdict.ok
            assert output.verdict.ok
            np.testing.assert_allclose(output.reference.positions[-1], shifted, atol=1e-6)
    assert len(carried_by) == 12
    assert threading.current_thread() not in carried_by
    assert np.max(np.abs(np.diff(steps))) < PERIOD**2 * 1.2 * planner.settings.acceleration
    assert sum(steps) > 0.02


def test_a_goal_that_is_being_prepared_when_the_arm_is_lost_is_dropped_too(planner, inputs):
    """It was given before: what sets the arm moving again is a goal given after."""
    planner.clear_goal()
    release = threading.Event()
    with ThreadPoolExecutor(1) as background:
        cycle = PlanningCycle(planner, 0.1, 1.0, 0.05, 0.3, clock=lambda: 0.0, background=background)
        background.submit(release.wait)
        assert cycle.run(inputs, PERIOD).verdict.reason == PREPARING
        away = inputs.measured[0] + [0.0, 0.06, 0.0], inputs.measured[1]
        pushed = dataclasses.replace(inputs, measured=away)
        assert "send the goal again" in cycle.run(pushed, PERIOD).goal_verdict.reason
        release.set()
        for _ in range(round(2.0 * REST_TIME / PERIOD)):
            background.submit(lambda: None).result()
            output = cycle.run(pushed, PERIOD)
        assert output.verdict.code is VerdictCode.NO_GOAL
        np.testing.assert_array_equal(output.commanded[0], away[0])
        again = dataclasses.replace(pushed, goal_number=2)
        cycle.run(again, PERIOD)
        background.submit(lambda: None).result()
        assert cycle.run(again, PERIOD).verdict.ok


def rest(cycle: PlanningCycle, inputs: CycleInputs) -> list[CycleOutput]:
    """Cycles with an arm that stays where it was measured, a little longer than an arm that was lost has to rest."""
    return [cycle.run(inputs, PERIOD) for _ in range(round(REST_TIME / PERIOD) + 2)]


def test_an_arm_moved_by_hand_drops_the_goal_and_does_not_move_until_the_next(cycle, inputs, start):
    follow(cycle, inputs, 20)
    pushed = dataclasses.replace(inputs, measured=(start[0] + np.array([0.0, 0.0, 0.06]), start[1]))
    outputs = rest(cycle, pushed)
    assert outputs[0].verdict.code is VerdictCode.BAD_INPUT
    assert "the arm is" in outputs[0].verdict.reason
    assert outputs[0].commanded is None
    assert outputs[-1].verdict.code is VerdictCode.NO_GOAL
    assert "goal dropped: the arm was" in outputs[-1].verdict.reason
    np.testing.assert_array_equal(outputs[-1].commanded[0], pushed.measured[0])
    later = cycle.run(pushed, PERIOD)
    np.testing.assert_array_equal(later.commanded[0], pushed.measured[0])
    assert later.speed == 0.0
    again = cycle.run(dataclasses.replace(pushed, goal_number=2), PERIOD)
    assert again.verdict.ok
    np.testing.assert_allclose(again.commanded[0], pushed.measured[0], atol=cycle.planner.settings.speed * PERIOD)


def test_joint_states_that_jump_to_and_fro_are_never_chased(cycle, inputs, goal, start):
    """Two drivers talk at once: the arm seems to be at two places in turn."""
    follow(cycle, inputs, 20)
    here = cycle.follower.position.copy(), cycle.follower.quaternion.copy()
    commanded = []
    for number in range(200):
        seen = dataclasses.replace(inputs, measured=(goal, here)[number % 2], goal_number=1 + number // 50)
        output = cycle.run(seen, PERIOD)
        assert output.verdict.code is VerdictCode.BAD_INPUT
        commanded.append(output.commanded)
    assert commanded == [None] * 200


def test_an_arm_that_is_led_by_hand_is_not_commanded(cycle, inputs, start):
    follow(cycle, inputs, 20)
    for step in range(100):
        led = start[0] + np.array([0.0, 0.0, 0.06 + 0.0005 * step])
        assert cycle.run(dataclasses.replace(inputs, measured=(led, start[1])), PERIOD).commanded is None


def test_a_goal_given_while_a_lost_arm_comes_to_rest_is_kept(cycle, inputs, start):
    follow(cycle, inputs, 20)
    pushed = dataclasses.replace(inputs, measured=(start[0] + np.array([0.0, 0.0, 0.06]), start[1]))
    cycle.run(pushed, PERIOD)
    outputs = rest(cycle, dataclasses.replace(pushed, goal_number=2))
    assert not outputs[0].verdict.ok
    assert outputs[-1].verdict.ok


def test_a_long_silence_of_the_arm_drops_the_goal(cycle, inputs):
    """And ends the stream: an arm that comes back elsewhere must not be drawn to where it was sent."""
    follow(cycle, inputs, 60)
    for age in np.arange(0.11, 1.2, PERIOD):
        output = cycle.run(dataclasses.replace(inputs, state_age=age), PERIOD)
        assert output.verdict.code is VerdictCode.STALE_STATE
        assert (output.commanded is None) == (age > cycle.resume_timeout)
    back = dataclasses.replace(inputs, measured=(cycle.follower.position.copy(), cycle.follower.quaternion.copy()))
    outputs = rest(cycle, back)
    assert outputs[0].commanded is None
    assert outputs[-1].verdict.code is VerdictCode.NO_GOAL
    assert "missing for more than 1 s" in outputs[-1].verdict.reason
    np.testing.assert_array_equal(outputs[-1].commanded[0], back.measured[0])
    assert cycle.run(dataclasses.replace(back, goal_number=2), PERIOD).verdict.ok


def test_a_second_commander_stops_the_arm_and_drops_the_goal(cycle, inputs):
    follow(cycle, inputs, 60)
    for _ in range(60):
        arm = (cycle.follower.position, cycle.follower.quaternion)
        output = cycle.run(dataclasses.replace(inputs, measured=arm, publishers=("/left", "/right")), PERIOD)
        assert output.verdict.code is VerdictCode.CONFLICT
        assert "/left and /right" in output.verdict.reason
    assert output.speed == 0.0
    arm = (cycle.follower.position, cycle.follower.quaternion)
    alone = cycle.run(dataclasses.replace(inputs, measured=arm, publishers=("/left",)), PERIOD)
    assert alone.verdict.code is VerdictCode.NO_GOAL
    assert "goal dropped: target_pose had more than one publisher" in alone.verdict.reason


@pytest.mark.parametrize(("speed", "cycles"), [(0.5, 120), (2.0, 30)])
def test_the_stream_goes_on_with_a_simulated_clock(cycle, inputs, speed, cycles):
    """As far as in so much time of a real one, however fast it runs, and no further while it stands."""
    simulated = dataclasses.replace(inputs, simulated=True, now=1.0)
    heard, path = 50.0, []
    for number in range(3 * cycles):
        stands = cycles <= number < 2 * cycles
        heard += 0.0 if stands else speed * PERIOD
        output = cycle.run(dataclasses.replace(simulated, heard=heard), PERIOD)
        simulated = dataclasses.replace(simulated, measured=output.commanded)
        path.append(output.commanded[0].copy())
    np.testing.assert_array_equal(path[cycles], path[2 * cycles - 1])
    limit = cycle.planner.settings.speed * speed * PERIOD
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 1.001 * limit
    assert np.linalg.norm(path[-1] - path[0]) > 0.1


def test_a_leap_of_simulated_time_is_no_leap_of_the_arm(cycle, inputs):
    follow(cycle, dataclasses.replace(inputs, simulated=True, now=1.0, heard=10.0), 2)
    here = cycle.follower.position.copy()
    leap = dataclasses.replace(inputs, measured=(here, cycle.follower.quaternion), simulated=True, now=1.0, heard=11.9)
    assert np.linalg.norm(cycle.run(leap, PERIOD).commanded[0] - here) <= 0.2 * LONGEST_ADVANCE
    assert cycle.planner.settings.speed * LONGEST_ADVANCE <= LARGEST_STEP_POSITION
    assert cycle.planner.settings.angular_speed * LONGEST_ADVANCE <= LARGEST_STEP


@pytest.mark.parametrize("jump", [5.0, -5.0])
def test_a_clock_that_was_set_drops_the_goal_until_the_arm_has_rested(cycle, inputs, jump):
    here = follow(cycle, inputs, 60)[-1]
    arm = (here, cycle.follower.quaternion.copy())
    after = dataclasses.replace(inputs, measured=arm, now=jump, set_by=jump)
    outputs = rest(cycle, after)
    assert outputs[0].verdict.code is VerdictCode.BAD_INPUT
    assert f"the clock was set by {jump:+.1f} s" in outputs[0].verdict.reason
    assert outputs[-1].verdict.code is VerdictCode.NO_GOAL
    assert f"goal dropped: the clock was set by {jump:+.1f} s" in outputs[-1].verdict.reason
    np.testing.assert_array_equal(outputs[-1].commanded[0], here)
    assert cycle.run(dataclasses.replace(after, goal_number=2), PERIOD).verdict.ok


def test_small_tracking_errors_do_not_disturb_the_stream(cycle, inputs):
    for _ in range(30):
        output = cycle.run(inputs, PERIOD)
        assert output.verdict.ok
        near = output.commanded[0] + np.array([0.0, 0.0, 0.01])
        inputs = dataclasses.replace(inputs, measured=(near, output.commanded[1]))


def test_obstacles_are_known_to_the_planner_even_while_it_holds(cycle, inputs, planner, flat_skill):
    wall = spheres((0.5 * (flat_skill.start_pose[:3] + flat_skill.goal_pose[:3]), 0.15))
    cycle.run(dataclasses.replace(inputs, hold=True, obstacles=wall), PERIOD)
    poses = flat_skill.start_pose[:3], flat_skill.start_pose[3:], flat_skill.goal_pose[:3], flat_skill.goal_pose[3:]
    assert planner.plan(*poses).verdict.clearance != np.inf


@pytest.mark.parametrize("braking_fails", [False, True])
def test_a_fault_in_the_tick_stops_along_the_certified_way(cycle, inputs, goal, monkeypatch, braking_fails):
    positions = follow(cycle, inputs, 60)
    if braking_fails:
        monkeypatch.setattr(cycle.planner, "stop", failing)
    here = cycle.follower.position
    for _ in range(60):
        output = cycle.stop(Verdict(VerdictCode.BAD_INPUT, "internal error"))
        positions.append(output.commanded[0])
    assert output.speed == 0.0
    settings = cycle.planner.settings
    assert_smooth(np.array(positions), settings)
    assert np.linalg.norm(positions[-1] - here) <= 1.01 * settings.speed**2 / (2.0 * settings.acceleration)
    resumed = follow(cycle, dataclasses.replace(inputs, measured=output.commanded), 500)
    assert_smooth(np.array([*positions, *resumed]), settings)
    np.testing.assert_allclose(resumed[-1], goal[0], atol=1e-3)


def failing(*_: object) -> None:
    raise RuntimeError("a fault")


def test_faults_while_the_reference_brakes_do_not_brake_twice(cycle, inputs):
    follow(cycle, inputs, 60)
    held = dataclasses.replace(inputs, hold=True, measured=(cycle.follower.position, cycle.follower.quaternion))
    speeds = [cycle.follower.speed]
    for _ in range(20):
        cycle.run(held, PERIOD)
        speeds.append(cycle.follower.speed)
        cycle.stop(Verdict(VerdictCode.BAD_INPUT, "internal error"))
        speeds.append(cycle.follower.speed)
        held = dataclasses.replace(held, measured=(cycle.follower.position, cycle.follower.quaternion))
    assert speeds[-1] == 0.0
    assert np.abs(np.diff(speeds)).max() <= 1.02 * cycle.planner.settings.acceleration * PERIOD


def test_a_fault_while_a_simulation_stands_moves_nothing_and_stops_as_it_goes_on(cycle, inputs, monkeypatch):
    simulated, heard = dataclasses.replace(inputs, simulated=True, now=1.0), 50.0
    for _ in range(60):
        heard += PERIOD
        output = cycle.run(dataclasses.replace(simulated, heard=heard), PERIOD)
        simulated = dataclasses.replace(simulated, measured=output.commanded)
    here, speed = output.commanded[0].copy(), output.speed
    monkeypatch.setattr(cycle, "_ready", failing)
    for number in range(100):
        heard += 0.0 if number < 20 else PERIOD
        with pytest.raises(RuntimeError):
            cycle.run(dataclasses.replace(simulated, heard=heard), PERIOD)
        output = cycle.stop(Verdict(VerdictCode.BAD_INPUT, "internal error"))
        if number < 20:
            np.testing.assert_array_equal(output.commanded[0], here)
            assert output.speed == pytest.approx(speed, rel=1e-12)
    assert output.speed == 0.0
    assert np.linalg.norm(output.commanded[0] - here) > 0.01


def test_a_fault_at_rest_moves_nothing(cycle, inputs, start):
    cycle.run(dataclasses.replace(inputs, goal=None, goal_number=0), PERIOD)
    for _ in range(20):
        output = cycle.stop(Verdict(VerdictCode.BAD_INPUT, "internal error"))
        np.testing.assert_array_equal(output.commanded[0], start[0])


def test_brakes_along_the_last_reference_when_the_way_is_blocked(cycle, inputs, flat_skill):
    here = follow(cycle, inputs, 60)[-1]
    speed = cycle.follower.speed
    assert speed > 0.1
    wall = spheres((flat_skill.goal_pose[:3], 0.1))
    blocked = dataclasses.replace(inputs, obstacles=wall)
    speeds = []
    for _ in range(60):
        blocked = dataclasses.replace(blocked, measured=(cycle.follower.position, cycle.follower.quaternion))
        output = cycle.run(blocked, PERIOD)
        assert output.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        assert output.reference is None
        speeds.append(output.speed)
    assert speeds[0] > 0.5 * speed
    assert speeds[-1] == 0.0
    assert np.linalg.norm(cycle.follower.position - here) > 0.01
