"""One cycle on a joint-space skill: what is sent is continuous with what is played, and stops where it must."""

from __future__ import annotations

import dataclasses
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.nodes.arm_watch import REST_TIME
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput
from geodesic_motion_ros.nodes.input_faults import CLOCK_STANDS, NO_CLOCK
from geodesic_motion_ros.nodes.planner_cycle import PlannerCycle
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.trajectory.trajectory_player import Discontinuity
from geodesic_motion_ros.utils.errors import ParameterError

PERIOD = 0.02
HORIZON = 2.4


@dataclass
class Arm:
    """Plays trajectories as joint_trajectory_controller does; `displaced` [rad] is what a person pushes it by, or it
    rests beside what is commanded. tells : whether its drive says what it commands.
    """

    position: np.ndarray
    now: float = 100.0
    played: tuple[JointReference, float] | None = None
    displaced: np.ndarray | None = None
    tells: bool = False
    states: list[np.ndarray] = field(default_factory=list)

    def desired(self, time: float) -> np.ndarray:
        """Position, velocity and acceleration (3, eta) at a time [s]."""
        if self.played is None:
            return np.stack([self.position, *np.zeros((2, len(self.position)))])
        return np.stack(self.played[0].sample(time - self.played[1]))

    def measured(self) -> np.ndarray:
        position = self.desired(self.now)[0]
        return position if self.displaced is None else position + self.displaced

    def take(self, output: CycleOutput) -> None:
        if output.trajectory is not None:
            self.played = output.trajectory


@pytest.fixture(scope="module")
def planner(reach_skill: Skill) -> ReactivePlanner:
    return ReactivePlanner(reach_skill)


@pytest.fixture
def cycle(planner: ReactivePlanner) -> PlannerCycle:
    planner.clear_goal()
    planner.set_obstacles(np.zeros((0, 3)), np.zeros(0))
    planner.hold(())
    return PlannerCycle(planner, 0.1, 1.0, tracking_tolerance=0.1, horizon=HORIZON, clock=lambda: 0.0)


@pytest.fixture
def arm(reach_skill: Skill) -> Arm:
    return Arm(reach_skill.canonical.start_poles[0].copy())


@pytest.fixture
def inputs(reach_skill: Skill) -> CycleInputs:
    goal = GoalRequest(configuration=reach_skill.canonical.goal_poles[0])
    return CycleInputs(None, 0.005, goal, 1, ObstacleTracker().current(0.0))


def test_goals_may_be_prepared_while_cycles_go_on(planner, arm, inputs) -> None:
    """A goal that is still being prepared is no goal yet; a refused one leaves the old one alone."""
    release = threading.Event()
    with ThreadPoolExecutor(1) as background:
        cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, clock=lambda: 0.0, background=background)
        planner.clear_goal()
        background.submit(release.wait)
        waiting = follow(cycle, arm, inputs, 0.05)
        assert {output.verdict.code for output in waiting} == {VerdictCode.NO_GOAL}
        assert all("is being prepared" in output.goal_verdict.reason for output in waiting)
        release.set()
        background.submit(lambda: None).result()
        going = follow(cycle, arm, inputs, 0.3)
        assert all(output.verdict.ok and output.goal_verdict.ok for output in going)

        far = GoalRequest(Pose(np.array([5.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0])))
        other = dataclasses.replace(inputs, goal=far, goal_number=2)
        follow(cycle, arm, other, 0.02)
        background.submit(lambda: None).result()
        kept = follow(cycle, arm, other, 0.1)
        assert {output.goal_verdict.code for output in kept} == {VerdictCode.GOAL_OUT_OF_SUPPORT}
        assert all(output.verdict.ok for output in kept)


def follow(cycle: PlannerCycle, arm: Arm, inputs: CycleInputs, seconds: float) -> list[CycleOutput]:
    """Run cycles with an arm that plays what is sent; it must be continuous in position, velocity, acceleration."""
    outputs = []
    for _ in range(round(seconds / PERIOD)):
        before = arm.desired(arm.now)
        drive = before[0] if arm.tells else None
        inputs = dataclasses.replace(inputs, measured=arm.measured(), drive=drive, now=arm.now, heard=arm.now)
        outputs.append(cycle.run(inputs, PERIOD))
        arm.take(outputs[-1])
        if arm.displaced is None or arm.tells:
            np.testing.assert_allclose(arm.desired(arm.now), before, atol=1e-6)
        arm.states.append(arm.desired(arm.now))
        arm.now += PERIOD
    return outputs


def arrived(output: CycleOutput) -> bool:
    return output.verdict.ok and output.time_to_goal == 0.0 and output.speed == 0.0


def arrive(cycle: PlannerCycle, arm: Arm, inputs: CycleInputs) -> list[CycleOutput]:
    """Run cycles until the arm rests at the end of its path, for 15 s at most."""
    outputs = follow(cycle, arm, inputs, PERIOD)
    while not arrived(outputs[-1]) and len(outputs) * PERIOD < 15.0:
        outputs += follow(cycle, arm, inputs, 0.1)
    return outputs


def test_reaches_the_goal_and_sends_little_while_nothing_changes(cycle, arm, inputs):
    """Two trajectories in the time of a horizon, until one has reached the goal; more in the first second."""
    outputs = follow(cycle, arm, inputs, 12.0)
    assert outputs[-1].verdict.ok
    np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)
    sent = [number * PERIOD for number, output in enumerate(outputs) if output.trajectory is not None]
    assert np.all(np.diff(sent) >= 0.1 - 1e-6)
    later = [time for time in sent if time > 1.1]
    assert len(later) >= 3
    assert np.all(np.diff(later) >= 0.5 * HORIZON - 0.03)
    assert outputs[0].time_to_goal - HORIZON <= sent[-1] <= outputs[0].time_to_goal
    assert outputs[round(0.1 / PERIOD)].time_to_goal > 1.0
    assert outputs[-1].time_to_goal == 0.0
    assert outputs[round(1.0 / PERIOD)].speed > 0.05


def test_an_arm_that_hears_no_more_stops_by_itself_and_goes_on_when_cycles_do(cycle, arm, inputs):
    follow(cycle, arm, inputs, 1.5)
    assert np.max(np.abs(arm.states[-1][1])) > 0.05
    (reference, begin), stalled = arm.played, arm.now
    assert begin + reference.duration < stalled + HORIZON + 0.5
    arm.now += 3.0
    np.testing.assert_array_equal(arm.desired(arm.now)[1:], 0.0)
    assert np.max(np.abs(arm.measured() - inputs.goal.configuration)) > 0.1
    again = arrive(cycle, arm, inputs)
    assert again[0].verdict.ok
    np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)


