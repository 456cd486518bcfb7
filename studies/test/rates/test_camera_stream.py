"""A camera that sees the arm: its pictures are true, and what planner and twin do with it is counted."""

from __future__ import annotations

import os

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from scipy.spatial.distance import cdist
from sensor_msgs.msg import JointState, PointCloud2

from geodesic_motion_ros.demo.demo_run import Processes, isolated_environment
from geodesic_motion_ros.geometry.quaternions import rotate
from geodesic_motion_ros.nodes.messages import joint_state_message, read_cloud, seconds
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.rates import camera_stream
from geodesic_motion_studies.rates.camera_process import FRAME, command
from geodesic_motion_studies.rates.depth_picture import BALL, NOISE, DepthPicture, camera
from geodesic_motion_studies.rates.planner_stream import Tick

ROBOT, MODEL = Robot.named("panda"), CollisionModel.named("panda")
POINTS = 5000
#: Beside the arm where it is ready, and seen.
PLACE = np.array([0.5, -0.4, 0.7])


def to_base(points: np.ndarray) -> np.ndarray:
    """From the camera's frame."""
    place, quaternion = camera(POINTS).pose
    return place + rotate(quaternion, points.astype(float))


def on_arm(points: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Which points (n, 3) [m] are no farther from the surface of the arm's spheres than noise."""
    off = cdist(points, MODEL.positions(ROBOT, joints[None])[0]) - MODEL.radii
    return np.abs(off.min(axis=1)) < 6.0 * NOISE


def test_a_picture_shows_what_is_in_front_row_by_row():
    picture = DepthPicture(ROBOT, MODEL, POINTS, PLACE)
    seen = picture.take(ROBOT.ready)
    assert POINTS <= len(seen.points) < 1.02 * POINTS
    settings = camera(POINTS)
    slopes = (seen.points / seen.points[:, 2:])[:, :2].reshape(settings.height, settings.width, 2)
    assert np.all(np.diff(slopes[..., 0], axis=1) > 0.0)
    assert np.all(np.diff(slopes[..., 1], axis=0) > 0.0)

    points = to_base(seen.points)
    of_ball = np.abs(np.linalg.norm(points - PLACE, axis=1) - BALL) < 6.0 * NOISE
    assert of_ball.sum() == seen.of_ball > 5
    arm = on_arm(points, ROBOT.ready)
    # What stands is as near to the base in a few places.
    assert 0 <= arm.sum() - seen.of_arm < 20
    assert 0.1 < seen.of_arm / len(points) < 0.4
    others = points[~arm & ~of_ball]
    assert np.all(np.min(np.abs(others - [-0.6, 0.9, -0.05]), axis=1) < 6.0 * NOISE)
    # The noise of the next one is another one.
    assert not np.array_equal(seen.points.copy(), picture.take(ROBOT.ready).points)
    assert DepthPicture(ROBOT, MODEL, POINTS, None).take(ROBOT.ready).of_ball == 0


def test_balls_stand_three_centimetres_before_the_forearm():
    skill = Skill.load(camera_stream.SKILL)
    places = camera_stream.ball_places(skill, 4, POINTS, seed=1)
    forearm = np.isin(MODEL.points.names, camera_stream.FOREARM)
    arm = camera_stream.ReactivePlanner(skill)
    motion = arm.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3])).reference
    gaps = [
        np.min(cdist(places, centres[forearm]) - MODEL.radii[forearm] - BALL, axis=1)
        for centres in MODEL.positions(ROBOT, motion.positions)
    ]
    np.testing.assert_allclose(gaps[0], camera_stream.GAP, atol=2e-4)
    # It goes there, or nearer.
    assert np.min(gaps) < 0.0
    np.testing.assert_array_equal(camera_stream.ball_places(skill, 4, POINTS, seed=1), places)
    assert not np.array_equal(camera_stream.ball_places(skill, 4, POINTS, seed=2), places)


def ticks(times: np.ndarray, codes: dict[int, str] | None = None) -> list[Tick]:
    """Ticks at times [s], OK but for those of some numbers."""
    found = codes or {}
    return [Tick(time, n, 1.0, 0, found.get(n, "OK"), 0.0, "why") for n, time in enumerate(times.tolist())]


def test_the_least_rate_is_that_of_the_worst_ten_seconds():
    steady, slow = np.arange(0.0, 20.0, 0.01), np.arange(20.0, 25.0, 0.02)
    times = np.concatenate([steady, slow, np.arange(25.0, 40.0, 0.01)])
    assert camera_stream.least_rate(ticks(steady)) == pytest.approx(100.0, abs=0.2)
    assert camera_stream.least_rate(ticks(times)) == pytest.approx(75.0, abs=0.2)
    assert camera_stream.least_rate(ticks(slow)) == pytest.approx(50.0, abs=0.2)


