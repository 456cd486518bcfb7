"""The node `franka` and the planner drive a simulated FR3 over Franka's own protocol, by Franka's own library.

All are processes of their own. The arm enforces all of its reflexes, and lives in a time of its own, which waits for
who commands it: a busy machine is hardly a reason for one.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from geodesic_motion_ros.demo.demo_node import Demo
from geodesic_motion_ros.demo.demo_run import DemoError, Processes, isolated_environment
from geodesic_motion_ros.demo.server_probe import (
    FOLDER,
    ServerProbe,
    loopback_address,
    start_driver,
    start_planner,
    start_server,
)
from geodesic_motion_ros.hardware import fci_link
from geodesic_motion_ros.hardware.drive_state import DriveMode
from geodesic_motion_ros.hardware.drive_talk import Notice
from geodesic_motion_ros.hardware.fci_link import FciLink
from geodesic_motion_ros.nodes.messages import seconds
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.hardware.served_runs import start_network

REPOSITORY = Path(__file__).resolve().parents[3]
SKILL, SPEED = "fr3_reach_to_grasp", "1.0"
ROBOT = Robot.named("fr3")
#: The planner of the demo's scene; it is patient with a machine that is busy.
PLANNER = {
    "skill": SKILL, "scene": "table", "latency": 0.1, "tracking_tolerance_joint": 0.3, "latent_view_rate": 0.0,
}  # fmt: skip
#: The longest that anything is waited for [s], many times what it takes.
PATIENCE = 200.0
#: The simulated arm's servo holds it so near to what it is commanded [rad]; its velocities jitter while it stands.
NEAR = 0.02

pytestmark = pytest.mark.skipif(
    not (REPOSITORY / FOLDER / ".ready").exists(), reason="no simulated arm is installed: `make robot-server`"
)


class Bench:
    """A server, a driver, a probe of them, and on request a planner.

    speed : of the server. driver : "real" where the driver takes its time for real. stall : of a network between them
        [s]; None: there is none.
    """

    def __init__(
        self, folder: Path, stack: ExitStack, speed: str = SPEED, driver: str = SPEED, stall: float | None = None
    ) -> None:
        self._domain, self._address = int(os.environ["ROS_DOMAIN_ID"]), loopback_address()
        self.processes = stack.enter_context(Processes(folder, isolated_environment(self._domain)))
        self._stack, self._speed, self._driver, self._stall = stack, speed, driver, stall
        self.start_server()
        if stall is not None:
            start_network(self.processes, self._address, stall)
        self.start_driver()

    def start_server(self) -> None:
        start_server(self.processes, REPOSITORY / FOLDER, self._address, SKILL, self._speed)

    def start_driver(self) -> None:
        address = self._address if self._stall is None else loopback_address(network=True)
        start_driver(self.processes, address, self._driver)

    def probe(self, obstacle: Any = None) -> ServerProbe:
        skill, simulated = Skill.load(SKILL), self._driver != "real"
        probe = ServerProbe(self.processes, self._domain, skill, obstacle, print, simulated, PATIENCE)
        return self._stack.enter_context(probe)

    def plan(self, **parameters: Any) -> None:
        start_planner(self.processes, SPEED, PLANNER | parameters)

    def process_of_the_arm(self) -> int:
        """The number of the process that the driver has started."""
        driver = self.processes.number("franka")
        (child,) = Path(f"/proc/{driver}/task/{driver}/children").read_text().split()
        return int(child)

    def log(self) -> str:
        return self.processes.log("franka")


@pytest.fixture
def start_bench(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    with ExitStack() as stack:
        yield partial(Bench, tmp_path, stack)


@pytest.fixture
def bench(start_bench: Callable[..., Bench]) -> Bench:
    return start_bench()


def disarmed(probe: ServerProbe) -> None:
    probe.wait(lambda: probe.mode == "DISARMED" and probe.arming.service_is_ready(), "an arm that is not armed")


def armed(probe: ServerProbe) -> None:
    disarmed(probe)
    probe.arm_driver()
    probe.wait(lambda: probe.mode == "FOLLOWING", "an arm that follows")


def motion_message(start: np.ndarray, joint: int, angle: float, duration: float) -> JointTrajectory:
    """A trajectory of one quintic that turns one joint; it begins when it is received."""
    end = start + angle * np.eye(7)[joint]
    still = [0.0] * 7
    points = [
        JointTrajectoryPoint(
            positions=place.tolist(), velocities=still, accelerations=still,
            time_from_start=Duration(sec=int(at), nanosec=round(1e9 * (at % 1.0))),
        )
        for at, place in ((0.0, start), (duration, end))
    ]  # fmt: skip
    return JointTrajectory(joint_names=list(ROBOT.joint_names), points=points)


def until_sent(probe: ServerProbe, message: JointTrajectory, done: Callable[[], bool], what: str) -> None:
    """Send a trajectory once who receives it is there, and wait for what comes of it."""
    publisher = probe.node.create_publisher(JointTrajectory, "joint_trajectory", QoSProfile(depth=10))
    probe.wait(lambda: publisher.get_subscription_count() > 0, "the driver to hear trajectories")
    publisher.publish(message)
    probe.wait(done, what)
    probe.node.destroy_publisher(publisher)


@pytest.fixture(scope="module")
def scene() -> Any:
    """The demo's sphere."""
    return Demo(SKILL, "table", Path("out"), False, 1).scene


