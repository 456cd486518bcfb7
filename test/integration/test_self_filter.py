"""A camera that sees the arm: planner and twin over DDS, and clouds of what is where at the time of their stamps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from bench import BASE, Bench
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.time import Time
from scipy.spatial.distance import cdist
from sensor_msgs.msg import JointState, PointCloud2

from geodesic_motion_ros.nodes.messages import cloud_message, seconds
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

ROBOT, SPHERES = Robot.named("panda"), CollisionModel.named("panda")
#: Of a depth camera: noise [m], and how late its clouds are [s].
NOISE, DELAY = 0.003, 0.06
FOREARM = ("panda_link3", "panda_link4", "panda_link5")
NOTHING = np.zeros((0, 3))
REACH = "panda_reach_to_grasp"


def ball(centre: list[float], radius: float = 0.03) -> np.ndarray:
    """Points (400, 3) [m] on a ball."""
    directions = np.random.default_rng(1).normal(size=(400, 3))
    return np.array(centre) + radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.fixture
def options(skill_folder):
    """A planner for a busy machine."""
    return {
        "skill": str(skill_folder),
        "state_timeout": 5.0,
        "resume_timeout": 60.0,
        "obstacle_timeout": 30.0,
        "tracking_tolerance_joint": 0.3,
        "latency": 0.1,
        "latent_view_rate": 0.0,
        "required_obstacle_topics": ["obstacle_cloud"],
        "obstacle_cloud_radius": 0.005,
    }


class Camera:
    """Sees the twin's arm and what stands beside it, and says so thirty times a second, late as cameras are.

    Attributes
    ----------
    moving : points (m, 3) [m] at a time [s] of what moves.
    """

    def __init__(self, bench: Bench, others: np.ndarray, seen: bool = True) -> None:
        """others : (n, 3) [m] points of what stands beside the arm, in its clouds where it is seen."""
        self._bench, self._others, self._shown = bench, others, others if seen else NOTHING
        self._random = np.random.default_rng(0)
        directions = self._random.normal(size=(len(SPHERES), 60, 3))
        self._surface = SPHERES.radii[:, None, None] * directions / np.linalg.norm(directions, axis=2, keepdims=True)
        self.moving: Callable[[float], np.ndarray] = lambda time: NOTHING
        self._times: list[float] = []
        self._joints: list[np.ndarray] = []
        bench.probe.create_subscription(JointState, "joint_states", self._hear, 10)
        self._publisher = bench.publisher(PointCloud2, "obstacle_cloud")
        bench.repeat(1.0 / 30.0, self._send)

    def _hear(self, message: JointState) -> None:
        self._times.append(seconds(message.header.stamp))
        self._joints.append(np.array(message.position))

    def _send(self) -> None:
        time = self._bench.now() - DELAY
        if not self._times or not self._times[0] <= time <= self._times[-1]:
            return
        joints = np.array([np.interp(time, self._times, column) for column in np.transpose(self._joints)])
        centres = SPHERES.positions(ROBOT, joints[None])[0]
        arm = (centres[:, None] + self._surface).reshape(-1, 3)
        arm += self._random.normal(0.0, NOISE, arm.shape)
        stamp = Time(nanoseconds=round(1e9 * time)).to_msg()
        self._publisher.publish(cloud_message(np.concatenate([arm, self._shown, self.moving(time)]), BASE, stamp))

    @property
    def gaps(self) -> np.ndarray:
        """How far the forearm was from what stands beside it (t,) [m]."""
        if not self._joints:
            return np.zeros(0)
        forearm = np.array([name in FOREARM for name in SPHERES.points.names])
        centres = SPHERES.positions(ROBOT, np.array(self._joints))[:, forearm].reshape(-1, 3)
        away = cdist(centres, self._others).min(axis=1).reshape(-1, forearm.sum())
        return (away - SPHERES.radii[forearm]).min(axis=1)

    @property
    def travelled(self) -> float:
        """By how much a joint has moved at most [rad]."""
        return float(np.max(np.ptp(self._joints, axis=0)))


@pytest.mark.parametrize("on", [True, False], ids=["on", "control: off"])
def test_an_arm_in_the_cloud_does_not_stop_itself(bench, options, skill, start_joints, on):
    bench.watch_planner()
    bench.listen(DiagnosticArray, "/diagnostics")
    bench.add(TwinNode, initial_joint_positions=start_joints.tolist())
    planner = bench.add(PlannerNode, **options, self_filter=on)
    # A cloud of the time before the planner knows joint states would be refused.
    bench.wait(lambda: planner.inputs.arm.joints is not None, "joint states")
    camera = Camera(bench, NOTHING)
    bench.wait_for_code("NO_GOAL")
    bench.send_goal(skill.goal_pose)
    if not on:
        bench.wait_for_code("IN_COLLISION", "obstacle_cloud")
        return
    bench.wait_for_code("OK")
    bench.wait(bench.at_goal, "the arm at its goal")
    assert camera.travelled > 0.3
    codes = [message.status[0].message.split()[0] for message in bench.heard["planner/status"]]
    after = codes[codes.index("OK") :]
    assert {code.rstrip(":") for code in after} == {"OK"}
    figures = planner.inputs.obstacles.clouds.figures
    assert (figures.of_arm, figures.points) == (60 * len(SPHERES), 0)
    assert planner.inputs.refusals.counts == {}
    bench.wait(lambda: bench.health().get("cloud_points_of_arm") == str(figures.of_arm), "the figures of the cloud")


def reach(
    bench: Bench, options: dict[str, object], others: np.ndarray, seen: bool = True, **parameters: object
) -> Camera:
    """Send the arm of a shipped skill to its goal, past what stands there."""
    bench.watch_planner()
    bench.add(TwinNode, skill=REACH)
    bench.add(PlannerNode, **options | {"skill": REACH} | parameters)
    camera = Camera(bench, others, seen)
    bench.wait_for_code("NO_GOAL")
    bench.send_goal(Skill.load(REACH).goal_pose)
    return camera


@pytest.mark.parametrize("seen", [True, False], ids=["seen", "control: not in the cloud"])
def test_a_ball_two_centimetres_in_the_path_of_the_forearm_is_avoided(bench, options, seen):
    camera = reach(bench, options, ball([0.315, 0.148, 0.318], 0.05), seen)
    bench.wait_for_code("OK")
    bench.wait(bench.at_goal, "the arm at its goal")
    assert camera.travelled > 1.0
    assert bool(np.min(camera.gaps) > options["obstacle_cloud_radius"]) is seen


def test_a_ball_that_moves_is_known_with_its_velocity_and_what_stands_stands(bench, options):
    """In a cloud a ball circles beside a wall; the planner knows where it is now, however late the cloud is."""
    bench.watch_planner()
    bench.add(TwinNode, skill=REACH)
    planner = bench.add(PlannerNode, **options | {"skill": REACH})
    # No coarser than half of a cube: what is coarser falls apart.
    sides = np.meshgrid(0.3, np.linspace(-0.6, 0.6, 121), np.linspace(0.8, 1.2, 41))
    wall = np.stack(sides, axis=-1).reshape(-1, 3)
    radius, speed = 0.2, 0.1

    def place(time: float) -> np.ndarray:
        turned = speed / radius * time
        return np.array([0.6, -0.6, 0.3]) + radius * np.array([np.cos(turned), np.sin(turned), 0.0])

    def velocity(time: float) -> np.ndarray:
        turned = speed / radius * time
        return speed * np.array([-np.sin(turned), np.cos(turned), 0.0])

    camera = Camera(bench, NOTHING)
    camera.moving = lambda time: np.concatenate([ball(place(time), 0.05), wall])
    bench.wait_for_code("NO_GOAL")

    def known() -> bool:
        snapshot = planner.inputs.snapshot()
        velocities = snapshot.obstacles.velocities
        return len(velocities) > 0 and bool(np.min(np.linalg.norm(velocities - velocity(bench.now()), axis=1)) < 0.03)

    bench.wait(known, "the ball's velocity")
    snapshot, now = planner.inputs.snapshot(), bench.now()
    there = snapshot.obstacles.moved_on(snapshot.heard, 1.0, 0.0)
    # Both clocks are read one after the other, on a busy machine.
    assert np.min(np.linalg.norm(there.centres - place(now), axis=1)) < 0.05
    assert len(snapshot.obstacles.cloud.occupied) > 500
    # Where the first cloud showed it, it is remembered for a moment.
    bench.wait(lambda: planner.inputs.obstacles.clouds.figures.clusters == 1, "the ball alone")


@pytest.mark.parametrize("padding", [0.02, 0.15], ids=["seen", "control: within the padding"])
def test_a_ball_three_centimetres_before_the_forearm_is_seen_and_not_hit(bench, options, padding):
    """It is not in the ball, but the ball is on all of its paths."""
    camera = reach(bench, options, ball([0.5916, -0.1446, 0.4588]), self_filter_padding=padding)
    if padding > 0.03:
        bench.wait(lambda: len(camera.gaps) and np.min(camera.gaps) < 0.0, "the forearm in the ball")
        return
    bench.wait_for_code("NO_FEASIBLE_PATH")
    bench.live(3.0)
    assert bench.status()["code"] in ("NO_FEASIBLE_PATH", "DEADLINE_MISSED")
    np.testing.assert_allclose(camera.gaps, 0.03, atol=0.001)