def test_cycles_that_come_back_while_the_arm_brakes_go_on_from_there(cycle, arm, inputs):
    follow(cycle, arm, inputs, 1.5)
    reference, begin = arm.played
    arm.now = begin + reference.duration - 0.2
    assert np.any(arm.desired(arm.now)[1])
    again = arrive(cycle, arm, inputs)
    assert again[0].verdict.ok
    np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)


def test_what_would_take_over_in_the_past_is_not_sent_and_the_next_cycle_finds_it_again(planner, arm, inputs):
    planner.clear_goal()
    time = [0.0]

    def slow() -> float:
        """From one look to the next pass 30 ms, as long as there are two numbers."""
        time[0] += 0.03 * (len(time) > 1)
        return time[0]

    cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, clock=slow)
    follow(cycle, arm, inputs, 1.0)
    holding = dataclasses.replace(inputs, hold=True)
    time.append(0.0)
    missed = follow(cycle, arm, holding, PERIOD)[0]
    assert missed.verdict.code is VerdictCode.DEADLINE_MISSED
    assert missed.trajectory is None
    time.pop()
    stopped = follow(cycle, arm, holding, PERIOD)[0]
    assert stopped.verdict.code is VerdictCode.HOLD_REQUESTED
    assert stopped.trajectory is not None


def test_a_search_that_took_too_long_is_followed_by_a_stop_from_the_present_on(planner, arm, inputs, monkeypatch):
    planner.clear_goal()
    time, stall, solved = [0.0], 0.05, Solver.solve

    def stalled(*arguments):
        plan = solved(*arguments)
        time[0] += stall
        return plan

    cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, clock=lambda: time[0])
    follow(cycle, arm, inputs, 1.0)
    monkeypatch.setattr(Solver, "solve", stalled)
    # A new goal: the path being followed leads elsewhere, and another one is looked for.
    back = dataclasses.replace(inputs, goal=GoalRequest(configuration=arm.states[0][0]), goal_number=2)
    before = arm.played
    output = cycle.run(dataclasses.replace(back, measured=arm.measured(), now=arm.now, heard=arm.now), PERIOD)
    assert output.verdict.code is VerdictCode.DEADLINE_MISSED
    reference, begin = output.trajectory
    # The arm hears of the stop after the stall: until then, and until a latency later, it is what is being played.
    for since in (0.0, stall, stall + planner.settings.latency - 1e-3):
        now = arm.now + since
        if now >= begin:
            np.testing.assert_allclose(reference.sample(now - begin), before[0].sample(now - before[1]), atol=1e-6)
    assert begin <= arm.now + stall
    assert begin + reference.duration < arm.now + stall + 0.6
    assert np.any(reference.velocities[0])


@pytest.mark.parametrize("obstructed", [False, True], ids=["hold", "obstacle"])
def test_a_path_on_which_no_stop_was_found_in_time_is_not_sent_again(planner, arm, inputs, obstructed):
    """Cycles that all take too long: the arm comes to rest where what was sent before them ends."""
    planner.clear_goal()
    time, passing = [0.0], [0.0]

    def slow() -> float:
        time[0] += passing[0]
        return time[0]

    cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, clock=slow)
    follow(cycle, arm, inputs, 1.5)
    sent, tracker = arm.played, ObstacleTracker()
    ahead = planner.remaining_motion(arm.now)[0].positions[-1]
    tracker.put("obstacles", ("", 0), planner.robot.forward(ahead)[0], 0.08, arm.now, 0.0)
    change = {"obstacles": tracker.current(arm.now)} if obstructed else {"hold": True}
    passing[0] = 0.03
    missed = follow(cycle, arm, dataclasses.replace(inputs, **change), sent[1] + sent[0].duration + 0.1 - arm.now)
    assert missed[0].verdict.code is VerdictCode.DEADLINE_MISSED
    assert all(output.trajectory is None for output in missed)
    assert arm.played is sent
    np.testing.assert_array_equal(arm.desired(arm.now)[1:], 0.0)
    assert np.max(np.abs(arm.measured() - inputs.goal.configuration)) > 0.1


def test_a_horizon_shorter_than_the_prediction_is_refused(planner):
    with pytest.raises(ParameterError, match=r"horizon = 0\.5: must not be less than prediction, 2\.4 s"):
        PlannerCycle(planner, 0.1, 1.0, tracking_tolerance=0.1, horizon=0.5)


def test_a_goal_pose_is_reached_in_one_of_the_demonstrated_families(cycle, arm, inputs, reach_skill):
    pose = Pose(reach_skill.goal_pose[:3], reach_skill.goal_pose[3:])
    outputs = arrive(cycle, arm, dataclasses.replace(inputs, goal=GoalRequest(pose)))
    assert "configurations near those demonstrated" in outputs[0].goal_verdict.reason
    position, quaternion = cycle.planner.robot.forward(arm.measured())
    np.testing.assert_allclose(position, pose.position, atol=1e-3)
    assert abs(quaternion @ pose.quaternion) > 1.0 - 1e-5


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"state_age": 0.11}, VerdictCode.STALE_STATE),
        ({"hold": True}, VerdictCode.HOLD_REQUESTED),
        ({"silent_sources": {"obstacles": 0.7}}, VerdictCode.STALE_OBSTACLES),
    ],
    ids=["old state", "hold", "silent obstacles"],
)
def test_a_reason_to_hold_stops_on_the_path_and_its_end_resumes(cycle, arm, inputs, change, code):
    follow(cycle, arm, inputs, 1.5)
    assert np.max(np.abs(arm.states[-1][1])) > 0.05
    stopping = follow(cycle, arm, dataclasses.replace(inputs, **change), 1.0)
    assert all(output.verdict.code is code for output in stopping)
    assert sum(output.trajectory is not None for output in stopping) == 1
    np.testing.assert_array_equal(arm.states[-1][1:], 0.0)
    again = arrive(cycle, arm, inputs)
    assert again[0].verdict.ok
    np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)


def test_it_states_why_no_joint_state_can_be_used(cycle, arm, inputs):
    fault = "no message has panda_joint1"
    never = dataclasses.replace(inputs, now=arm.now, heard=arm.now)
    reasons = {why: cycle.run(dataclasses.replace(never, state_fault=why), PERIOD).verdict for why in ("", fault)}
    assert {verdict.code for verdict in reasons.values()} == {VerdictCode.STALE_STATE}
    assert reasons[""].reason == "joint_states: none has arrived yet"
    assert reasons[fault].reason == f"joint_states: {fault}"
    follow(cycle, arm, inputs, 0.1)
    for why, end in (("", ""), (fault, f"; {fault}")):
        for age in (0.11, 0.12):
            late = dataclasses.replace(inputs, state_age=age, state_fault=why)
            verdict = follow(cycle, arm, late, PERIOD)[0].verdict
            # a reason that stays is the same text each cycle; the age is a figure beside it
            assert verdict.reason == f"joint_states: the newest state is older than state_timeout, 0.1 s{end}"
            assert dataclasses.replace(late, measured=arm.measured()).figures == {"age_joint_states": age}


