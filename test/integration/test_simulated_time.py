"""Planner and twin by a clock that a simulator shows: it runs slowly, stands, and is set."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.messages import seconds
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

# The clock here is one of a simulator of its own, that goes on as fast as it wants to.
pytestmark = pytest.mark.realtime

ROBOT = Robot.named("panda")
BEGIN = 1000.0
#: The clock is published so often [s].
TICK = 0.005


class SimulatedClock:
    """`/clock` of a simulator that runs `speed` times as fast as real time."""

    def __init__(self, bench) -> None:
        self.time, self.speed = BEGIN, 1.0
        self._publisher = bench.probe.create_publisher(Clock, "/clock", 10)
        bench.repeat(TICK, self._go_on)

    def _go_on(self) -> None:
        self.time += self.speed * TICK
        message = Clock()
        message.clock.sec, message.clock.nanosec = int(self.time), int(1e9 * (self.time % 1.0))
        self._publisher.publish(message)


OPTIONS = {
    "state_timeout": 0.5, "resume_timeout": 0.6, "tracking_tolerance": 0.3, "tracking_tolerance_angle": 1.0,
    "tracking_tolerance_joint": 0.3, "latent_view_rate": 0.0, "use_sim_time": True,
}  # fmt: skip


def make(bench, name: str, **options) -> SimulatedClock:
    """A planner and a twin for a skill, at rest at its start, and the clock they live by."""
    bench.skill = Skill.load(name)
    bench.watch_planner()
    bench.listen(JointState, "joint_states", 1000)
    bench.listen(JointTrajectory, "joint_trajectory", 1000)
    clock = SimulatedClock(bench)
    bench.add(TwinNode, skill=name, use_sim_time=True)
    bench.add(PlannerNode, skill=name, **OPTIONS, **options)
    bench.wait_for_code("NO_GOAL")
    return clock


@pytest.fixture(params=["tool", "whole arm"])
def clock(request, bench, skill_folder) -> SimulatedClock:
    if request.param == "tool":
        return make(bench, str(skill_folder), tool_spheres=[0.0, 0.0, 0.0, 0.04])
    return make(bench, "panda_reach_to_grasp")


def go(bench) -> None:
    bench.send_goal(bench.skill.goal_pose, bench.skill.base_frame)
    bench.wait_for_code("OK")


def tool(bench) -> np.ndarray:
    return ROBOT.forward(np.array(bench.heard["joint_states"][-1].position))[0]


def wait_until_in_motion(bench) -> None:
    start = tool(bench)
    bench.wait(lambda: np.linalg.norm(tool(bench) - start) > 0.05, "the arm in motion")


def wait_until_there(bench) -> None:
    bench.wait(lambda: np.linalg.norm(tool(bench) - bench.skill.goal_pose[:3]) < 0.005, "the arm at the goal")


def wait_for_ticks(bench, count: int) -> None:
    until = int(bench.status()["tick"]) + count
    bench.wait(lambda: int(bench.status()["tick"]) > until, f"{count} ticks")


def stamps(messages: list) -> np.ndarray:
    return np.array([seconds(message.header.stamp) for message in messages])


def check_commands(bench) -> None:
    """All numbers are finite."""
    for trajectory in bench.heard["joint_trajectory"]:
        rows = [[*point.positions, *point.velocities, *point.accelerations] for point in trajectory.points]
        assert np.all(np.isfinite(rows))
    for message in bench.heard["target_pose"]:
        position, turn = message.pose.position, message.pose.orientation
        assert np.all(np.isfinite([position.x, position.y, position.z, turn.w, turn.x, turn.y, turn.z]))


def test_slowly_or_not_at_all_the_motion_is_that_of_the_simulation(bench, clock) -> None:
    clock.speed = 0.5
    go(bench)
    wait_until_in_motion(bench)
    clock.speed = 0.0
    wait_for_ticks(bench, 20)
    before, heard = tool(bench), len(bench.heard["joint_states"])
    # longer than joint states may be missing
    wait_for_ticks(bench, 100)
    assert bench.status()["code"] == "OK"
    assert len(bench.heard["joint_states"]) - heard <= 2
    np.testing.assert_allclose(tool(bench), before, atol=1e-6)
    clock.speed = 0.5
    wait_until_there(bench)
    states, speed_limit = list(bench.heard["joint_states"]), 0.2
    times, places = stamps(states), np.array([ROBOT.forward(np.array(state.position))[0] for state in states])
    window = 20
    passed = np.maximum(times[window:] - times[:-window], 0.02)
    speeds = np.linalg.norm(places[window:] - places[:-window], axis=1) / passed
    # by the steady clock it would be twice as fast
    if not bench.heard["joint_trajectory"]:
        assert np.percentile(speeds[speeds > 0.01], 75) < 1.25 * speed_limit
    begins = stamps(bench.heard["joint_trajectory"])
    assert np.all((begins > BEGIN - 1.0) & (begins < clock.time + 1.0))
    check_commands(bench)


@pytest.mark.parametrize("jump", [5.0, -5.0, "reset"])
def test_a_clock_that_is_set_stops_the_arm_until_the_goal_is_sent_again(bench, jump) -> None:
    clock = make(bench, "panda_reach_to_grasp")
    go(bench)
    wait_until_in_motion(bench)
    if jump == "reset":  # as Gazebo's: the next time is 0
        clock.time = -clock.speed * TICK
        bench.wait_for_code("NO_GOAL", "goal dropped: the clock was set by -")
    else:
        clock.time += jump
        bench.wait_for_code("NO_GOAL", f"goal dropped: the clock was set by {jump:+.1f} s")
    rest = tool(bench)
    wait_for_ticks(bench, 30)
    np.testing.assert_allclose(tool(bench), rest, atol=2e-3)
    go(bench)
    wait_until_there(bench)
    check_commands(bench)


def test_without_a_clock_joint_states_are_of_no_use(bench, skill_folder, start_joints) -> None:
    bench.watch_planner()
    bench.add(PlannerNode, skill=str(skill_folder), **OPTIONS)
    bench.send_joint_states(start_joints)
    bench.wait(lambda: "nothing has been received on /clock" in bench.status().get("refused_input", ""), "the refusal")
    assert bench.status()["code"] == "STALE_STATE"
    bench.listen(PoseStamped, "target_pose")
    SimulatedClock(bench)
    bench.wait_for_code("NO_GOAL")
