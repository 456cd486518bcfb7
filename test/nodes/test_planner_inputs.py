"""What the planner knows of obstacles by the stamps of their messages, at times of the test's own."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.nodes.cloud_thread import CloudFigures
from geodesic_motion_ros.nodes.messages import cloud_message, joint_state_message
from geodesic_motion_ros.nodes.node_time import NodeTime
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.planner_inputs import PlannerInputs
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot

#: [m/s], [s].
SPEED, PATIENCE = 0.5, 10.0
BASE = "panda_link0"
UNHEARD = "nothing has been received yet (required_obstacle_topics)"
PARAMETERS = {parameter.name: parameter.default for parameter in PLANNER}


class Bench:
    """Inputs of a planner, and the clocks they look at: `go` lets time pass, `jump` sets the ROS clock [s]."""

    def __init__(self, node: Any, **parameters: Any) -> None:
        self.ros, self.steady = 1_000_000_000_000, 5_000_000_000
        self.ros_time_is_active = False
        self.changed = threading.Event()
        self.parameters = PARAMETERS | parameters
        robot = Robot.named("panda")
        self.inputs = PlannerInputs(node, self.parameters, robot, "panda", self.changed.set)
        self.inputs.time = NodeTime(self, lambda: self.steady)

    def now(self) -> Any:
        return SimpleNamespace(nanoseconds=self.ros)

    def go(self, seconds: float) -> None:
        self.ros += round(1e9 * seconds)
        self.steady += round(1e9 * seconds)

    def jump(self, seconds: float) -> None:
        self.ros += round(1e9 * seconds)

    def header(self, late: float | None = 0.0) -> Header:
        """late : how long ago its stamp is [s]; None: stamp 0."""
        at = 0 if late is None else self.ros - round(1e9 * late)
        return Header(frame_id=BASE, stamp=Time(sec=at // 10**9, nanosec=at % 10**9))

    def sphere(self, x: float = 0.5, late: float | None = 0.0, **fields: Any) -> Marker:
        marker = Marker(header=self.header(late), type=Marker.SPHERE, **fields)
        marker.pose.position.x = x
        marker.scale.x = marker.scale.y = marker.scale.z = 0.1
        return marker

    def tell(self, *markers: Marker) -> None:
        self.inputs.on_obstacles(serialize_message(MarkerArray(markers=list(markers))))

    def move(self, late: float | None, duration: float = 1.0, delay: float | None = None) -> None:
        """Tell of a sphere along x, where it was `delay` ago, sixty times a second.

        late : as of `header`.
        """
        for _ in range(round(60 * duration)):
            self.go(1.0 / 60.0)
            self.tell(self.sphere(SPEED * (self.true_time - ((late or 0.0) if delay is None else delay)), late))

    @property
    def true_time(self) -> float:
        return 1e-9 * self.steady

    def place_now(self) -> float:
        """Where along x the first sphere is expected now [m]."""
        snapshot = self.inputs.snapshot()
        return float(snapshot.obstacles.moved_on(snapshot.heard, 1.6, 0.0).centres[0, 0])


@pytest.fixture
def node() -> Iterator[Any]:
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("listener", context=context)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.fixture
def bench(node) -> Bench:
    return Bench(node)


def cloud(header: Header) -> PointCloud2:
    """Of one point, the origin."""
    return cloud_message(np.zeros((1, 3)), header.frame_id, header.stamp)


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
        self.bench.inputs.on_cloud(cloud_message(points, BASE, self.bench.header(late).stamp))

    def figures(self) -> CloudFigures:
        """Of the newest cloud, once it is taken."""
        assert self.bench.changed.wait(PATIENCE)
        return self.bench.inputs.cloud_figures()

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


class TestLate:
    def test_what_moves_is_where_it_has_moved_since_its_stamp(self, bench):
        bench.move(late=0.4)
        np.testing.assert_allclose(bench.place_now(), SPEED * bench.true_time, atol=1e-6)
        np.testing.assert_allclose(bench.inputs.snapshot().obstacles.velocities, [[SPEED, 0.0, 0.0]], atol=1e-6)
        snapshot = bench.inputs.snapshot()
        assert not snapshot.silent_sources
        assert not snapshot.late_sources
        # a stop is kept free of all places since it was seen
        assert snapshot.obstacles.moved_on(snapshot.heard, 1.6, 0.0).ages == pytest.approx(0.4)

    def test_without_a_stamp_it_lags_behind(self, bench):
        bench.move(late=None, delay=0.4)
        np.testing.assert_allclose(bench.place_now(), SPEED * (bench.true_time - 0.4), atol=1e-6)

    def test_a_stamp_of_the_future_is_the_arrival(self, bench):
        bench.move(late=-5.0, delay=0.0)
        np.testing.assert_allclose(bench.place_now(), SPEED * bench.true_time, atol=1e-6)
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.0)

    def test_of_a_stamp_of_long_ago_nothing_is_foretold_and_the_topic_is_late(self, bench):
        bench.move(late=2.0)
        np.testing.assert_allclose(bench.place_now(), SPEED * (bench.true_time - 2.0), atol=1e-6)
        snapshot = bench.inputs.snapshot()
        assert snapshot.late_sources == {"obstacles": pytest.approx(2.0)}
        assert not snapshot.silent_sources
        assert bench.inputs.ages()["obstacles"] == pytest.approx(2.0)
        bench.move(late=0.0, duration=0.1)
        assert not bench.inputs.snapshot().late_sources
        # it falls silent by how long nothing has been heard
        bench.go(0.6)
        assert bench.inputs.snapshot().silent_sources == {"obstacles": pytest.approx(0.6)}
        assert not bench.inputs.snapshot().late_sources

    def test_the_keep_policy_keeps_late_obstacles_too(self, node):
        bench = Bench(node, obstacle_silence_policy="keep")
        bench.move(late=2.0)
        assert not bench.inputs.snapshot().late_sources
        assert len(bench.inputs.snapshot().obstacles) == 1

    @pytest.mark.parametrize("topic", ["obstacle_marker", "obstacle_point", "obstacle_cloud"])
    def test_every_topic_is_judged_by_its_stamps(self, bench, topic):
        inputs = bench.inputs
        if topic == "obstacle_marker":
            inputs.on_marker(serialize_message(bench.sphere(late=2.0)))
        elif topic == "obstacle_point":
            inputs.on_point(PointStamped(header=bench.header(2.0)))
        else:
            bench.parameters["self_filter"] = False  # which joint states of then would take
            inputs.start()
            inputs.on_cloud(cloud(bench.header(2.0)))
            assert bench.changed.wait(PATIENCE)
            inputs.stop()
        assert len(inputs.snapshot().obstacles) == 1
        assert inputs.snapshot().late_sources == {topic: pytest.approx(2.0)}
        bench.go(0.6)
        assert inputs.snapshot().silent_sources == {topic: pytest.approx(0.6)}

    @pytest.mark.parametrize("speed", [SPEED, 0.0])
    def test_of_two_who_share_a_topic_the_late_one_is_named_by_its_obstacles(self, bench, speed):
        for _ in range(30):
            bench.go(1.0 / 60.0)
            bench.tell(bench.sphere(speed * bench.true_time, 2.0, ns="late"))
            bench.tell(bench.sphere(ns="on time"))
        assert bench.inputs.snapshot().late_sources == {"obstacles/late/0": pytest.approx(2.0)}

    def test_what_has_no_stamp_is_as_old_as_what_stands_beside_it(self, bench):
        everything = Marker(action=Marker.DELETEALL, ns="other")
        bench.tell(everything, bench.sphere(late=2.0), bench.sphere(late=None, id=1))
        assert bench.inputs.snapshot().late_sources == {"obstacles": pytest.approx(2.0)}
        # with one newer marker in the message its topic is not late, but the other one is
        bench.tell(bench.sphere(late=2.0), bench.sphere(late=0.1, id=1))
        assert bench.inputs.snapshot().late_sources == {"obstacles//0": pytest.approx(2.0)}
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.1)

    def test_what_was_overtaken_makes_nothing_older(self, bench):
        bench.tell(bench.sphere(late=0.1))
        bench.tell(bench.sphere(late=0.4))
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.1)
        assert bench.inputs.refusals.counts["obstacles"] == 1

    def test_a_lifetime_counts_from_the_arrival(self, bench):
        marker = bench.sphere(late=2.0)
        marker.lifetime.sec = 1
        bench.tell(marker)
        bench.go(0.9)
        assert len(bench.inputs.snapshot().obstacles) == 1
        bench.go(0.2)
        assert len(bench.inputs.snapshot().obstacles) == 0

    def test_what_moved_and_is_not_published_again_may_stand_anywhere_since_its_stamp(self, bench):
        bench.move(late=0.4)
        bench.go(0.3)
        obstacles = bench.inputs.snapshot().obstacles
        standing = ~np.any(obstacles.velocities, axis=1)
        x = obstacles.centres[standing, 0]
        # until it is looked at again, 50 ms later
        np.testing.assert_allclose([min(x), max(x)], SPEED * (bench.true_time - np.array([0.7, -0.05])), atol=1e-6)


def test_a_detector_that_labels_its_obstacles_is_heard(bench):
    label = bench.sphere(ns="labels")
    label.type, label.text, label.scale.x, label.scale.y = Marker.TEXT_VIEW_FACING, "cup", 0.0, 0.0
    bench.tell(Marker(action=Marker.DELETEALL), bench.sphere(), label)
    bench.inputs.on_marker(serialize_message(label))
    snapshot = bench.inputs.snapshot()
    assert len(snapshot.obstacles) == 1
    assert (bench.inputs.refusals.counts, snapshot.unusable_sources) == ({}, {})


class TestClock:
    @pytest.mark.parametrize("jump", [5.0, -5.0])
    def test_that_is_set_makes_nothing_old(self, bench, jump):
        bench.move(late=0.1)
        bench.jump(jump)
        assert not bench.inputs.snapshot().late_sources
        # its sender's clock is set as well
        bench.move(late=0.1)
        snapshot = bench.inputs.snapshot()
        assert not snapshot.late_sources
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.1)
        np.testing.assert_allclose(bench.place_now(), SPEED * bench.true_time, atol=1e-6)

    def test_of_the_node_alone_that_is_set_makes_late_until_its_sender_agrees(self, bench):
        bench.tell(bench.sphere())
        bench.jump(5.0)
        for _ in range(6):
            bench.go(0.1)
            bench.tell(bench.sphere(late=5.0))
        assert bench.inputs.snapshot().late_sources == {"obstacles": pytest.approx(0.6)}
        bench.tell(bench.sphere())
        assert not bench.inputs.snapshot().late_sources

    def test_that_is_not_there_yet_makes_nothing_late(self, bench):
        bench.ros_time_is_active, stamp = True, bench.header()
        bench.ros = 0
        marker = bench.sphere()
        marker.header = stamp
        bench.tell(marker)
        assert bench.inputs.ages()["obstacles"] == pytest.approx(0.0)
        assert not bench.inputs.snapshot().late_sources


class TestRequired:
    @pytest.fixture(params=["hold", "keep"])
    def bench(self, request, node) -> Bench:
        required = ["", "obstacles", "obstacle_point"]
        return Bench(node, required_obstacle_topics=required, obstacle_silence_policy=request.param)

    def test_topics_are_unheard_until_each_has_spoken_and_after_all_was_cleared(self, bench):
        assert bench.inputs.snapshot().unusable_sources == {"obstacles": UNHEARD, "obstacle_point": UNHEARD}
        bench.tell()
        assert bench.inputs.snapshot().unusable_sources == {"obstacle_point": UNHEARD}
        bench.inputs.on_point(PointStamped(header=bench.header()))
        assert bench.inputs.snapshot().unusable_sources == {}
        bench.inputs.clear_obstacles()
        assert bench.inputs.snapshot().unusable_sources == {"obstacles": UNHEARD, "obstacle_point": UNHEARD}

    def test_one_that_deletes_its_last_obstacle_must_go_on(self, bench):
        bench.inputs.on_point(PointStamped(header=bench.header()))
        for markers in ([bench.sphere()], [Marker(action=Marker.DELETEALL)], []):
            bench.tell(*markers)
            bench.go(0.4)
            assert "obstacles" not in bench.inputs.snapshot().silent_sources
            assert bench.inputs.snapshot().unusable_sources == {}
        bench.tell(Marker(action=Marker.DELETEALL))
        bench.go(0.6)
        silent = bench.parameters["obstacle_silence_policy"] == "hold"
        assert ("obstacles" in bench.inputs.snapshot().silent_sources) is silent
        assert bench.inputs.snapshot().unusable_sources == {}

    def test_one_that_deletes_all_and_cannot_be_used_is_unusable_until_it_can(self, bench):
        bench.inputs.on_point(PointStamped(header=bench.header()))
        elsewhere = Marker(header=Header(frame_id="camera"), type=Marker.SPHERE)
        for before in ([bench.sphere()], []):
            bench.tell(*before)
            assert bench.inputs.snapshot().unusable_sources == {}
            bench.tell(Marker(action=Marker.DELETEALL), elsewhere)
            (reason,) = bench.inputs.snapshot().unusable_sources.values()
            assert "frame 'camera' is unknown" in reason
        bench.tell(bench.sphere())
        bench.tell(elsewhere)
        assert bench.inputs.snapshot().unusable_sources == {}

    def test_none_is_by_default(self, node):
        assert Bench(node).inputs.snapshot().unusable_sources == {}


def test_the_task_frame_has_an_age_once_it_was_heard_and_is_never_silent(bench):
    assert "task_frame" not in bench.inputs.ages()
    frame = PoseStamped(header=bench.header(0.2))
    frame.pose.orientation.w = 1.0
    bench.inputs.on_task_frame(frame)
    bench.go(3.0)
    assert bench.inputs.ages() == {"task_frame": pytest.approx(3.2)}
    assert not bench.inputs.snapshot().silent_sources


class TestHeld:
    """What the hand holds: a message counts as a whole, or not at all."""

    def ball(self, number: int = 1, **fields: Any) -> Marker:
        marker = Marker(header=Header(frame_id="panda_grasptarget"), ns="toy", id=number, type=Marker.SPHERE, **fields)
        marker.scale.x = marker.scale.y = marker.scale.z = 0.06
        return marker

    def tell(self, bench: Bench, *markers: Marker) -> tuple[list[str], str]:
        """Names of what is held after a message, and why that is not known."""
        bench.inputs.receive_held(serialize_message(MarkerArray(markers=list(markers))))
        snapshot = bench.inputs.snapshot()
        return [held.name for held in snapshot.held], snapshot.held_refused

    def test_all_of_a_message_or_nothing(self, bench):
        assert self.tell(bench, self.ball(), self.ball(2)) == (["toy/1", "toy/2"], "")
        mesh = self.ball(3)
        mesh.type, mesh.mesh_resource = Marker.MESH_RESOURCE, "package://toys/car.stl"
        names, refused = self.tell(bench, self.ball(4), mesh)
        assert names == ["toy/1", "toy/2"]
        assert "marker toy/3: type 10, a mesh" in refused
        assert bench.inputs.refusals.counts == {"~/held_objects": 1}
        # What is said of other objects, or of none, does not say what was to be attached.
        assert self.tell(bench) == (names, refused)
        assert self.tell(bench, self.ball()) == (names, refused)
        assert self.tell(bench, self.ball(4)) == ([*names, "toy/4"], refused)
        assert self.tell(bench, self.ball(3, action=Marker.DELETE)) == ([*names, "toy/4"], "")

    def test_an_object_whose_replacement_was_refused_still_counts_and_can_be_detached(self, bench):
        self.tell(bench, self.ball())
        names, refused = self.tell(bench, self.ball(lifetime=Duration(sec=1)))
        assert names == ["toy/1"]
        assert "lifetime" in refused
        assert self.tell(bench, self.ball(action=Marker.DELETE)) == ([], "")

    @pytest.mark.parametrize(("namespace", "why"), [("toy", ""), ("", ""), ("other", "marker toy/1: action 7")])
    def test_what_is_unknown_is_detached_with_its_namespace(self, bench, namespace, why):
        self.tell(bench, self.ball(action=7))
        _, refused = self.tell(bench, Marker(ns=namespace, action=Marker.DELETEALL))
        assert refused[: len(why)] == why
        assert bool(refused) == bool(why)

    def test_to_detach_what_is_not_held_changes_nothing(self, bench):
        self.tell(bench, self.ball())
        assert self.tell(bench, self.ball(2, action=Marker.DELETE)) == (["toy/1"], "")
        assert "nothing of this name is held; held: toy/1" in bench.inputs.refusals.newest(PATIENCE)
        assert self.tell(bench, self.ball(action=Marker.DELETE)) == ([], "")

    def test_what_is_no_marker_array(self, bench):
        bench.inputs.receive_held(b"\x00\x01\x00\x00\xff")
        assert bench.inputs.snapshot().held_refused
        assert self.tell(bench, self.ball())[1]
        assert self.tell(bench, Marker(action=Marker.DELETEALL)) == ([], "")


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
        camera.bench.inputs.tracking_error = 0.003
        camera.bench.inputs.clear_obstacles()  # what came within the padding would stay for a moment
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
        camera.bench.inputs.receive_held(serialize_message(MarkerArray(markers=[marker])))
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
        camera.bench.inputs.clear_obstacles()
        assert camera.middles() == 0
        assert camera.show(camera.arm(off=0.01)[:1]).remembered == 0
        come()
        camera.bench.go(MOMENT)
        camera.tell_joints()
        assert camera.show(camera.arm(off=0.01)[:1]).remembered == 0
        assert camera.middles() == 0