@pytest.mark.parametrize("turns", [-1, 1])
def test_a_driver_that_wraps_a_joint_in_motion_is_followed_and_sent_the_turn_that_it_reports(
    endless_reach_skill, inputs, arm, turns
):
    planner = ReactivePlanner(endless_reach_skill)
    cycle = PlannerCycle(planner, 0.1, 1.0, tracking_tolerance=0.1, horizon=HORIZON, clock=lambda: 0.0)
    start, goal = arm.position[6], inputs.goal.configuration[6]
    assert abs(goal - start) > 0.05
    beyond = 0.5 * (start + goal)
    outputs = []
    while len(outputs) < 1000 and not (outputs and arrived(outputs[-1])):
        true = arm.measured()
        true[6] -= 2.0 * np.pi * np.round((true[6] - beyond) / (2.0 * np.pi))
        # the joint passes the edge of the driver's range halfway
        reported = true.copy()
        wraps = (true[6] - beyond) * (goal - start) > 0.0
        reported[6] += 2.0 * np.pi * turns * wraps
        seen = dataclasses.replace(
            inputs, measured=reported, now=arm.now, heard=arm.now, goal_number=1, publishers=("a",), subscribers=("b",)
        )
        outputs.append(cycle.run(seen, PERIOD))
        if (sent := outputs[-1].trajectory) is not None:
            # what is sent begins the shorter angle from what is reported, for a controller that counts no turns
            assert np.all(np.abs(sent[0].positions[0] - reported) < 0.2)
        arm.take(outputs[-1])
        arm.now += PERIOD
    assert {output.verdict.code for output in outputs} <= {VerdictCode.OK, VerdictCode.NO_GOAL}
    np.testing.assert_allclose(np.delete(arm.measured() - inputs.goal.configuration, 6), 0.0, atol=1e-6)
    off = arm.measured()[6] - goal
    assert off == pytest.approx(2.0 * np.pi * np.round(off / (2.0 * np.pi)), abs=1e-6)


def test_what_is_not_seen_of_the_arm_counts_as_lag(cycle, arm, inputs, planner):
    # an arm that rests, which is where it was sent at any time
    inputs = dataclasses.replace(inputs, goal=None, goal_number=0)
    follow(cycle, arm, inputs, 0.1)
    assert planner.tracking.lag == 0.0
    lags = []
    for age, duration in ((0.05, 0.1), (0.075, PERIOD), (0.095, PERIOD), (0.005, 0.9), (0.005, 0.2)):
        follow(cycle, arm, dataclasses.replace(inputs, state_age=age), duration)
        lags.append(planner.tracking.lag)
    # rounded up to 10 ms; kept for a second
    np.testing.assert_allclose(lags, [0.0, 0.03, 0.05, 0.05, 0.0], atol=1e-9)


def test_the_limits_are_kept_while_goals_change_in_motion(cycle, arm, inputs, planner):
    random = np.random.default_rng(3)
    for number in range(2, 14):
        goal = GoalRequest(configuration=inputs.goal.configuration + random.uniform(-0.05, 0.05, 7))
        follow(cycle, arm, dataclasses.replace(inputs, goal=goal, goal_number=number), 0.4)
    states, limits = np.array(arm.states), planner.limits
    assert np.all(np.abs(states[:, 1]) <= limits.velocity + 1e-6)
    assert np.all(np.abs(states[:, 2]) <= limits.acceleration + 1e-6)
    assert np.max(np.abs(np.diff(states[:, 0], axis=0))) <= 0.02
    assert np.max(np.abs(states[:, 1])) > 0.1


def test_an_arm_that_is_pushed_away_is_lost_stays_and_needs_a_new_goal(cycle, arm, inputs):
    follow(cycle, arm, inputs, 1.5)
    arm.displaced = np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    lost = follow(cycle, arm, inputs, PERIOD)[0]
    assert lost.verdict.code is VerdictCode.BAD_INPUT
    assert "'panda_joint2'" in lost.verdict.reason
    # What is sent keeps the arm where it was found.
    where = lost.trajectory[0].positions
    np.testing.assert_allclose(where[-1], where[0])
    arm.position, arm.played, arm.displaced = where[0], None, None
    waiting = follow(cycle, arm, inputs, 2.0 * REST_TIME)
    assert waiting[-1].verdict.code is VerdictCode.NO_GOAL
    assert "send the goal again" in waiting[-1].goal_verdict.reason
    moving = arrive(cycle, arm, dataclasses.replace(inputs, goal_number=2))
    assert moving[-1].verdict.ok
    np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)


@dataclass
class Late(Arm):
    """Is always where it was to be 0.06 s ago."""

    def measured(self) -> np.ndarray:
        return self.states[max(0, len(self.states) - round(0.06 / PERIOD))][0] if self.states else super().measured()


def test_a_lag_is_counted_while_the_arm_waits_and_when_it_sets_out_again(cycle, arm, inputs, planner):
    late = Late(arm.position)
    follow(cycle, late, inputs, 2.0)
    lag = planner.tracking.lag
    assert lag == pytest.approx(0.06, abs=0.02)
    waiting = follow(cycle, late, dataclasses.replace(inputs, hold=True), 3.0)
    assert waiting[-1].speed == 0.0
    assert planner.tracking.lag >= lag
    here = GoalRequest(configuration=late.measured())
    follow(cycle, late, dataclasses.replace(inputs, goal=here, goal_number=2), 2.0)
    assert planner.tracking.lag >= lag


@dataclass
class Cartesian:
    """An arm whose tool is at once where it is sent, in a posture of its own: that in which it stands, or near it."""

    robot: Robot
    position: np.ndarray
    stiff: bool

    def follow(self, output: CycleOutput) -> None:
        if output.configuration is not None:
            first = self.position + (0.0 if self.stiff else 1.0) * (output.configuration - self.position)
            self.position = solve(self.robot, *self.robot.forward(output.configuration), start=first)