def test_the_goal_is_reached_without_a_reflex(bench: Bench) -> None:
    bench.plan()
    probe = bench.probe()
    recording = probe.run()
    assert np.isfinite(recording.arrived), recording.newest
    assert not probe.stops
    assert "refused" not in bench.log()
    times, commanded = np.array(probe.commanded_times), np.array(probe.commanded)[:, :7]
    # what was commanded between two messages never needed more than the arm's limits
    speeds = np.diff(commanded, axis=0) / np.diff(times)[:, None]
    assert np.all(np.abs(speeds) < ROBOT.velocity_limits)


def test_a_sphere_in_the_path_is_passed_by_the_elbow(bench: Bench, scene: Any) -> None:
    bench.plan(obstacle_point_radius=scene.obstacle.radius)
    probe = bench.probe(scene.obstacle)
    recording = probe.run()
    assert np.isfinite(recording.arrived), recording.newest
    assert not probe.stops
    assert recording.min_clearance > 0.0
    assert recording.contacts == 0


def test_without_avoidance_the_same_sphere_is_hit(bench: Bench, scene: Any) -> None:
    bench.plan(obstacle_point_radius=scene.obstacle.radius, avoidance=False)
    probe = bench.probe(scene.obstacle)
    recording = probe.run()
    assert np.isfinite(recording.arrived), recording.newest
    assert not probe.stops
    assert recording.min_clearance < 0.0


def test_an_arm_whose_planner_is_killed_rests_on_its_path(bench: Bench) -> None:
    bench.plan()
    probe = bench.probe()
    probe.prepare()
    probe.begin()
    probe.wait(lambda: probe.fastest() > 0.2, "the arm in motion")
    probe.wait(lambda: float(probe.values["commanded_speed_mrad_s"]) > 100.0, "the status to say how fast")
    bench.processes.end("planner", signal.SIGKILL)
    place = probe.drive[:7]
    probe.wait(probe.stands, "the arm at rest")
    probe.wait(lambda: float(probe.values["commanded_speed_mrad_s"]) == 0.0, "the status to say that it rests")
    assert np.abs(probe.drive[:7] - place).max() > 0.02
    assert probe.mode == "FOLLOWING"
    assert not probe.stops


def test_an_arm_whose_driver_is_killed_rests_and_its_motion_ends_in_order(bench: Bench) -> None:
    probe = bench.probe()
    armed(probe)
    start = probe.drive[:7]
    message = motion_message(start, 0, 0.5, 2.0)
    until_sent(probe, message, lambda: probe.fastest() > 0.2, "the arm in motion")
    orphan = bench.process_of_the_arm()
    bench.processes.end("franka", signal.SIGKILL)
    assert Path(f"/proc/{orphan}").exists()
    # a new driver finds the arm once the process of the old one is through
    probe.forget_driver()
    states = probe.states
    bench.start_driver()
    probe.wait(lambda: probe.mode and probe.states > states, "a new driver that hears the arm")
    probe.wait(lambda: probe.mode == "DISARMED" and probe.stands(), "an arm that stands, without a reflex")
    np.testing.assert_allclose(probe.arm[:7], start + 0.5 * np.eye(7)[0], atol=NEAR)
    assert not probe.stops


