"""The filter between somebody who sends trajectories and an arm: the real nodes, the arm in PyBullet."""

from __future__ import annotations

import numpy as np
import pytest
from bench import Bench
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from geodesic_motion_ros.nodes.filter_node import FilterNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.faults.fuzz import OFFERS, Fuzzer

#: Where the arm stands, and where what is offered leads [rad]; how long it takes [s].
BEGIN = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.7])
END = BEGIN + np.array([0.6, 0.4, -0.3, 0.3, 0.2, 0.2, -0.3])
SECONDS = 2.0
#: For a busy machine.
OPTIONS = {"robot": "panda", "scene": "none", "state_timeout": 5.0, "resume_timeout": 60.0, "latency": 0.1}


@pytest.fixture
def arm(bench: Bench) -> Bench:
    """A bench with a twin and a filter, which knows of the arm."""
    bench.listen(DiagnosticArray, "filter/status")
    bench.listen(JointState, "joint_states")
    bench.add(TwinNode, robot="panda", skill="", initial_joint_positions=BEGIN.tolist())
    bench.add(FilterNode, **OPTIONS)
    bench.wait(lambda: status(bench).get("code") == "NO_GOAL", "a filter that knows of the arm")
    return bench


def status(bench: Bench) -> dict[str, str]:
    """The newest status of the filter, by key."""
    heard = bench.heard["filter/status"]
    return {pair.key: pair.value for pair in heard[-1].status[0].values} if heard else {}


def measured(bench: Bench) -> np.ndarray:
    """Where the arm is measured (7,) [rad]."""
    message = bench.heard["joint_states"][-1]
    return np.array([message.position[message.name.index(name)] for name in Robot.named("panda").joint_names])


def send(bench: Bench, begin: np.ndarray, end: np.ndarray, points: int = 60) -> None:
    """Offer a motion of least jerk between two configurations, to be played at once."""
    share = np.linspace(0.0, 1.0, points)
    passed = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    message = JointTrajectory(joint_names=list(Robot.named("panda").joint_names))
    for time, one in zip(SECONDS * share, passed, strict=True):
        at = Duration(sec=int(time), nanosec=round(1e9 * (time - int(time))))
        message.points.append(
            JointTrajectoryPoint(positions=(begin + one * (end - begin)).tolist(), time_from_start=at)
        )
    bench.publisher(JointTrajectory, "filter/joint_trajectory").publish(message)


def is_at(bench: Bench, where: np.ndarray) -> bool:
    return bool(np.max(np.abs(measured(bench) - where)) < 0.01) and float(status(bench)["speed"]) == 0.0


def test_a_trajectory_is_played_and_one_that_is_wrong_is_named(arm: Bench) -> None:
    assert status(arm)["reason"] == "no trajectory has been given"
    arm.listen_to_log()
    send(arm, BEGIN, END)
    arm.wait(lambda: is_at(arm, END) and status(arm)["code"] == "OK", "the end of the trajectory")
    arm.wait(lambda: arm.logged("at the end of the trajectory after"), "the arrival in the log")
    send(arm, END, np.full(7, np.nan))
    refused = "'panda_joint1' is nan"
    arm.wait(lambda: refused in status(arm).get("goal_reason", "") + status(arm)["reason"], "the refusal")
    assert is_at(arm, END)


def refused_messages() -> list[tuple[str, type, object, str]]:
    """Topic, kind and content of messages that cannot be read, and words of the refusal."""
    names, count = list(Robot.named("panda").joint_names), 7
    place = BEGIN.tolist()

    def chunk(joints: list[str], *positions: list[float]) -> JointTrajectory:
        return JointTrajectory(joint_names=joints, points=[JointTrajectoryPoint(positions=one) for one in positions])

    with_efforts = chunk(names, place)
    with_efforts.points[0].effort = count * [0.0]
    of_trajectories = [
        (chunk(names), "has no points"),
        (chunk([], place), "lacks joints panda_joint1"),
        (chunk([*names[:-1], "nose"], place), "lacks joints panda_joint7"),
        (chunk([*names, "nose"], [*place, 0.0]), "has unknown joints nose"),
        (chunk([*names, names[0]], [*place, 0.0]), "names a joint twice"),
        (chunk(names, place, place[:3]), "has 3 positions at point 1"),
        (chunk(names, []), "has no positions"),
        (with_efforts, "has efforts"),
    ]
    of_targets = [
        (JointState(name=names[:3], position=place[:3]), "lacks panda_joint4"),
        (JointState(name=names, position=place[:3]), "has 7 names and 3 positions"),
        (JointState(name=[*names, names[0]], position=[*place, 0.0]), "names a joint twice"),
        (JointState(name=names, position=[*place[:6], float("nan")]), "joint panda_joint7"),
        (JointState(name=names), "and no positions"),
    ]
    return [
        *(("joint_trajectory", JointTrajectory, message, words) for message, words in of_trajectories),
        *(("joint_target", JointState, message, words) for message, words in of_targets),
    ]