@pytest.mark.parametrize("stiff", [False, True])
def test_an_arm_that_holds_the_tool_in_another_posture_stops_and_plans_again_from_there(planner, arm, inputs, stiff):
    """Where it follows the posture it never stops: the control."""
    planner.clear_goal()
    cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, "target_pose", clock=lambda: 0.0, tool_tolerance=(0.01, 0.05))
    follower, now, codes, output = Cartesian(planner.robot, arm.position, stiff), 100.0, [], None
    while output is None or not (arrived(output) or "does not follow the posture" in output.goal_verdict.reason):
        assert now < 130.0
        output = cycle.run(dataclasses.replace(inputs, measured=follower.position, now=now, heard=now), PERIOD)
        codes.append(output.verdict.code)
        follower.follow(output)
        now += PERIOD
    stopped = VerdictCode.BAD_INPUT in codes
    assert stopped == stiff
    if output.verdict.ok:
        ends = follower.position, inputs.goal.configuration
        reached, wanted = (planner.robot.forward(joints)[0] for joints in ends)
        np.testing.assert_allclose(reached, wanted, atol=1e-3)


def test_an_arm_that_never_holds_its_posture_loses_the_goal_after_two_stops(planner, arm, inputs):
    planner.clear_goal()
    cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, "target_pose", clock=lambda: 0.0, tool_tolerance=(5.0, 3.2))
    now, stops, before = 100.0, 0, VerdictCode.OK
    output = None
    while output is None or "does not follow the posture" not in output.goal_verdict.reason:
        assert now < 120.0
        # It moves to and fro, whatever it is sent, and rests in between.
        measured = arm.position + 0.15 * np.eye(7)[2] * (int((now - 100.0) / 1.5) % 2)
        output = cycle.run(dataclasses.replace(inputs, measured=measured, now=now, heard=now), PERIOD)
        stops += output.verdict.code is VerdictCode.BAD_INPUT and before is not VerdictCode.BAD_INPUT
        before = output.verdict.code
        now += PERIOD
    assert stops == 2
    assert output.verdict.reason.startswith("the controller does not follow the posture: the arm was 0.1")


@pytest.mark.parametrize("jump", [5.0, -5.0])
def test_a_clock_that_was_set_stops_the_arm_where_it_is(cycle, arm, inputs, jump):
    follow(cycle, arm, inputs, 1.5)
    where, after = arm.measured(), dataclasses.replace(inputs, set_by=jump)
    arm.now += jump
    stopped = cycle.run(dataclasses.replace(after, measured=where, now=arm.now, heard=arm.now), PERIOD)
    assert f"the clock was set by {jump:+.1f} s" in stopped.verdict.reason
    reference, begin = stopped.trajectory
    np.testing.assert_array_equal(reference.positions, np.tile(where, (len(reference.times), 1)))
    assert begin + reference.times[-1] > arm.now
    arm.position, arm.played, arm.displaced = where, None, None
    waiting = follow(cycle, arm, after, 2.0 * REST_TIME)
    assert waiting[-1].verdict.code is VerdictCode.NO_GOAL
    assert "the clock was set" in waiting[-1].goal_verdict.reason
    moving = arrive(cycle, arm, dataclasses.replace(after, goal_number=2))
    assert moving[-1].verdict.ok
    np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)


@pytest.mark.parametrize(
    ("simulated", "reason"), [(True, "the clock was set by -1800000000.0 s"), (False, NO_CLOCK)]
)
def test_a_simulation_of_today_that_begins_at_zero_again_is_no_missing_clock(cycle, arm, inputs, simulated, reason):
    """A node that is to follow a simulation from now on has a clock at 0, too."""
    follow(cycle, arm, dataclasses.replace(inputs, simulated=simulated), 0.5)
    at_zero = dataclasses.replace(inputs, simulated=True, has_clock=False, set_by=-1.8e9)
    stopped = cycle.run(dataclasses.replace(at_zero, measured=arm.measured(), now=arm.now, heard=arm.now), PERIOD)
    assert stopped.goal_verdict.code is VerdictCode.NO_GOAL
    assert stopped.goal_verdict.reason == f"goal dropped: {reason}; send the goal again"


def test_a_simulation_that_stands_stops_the_arm_until_it_goes_on(cycle, arm, inputs):
    """Who drives it may have ended. The goal stays: it may be paused."""
    follow(cycle, arm, dataclasses.replace(inputs, simulated=True), 0.5)
    standing = dataclasses.replace(inputs, simulated=True, measured=arm.measured(), now=arm.now, heard=arm.now)
    for stood, code in ((0.9 * CLOCK_STANDS, VerdictCode.OK), (1.1 * CLOCK_STANDS, VerdictCode.STALE_STATE)):
        verdict = cycle.run(dataclasses.replace(standing, clock_stood=stood), PERIOD).verdict
        assert verdict.code is code
    assert "/clock has stood" in verdict.reason
    assert arrive(cycle, arm, dataclasses.replace(inputs, simulated=True))[-1].verdict.ok


def test_nothing_is_sent_before_there_is_a_goal(cycle, arm, inputs):
    outputs = follow(cycle, arm, dataclasses.replace(inputs, goal=None, goal_number=0), 0.5)
    assert all(output.trajectory is None for output in outputs)
    assert outputs[-1].verdict.code is VerdictCode.NO_GOAL


def test_two_commanders_stop_the_arm(cycle, arm, inputs):
    follow(cycle, arm, inputs, 1.5)
    rivals = dataclasses.replace(inputs, publishers=("planner", "teleop"))
    outputs = follow(cycle, arm, rivals, 1.0)
    assert outputs[-1].verdict.code is VerdictCode.CONFLICT
    assert "joint_trajectory is published by planner and teleop" in outputs[-1].verdict.reason
    np.testing.assert_array_equal(arm.states[-1][1:], 0.0)


def test_an_arm_whose_commands_no_node_receives_stays(cycle, arm, inputs):
    """What it is sent would not be played, and it would be taken for lost."""
    unheard = follow(cycle, arm, dataclasses.replace(inputs, subscribers=()), 0.5)
    assert all(output.verdict.code is VerdictCode.BAD_INPUT for output in unheard)
    assert "no node receives joint_trajectory" in unheard[-1].verdict.reason
    assert all(output.trajectory is None or output.speed == 0.0 for output in unheard)
    assert arrive(cycle, arm, dataclasses.replace(inputs, subscribers=("/controller",)))[-1].verdict.ok
    np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)


