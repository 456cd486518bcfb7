"""The node `twin` and the topic `joint_trajectory`: followed, replaced in motion, refused, ended."""

from __future__ import annotations

import signal

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.messages import seconds
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.description import shipped_robots
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference, joined

ROBOT = Robot.named("panda")
LIMITS = JointLimits.of(ROBOT, speed_scale=0.25, acceleration_scale=0.2)
START = ROBOT.ready
GOAL = START + np.array([0.6, 0.3, -0.4, 0.3, 0.4, -0.3, 0.5])
OTHER_GOAL = START + np.array([-0.3, 0.5, 0.2, 0.1, -0.4, 0.2, 0.0])


def motion(
    start: np.ndarray, goal: np.ndarray, velocity: np.ndarray | None = None, acceleration: np.ndarray | None = None
) -> JointReference:
    reference = timed_joint_reference(np.stack([start, goal]), np.zeros((2, 1)), LIMITS, velocity, acceleration)
    assert reference is not None
    return reference


@pytest.fixture
def twin(bench):
    """A bench with a twin at START."""
    bench.twin = bench.add(TwinNode, skill="", initial_joint_positions=START.tolist())
    bench.listen(JointState, "joint_states", 1000)
    bench.wait(lambda: bench.heard["joint_states"], "the state of the arm")
    return bench


def serialised(reference: JointReference, begin: float, joint_names: tuple[str, ...] = ROBOT.joint_names) -> bytes:
    knots = reference.times, reference.positions, reference.velocities, reference.accelerations
    return joint_trajectory_bytes(joint_names, *knots, round(1e9 * begin))


def send(bench, reference: JointReference, begin: float, *joint_names: tuple[str, ...]) -> None:
    bench.publisher(JointTrajectory, "joint_trajectory").publish(serialised(reference, begin, *joint_names))


def measured(bench) -> np.ndarray:
    return np.array(bench.heard["joint_states"][-1].position)


def wait_for_time(bench, time: float) -> None:
    bench.wait(lambda: seconds(bench.heard["joint_states"][-1].header.stamp) > time, f"states after {time} s")


def wait_for_rest(bench, goal: np.ndarray) -> None:
    bench.wait(lambda: np.max(np.abs(measured(bench) - goal)) < 1e-3, "the arm at its goal")
    heard = len(bench.heard["joint_states"])
    bench.wait(lambda: len(bench.heard["joint_states"]) > heard + 30, "further states")
    np.testing.assert_allclose(measured(bench), goal, atol=1e-3)


def check_followed(bench, pieces: list[tuple[JointReference, float, float]]) -> None:
    """The states heard are those of references, each played from its begin and published until an end [s]."""
    errors = []
    for state in bench.heard["joint_states"]:
        stamp = seconds(state.header.stamp)
        for reference, begin, end in pieces:
            if begin <= stamp < end:
                position, velocity, _ = reference.sample(stamp - begin)
                errors.append((np.max(np.abs(position - state.position)), np.max(np.abs(velocity - state.velocity))))
    assert len(errors) > 30
    assert np.all(np.array(errors) < (5e-3, 0.1))


def test_a_trajectory_is_followed_to_its_goal_and_held_without_a_stream(twin):
    reference = motion(START, GOAL)
    twin.publisher(JointTrajectory, "joint_trajectory")
    begin = twin.now() + 0.1
    send(twin, reference, begin)
    wait_for_time(twin, begin + reference.duration)
    wait_for_rest(twin, GOAL)
    assert reference.duration > 3.0 * twin.twin.get_parameter("command_timeout").value
    check_followed(twin, [(reference, begin, begin + reference.duration)])


@pytest.mark.parametrize("name", shipped_robots())
def test_every_shipped_robot_starts_at_ready_and_follows_a_trajectory(bench, name):
    robot = Robot.named(name)
    path = robot.ready + np.array([[0.0], [0.3]])
    reference = timed_joint_reference(path, np.zeros((2, 1)), JointLimits.of(robot, speed_scale=0.5))
    bench.add(TwinNode, skill="", robot=name)
    bench.listen(JointState, "joint_states", 1000)
    state = bench.wait(lambda: bench.heard["joint_states"], "the state of the arm")[0]
    assert tuple(state.name) == robot.joint_names
    np.testing.assert_allclose(state.position, robot.ready, atol=0.01)
    bench.publisher(JointTrajectory, "joint_trajectory")
    send(bench, reference, bench.now() + 0.1, robot.joint_names)
    wait_for_rest(bench, path[-1])


