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

ROBOT = Robot.named("panda")

OPTIONS = {
    "state_timeout": 0.5, "resume_timeout": 0.6, "tracking_tolerance": 0.3, "tracking_tolerance_angle": 1.0,
    "tracking_tolerance_joint": 0.3, "latent_view_rate": 0.0,
}  # fmt: skip


def make(bench, name: str, **options) -> None:
    """A planner and a twin for a skill, at rest at its start."""
    bench.skill = Skill.load(name)
    bench.watch_planner()
    bench.listen(JointState, "joint_states", 1000)
    bench.listen(JointTrajectory, "joint_trajectory", 1000)
    bench.add(TwinNode, skill=name)
    bench.add(PlannerNode, skill=name, **OPTIONS, **options)
    bench.wait_for_code("NO_GOAL")


@pytest.fixture(params=["tool", "whole arm"])
def arm(request, bench, skill_folder) -> None:
    if request.param == "tool":
        make(bench, str(skill_folder), tool_spheres=[0.0, 0.0, 0.0, 0.04])
    else:
        make(bench, "panda_reach_to_grasp")


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


def stand(bench, count: int) -> None:
    """Have the planner tick so often by its own time, while the simulation stands."""
    until = int(bench.status()["tick"]) + count
    bench.poll(lambda: int(bench.status()["tick"]) > until, f"{count} ticks")


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


def test_a_simulation_that_goes_on_or_stands_is_all_the_time_there_is(bench, arm) -> None:
    began = bench.now()
    go(bench)
    wait_until_in_motion(bench)
    before, heard = tool(bench), len(bench.heard["joint_states"])
    # longer than joint states may be missing
    stand(bench, 100)
    assert bench.status()["code"] == "STALE_STATE"
    assert "/clock has stood" in bench.status()["reason"]
    assert len(bench.heard["joint_states"]) - heard <= 2
    np.testing.assert_allclose(tool(bench), before, atol=1e-6)
    wait_until_there(bench)
    states, speed_limit = list(bench.heard["joint_states"]), 0.2
    times, places = stamps(states), np.array([ROBOT.forward(np.array(state.position))[0] for state in states])
    window = 20
    passed = np.maximum(times[window:] - times[:-window], 0.02)
    speeds = np.linalg.norm(places[window:] - places[:-window], axis=1) / passed
    # The simulation here goes on several times as fast as the steady clock, or stands.
    if not bench.heard["joint_trajectory"]:
        assert 0.5 * speed_limit < np.percentile(speeds[speeds > 0.01], 75) < 1.25 * speed_limit
    begins = stamps(bench.heard["joint_trajectory"])
    assert np.all((begins > began - 1.0) & (begins < bench.now() + 1.0))
    check_commands(bench)


@pytest.mark.parametrize("jump", [5.0, -5.0, "reset"])
def test_a_clock_that_is_set_stops_the_arm_until_the_goal_is_sent_again(bench, jump) -> None:
    make(bench, "panda_reach_to_grasp")
    go(bench)
    wait_until_in_motion(bench)
    if jump == "reset":  # as Gazebo's: the next time is 0
        bench.set_clock(0.0)
        bench.wait_for_code("NO_GOAL", "goal dropped: the clock was set by -")
    else:
        bench.set_clock(bench.now() + jump)
        bench.wait_for_code("NO_GOAL", f"goal dropped: the clock was set by {jump:+.1f} s")
    rest = tool(bench)
    bench.live(0.3)
    np.testing.assert_allclose(tool(bench), rest, atol=2e-3)
    go(bench)
    wait_until_there(bench)
    check_commands(bench)


@pytest.mark.realtime
def test_without_a_clock_joint_states_are_of_no_use(bench, skill_folder, start_joints) -> None:
    bench.watch_planner()
    bench.add(PlannerNode, skill=str(skill_folder), use_sim_time=True, **OPTIONS)
    bench.send_joint_states(start_joints)
    bench.wait(lambda: "nothing has been received on /clock" in bench.status().get("refused_input", ""), "the refusal")
    assert bench.status()["code"] == "STALE_STATE"
    bench.listen(PoseStamped, "target_pose")
    publisher = bench.probe.create_publisher(Clock, "/clock", 10)
    bench.repeat(0.01, lambda: publisher.publish(Clock(clock=bench.probe.get_clock().now().to_msg())))
    bench.wait_for_code("NO_GOAL")
