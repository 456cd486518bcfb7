"""The command `goal` waits for a planner, and says what becomes of the goal until the arm has arrived."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from bench import PATIENCE
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.nodes import goal_sender
from geodesic_motion_ros.nodes.goal_sender import (
    GoalNotReachedError,
    GoalRefusedError,
    JointGoal,
    NoPlannerError,
    PoseGoal,
    ProgressReport,
    goal_of_skill,
    send_goal,
)
from geodesic_motion_ros.nodes.messages import read_joint_positions, read_pose
from geodesic_motion_ros.nodes.newest_goal import PREPARING
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

SKILLS = Path(__file__).resolve().parents[1] / "skills"
#: Wide enough to block every demonstration where no scene is declared.
WALL = "{ball: {kind: static, centre: [0.465, -0.01, 0.34], radius: 0.08}}"


@pytest.fixture
def options(skill_folder):
    """A planner for a busy machine: it waits long before it calls the twin's messages stale."""
    return {
        "skill": str(skill_folder), "state_timeout": 5.0, "resume_timeout": 60.0, "obstacle_timeout": 30.0,
        "tracking_tolerance_joint": 0.3, "latency": 0.1, "latent_view_rate": 0.0,
    }  # fmt: skip


@pytest.fixture
def goal(skill) -> PoseGoal:
    return PoseGoal(skill.goal_pose, skill.base_frame)


@pytest.fixture
def clock(monkeypatch) -> list[float]:
    """By how much the clock of the sender is ahead [s]: a test lets its patience pass at once."""
    ahead, monotonic = [0.0], time.monotonic

    class Ahead:
        @staticmethod
        def monotonic() -> float:
            return monotonic() + ahead[0]

    monkeypatch.setattr(goal_sender, "time", Ahead)
    return ahead


def send(bench, goal, *arguments, **options) -> float:
    return bench.during(lambda: send_goal(goal, *arguments, **options))


@pytest.mark.parametrize("shipped", [None, "ur5_reach"], ids=["seven joints", "six joints"])
def test_the_tour_planner_and_twin_as_they_start_and_the_goal_of_the_skill(bench, options, skill, shipped):
    bench.watch_planner()
    if shipped is not None:
        skill = Skill.load(shipped)
        options["skill"] = shipped
    bench.add(TwinNode, skill=options["skill"])
    bench.add(PlannerNode, **options)
    lines = []
    took = send(bench, PoseGoal(skill.goal_pose, skill.base_frame), said=lines.append)
    assert took > 1.0
    bench.wait(lambda: float(bench.status()["time_to_goal"]) == float(bench.status()["speed"]) == 0.0, "the arrival")
    assert lines[0].startswith("ros2 topic pub --once /goal_pose geometry_msgs/msg/PoseStamped")
    accepted = next(number for number, line in enumerate(lines) if line.startswith("accepted: "))
    moving = [line for line in lines[accepted + 1 :] if line.startswith("moving, ")]
    assert moving
    assert 0.0 < float(moving[0].split()[1]) < took
    # What lasts for a cycle or two, as DEADLINE_MISSED, is not said.
    assert all(line.startswith(("moving, ", "following: OK", "stopping: ")) for line in lines[accepted + 1 :])
    # ... and back, on the same paths.
    assert send(bench, goal_of_skill(skill, end="start")) > 1.0
    bench.wait(lambda: float(bench.status()["time_to_goal"]) == float(bench.status()["speed"]) == 0.0, "the start")


def test_a_configuration_is_a_goal_too(bench, options, start_joints, skill):
    bench.watch_planner()
    bench.add(TwinNode, skill=options["skill"])
    planner = bench.add(PlannerNode, **options)
    names = planner.planner.robot.joint_names
    turned = JointGoal(names[::-1], start_joints[::-1])  # messages have them in any order
    lines = []
    assert send(bench, turned, said=lines.append) >= 0.0
    assert lines[0].startswith("ros2 topic pub --once /goal_joints sensor_msgs/msg/JointState")
    assert int(bench.status()["goal_number"]) == 1


@pytest.mark.parametrize(("learned", "topic"), [("arm_of_5", "/goal_joints"), ("reach", "/goal_pose")])
def test_the_planner_says_on_which_topic_its_arm_takes_goals(bench, options, learned, topic):
    bench.listen_to_log()
    bench.add(PlannerNode, **options | {"skill": str(SKILLS / learned)})
    (line,) = bench.wait(lambda: bench.logged("ready: skill"), "the planner")
    assert line.endswith(f"then for a goal on {topic}")