@pytest.mark.realtime
def test_an_arm_whose_process_stood_still_stays_on_the_path(bench):
    """The motion bends, so that an arm which made for where it should be by now would leave it."""
    angles = np.linspace(0.0, np.pi, 60)
    bend = 0.5 * np.stack([np.sin(angles), 1.0 - np.cos(angles)], axis=1)
    path = START + np.column_stack([bend[:, :1], np.zeros((60, 2)), bend[:, 1:], np.zeros((60, 3))])
    reference = timed_joint_reference(path, np.zeros((60, 1)), JointLimits.of(ROBOT, speed_scale=0.5))
    assert reference is not None
    bench.listen(JointState, "joint_states", 1000)
    process = bench.launch("twin_node", initial_joint_positions=START.tolist())
    bench.wait(lambda: bench.heard["joint_states"], "the state of the arm")
    bench.publisher(JointTrajectory, "joint_trajectory")
    begin = bench.now() + 0.1
    send(bench, reference, begin)
    wait_for_time(bench, begin + 0.3 * reference.duration)
    stopped = seconds(bench.heard["joint_states"][-1].header.stamp)
    process.send_signal(signal.SIGSTOP)
    bench.poll(lambda: bench.now() > stopped + 0.4, "0.4 s to pass")
    process.send_signal(signal.SIGCONT)
    wait_for_rest(bench, path[-1])
    stamps = np.array([seconds(state.header.stamp) for state in bench.heard["joint_states"]])
    assert np.max(np.diff(stamps)) > 0.35
    passed = reference.samples(np.linspace(0.0, reference.duration, 2000))[0]
    arm = np.array([state.position for state in bench.heard["joint_states"]])
    off = np.min(np.max(np.abs(arm[:, None] - passed), axis=2), axis=1)
    assert np.max(off) < 5e-3


def test_a_replacement_in_motion_gives_no_jump(twin):
    old = motion(START, GOAL)
    twin.publisher(JointTrajectory, "joint_trajectory")
    begin = twin.now() + 0.1
    send(twin, old, begin)
    wait_for_time(twin, begin + 0.45 * old.duration)
    ahead = int(np.searchsorted(old.times, twin.now() - begin + 0.2))
    since, switch = old.times[ahead - 12], old.times[ahead]
    position, velocity, acceleration = old.sample(switch)
    assert np.max(np.abs(velocity)) > 0.2
    new = motion(position, OTHER_GOAL, velocity, acceleration)
    send(twin, joined(old, since, new, switch), begin + since)
    wait_for_rest(twin, OTHER_GOAL)
    check_followed(twin, [(old, begin, begin + switch), (new, begin + switch, begin + switch + new.duration)])


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda message: setattr(message.points[3], "positions", [np.nan] * 7), "positions of a trajectory hold nan"),
        (lambda message: setattr(message.header.stamp, "sec", message.header.stamp.sec - 100), "ends in the past"),
        (lambda message: setattr(message, "points", []), "no points: what is played goes on"),
    ],
    ids=["in the message", "in its time", "empty"],
)
def test_a_bad_one_is_refused_and_the_old_one_goes_on(twin, spoil, reason):
    reference = motion(START, GOAL)
    twin.listen_to_log()
    twin.publisher(JointTrajectory, "joint_trajectory")
    begin = twin.now() + 0.1
    send(twin, reference, begin)
    wait_for_time(twin, begin + 0.3 * reference.duration)
    message = deserialize_message(serialised(motion(START, OTHER_GOAL), twin.now()), JointTrajectory)
    spoil(message)
    twin.publisher(JointTrajectory, "joint_trajectory").publish(message)
    twin.wait(lambda: twin.logged(reason), f"a refusal: {reason}")
    wait_for_rest(twin, GOAL)
    check_followed(twin, [(reference, begin, begin + reference.duration)])


def test_whichever_spoke_last_commands_and_the_change_is_logged(twin, make_pose):
    twin.listen_to_log()
    send(twin, motion(START, GOAL), 0.0)
    wait_for_rest(twin, GOAL)
    pose = make_pose(np.concatenate(ROBOT.forward(START)))
    publisher = twin.publisher(PoseStamped, "target_pose")
    timer = twin.repeat(0.02, lambda: publisher.publish(pose))
    tool = lambda: ROBOT.forward(measured(twin))[0]  # noqa: E731
    twin.wait(lambda: np.linalg.norm(tool() - ROBOT.forward(START)[0]) < 2e-3, "the arm at the pose")
    twin.probe.destroy_timer(timer)
    wait_for_time(twin, twin.now() + 2.0 * twin.twin.get_parameter("command_timeout").value)
    send(twin, motion(measured(twin), GOAL), 0.0)
    wait_for_rest(twin, GOAL)
    said = [
        "joint_trajectory commands the arm from now on",
        "target_pose commands the arm from now on, no longer joint_trajectory",
        "joint_trajectory commands the arm from now on, no longer target_pose",
    ]
    twin.wait(lambda: len(twin.logged("commands the arm")) == 3, "three changes in the log")
    assert twin.logged("commands the arm") == said


def test_when_nothing_new_comes_after_the_end_the_twin_says_so_once_and_the_arm_stays(twin):
    assert twin.twin.set_parameters([Parameter("cmd_timeout", value=0.1)])[0].successful
    twin.listen_to_log()
    for count, goal in enumerate((GOAL, START), 1):
        send(twin, motion(measured(twin), goal), 0.0)
        twin.wait(lambda count=count: len(twin.logged("cmd_timeout")) == count, "the warning")
        wait_for_rest(twin, goal)
        assert len(twin.logged("cmd_timeout")) == count


def test_reset_ends_a_trajectory(twin):
    twin.publisher(JointTrajectory, "joint_trajectory")
    begin = twin.now() + 0.1
    reference = motion(START, GOAL)
    send(twin, reference, begin)
    wait_for_time(twin, begin + 0.4 * reference.duration)
    assert np.max(np.abs(measured(twin) - START)) > 0.05
    assert twin.call(Trigger, "twin/reset", Trigger.Request()).success
    twin.wait(lambda: np.max(np.abs(measured(twin) - START)) < 1e-3, "the arm back at its start")
    wait_for_time(twin, begin + reference.duration + 0.2)
    wait_for_rest(twin, START)