def test_a_task_frame_elsewhere_is_refused(cycle, arm, inputs):
    frame = np.array([0.1, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    output = follow(cycle, arm, dataclasses.replace(inputs, task_frame=frame), PERIOD)[0]
    assert output.verdict.code is VerdictCode.BAD_INPUT
    assert "task frame" in output.verdict.reason


@pytest.mark.parametrize("bad", [np.full(7, np.nan), np.full(7, 9.0), np.zeros(6)], ids=["nan", "limits", "six joints"])
def test_a_goal_that_is_none_is_refused_and_the_old_one_stays(cycle, arm, inputs, bad):
    follow(cycle, arm, inputs, 1.0)
    output = arrive(cycle, arm, dataclasses.replace(inputs, goal=GoalRequest(configuration=bad), goal_number=2))[-1]
    assert output.goal_verdict.code is VerdictCode.BAD_INPUT
    assert output.verdict.ok
    np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)


def test_an_old_state_is_compared_with_what_was_commanded_then(cycle, arm, inputs):
    follow(cycle, arm, inputs, 2.5)
    fastest = np.max(np.abs(arm.states[-1][1]))
    late = dataclasses.replace(inputs, state_age=4.0 * PERIOD)
    cycle.tracking_tolerance = 0.2 * fastest * 4.0 * PERIOD
    for _ in range(20):
        measured = arm.states[-4][0]
        output = cycle.run(dataclasses.replace(late, measured=measured, now=arm.now, heard=arm.now), PERIOD)
        arm.take(output)
        arm.states.append(arm.desired(arm.now))
        arm.now += PERIOD
        assert output.verdict.ok


class TestDrive:
    """An arm that rests beside what its drive commands, as all real ones do: what is commanded never steps."""

    #: So far beside it [rad].
    OFF = np.array([0.0, 0.002, 0.0, -0.003, 0.0, 0.0, 0.001])

    @pytest.fixture
    def cycle(self, reach_skill) -> PlannerCycle:
        """With a planner to which nothing is known of an arm yet."""
        return PlannerCycle(ReactivePlanner(reach_skill), 0.1, 1.0, 0.1, HORIZON, clock=lambda: 0.0)

    @pytest.fixture
    def beside(self, arm) -> Arm:
        arm.displaced, arm.tells = self.OFF, True
        return arm

    @pytest.mark.parametrize("tells", [False, True], ids=["control: the drive says nothing", "it says where"])
    def test_the_first_motion_begins_where_the_drive_commands_the_arm(self, cycle, beside, inputs, tells):
        start, beside.tells = beside.position.copy(), tells
        outputs = follow(cycle, beside, inputs, 0.3)
        first = next(output for output in outputs if output.trajectory is not None)
        off = 0.0 if tells else self.OFF
        np.testing.assert_allclose(first.trajectory[0].positions[0], start + off, atol=1e-12)
        said = [output.news for output in outputs if output.news]
        assert len(said) == 1
        assert ("3.00 mrad in 'panda_joint4'" in said[0]) == tells
        assert ("nothing is heard of what the drive commands" in said[0]) != tells
        assert arrived(arrive(cycle, beside, inputs)[-1])

    def test_how_far_it_rests_from_its_command_is_a_reason_with_a_figure_and_counted(self, cycle, beside, inputs):
        arrive(cycle, beside, inputs)
        outputs = follow(cycle, beside, inputs, 2.0 * REST_TIME)
        stays = "at rest the arm stays 3.0 mrad in 'panda_joint4' from where it is commanded"
        assert outputs[-1].verdict.ok
        assert outputs[-1].verdict.reason.endswith(stays)
        assert [output.news for output in outputs if output.news] == [stays]
        assert cycle.steady.size == pytest.approx(0.003)
        # neither corrected nor stepped over
        np.testing.assert_allclose(beside.desired(beside.now)[0], inputs.goal.configuration, atol=1e-9)
        centres = [
            cycle.planner.collision.positions(cycle.planner.robot, joints[None])[0]
            for joints in (beside.measured(), beside.desired(beside.now)[0])
        ]
        off = np.max(np.linalg.norm(centres[0] - centres[1], axis=1))
        assert off <= cycle.planner.tracking.error <= off + 1.01e-3

    def test_it_is_counted_in_the_first_motion(self, cycle, beside, inputs):
        """Before anything was seen of how the arm follows."""
        while beside.played is None:
            assert cycle.planner.tracking.error == 0.0
            follow(cycle, beside, inputs, PERIOD)
        assert cycle.planner.tracking.error > 0.0

    def test_an_arm_elsewhere_than_its_drive_commands_it_is_not_moved(self, cycle, beside, inputs):
        beside.displaced = np.array([0.0, 0.15, 0.0, 0.0, 0.0, 0.0, 0.0])
        outputs = follow(cycle, beside, inputs, 0.5)
        assert {output.verdict.code for output in outputs} == {VerdictCode.BAD_INPUT}
        assert "0.150 rad in 'panda_joint2' from where its drive commands it" in outputs[-1].verdict.reason
        assert all(output.trajectory is None for output in outputs)
        beside.displaced = self.OFF
        assert arrived(arrive(cycle, beside, inputs)[-1])

    def test_a_drive_that_follows_nothing_is_named_and_the_goal_dropped(self, cycle, beside, inputs):
        """As one that was not armed; long before the arm is farther from its command than is allowed."""
        cycle.tracking_tolerance = 3.0
        stands, outputs = beside.position, []
        while beside.now < 103.0:
            now, measured = beside.now, beside.measured()
            seen = dataclasses.replace(inputs, drive=stands, measured=measured, now=now, heard=now)
            outputs.append(cycle.run(seen, PERIOD))
            beside.now += PERIOD
        lost = [output for output in outputs if output.verdict.code is VerdictCode.BAD_INPUT]
        assert "the drive stands still" in lost[0].verdict.reason
        assert "is it armed?" in lost[0].verdict.reason
        assert outputs[-1].verdict.code is VerdictCode.NO_GOAL
        assert "the drive stood still" in outputs[-1].verdict.reason

    def test_an_arm_that_is_pushed_away_is_braked_by_what_its_drive_follows(self, cycle, beside, inputs):
        """To be commanded to stand where it was found would be a step."""
        follow(cycle, beside, inputs, 1.5)
        assert np.max(np.abs(beside.states[-1][1])) > 0.05
        beside.displaced = np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
        lost = follow(cycle, beside, inputs, 1.0)
        assert {output.verdict.code for output in lost} == {VerdictCode.BAD_INPUT}
        np.testing.assert_array_equal(beside.states[-1][1:], 0.0)
        beside.displaced = self.OFF
        waiting = follow(cycle, beside, inputs, 2.0 * REST_TIME)
        assert waiting[-1].verdict.code is VerdictCode.NO_GOAL
        assert any("motions begin where the drive commands the arm" in output.news for output in waiting)
        assert arrived(arrive(cycle, beside, dataclasses.replace(inputs, goal_number=2))[-1])
        np.testing.assert_allclose(beside.desired(beside.now)[0], inputs.goal.configuration, atol=1e-9)

    def test_a_drive_that_was_begun_anew_where_the_arm_is_measured_is_not_stepped(self, cycle, beside, inputs):
        """As a controller is that was stopped and activated again."""
        arrive(cycle, beside, inputs)
        follow(cycle, beside, inputs, 2.0 * REST_TIME)
        beside.position, beside.played, beside.displaced = beside.measured(), None, np.zeros(7)
        again = follow(cycle, beside, inputs, 2.0 * REST_TIME)
        assert any("motions begin where the drive commands the arm" in output.news for output in again)
        assert all(output.verdict.ok for output in again)
        arrive(cycle, beside, inputs)
        np.testing.assert_allclose(beside.desired(beside.now)[0], inputs.goal.configuration, atol=1e-9)

    @pytest.mark.parametrize("tells", [False, True])
    def test_an_arm_that_is_back_after_a_silence_is_where_it_was_sent_to_stand(self, cycle, beside, inputs, tells):
        """Not where it is measured: that would be a step."""
        start, beside.tells = beside.position.copy(), tells
        follow(cycle, beside, inputs, 1.5)
        if not tells:
            # the first motion was a step, and is over
            beside.displaced = None
        follow(cycle, beside, dataclasses.replace(inputs, state_age=2.0), 1.5)
        np.testing.assert_array_equal(beside.states[-1][1:], 0.0)
        beside.displaced, stands = self.OFF, beside.states[-1][0]
        back = follow(cycle, beside, inputs, 2.0 * REST_TIME)
        assert "joint_states were missing" in back[-1].goal_verdict.reason
        assert all(output.trajectory is None for output in back)
        again = follow(cycle, beside, dataclasses.replace(inputs, goal_number=2), 0.5)
        first = next(output for output in again if output.trajectory is not None)
        np.testing.assert_allclose(first.trajectory[0].positions[0], stands, atol=1e-9)
        assert np.max(np.abs(stands - start)) > 0.05

    def test_a_drive_that_fell_silent_is_named_where_a_motion_has_to_begin(self, cycle, beside, inputs):
        known = dataclasses.replace(
            inputs, measured=beside.measured(), drive=beside.position, drive_age=0.2, now=beside.now, heard=beside.now
        )
        assert cycle.run(known, PERIOD).verdict.reason.startswith("commanded_joint_states: the newest is older")


@dataclass
class Wired(Arm):
    """Hears trajectories `late` [s] after they were sent, and counts those that are a step of what it commands: it
    refuses them, as an arm whose drive judges its commands, or plays them, as joint_trajectory_controller.

    sudden : every so many trajectories one is late by SUDDEN [s]; 0: none.
    """

    SUDDEN = 0.12

    late: float = 0.0
    refuses: bool = False
    sudden: int = 0
    steps: int = 0
    count: int = 0
    waiting: list[tuple[float, tuple[JointReference, float]]] = field(default_factory=list)

    def take(self, output: CycleOutput) -> None:
        if output.trajectory is None:
            return
        self.count += 1
        is_late = self.sudden and self.count % self.sudden == 0
        due = self.now + (self.SUDDEN if is_late else self.late)
        # None overtakes another one; of those that wait together the newest is heard alone.
        self.waiting = [one for one in self.waiting if one[0] < due]
        self.waiting.append((due, output.trajectory))

    def hear(self) -> None:
        """Take what has come since it was heard last, each when it came."""
        while self.waiting and self.waiting[0][0] <= self.now:
            due, trajectory = self.waiting.pop(0)
            before, after = self.desired(due), trajectory[0].sample(due - trajectory[1])
            stepped = Discontinuity.between(before, np.stack(after), 0.0) is not None
            self.steps += stepped
            if not (stepped and self.refuses):
                self.played = trajectory


class TestDelivery:
    """Trajectories that arrive late: as long as that is measured none is a step of what is commanded."""

    @pytest.fixture
    def cycle(self, reach_skill) -> PlannerCycle:
        return PlannerCycle(ReactivePlanner(reach_skill), 0.1, 1.0, 0.1, HORIZON, clock=lambda: 0.0)

    @staticmethod
    def drive(
        cycle: PlannerCycle, arm: Wired, inputs: CycleInputs, transit: float, seconds: float
    ) -> list[CycleOutput]:
        """Run cycles in which messages of the arm are known to take so long."""
        outputs = []
        for _ in range(round(seconds / PERIOD)):
            arm.hear()
            place = arm.measured()
            known = dataclasses.replace(
                inputs, measured=place, drive=place, transit=transit, now=arm.now, heard=arm.now
            )
            outputs.append(cycle.run(known, PERIOD))
            arm.take(outputs[-1])
            arm.now += PERIOD
        return outputs

    def change_goals(self, cycle: PlannerCycle, arm: Wired, inputs: CycleInputs, transit: float) -> CycleInputs:
        """Have goals change in motion, for ten takeovers; returns the inputs with the last one."""
        random = np.random.default_rng(3)
        for number in range(2, 12):
            place = GoalRequest(configuration=inputs.goal.configuration + random.uniform(-0.05, 0.05, 7))
            last = dataclasses.replace(inputs, goal=place, goal_number=number)
            self.drive(cycle, arm, last, transit, 0.4)
        return last

    @pytest.mark.parametrize(
        ("late", "transit", "stepped"),
        [(0.025, 0.0, False), (0.06, 0.06, False), (0.15, 0.15, False), (0.06, 0.0, True)],
        ids=["within the latency", "60 ms", "150 ms", "control: 60 ms that are not known"],
    )
    def test_what_is_as_late_as_was_measured_is_no_step(self, cycle, arm, inputs, late, transit, stepped):
        wired = Wired(arm.position, late=late)
        last = self.change_goals(cycle, wired, inputs, transit)
        assert (wired.steps > 0) == stepped
        if not stepped:
            outputs = self.drive(cycle, wired, last, transit, 12.0)
            assert arrived(outputs[-1])
            np.testing.assert_allclose(wired.measured(), last.goal.configuration, atol=1e-9)
            assert cycle.not_taken == 0

    def test_a_drive_that_refuses_what_came_late_is_planned_for_from_where_it_is(self, cycle, arm, inputs):
        """The lateness comes by surprise: nothing was measured of it."""
        wired = Wired(arm.position, refuses=True, sudden=3)
        last = self.change_goals(cycle, wired, inputs, 0.0)
        assert wired.steps > 0
        assert cycle.not_taken > 0
        wired.sudden = 0
        outputs = self.drive(cycle, wired, last, 0.0, 12.0)
        assert arrived(outputs[-1])
        np.testing.assert_allclose(wired.measured(), last.goal.configuration, atol=1e-9)

    def test_what_is_found_too_late_to_be_sent_is_withheld_and_found_again_for_later(self, reach_skill, arm, inputs):
        """The machine stands still after a tick has found it in time: nothing was late before."""
        time, stalls = [0.0], [0]
        cycle = PlannerCycle(ReactivePlanner(reach_skill), 0.1, 1.0, 0.1, HORIZON, clock=lambda: time[0])
        follow(cycle, arm, inputs, 1.0)
        commit = type(cycle.planner)._commit

        def stalled(planner, *arguments):
            plan = commit(planner, *arguments)
            if plan.reference is not None and stalls[0]:
                stalls[0] -= 1
                time[0] += 0.05
            return plan

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ReactivePlanner, "_commit", stalled)
            stalls[0] = 1
            back = dataclasses.replace(inputs, goal=GoalRequest(configuration=arm.states[0][0]), goal_number=2)
            played = arm.played
            late = follow(cycle, arm, back, PERIOD)[0]
            assert late.verdict.code is VerdictCode.DEADLINE_MISSED
            # sent 50 ms after its cycle began, and 5 ms later heard, of a takeover after 30 ms
            assert "25 ms after it takes over" in late.verdict.reason
            assert late.trajectory is None
            assert arm.played is played
            assert cycle.withheld == 1
            again = follow(cycle, arm, back, PERIOD)[0]
        assert again.trajectory is not None
        assert cycle.planner.latency == pytest.approx(cycle.planner.settings.latency + 0.03)
        assert arrived(arrive(cycle, arm, back)[-1])
        np.testing.assert_allclose(arm.measured(), back.goal.configuration, atol=1e-9)