def test_a_refused_goal_is_reported_also_where_the_arm_stands_at_an_earlier_one(
    bench, options, goal, skill, skill_folder
):
    bench.add(TwinNode, namespace="left", skill=str(skill_folder))
    bench.add(PlannerNode, namespace="left", **options)
    left, lines = ("-r", "__ns:=/left"), []
    send(bench, goal, left, said=lines.append)
    assert "--once /left/goal_pose" in lines[0]
    far = PoseGoal(skill.goal_pose + np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), skill.base_frame)
    with pytest.raises(GoalRefusedError, match="the planner refuses the goal: GOAL_OUT_OF_SUPPORT: "):
        send(bench, far, left)


def test_the_answer_to_a_goal_is_waited_for_while_it_is_prepared(bench, options, goal, skill_folder, monkeypatch):
    bench.watch_planner()
    bench.add(TwinNode, skill=str(skill_folder))
    node = bench.add(PlannerNode, **options)
    bench.wait_for_code("NO_GOAL")
    planner = node.planner
    prepare, said = planner.prepare_goal, []

    def slowly(*arguments):
        until = int(bench.status()["tick"]) + 40
        bench.wait(lambda: int(bench.status()["tick"]) >= until, "40 ticks")
        said.append(bench.heard["planner/status"][-1].status[0].message)
        return prepare(*arguments)

    monkeypatch.setattr(planner, "prepare_goal", slowly)
    send(bench, goal)
    assert said == [f"NO_GOAL: {PREPARING}"]


def test_a_planner_that_starts_is_waited_for_as_long_as_it_is_there(bench, options, goal, skill_folder, clock):
    bench.add(TwinNode, skill=str(skill_folder))
    # A planner that is there, and does not listen yet.
    starting = rclpy.create_node("planner", context=bench.context)

    def said(line: str) -> None:
        lines.append(line)
        if line.startswith("the planner starts: "):
            clock[0] += 1e6  # more than any patience
            if len(lines) < 5:
                bench.add(PlannerNode, **options)

    lines: list[str] = []
    assert send(bench, goal, patience=60.0, said=said) > 0.0
    assert "the planner starts: waiting for it; Ctrl-C leaves" in lines
    starting.destroy_node()


def test_where_no_planner_is_there_it_gives_up_and_says_so(bench, goal, clock):
    def said(line: str) -> None:
        if line.startswith("waiting for a planner that listens to /goal_pose"):
            clock[0] += 61.0

    with pytest.raises(NoPlannerError, match=r"nobody listens to /goal_pose: start the planner first .waited 60 s"):
        send(bench, goal, patience=60.0, said=said)


def test_what_lasts_is_said_soon_and_what_changes_all_the_time_now_and_then() -> None:
    times = np.arange(0.1, 12.0, 0.1)
    steady = ProgressReport(0.0)
    said = [float(time) for time in times if steady.take("waiting", time)]
    np.testing.assert_allclose(said, [0.6, 5.6, 10.6], atol=1e-9)
    changing = ProgressReport(0.0)
    said = [float(time) for number, time in enumerate(times) if changing.take(f"reason {number // 3 % 2}", time)]
    np.testing.assert_allclose(said, [5.0, 10.0], atol=1e-9)
    # What begins is not said for a moment, though the last word is not long ago.
    assert not steady.take("moving", 12.0)
    assert steady.take("moving", 12.5)


def test_an_arm_that_stands_is_not_waited_for_for_ever_and_the_reason_is_said(bench, options, goal, clock):
    bench.watch_planner()
    bench.add(TwinNode, skill=options["skill"], spheres=WALL, spawn_at_start=True)
    planner = bench.add(PlannerNode, **options)
    bench.wait(lambda: len(planner.inputs.snapshot().obstacles.radii), "the wall at the planner")
    waiting = "waiting: NO_FEASIBLE_PATH: ", "waiting: DEADLINE_MISSED: "
    reasons: list[str] = []

    def said(line: str) -> None:
        # A busy machine may wait before that, while the goal is prepared.
        if line.startswith(waiting):
            reasons.append(line)
            clock[0] += 61.0

    with pytest.raises(GoalNotReachedError, match=r"the arm has stood for 60 s: .*; the planner keeps the goal"):
        send(bench, goal, patience=60.0, said=said)
    assert reasons
    assert bench.status()["goal_code"] == "OK"


