"""Clouds that show the arm, at times of the test's own."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.nodes.cloud_thread import CloudFigures
from geodesic_motion_ros.nodes.messages import cloud_message, joint_state_message
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from test.nodes.inputs_bench import BASE, PATIENCE, Bench

SPHERES = CollisionModel.named("panda")


class Camera:
    """A camera that sees an arm in motion, whose joint states come a hundred times a second."""

    def __init__(self, bench: Bench) -> None:
        self.bench, self.robot = bench, Robot.named("panda")

    def joints(self, late: float = 0.0) -> np.ndarray:
        """Where the arm was so long ago [s]: (7,) [rad], at half a radian a second."""
        return self.robot.ready + 0.5 * np.sin(self.bench.true_time - late) * np.array([1.0, 0, 0, 0, 0, 0, 1.0])

    def tell_joints(self) -> None:
        stamp = self.bench.header().stamp
        message = joint_state_message(self.robot.joint_names, self.joints(), np.zeros(7), stamp)
        self.bench.inputs.on_joint_states(serialize_message(message))
        self.bench.inputs.snapshot()

    def move(self, duration: float) -> None:
        """Let time pass in which joint states come [s]."""
        for _ in range(round(100 * duration)):
            self.bench.go(0.01)
            self.tell_joints()

    def arm(self, late: float = 0.0, off: float = 0.0) -> np.ndarray:
        """Fifty points on each of its spheres, so long ago [s]; or one, so far off all of them [m]."""
        centres = SPHERES.positions(self.robot, self.joints(late)[None])[0]
        directions = np.random.default_rng(0).normal(size=(50, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        points = (centres[:, None] + (SPHERES.radii[:, None, None] + off) * directions).reshape(-1, 3)
        if not off:
            return points
        gaps = np.min(np.linalg.norm(points[:, None] - centres, axis=2) - SPHERES.radii, axis=1)
        return points[gaps > off - 1e-9][:1]

    def send(self, points: np.ndarray, late: float = 0.0) -> None:
        self.bench.changed.clear()
        self.bench.inputs.obstacles.clouds.on_cloud(cloud_message(points, BASE, self.bench.header(late).stamp))

    def figures(self) -> CloudFigures:
        """Of the newest cloud, once it is taken."""
        assert self.bench.changed.wait(PATIENCE)
        return self.bench.inputs.obstacles.clouds.figures

    def show(self, points: np.ndarray, late: float = 0.0) -> CloudFigures:
        self.send(points, late)
        return self.figures()

    def refused(self) -> str:
        """Why the newest cloud is of no use."""
        assert self.bench.changed.wait(PATIENCE)
        return self.bench.inputs.refusals.newest(PATIENCE)

    def middles(self) -> int:
        """How many cubes are occupied."""
        return len(self.bench.inputs.snapshot().obstacles.cloud.occupied)


class TestSelfFilter:
    """Clouds that show the arm, at a time at which it was measured or not."""

    @pytest.fixture
    def camera(self, bench) -> Iterator[Camera]:
        bench.inputs.start()
        yield Camera(bench)
        bench.inputs.stop()

    def test_the_arm_is_taken_out_where_it_was_at_the_stamp_of_the_cloud(self, camera):
        camera.move(1.0)
        figures = camera.show(camera.arm(late=0.3), late=0.3)
        assert (figures.points, figures.of_arm, figures.remembered) == (0, 54 * 50, 0)
        assert camera.middles() == 0
        # Seen 0.3 s later the same points are where the arm was, and it has moved on.
        assert camera.show(camera.arm(late=0.3), late=0.0).points > 0

    def test_without_the_filter_it_is_an_obstacle(self, camera):
        camera.bench.parameters["self_filter"] = False
        assert camera.show(camera.arm(), late=0.0).points == 54 * 50

    def test_what_is_near_the_arm_is_kept_beyond_the_padding_and_the_tracking_error(self, camera):
        camera.move(0.1)
        assert camera.show(camera.arm(off=0.022)).of_arm == 0
        camera.bench.inputs.obstacles.clouds.tracking_error = 0.003
        camera.bench.inputs.obstacles.clear()  # what came within the padding would stay for a moment
        assert camera.show(camera.arm(off=0.022)).points == 0
        camera.bench.parameters["self_filter_padding"] = 0.01
        assert camera.show(camera.arm(off=0.022)).of_arm == 0

    def test_a_cloud_newer_than_the_arm_waits_for_the_next_joint_state(self, camera):
        camera.move(0.1)
        camera.bench.go(0.004)
        shown = camera.arm()
        camera.send(shown)
        assert not camera.bench.changed.wait(0.05)
        camera.bench.go(0.006)
        camera.tell_joints()
        assert camera.figures().of_arm == len(shown)

    def test_a_cloud_that_no_joint_state_follows_is_not_used(self, camera):
        camera.move(0.1)
        camera.bench.go(0.004)
        camera.send(camera.arm())
        assert not camera.bench.changed.wait(0.05)
        camera.bench.go(camera.bench.parameters["state_timeout"] + 0.01)
        assert "the newest joint state is 4 ms older" in camera.refused()
        # The next one that can be used ends that.
        camera.move(0.1)
        camera.show(camera.arm())
        assert camera.bench.inputs.snapshot().unusable_sources == {}

    @pytest.mark.parametrize(
        ("moved", "late", "why"),
        [
            (0.0, 0.0, "there is no joint state yet"),
            (0.1, 0.3, "the oldest joint state that is known is 210 ms newer"),
            (8.0, 7.0, "the oldest joint state that is known is 2000 ms newer"),
        ],
    )
    def test_a_cloud_of_a_time_at_which_the_arm_is_not_known_is_not_used(self, camera, moved, late, why):
        camera.move(moved)
        camera.send(camera.arm(), late)
        camera.bench.go(camera.bench.parameters["state_timeout"] + 0.01)
        reason = camera.refused()
        assert why in reason
        assert "set self_filter to false where no cloud shows the arm" in reason

    def test_a_pause_of_the_joint_states_is_not_interpolated(self, camera):
        camera.move(0.1)
        camera.bench.go(0.3)
        camera.tell_joints()
        camera.send(camera.arm(late=0.1), late=0.1)
        assert "the joint states around it are 300 ms apart" in camera.refused()

    def test_what_the_hand_holds_is_taken_out_too(self, camera):
        camera.move(0.1)
        ball = HeldObject("ball/1", "sphere", (0.1,), (0.0, 0.0, 0.15))
        centre = SPHERES.holding(camera.robot, [ball]).positions(camera.robot, camera.joints()[None])[0, -1]
        points = centre + 0.05 * np.eye(3)
        assert camera.show(points).points == 3
        marker = Marker(header=Header(frame_id="panda_grasptarget"), ns="ball", id=1, type=Marker.SPHERE)
        marker.scale.x = marker.scale.y = marker.scale.z = 0.2
        marker.pose.position.z = 0.15
        camera.bench.inputs.obstacles.receive_held(serialize_message(MarkerArray(markers=[marker])))
        assert (camera.show(points).points, camera.figures().of_arm) == (0, 3)

    def test_what_came_to_the_arm_is_remembered_until_all_is_cleared_or_a_moment_has_passed(self, camera):
        def come() -> None:
            camera.tell_joints()
            camera.show(camera.arm(off=0.022)[:1])
            camera.bench.go(0.03)
            camera.tell_joints()

        come()
        figures = camera.show(camera.arm(off=0.01)[:1])
        assert (figures.points, figures.of_arm, figures.remembered) == (0, 1, 1)
        assert camera.middles() == 1
        camera.bench.inputs.obstacles.clear()
        assert camera.middles() == 0
        assert camera.show(camera.arm(off=0.01)[:1]).remembered == 0
        come()
        camera.bench.go(MOMENT)
        camera.tell_joints()
        assert camera.show(camera.arm(off=0.01)[:1]).remembered == 0
        assert camera.middles() == 0