class TestArming:
    """A planner that is not armed plans and shows, and commands nothing."""

    UNARMED = "not armed: nothing is commanded; call ~/arm"

    @pytest.fixture
    def unarmed(self, inputs) -> CycleInputs:
        return dataclasses.replace(inputs, unarmed=self.UNARMED)

    @pytest.mark.parametrize("output", ["joint_trajectory", "target_pose"])
    def test_it_shows_the_path_and_commands_nothing(self, planner, arm, inputs, unarmed, output):
        planner.clear_goal()
        cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, output, clock=lambda: 0.0)
        shown = follow(cycle, arm, unarmed, 3.0)
        assert all(one.trajectory is None and one.configuration is None and one.speed == 0.0 for one in shown)
        assert {one.verdict.code for one in shown} == {VerdictCode.HOLD_REQUESTED}
        assert shown[-1].verdict.reason == self.UNARMED
        np.testing.assert_allclose(shown[-1].reference.positions[0], arm.position, atol=1e-9)
        np.testing.assert_allclose(shown[-1].reference.positions[-1], inputs.goal.configuration, atol=1e-9)

    def test_it_shows_the_path_from_where_the_arm_is_moved_to(self, cycle, arm, unarmed):
        follow(cycle, arm, unarmed, 0.5)
        arm.position = arm.position + np.array([0.0, 0.04, 0.0, 0.0, 0.0, 0.0, 0.0])
        moved = follow(cycle, arm, unarmed, 0.5)
        np.testing.assert_allclose(moved[-1].reference.positions[0], arm.position, atol=1e-9)

    def test_it_states_what_would_be_refused(self, cycle, arm, unarmed, reach_skill):
        without = follow(cycle, arm, dataclasses.replace(unarmed, goal=None, goal_number=0), 0.1)
        assert without[-1].verdict.code is VerdictCode.NO_GOAL
        silent = follow(cycle, arm, dataclasses.replace(unarmed, state_age=0.5), 0.1)
        assert silent[-1].verdict.code is VerdictCode.STALE_STATE
        tracker = ObstacleTracker()
        middle = 0.5 * (arm.position + unarmed.goal.configuration)
        tracker.put("obstacles", ("", 0), cycle.planner.robot.forward(middle)[0], 0.25, arm.now, 0.0)
        blocked = follow(cycle, arm, dataclasses.replace(unarmed, obstacles=tracker.current(arm.now)), 0.5)
        assert blocked[-1].verdict.code in (VerdictCode.NO_FEASIBLE_PATH, VerdictCode.IN_COLLISION)
        assert blocked[-1].reference is None

    def test_arming_moves_nothing_before_the_next_goal(self, cycle, arm, inputs, unarmed):
        follow(cycle, arm, unarmed, 1.0)
        armed = follow(cycle, arm, inputs, 1.0)
        assert all(one.trajectory is None for one in armed)
        assert {one.verdict.code for one in armed} == {VerdictCode.NO_GOAL}
        assert armed[-1].goal_verdict.reason == "goal dropped: ~/arm was called with true; send the goal again"
        assert arrived(arrive(cycle, arm, dataclasses.replace(inputs, goal_number=2))[-1])
        np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)

    def test_disarmed_in_motion_it_brakes_on_its_path_and_is_silent_then(self, cycle, arm, inputs, unarmed):
        follow(cycle, arm, inputs, 1.5)
        assert np.max(np.abs(arm.states[-1][1])) > 0.05
        path = cycle.planner.motion_to_goal()[0]
        braking = follow(cycle, arm, unarmed, 1.0)
        assert sum(one.trajectory is not None for one in braking) == 1
        np.testing.assert_array_equal(arm.states[-1][1:], 0.0)
        passed = path.samples(np.linspace(0.0, path.duration, 4000))[0]
        assert np.min(np.max(np.abs(passed - arm.measured()), axis=1)) < 1e-3
        silent = follow(cycle, arm, unarmed, 1.0)
        assert all(one.trajectory is None and one.configuration is None for one in silent)
        assert silent[-1].goal_verdict.code is VerdictCode.NO_GOAL
        again = arrive(cycle, arm, dataclasses.replace(inputs, goal_number=2))
        assert arrived(again[-1])

    def test_what_drops_the_goal_disarms(self, cycle, arm, inputs):
        moving = follow(cycle, arm, inputs, 1.0)
        assert {one.disarms for one in moving} == {""}
        arm.displaced = np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
        lost = follow(cycle, arm, inputs, PERIOD)[0]
        assert "'panda_joint2' from where it was sent" in lost.disarms