def test_an_arm_that_is_not_armed_does_not_move_and_says_what_to_do(bench: Bench) -> None:
    probe = bench.probe()
    disarmed(probe)
    probe.wait(lambda: probe.states > 0, "states")
    place = probe.arm[:7]
    message = motion_message(probe.drive[:7], 0, 0.3, 1.0)
    refused = "nothing is followed: the arm is not armed: call ~/arm with data: true"
    until_sent(probe, message, lambda: refused in bench.log(), "a refusal")
    until = probe.now() + 1.5
    probe.wait(lambda: probe.now() > until, "the time of the motion to pass")
    np.testing.assert_allclose(probe.arm[:7], place, atol=NEAR)
    assert probe.fastest() == 0.0
    # armed it follows the next one
    armed(probe)
    until_sent(probe, message, lambda: probe.fastest() > 0.2, "the arm in motion")
    probe.wait(probe.stands, "the arm at rest")
    # disarmed in motion it goes on to rest, and follows nothing then
    back = motion_message(probe.drive[:7], 0, -0.3, 1.0)
    until_sent(probe, back, lambda: probe.fastest() > 0.2, "the arm in motion")
    assert "goes on to rest" in probe.arm_driver(False)
    disarmed(probe)
    np.testing.assert_allclose(probe.arm[:7], place, atol=NEAR)
    assert not probe.stops


def test_a_trajectory_that_steps_is_refused_with_the_figure_and_the_arm_goes_on(bench: Bench) -> None:
    probe = bench.probe()
    armed(probe)
    start = probe.drive[:7]
    until_sent(probe, motion_message(start, 0, 0.5, 2.0), lambda: probe.fastest() > 0.2, "the arm in motion")
    # it begins where the arm stood: by now that is a step
    refused = "does not continue what is commanded: within a millisecond fr3_joint1 would have a"
    until_sent(probe, motion_message(start, 0, -0.5, 2.0), lambda: refused in bench.log(), "a refusal")
    probe.wait(probe.stands, "the arm at rest")
    np.testing.assert_allclose(probe.drive[:7], start + 0.5 * np.eye(7)[0], atol=1e-12)
    assert probe.mode == "FOLLOWING"
    assert not probe.stops


def test_a_reflex_is_named_and_nothing_moves_before_an_operator_recovers_and_arms(bench: Bench) -> None:
    probe = bench.probe()
    armed(probe)
    message = motion_message(probe.drive[:7], 0, 0.5, 2.0)
    until_sent(probe, message, lambda: probe.fastest() > 0.2, "the arm in motion")
    # who commands it falls silent for more than 20 milliseconds of the arm's time
    process = bench.process_of_the_arm()
    os.kill(process, signal.SIGSTOP)
    reflex = "communication_constraints_violation"
    probe.wait(lambda: reflex in bench.processes.log("robot_server"), "the arm's own reflex")
    os.kill(process, signal.SIGCONT)
    probe.wait(lambda: probe.mode == "REFLEX", "the reflex to be heard")
    probe.wait(lambda: reflex in probe.said and "20 commands in a row" in probe.said, "its name in plain words")
    assert "~/recover" in probe.said
    with pytest.raises(DemoError, match=reflex):
        probe.arm_driver()
    probe.recover()
    disarmed(probe)
    message = motion_message(probe.drive[:7], 0, 0.2, 1.0)
    until_sent(probe, message, lambda: "the arm is not armed" in bench.log(), "a refusal")
    armed(probe)
    until_sent(
        probe, motion_message(probe.drive[:7], 0, 0.2, 1.0), lambda: probe.fastest() > 0.1, "the arm in motion again"
    )
    probe.wait(probe.stands, "the arm at rest")