def test_a_stop_is_false_but_while_a_goal_is_changed():
    """Ticks are a quarter of a second apart, and the goal is new at 10 s."""
    seen = ticks(np.arange(0.0, 30.0, 0.25), {40: "NO_GOAL", 41: "NO_GOAL", 44: "NO_GOAL", 80: "IN_COLLISION"})
    changing, false_stops = camera_stream.stops(seen, [9.9])
    assert changing == {"NO_GOAL: why": 2}
    assert false_stops == {"NO_GOAL: why": 1, "IN_COLLISION: why": 1}


def test_a_cloud_shows_the_arm_where_it_was_at_its_stamp(tmp_path):
    """The camera as a process, and joint states of an arm that turns at its base all the time."""
    domain = int(os.environ["ROS_DOMAIN_ID"])
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("arm", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    began = 1e-9 * node.get_clock().now().nanoseconds
    clouds: list[PointCloud2] = []
    states = node.create_publisher(JointState, "joint_states", 10)

    def joints(time: float) -> np.ndarray:
        return ROBOT.ready + 0.3 * np.sin(time - began) * np.eye(len(ROBOT.ready))[0]

    def send() -> None:
        now = node.get_clock().now()
        place = joints(1e-9 * now.nanoseconds)
        states.publish(joint_state_message(ROBOT.joint_names, place, np.zeros_like(place), now.to_msg()))

    node.create_timer(0.01, send)
    node.create_subscription(PointCloud2, "obstacle_cloud", clouds.append, rclpy.qos.qos_profile_sensor_data)
    try:
        with Processes(tmp_path, isolated_environment(domain)) as processes:
            processes.run("camera", command("panda", POINTS, None))
            while len(clouds) < 10:
                executor.spin_once(timeout_sec=0.1)
                processes.check()
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)
    for cloud in clouds:
        points, not_finite = read_cloud(cloud, FRAME)
        assert not_finite == 0
        there = seconds(cloud.header.stamp)
        share = np.mean(on_arm(to_base(points), joints(there)))
        assert share > 0.1
        # The control: a moment later it is elsewhere.
        assert np.mean(on_arm(to_base(points), joints(there) + 0.1 * np.eye(len(ROBOT.ready))[0])) < 0.9 * share


@pytest.mark.realtime
def test_some_seconds_are_counted(tmp_path):
    domain = int(os.environ["ROS_DOMAIN_ID"])
    row = camera_stream.measure_minutes(camera_stream.SKILL, tmp_path, 0.05, POINTS, 50.0, domain)
    assert row.motions + row.unfinished >= 1
    assert 0.0 < row.least_rate <= 1.2 * row.rate
    assert row.used > 0.0
    assert 0.0 < row.cloud_p50 <= row.cloud_p99
    assert row.points >= POINTS
    # The planner takes what is within the padding of the arm, too.
    assert row.of_arm > 0.1 * row.points
    assert row.dropped > 0.8 * row.of_arm
    assert all(share > 0.0 for share in row.processor.values())
    assert "false stops [ticks]" in camera_stream.minutes_table(row)


@pytest.mark.realtime
def test_a_ball_in_the_cloud_is_seen_and_its_gap_measured(tmp_path):
    domain = int(os.environ["ROS_DOMAIN_ID"])
    place = camera_stream.ball_places(Skill.load(camera_stream.SKILL), 1)
    seen, unseen = camera_stream.measure_balls(camera_stream.SKILL, tmp_path, place, 50_000, 50.0, domain)
    assert (seen.in_cloud, unseen.in_cloud) == (True, False)
    assert seen.start_gap == pytest.approx(camera_stream.GAP, abs=2e-3)
    assert seen.least_gap > 0.0
    assert unseen.least_gap < 0.0
    assert unseen.travelled > 1.0
    assert camera_stream.balls_table([seen, unseen]).count("yes") >= 1


@pytest.mark.parametrize("wrong", [{"minutes": 0.0}, {"minutes": 1.0, "points": 0}, {"minutes": 1.0, "rate": 0.0}])
def test_impossible_measurements_are_refused(tmp_path, wrong):
    with pytest.raises(ParameterError, match="must be positive"):
        camera_stream.measure_minutes(camera_stream.SKILL, tmp_path, **wrong)