class TestPause:
    """An arm that is to rest on its path goes on to the same goal once that is over."""

    def test_it_rests_on_its_path_and_goes_on(self, cycle, arm, inputs):
        follow(cycle, arm, inputs, 1.5)
        path = cycle.planner.motion_to_goal()[0]
        cycle.paused = "speed_override is 0"
        resting = follow(cycle, arm, inputs, 1.5)
        assert {(one.verdict.code, one.verdict.reason) for one in resting} == {
            (VerdictCode.HOLD_REQUESTED, "speed_override is 0")
        }
        np.testing.assert_array_equal(arm.states[-1][1:], 0.0)
        passed = path.samples(np.linspace(0.0, path.duration, 4000))[0]
        assert np.min(np.max(np.abs(passed - arm.measured()), axis=1)) < 1e-3
        assert np.max(np.abs(arm.measured() - inputs.goal.configuration)) > 0.1
        cycle.paused = ""
        assert arrived(arrive(cycle, arm, inputs)[-1])
        np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-9)

    def test_it_goes_on_once_the_speed_that_it_is_to_have_counts(self, planner, arm, inputs):
        release = threading.Event()
        with ThreadPoolExecutor(1) as background:
            cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, clock=lambda: 0.0, background=background)
            planner.clear_goal()
            follow(cycle, arm, inputs, PERIOD)
            background.submit(lambda: None).result()
            follow(cycle, arm, inputs, 1.5)
            cycle.paused = "speed_override is 0"
            follow(cycle, arm, inputs, 1.5)
            background.submit(release.wait)
            cycle.changes, cycle.paused = {"speed_override": 0.2}, ""
            try:
                waiting = follow(cycle, arm, inputs, 0.2)
            finally:
                release.set()
            assert {one.verdict.code for one in waiting} == {VerdictCode.HOLD_REQUESTED}
            background.submit(lambda: None).result()
            began = len(arm.states)
            assert follow(cycle, arm, inputs, 2.0)[-1].verdict.ok
            speeds = np.abs(np.array(arm.states[began:])[:, 1])
            largest = 0.2 * planner.settings.speed_scale * planner.robot.velocity_limits
            assert np.all(speeds <= largest + 1e-9)
            assert np.max(speeds / largest) > 0.5
            assert planner.change_settings(speed_override=1.0).ok

    @pytest.mark.parametrize("change", [{"goal": None, "goal_number": 0}, {"state_age": 0.5}], ids=["no goal", "stale"])
    def test_what_else_keeps_it_from_moving_is_stated_first(self, cycle, arm, inputs, change):
        follow(cycle, arm, dataclasses.replace(inputs, goal=None, goal_number=0), 0.1)
        cycle.paused = "speed_override is 0"
        output = follow(cycle, arm, dataclasses.replace(inputs, **change), 0.1)[-1]
        assert output.verdict.code in (VerdictCode.NO_GOAL, VerdictCode.STALE_STATE)