def test_a_message_that_cannot_be_read_is_refused_by_its_topic_and_counted(arm: Bench) -> None:
    counts = {"joint_trajectory": 0, "joint_target": 0}
    for topic, kind, message, words in refused_messages():
        counts[topic] += 1
        arm.publisher(kind, f"filter/{topic}").publish(message)

        def is_counted(topic: str = topic) -> bool:
            return status(arm).get(f"refused_~/{topic}") == str(counts[topic])

        arm.wait(is_counted, f"the refusal of {topic}: {words}")
        assert status(arm)["goal_code"] == "BAD_INPUT"
        assert status(arm)["goal_reason"].startswith(f"~/{topic}: ")
        assert words in status(arm)["goal_reason"]
    assert is_at(arm, BEGIN)


def test_messages_full_of_nonsense_are_answered_each_and_a_trajectory_is_played_after_them(arm: Bench) -> None:
    arm.listen_to_log()
    fuzzer = Fuzzer(np.random.default_rng(0))
    for number in range(1, 101):
        topic = list(OFFERS)[number % 2]
        message = OFFERS[topic](fuzzer)
        arm.publisher(type(message), f"filter/{topic}").publish(message)
        arm.wait(lambda number=number: status(arm)["goal_number"] == str(number), f"an answer to message {number}")
        assert status(arm)["goal_code"] in ("OK", "BAD_INPUT")
        assert status(arm)["goal_reason"]
    assert not arm.logged("internal error")
    begin = measured(arm)
    send(arm, begin, begin + 0.1)
    arm.wait(lambda: is_at(arm, begin + 0.1), "the end of the trajectory")


def test_it_stops_before_what_stands_on_the_path_and_goes_on_when_that_is_removed(arm: Bench) -> None:
    place, _ = Robot.named("panda").forward(0.5 * (BEGIN + END))
    sent = arm.repeat(0.1, lambda: arm.send_spheres((place.tolist(), 0.05)))
    arm.send_spheres((place.tolist(), 0.05))
    send(arm, BEGIN, END)
    arm.wait(lambda: status(arm)["code"] == "NO_FEASIBLE_PATH" and status(arm)["mode"] == "waiting", "a stop")
    assert np.max(np.abs(measured(arm) - END)) > 0.1
    sent.cancel()
    arm.repeat(0.1, arm.delete_spheres)
    arm.wait(lambda: is_at(arm, END), "the end of the trajectory")


def test_it_brakes_before_it_ends(bench: Bench, arm: Bench) -> None:
    (node,) = (node for node in bench._nodes if isinstance(node, FilterNode))
    send(arm, BEGIN, END)
    arm.wait(lambda: float(status(arm)["speed"]) > 0.05, "an arm in motion")
    assert not node.is_at_rest
    node.brake()
    arm.wait(lambda: node.is_at_rest, "an arm that rests")
    assert status(arm)["reason"] == "the filter ends"
    assert np.max(np.abs(measured(arm) - END)) > 0.05  # the control: on its path


def test_it_follows_targets_that_stream(arm: Bench) -> None:
    publisher = arm.publisher(JointState, "filter/joint_target")
    names, passed = list(Robot.named("panda").joint_names), 0.0

    def move_on() -> None:
        nonlocal passed
        passed = min(1.0, passed + 0.01)
        publisher.publish(JointState(name=names, position=(BEGIN + passed * (END - BEGIN)).tolist()))

    arm.repeat(0.02, move_on)
    arm.wait(lambda: is_at(arm, END), "the last target")


def test_it_takes_parameters_while_it_runs(arm: Bench) -> None:
    wanted = [Parameter("speed_override", value=0.5), Parameter("detour", value=0.1)]
    request = SetParametersAtomically.Request(parameters=[one.to_parameter_msg() for one in wanted])
    result = arm.call(SetParametersAtomically, "filter/set_parameters_atomically", request).result
    assert result.successful, result.reason
    send(arm, BEGIN, END)
    arm.wait(lambda: is_at(arm, END) and status(arm)["speed_override"] == "0.5", "the end of the trajectory")