def test_a_goal_that_another_one_replaces_is_not_said_to_be_reached(bench, options, goal, skill):
    bench.watch_planner()
    bench.add(TwinNode, skill=options["skill"])
    bench.add(PlannerNode, **options)

    def said(line: str) -> None:
        if line.startswith("accepted: "):
            bench.send_goal(skill.start_pose)

    with pytest.raises(GoalNotReachedError, match="another goal has been sent to the planner"):
        send(bench, goal, said=said)


def test_a_goal_that_is_dropped_is_not_waited_for(bench, options, goal):
    bench.watch_planner()
    bench.add(TwinNode, skill=options["skill"])
    bench.add(PlannerNode, **options, speed_scale=0.01)

    def said(line: str) -> None:
        if line.startswith("moving, "):
            # Another node may command the arm, too.
            bench.probe.create_publisher(JointTrajectory, "joint_trajectory", 1)

    with pytest.raises(GoalNotReachedError, match=r"NO_GOAL: goal dropped: joint_trajectory had more than one publish"):
        send(bench, goal, said=said)


def test_ctrl_c_leaves_at_once():
    command = [sys.executable, "-m", "geodesic_motion_ros", "goal", "panda_pouring", "--wait", "600"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline().startswith("ros2 topic pub --once /goal_pose ")
        assert process.stdout.readline() == "waiting for a planner that listens to /goal_pose; Ctrl-C leaves\n"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert (process.returncode, out, err) == (130, "", "geodesic-motion: interrupted\n")


def test_the_command_for_the_ros2_command_line_holds_the_goal(skill, goal):
    """What `ros2 topic pub` is given is YAML of the message."""
    content = yaml.safe_load(goal.by_hand().split('"')[1])
    pose = Pose(position=Point(**content["pose"]["position"]), orientation=Quaternion(**content["pose"]["orientation"]))
    message = PoseStamped(header=Header(**content["header"]), pose=pose)
    position, quaternion = read_pose(message, skill.base_frame)
    np.testing.assert_allclose(position, skill.goal_pose[:3], atol=1e-4)
    np.testing.assert_allclose(quaternion, skill.goal_pose[3:], atol=1e-3)
    # Names of joints may be numbers, which YAML would make of them.
    names, positions = ("1", "2", "yaw"), np.array([0.1, -0.2, 3.0])
    message = JointState(**yaml.safe_load(JointGoal(names, positions).by_hand().split('"')[1]))
    np.testing.assert_allclose(read_joint_positions(message, names), positions, atol=1e-4)


def test_an_arm_that_holds_no_pose_is_sent_a_configuration(monkeypatch, capsys):
    skill = Skill.load("ur5_reach")
    assert main(["goal", "ur5_reach", "--print"]) == 0
    assert f"frame_id: {skill.base_frame}}}" in capsys.readouterr().out
    assert main(["goal", "ur5_reach", "--print", "--joint-prefix", "left_"]) == 0
    assert f"frame_id: left_{skill.base_frame}}}" in capsys.readouterr().out
    assert main(["goal", "ur5_reach", "--print", "--back"]) == 0
    assert capsys.readouterr().out == goal_of_skill(skill, end="start").by_hand() + "\n"
    monkeypatch.setattr(Robot, "takes_poses", False)
    robot = Robot.named("ur5")
    assert main(["goal", "ur5_reach", "--print", "--back"]) == 0
    content = yaml.safe_load(capsys.readouterr().out.split('"')[1])
    np.testing.assert_allclose(robot.forward(np.array(content["position"]))[0], skill.start_pose[:3], atol=1e-3)
    assert main(["goal", "ur5_reach", "--print"]) == 0
    content = yaml.safe_load(capsys.readouterr().out.split('"')[1])
    assert tuple(content["name"]) == tuple(robot.joint_names)
    np.testing.assert_allclose(robot.forward(np.array(content["position"]))[0], skill.goal_pose[:3], atol=1e-3)
    assert main(["goal", "ur5_reach", "--print", "--joint-prefix", "left_"]) == 0
    content = yaml.safe_load(capsys.readouterr().out.split('"')[1])
    assert content["name"] == [f"left_{name}" for name in robot.joint_names]
    assert main(["goal", "ur5_reach", "--print", "--move", "0", "0.1", "0"]) == 2
    assert "--move is of a pose, and an arm of 6 joints takes configurations" in capsys.readouterr().err