class TestHeldObjects:
    """An object in the hand, and the obstacle that has its name."""

    #: Between the fingers.
    BALL = HeldObject("toy/1", "sphere", (0.03,))

    def seen(self, cycle: PlannerCycle, configuration: np.ndarray, name: str = "toy") -> ObstacleTracker:
        """A tracker of a sphere where the ball is, with the arm in a configuration (7,)."""
        position, quaternion = cycle.planner.robot.forward(configuration)
        tracker = ObstacleTracker()
        centre = TaskFrame(position, quaternion).points_to_base(np.array([self.BALL.position]))[0]
        tracker.put("obstacles", (name, 1), centre, 0.03, 100.0)
        return tracker

    def test_the_obstacle_of_its_name_does_not_count_while_it_is_held_nor_until_the_hand_has_left_it(
        self, cycle, arm, inputs
    ):
        tracker = self.seen(cycle, arm.position)
        inputs = dataclasses.replace(inputs, obstacles=tracker.current(100.0))
        assert follow(cycle, arm, inputs, 0.05)[-1].verdict.code is VerdictCode.IN_COLLISION
        held = dataclasses.replace(inputs, held=(self.BALL,))
        assert follow(cycle, arm, held, 0.05)[-1].verdict.ok
        assert cycle.planner.held == (self.BALL,)
        # Released again at once: the hand is still where the ball is, and leaves.
        outputs = arrive(cycle, arm, inputs)
        assert cycle.planner.held == ()
        assert outputs[-1].verdict.ok
        np.testing.assert_allclose(arm.measured(), inputs.goal.configuration, atol=1e-6)
        assert len(cycle.planner.obstacles.radii) == 1

    def test_an_obstacle_of_its_name_that_is_elsewhere_counts(self, cycle, arm, inputs):
        held = dataclasses.replace(inputs, held=(self.BALL,))
        follow(cycle, arm, held, 0.05)
        ahead = cycle.planner.motion_to_goal()[0].sample(0.5 * cycle.planner.motion_to_goal()[0].duration)[0]
        tracker = self.seen(cycle, ahead)
        outputs = follow(cycle, arm, dataclasses.replace(inputs, obstacles=tracker.current(100.0)), 8.0)
        assert len(cycle.planner.obstacles.radii) == 1
        assert outputs[-1].verdict.code is not VerdictCode.IN_COLLISION

    def test_another_obstacle_there_counts(self, cycle, arm, inputs):
        tracker = self.seen(cycle, arm.position, "other")
        held = dataclasses.replace(inputs, held=(self.BALL,), obstacles=tracker.current(100.0))
        assert follow(cycle, arm, held, 0.05)[-1].verdict.code is VerdictCode.IN_COLLISION

    def test_it_is_prepared_before_a_goal_that_comes_with_it(self, planner, arm, inputs):
        release = threading.Event()
        with ThreadPoolExecutor(1) as background:
            cycle = PlannerCycle(planner, 0.1, 1.0, 0.1, HORIZON, clock=lambda: 0.0, background=background)
            planner.clear_goal()
            planner.hold(())
            background.submit(release.wait)
            with_goal = dataclasses.replace(inputs, held=(self.BALL,))
            try:
                waiting = follow(cycle, arm, with_goal, 0.05)
            finally:
                release.set()
            # An arm does not move while what its hand holds does not count yet.
            assert {output.verdict.code for output in waiting} == {VerdictCode.BAD_INPUT}
            assert "which does not count yet" in waiting[-1].verdict.reason
            assert planner.held == ()
            background.submit(lambda: None).result()
            follow(cycle, arm, with_goal, 0.02)
            assert planner.held == (self.BALL,)
            background.submit(lambda: None).result()
            assert follow(cycle, arm, with_goal, 0.2)[-1].verdict.ok

    def test_the_arm_stops_while_it_is_not_known_what_the_hand_holds(self, cycle, arm, inputs):
        follow(cycle, arm, inputs, 1.0)
        refused = dataclasses.replace(inputs, held_refused="marker toy/1: type 10")
        stopped = follow(cycle, arm, refused, 1.0)[-1]
        assert stopped.verdict.code is VerdictCode.BAD_INPUT
        assert "not known what the hand holds: marker toy/1: type 10" in stopped.verdict.reason
        assert stopped.speed == 0.0
        assert follow(cycle, arm, inputs, 0.1)[-1].verdict.ok