def test_a_lost_connection_is_found_again_and_needs_an_operator(bench: Bench) -> None:
    probe = bench.probe()
    armed(probe)
    bench.processes.end("robot_server", signal.SIGKILL)
    probe.wait(lambda: probe.mode == "CONNECTING", "the driver to notice")
    with pytest.raises(DemoError, match="no connection to the arm"):
        probe.arm_driver()
    bench.start_server()
    armed(probe)
    until_sent(
        probe, motion_message(probe.drive[:7], 0, 0.2, 1.0), lambda: probe.fastest() > 0.1, "the arm in motion again"
    )
    probe.wait(probe.stands, "the arm at rest")
    assert "no connection to the arm" in bench.log()


def test_a_network_that_stalls_longer_than_a_connection_lives_ends_the_motion_for_good(
    start_bench: Callable[..., Bench],
) -> None:
    bench = start_bench(stall=2.0)
    probe = bench.probe()
    armed(probe)
    start = probe.drive[:7]
    until_sent(probe, motion_message(start, 0, 0.5, 2.0), lambda: probe.fastest() > 0.2, "the arm in motion")
    bench.processes.send("network", signal.SIGUSR1)
    probe.wait(lambda: probe.mode == "CONNECTING", "the driver to notice")
    disarmed(probe)
    assert "held " in bench.processes.log("network")
    probe.wait(probe.stands, "the arm at rest")
    (stop,) = probe.stops
    assert "no connection to the arm" in stop
    # what came late moves nothing
    place, until = probe.arm[:7], probe.now() + 2.0
    assert np.abs(place - start).max() > NEAR
    probe.wait(lambda: probe.now() > until, "the time of the motion to pass")
    np.testing.assert_allclose(probe.arm[:7], place, atol=NEAR)


def test_an_arm_that_is_armed_in_the_middle_of_a_motion_stands_until_another_one_and_says_why(bench: Bench) -> None:
    probe = bench.probe()
    armed(probe)
    start = probe.drive[:7]
    underway = motion_message(start, 0, 0.5, 2.0)
    underway.header.stamp = Time(nanoseconds=round(1e9 * (probe.now() - 1.0))).to_msg()
    refused = "the motion began before the arm was armed"
    until_sent(probe, underway, lambda: refused in bench.log(), "a refusal")
    assert probe.fastest() == 0.0
    until_sent(probe, motion_message(start, 0, -0.3, 1.0), lambda: probe.fastest() > 0.1, "the arm in motion")
    probe.wait(probe.stands, "the arm at rest")
    assert not probe.stops


def test_an_arm_that_is_slower_than_its_driver_s_clock_is_named(start_bench: Callable[..., Bench]) -> None:
    probe = start_bench(speed="0.5", driver="real").probe()
    armed(probe)
    probe.wait(lambda: "its stamps are" in probe.said and "clock_from_robot" in probe.said, "the status to say so")


def test_the_time_of_a_simulated_arm_runs_on_when_it_stops_following(bench: Bench) -> None:
    probe = bench.probe()
    armed(probe)
    stamps: list[float] = []
    probe.node.create_subscription(
        JointState, "joint_states", lambda message: stamps.append(seconds(message.header.stamp)), QoSProfile(depth=50)
    )
    probe.wait(lambda: stamps, "states")
    message = motion_message(probe.drive[:7], 0, 0.5, 2.0)
    until_sent(probe, message, lambda: probe.fastest() > 0.2, "the arm in motion")
    probe.wait(probe.stands, "the arm at rest")
    followed = stamps[-1] - stamps[0]
    assert followed > 1.0
    probe.arm_driver(False)
    disarmed(probe)
    until = len(stamps) + 50
    probe.wait(lambda: len(stamps) > until, "states of the arm that is not armed")
    steps = np.diff(stamps)
    assert np.all(steps >= 0.0)
    assert steps.max() < 0.5 * followed


def test_a_driver_that_is_to_end_does_not_say_that_it_will_try_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fci_link, "_REST", PATIENCE)
    heard: list[Notice] = []
    # nobody is there, and the process hears that it is to end before it has noticed
    link = FciLink(loopback_address(), "fr3", True, 0, heard.append, print)
    link.start()
    link.stop()
    assert link.state().mode is DriveMode.ENDED
    assert not heard
