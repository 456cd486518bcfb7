"""The node `planner` by itself: what it says to good and bad input. The arm is a stream of joint states at rest."""

from __future__ import annotations

import math
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlan
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import Image, JointState, PointCloud2, PointField
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.errors import ParameterError, SkillError
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.task_frame import TaskFrame

# What moves in real time does so evenly where it has the machine to itself.
pytestmark = pytest.mark.realtime

BASE = "panda_link0"
# the middle of every demonstration, and a radius [m] that blocks them all without touching the ends
WALL = ([0.465, -0.01, 0.34], 0.2)


@pytest.fixture
def ready(bench, planner_options, start_joints):
    """A bench with a planner that has joint states and no goal."""
    bench.watch_planner()
    bench.planner = bench.add(PlannerNode, **planner_options)
    bench.joint_states = bench.send_joint_states(start_joints)
    bench.wait_for_code("NO_GOAL")
    return bench


@pytest.fixture
def moving(ready, skill):
    """The same, on its way to the skill's goal."""
    ready.send_goal(skill.goal_pose)
    ready.wait_for_code("OK")
    return ready


class TestStates:
    def test_says_what_it_lacks(self, bench, planner_options, start_joints, skill):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options)
        bench.wait_for_code("STALE_STATE", "joint_states: none has arrived")
        assert not bench.heard["target_pose"]
        bench.send_joint_states(start_joints)
        bench.wait_for_code("NO_GOAL")
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")

    def test_holds_where_the_arm_is_until_there_is_a_goal(self, ready, start_joints):
        position, _ = Robot.panda().forward(start_joints)
        target = ready.wait(lambda: ready.heard["target_pose"], "a target pose")[-1]
        assert target.header.frame_id == BASE
        point = target.pose.position
        np.testing.assert_allclose([point.x, point.y, point.z], position, atol=1e-9)

    def test_stream_reaches_the_goal_without_jumps_or_sign_flips(self, moving, skill):
        moving.wait(lambda: moving.status().get("time_to_goal", "nan") != "nan" and at_rest(moving), "rest at the goal")
        poses = [message.pose for message in moving.heard["target_pose"]]
        positions = np.array([[p.position.x, p.position.y, p.position.z] for p in poses])
        quaternions = np.array([[p.orientation.w, p.orientation.x, p.orientation.y, p.orientation.z] for p in poses])
        np.testing.assert_allclose(positions[-1], skill.goal_pose[:3], atol=1e-3)
        # 0.2 m/s at 100 Hz is 2 mm a message; on a busy machine the listener may lose some messages in a row
        assert np.linalg.norm(np.diff(positions, axis=0), axis=1).max() < 0.02
        assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.99)
        np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-9)

    def test_stops_when_joint_states_stop_and_resumes_when_they_return(self, moving, start_joints):
        moving.probe.destroy_timer(moving.joint_states)
        moving.wait_for_code("STALE_STATE", "joint_states: the newest is")
        moving.send_joint_states(start_joints)
        moving.wait_for_code("OK")

    def test_an_arm_that_was_moved_waits_for_the_goal_to_be_sent_again(
        self, bench, planner_options, start_joints, skill
    ):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options | {"tracking_tolerance": 0.05})
        timer = bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("BAD_INPUT", "the arm is")  # it stands still, whatever it is sent
        bench.probe.destroy_timer(timer)
        moved = start_joints + np.array([0.03, 0, 0, 0, 0, 0, 0])
        bench.send_joint_states(moved)
        bench.wait_for_code("NO_GOAL", "goal dropped: the arm was")
        expected, _ = Robot.panda().forward(moved)
        heard = len(bench.heard["target_pose"])
        bench.wait(lambda: len(bench.heard["target_pose"]) > heard + 20, "further target poses")
        point = bench.heard["target_pose"][-1].pose.position
        np.testing.assert_allclose([point.x, point.y, point.z], expected, atol=1e-9)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")

    def test_a_second_publisher_of_target_poses_is_named(self, moving):
        other = moving.probe.create_publisher(PoseStamped, "target_pose", 1)
        moving.wait_for_code("CONFLICT", "/planner and /probe")
        assert moving.heard["planner/status"][-1].status[0].level == DiagnosticStatus.ERROR
        moving.probe.destroy_publisher(other)
        moving.wait_for_code("NO_GOAL", "goal dropped")

    def test_hold_and_release(self, moving):
        assert moving.call(SetBool, "planner/hold", SetBool.Request(data=True)).success
        moving.wait_for_code("HOLD_REQUESTED")
        assert moving.call(SetBool, "planner/hold", SetBool.Request(data=False)).success
        moving.wait_for_code("OK")


def at_rest(bench) -> bool:
    return float(bench.status()["speed"]) == 0.0


def cloud_of(points: np.ndarray) -> PointCloud2:
    return PointCloud2(
        header=Header(frame_id=BASE), height=1, width=len(points), point_step=24, row_step=24 * len(points),
        fields=[
            PointField(name=name, offset=8 * i, datatype=PointField.FLOAT64, count=1) for i, name in enumerate("xyz")
        ],
        data=points.tobytes(),
    )  # fmt: skip


class TestObstacles:
    def test_all_ways_blocked_then_freed(self, moving):
        moving.send_spheres(WALL)
        moving.wait_for_code("NO_FEASIBLE_PATH")
        moving.delete_spheres()
        moving.wait_for_code("OK")

    def test_obstacle_on_the_robot(self, moving, skill):
        moving.send_spheres((skill.start_pose[:3], 0.45))
        status = moving.wait_for_code("IN_COLLISION")
        assert float(status["clearance"]) < 0.0

    @pytest.mark.parametrize("policy", ["hold", "keep"])
    def test_policy_when_an_obstacle_topic_falls_silent(self, bench, planner_options, start_joints, skill, policy):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options | {"obstacle_timeout": 0.5, "obstacle_silence_policy": policy})
        bench.listen(DiagnosticArray, "/diagnostics")
        bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")
        bench.send_spheres(([2.0, 2.0, 2.0], 0.1))
        if policy == "hold":
            bench.wait_for_code("STALE_OBSTACLES", "obstacles for")
            bench.call(Trigger, "planner/clear_obstacles", Trigger.Request())
            bench.wait_for_code("OK")
        else:
            bench.wait(lambda: float(health(bench).get("age_obstacles", "0")) > 1.0, "an obstacle topic gone silent")
            assert bench.status()["code"] == "OK"

    def test_every_kind_of_obstacle_counts(self, moving):
        """Each topic alone blocks the way, and its obstacle is gone when it is told to go."""
        grid = np.arange(-0.3, 0.3, 0.05)
        points = np.array([WALL[0] + np.array([x, 0.0, z]) for x in grid for z in grid])
        cloud = cloud_of(points)
        marker = Marker(header=Header(frame_id=BASE), type=Marker.SPHERE)
        marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = WALL[0]
        marker.scale.x = marker.scale.y = marker.scale.z = 0.4
        cube, cylinder = (Marker(header=Header(frame_id=BASE), type=kind) for kind in (Marker.CUBE, Marker.CYLINDER))
        for solid in (cube, cylinder):
            solid.pose.position.x, solid.pose.position.y, solid.pose.position.z = WALL[0]
            solid.pose.orientation.w = 1.0
            solid.scale.x = solid.scale.y = solid.scale.z = 0.4
        point = PointStamped(header=Header(frame_id=BASE))
        point.point.x, point.point.y, point.point.z = WALL[0]
        moving.planner.set_parameters([Parameter("obstacle_point_radius", value=0.2)])
        for kind, topic, message in (
            (Marker, "obstacle_marker", marker),
            (Marker, "obstacle_marker", cube),
            (Marker, "obstacle_marker", cylinder),
            (PointStamped, "obstacle_point", point),
            (PointCloud2, "obstacle_cloud", cloud),
        ):
            moving.publisher(kind, topic).publish(message)
            moving.wait_for_code("NO_FEASIBLE_PATH")
            moving.call(Trigger, "planner/clear_obstacles", Trigger.Request())
            moving.wait_for_code("OK")
        moving.listen(DiagnosticArray, "/diagnostics")
        moving.wait(lambda: health(moving).get("cloud_points") == str(len(points)), "the figures of the cloud")

    def test_an_obstacle_vanishes_with_its_lifetime(self, moving):
        marker = Marker(header=Header(frame_id=BASE), type=Marker.SPHERE)
        marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = WALL[0]
        marker.scale.x = marker.scale.y = marker.scale.z = 0.4
        marker.lifetime.nanosec = 300_000_000
        moving.publisher(Marker, "obstacle_marker").publish(marker)
        moving.wait_for_code("NO_FEASIBLE_PATH")
        moving.wait_for_code("OK")


def bad_marker(radius=0.05, x=0.4, frame=BASE) -> MarkerArray:
    marker = Marker(header=Header(frame_id=frame), type=Marker.SPHERE, ns="bad", id=7)
    marker.pose.position.x = x
    marker.scale.x = marker.scale.y = marker.scale.z = 2.0 * radius
    return MarkerArray(markers=[marker])


def goal(x=0.48, w=0.0, frame=BASE, y=0.26) -> PoseStamped:
    message = PoseStamped(header=Header(frame_id=frame))
    message.pose.position.x, message.pose.position.y, message.pose.position.z = x, y, 0.36
    message.pose.orientation.w, message.pose.orientation.x = w, 0.0 if w == 0.0 else 1.0
    return message


def joints(names, positions) -> JointState:
    return JointState(name=list(names), position=positions)


def cut_cloud() -> PointCloud2:
    return PointCloud2(header=Header(frame_id=BASE), height=1, width=5, point_step=12, row_step=60, data=b"123")


PANDA = Robot.panda().joint_names

REFUSED = {
    "NaN obstacle": (MarkerArray, "obstacles", bad_marker(x=math.nan), "centre holds nan"),
    "infinite obstacle": (MarkerArray, "obstacles", bad_marker(x=math.inf), "centre holds inf"),
    "negative radius": (MarkerArray, "obstacles", bad_marker(radius=-0.05), "must be positive"),
    "zero radius": (MarkerArray, "obstacles", bad_marker(radius=0.0), "must be positive"),
    "NaN radius": (MarkerArray, "obstacles", bad_marker(radius=math.nan), "scale holds nan"),
    "obstacle in an unknown frame": (MarkerArray, "obstacles", bad_marker(frame="camera"), "frame 'camera'"),
    "NaN point": (PointStamped, "obstacle_point", PointStamped(header=Header(frame_id="nowhere")), "frame 'nowhere'"),
    "truncated cloud": (PointCloud2, "obstacle_cloud", cut_cloud(), "no field x, y, z"),
    "zero quaternion": (PoseStamped, "goal_pose", goal(w=0.0), "zero quaternion"),
    "NaN goal": (PoseStamped, "goal_pose", goal(x=math.nan, w=1.0), "position holds nan"),
    "goal in an unknown frame": (PoseStamped, "goal_pose", goal(w=1.0, frame="map"), "frame 'map'"),
    "joint missing": (JointState, "joint_states", joints(PANDA[:-1], [0.0] * 6), "lacks panda_joint7"),
    "joint beyond its limits": (JointState, "joint_states", joints(PANDA, [0.0] * 7), "panda_joint4 at 0.000 (limits"),
    "NaN joint": (JointState, "joint_states", joints(PANDA, [math.nan] * 7), "joint panda_joint1 holds nan"),
}


class TestBadInput:
    def test_is_refused_with_the_reason_and_changes_nothing(self, moving):
        before = moving.planner._inputs.snapshot()
        for name, (kind, topic, message, reason) in REFUSED.items():
            publisher = moving.publisher(kind, topic)

            def refused(publisher=publisher, message=message, topic=topic, reason=reason) -> bool:
                # Sent until it is refused: with one place in the queue, a good message may take that of a bad one.
                publisher.publish(message)
                said = moving.status()["refused_input"]
                return said.startswith(f"{topic}: ") and reason in said

            moving.wait(refused, f"the refusal of: {name}")
            assert moving.heard["planner/status"][-1].status[0].level == DiagnosticStatus.WARN, name
            assert moving.status()["code"] == "OK", name
        after = moving.planner._inputs.snapshot()
        np.testing.assert_array_equal(after.obstacles.centres, before.obstacles.centres)
        np.testing.assert_array_equal(after.measured[0], before.measured[0])

    @pytest.mark.parametrize(
        ("pose", "code"),
        [
            ([5.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0], "GOAL_OUT_OF_SUPPORT"),
            ([0.30, 0.45, 0.36, 0.0, 1.0, 0.0, 0.0], "GOAL_OUT_OF_SUPPORT"),
            ([math.nan, 0.45, 0.36, 0.0, 1.0, 0.0, 0.0], "BAD_INPUT"),
        ],
        ids=["out of reach", "far off the demonstrations", "NaN"],
    )
    def test_a_bad_first_goal_is_the_verdict(self, ready, pose, code):
        ready.send_goal(np.array(pose))
        status = ready.wait_for_code(code)
        assert status["goal_code"] == code
        assert status["reason"]
        assert status["time_to_goal"] == "nan"

    def test_a_bad_later_goal_leaves_the_old_one(self, moving, skill):
        moving.send_goal(np.array([0.30, 0.45, 0.36, 0.0, 1.0, 0.0, 0.0]))
        moving.wait(lambda: moving.status()["goal_code"] == "GOAL_OUT_OF_SUPPORT", "a refused goal")
        assert moving.status()["code"] == "OK"
        moving.wait(lambda: at_rest(moving), "rest at the old goal")
        point = moving.heard["target_pose"][-1].pose.position
        np.testing.assert_allclose([point.x, point.y, point.z], skill.goal_pose[:3], atol=1e-3)

    def test_a_bad_marker_does_not_hide_the_good_one_beside_it(self, moving):
        moving.publisher(MarkerArray, "obstacles").publish(
            MarkerArray(markers=[*bad_marker(radius=-1.0).markers, *wall_markers()])
        )
        moving.wait_for_code("NO_FEASIBLE_PATH")

    def test_joints_in_another_order_with_fingers_are_the_same_joints(self, bench, planner_options, start_joints):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options)
        names = ["panda_finger_joint1", *reversed(PANDA)]
        bench.send_joint_states(np.array([0.04, *reversed(start_joints)]), names)
        bench.wait_for_code("NO_GOAL")
        point = bench.wait(lambda: bench.heard["target_pose"], "a target pose")[-1].pose.position
        expected, _ = Robot.panda().forward(start_joints)
        np.testing.assert_allclose([point.x, point.y, point.z], expected, atol=1e-9)


def wall_markers() -> list[Marker]:
    marker = Marker(header=Header(frame_id=BASE), type=Marker.SPHERE)
    marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = WALL[0]
    marker.scale.x = marker.scale.y = marker.scale.z = 0.4
    return [marker]


class TestTaskFrame:
    FRAME = TaskFrame(np.array([0.02, 0.03, 0.01]), np.array([math.cos(0.05), 0.0, 0.0, math.sin(0.05)]))

    def move_frame(self, bench, make_pose) -> None:
        frame = make_pose(np.concatenate([self.FRAME.origin, self.FRAME.quaternion]))
        bench.publisher(PoseStamped, "task_frame").publish(frame)
        bench.wait(lambda: not bench.planner._kind.planner._scene.frame.is_identity, "the frame in the planner")

    def test_a_plan_moves_with_the_frame(self, ready, skill, make_pose):
        def plan(frame: TaskFrame) -> np.ndarray:
            ends = skill.start_pose, skill.goal_pose
            start, end = (np.concatenate(frame.to_base(pose[:3], pose[3:])) for pose in ends)
            request = GetPlan.Request(start=make_pose(start), goal=make_pose(end))
            points = [item.pose.position for item in ready.call(GetPlan, "plan", request).plan.poses]
            return np.array([[point.x, point.y, point.z] for point in points])

        before = plan(TaskFrame.identity())
        assert len(before) > 10
        self.move_frame(ready, make_pose)
        np.testing.assert_allclose(plan(self.FRAME), self.FRAME.points_to_base(before), atol=1e-6)

    def test_a_goal_given_in_the_frame_moves_with_it(self, ready, skill, make_pose):
        ready.send_goal(skill.goal_pose, "task_frame")
        ready.wait_for_code("OK")
        self.move_frame(ready, make_pose)
        expected, _ = self.FRAME.to_base(skill.goal_pose[:3], skill.goal_pose[3:])

        def there() -> bool:
            point = ready.heard["target_pose"][-1].pose.position
            return float(np.linalg.norm(np.array([point.x, point.y, point.z]) - expected)) < 1e-3

        ready.wait(there, "the commanded pose at the moved goal")
        assert ready.status()["code"] == "OK"

    def test_a_bad_frame_is_refused_and_the_old_one_stays(self, moving):
        before = moving.planner._inputs.snapshot().task_frame
        moving.publisher(PoseStamped, "task_frame").publish(goal(x=0.1, w=0.0))
        moving.wait(lambda: "zero quaternion" in moving.status()["refused_input"], "the refusal of the frame")
        after = moving.planner._inputs.snapshot().task_frame
        np.testing.assert_array_equal(after[0], before[0])
        assert moving.status()["code"] == "OK"


class TestOtherFrames:
    """tf2 is played by a buffer of one transform, which comes late."""

    CAMERA = TaskFrame(np.array([1.2, 0.0, 0.9]), np.array([0.0, 0.6, 0.8, 0.0]))

    @pytest.fixture
    def buffer(self, monkeypatch):
        """Asked for anything, it has nothing until `known`."""

        class Late:
            known = False

            def lookup_transform(self, target: str, source: str, time: Time) -> TransformStamped:
                if not (self.known and (target, source) == (BASE, "camera")):
                    raise LookupError(f"no {source}")
                found = TransformStamped().transform
                place, turn = found.translation, found.rotation
                place.x, place.y, place.z = TestOtherFrames.CAMERA.origin.tolist()
                turn.w, turn.x, turn.y, turn.z = TestOtherFrames.CAMERA.quaternion.tolist()
                return TransformStamped(transform=found)

            def clear(self) -> None:
                pass

        late = Late()
        tf2 = SimpleNamespace(
            Buffer=lambda: late, TransformListener=lambda buffer, node: None, TransformException=LookupError
        )
        monkeypatch.setitem(sys.modules, "tf2_ros", tf2)
        return late

    def test_are_refused_until_their_transform_is_there(self, buffer, ready, skill, make_pose):
        ready.listen(DiagnosticArray, "/diagnostics")
        start, end = (
            np.concatenate(self.CAMERA.to_task(pose[:3], pose[3:])) for pose in (skill.start_pose, skill.goal_pose)
        )
        centre = self.CAMERA.points_to_task(np.array([[0.465, 0.8, 0.34]]))[0]
        obstacles = lambda: ready.planner._inputs.snapshot().obstacles  # noqa: E731
        ready.send_spheres((centre, 0.05), frame="camera")
        ready.wait(lambda: "frame 'camera'" in ready.status()["refused_input"], "the refusal of the obstacle")
        assert "no camera" in ready.status()["refused_input"]
        assert not len(obstacles())
        ready.wait(lambda: int(health(ready).get("refused_obstacles", "0")) > 0, "the refusal among those counted")
        buffer.known = True
        ready.send_spheres((centre, 0.05), frame="camera")
        ready.wait(lambda: len(obstacles()), "the obstacle")
        np.testing.assert_allclose(obstacles().centres, [[0.465, 0.8, 0.34]], atol=1e-9)
        request = GetPlan.Request(start=make_pose(start, "camera"), goal=make_pose(end, "camera"))
        last = ready.call(GetPlan, "plan", request).plan.poses[-1].pose.position
        np.testing.assert_allclose([last.x, last.y, last.z], skill.goal_pose[:3], atol=1e-3)
        ready.send_goal(end, "camera")
        ready.wait_for_code("OK")


class TestPlanService:
    def request(self, make_pose, start, end, frame=BASE) -> GetPlan.Request:
        return GetPlan.Request(start=make_pose(start, frame), goal=make_pose(end, frame))

    def test_answers_while_the_loop_runs(self, moving, skill, make_pose):
        ticks = len(moving.heard["planner/status"])
        plan = moving.call(GetPlan, "plan", self.request(make_pose, skill.start_pose, skill.goal_pose)).plan
        assert plan.header.frame_id == BASE
        first, last = plan.poses[0].pose.position, plan.poses[-1].pose.position
        np.testing.assert_allclose([first.x, first.y, first.z], skill.start_pose[:3], atol=1e-3)
        np.testing.assert_allclose([last.x, last.y, last.z], skill.goal_pose[:3], atol=1e-3)
        moving.wait(lambda: len(moving.heard["planner/status"]) > ticks + 10, "further cycles")
        assert moving.status()["code"] == "OK"

    def test_is_empty_when_there_is_no_way(self, ready, skill, make_pose):
        ready.send_spheres(WALL)
        ready.wait(lambda: len(ready.planner._inputs.snapshot().obstacles.radii), "the obstacle")
        ready.wait(lambda: len(ready.planner._kind.planner._scene.in_base.radii), "the obstacle in the planner")
        assert not ready.call(GetPlan, "plan", self.request(make_pose, skill.start_pose, skill.goal_pose)).plan.poses

    def test_is_empty_for_another_frame(self, ready, skill, make_pose):
        request = self.request(make_pose, skill.start_pose, skill.goal_pose, frame="map")
        assert not ready.call(GetPlan, "plan", request).plan.poses


def health(bench) -> dict[str, str]:
    heard = bench.heard["/diagnostics"]
    return {pair.key: pair.value for pair in heard[-1].status[0].values} if heard else {}


@pytest.mark.parametrize(("changes", "early"), [({"skill": "panda_reach_to_grasp"}, True), ({}, False)])
def test_an_obstacle_hurries_the_tick_of_a_whole_arm_skill_alone(bench, planner_options, monkeypatch, changes, early):
    """Poses are to be followed at once: their ticks stay even."""
    node, hurried = bench.add(PlannerNode, **planner_options | changes), threading.Event()
    monkeypatch.setattr(node._loop, "hurry", hurried.set)
    bench.watch_planner()
    bench.wait_for_code("STALE_STATE")
    assert not hurried.is_set()
    bench.send_spheres(([2.0, 2.0, 2.0], 0.1))
    bench.wait(lambda: len(node._inputs.snapshot().obstacles), "the obstacle")
    assert hurried.wait(20.0 if early else 0.2) is early


class TestPictures:
    def test_late_listeners_get_the_latent_view(self, bench, planner_options, start_joints, skill):
        node = bench.add(PlannerNode, **planner_options | {"latent_view_rate": 5.0, "latent_view_size": 128})
        bench.watch_planner()
        bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")
        node._view_thread.stop()
        node._show_view()
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        bench.listen(Image, "planner/latent_view", latched)
        image = bench.wait(lambda: bench.heard["planner/latent_view"], "a latent view")[-1]
        assert (image.height, image.width, image.encoding) == (128, 128, "rgb8")
        pixels = np.frombuffer(image.data, np.uint8).reshape(128, 128, 3)
        assert np.count_nonzero(np.all(pixels == 255, axis=2)) > 30, "the white path is not in the picture"

    def test_path_markers_and_health(self, moving, skill):
        moving.listen(Path, "path")
        moving.listen(MarkerArray, "planner/markers")
        moving.listen(DiagnosticArray, "/diagnostics")
        moving.send_spheres(([0.465, 0.8, 0.34], 0.03))
        path = moving.wait(lambda: moving.heard["path"], "a path")[-1]
        last = path.poses[-1].pose.position
        np.testing.assert_allclose([last.x, last.y, last.z], skill.goal_pose[:3], atol=1e-3)

        def seen(action: int) -> bool:
            shown = moving.heard["planner/markers"]
            return bool(shown) and any(m.ns == "obstacles" and m.action == action for m in shown[-1].markers)

        moving.wait(lambda: seen(Marker.ADD), "the obstacle among the markers")
        moving.delete_spheres()
        moving.wait(lambda: seen(Marker.DELETE), "the deletion of the obstacle's marker")
        moving.wait(lambda: float(health(moving).get("ticks", "0")) > 10, "the loop's health")
        assert float(health(moving)["rate_hz"]) > 0.0
        assert "age_joint_states" in health(moving)

    def test_solids_and_clouds_are_shown_as_the_planner_sees_them(self, moving):
        moving.listen(MarkerArray, "planner/markers")
        cube = Marker(header=Header(frame_id=BASE), type=Marker.CUBE)
        cube.pose.position.y, cube.pose.orientation.w = 0.8, 1.0
        cube.scale.x, cube.scale.y, cube.scale.z = 0.1, 0.2, 0.3
        moving.publisher(Marker, "obstacle_marker").publish(cube)
        points = np.array([[0.0, 0.7, 0.5], [0.0, 0.7, 0.6], [9.0, 9.0, 0.0], [np.nan, 0.0, 0.0]])
        moving.publisher(PointCloud2, "obstacle_cloud").publish(cloud_of(points))

        def shown(namespace: str) -> Marker | None:
            newest = moving.heard["planner/markers"][-1:]
            return next((m for array in newest for m in array.markers if m.ns == namespace), None)

        moving.wait(lambda: shown("solids") and shown("cloud"), "both among the markers")
        assert (shown("solids").type, shown("solids").scale.z) == (Marker.CUBE, 0.3)
        assert len(shown("cloud").points) == 2
        figures = moving.planner._inputs.cloud_figures()
        assert (figures.points, figures.out_of_reach, figures.not_finite) == (2, 1, 1)


class TestParameters:
    @pytest.mark.parametrize(
        ("name", "value", "hint"),
        [
            ("speed", 5.0, "from 0.001 to 2"),
            ("speed", 1, "write 1.0, not 1"),
            ("rate", math.nan, "from 10 to 1000"),
            ("tool_spheres", [0.0, 0.0, 0.04], "rows of 4"),
            ("tool_spheres", [0.0, 0.0, 0.0, -0.04], "not negative"),
            ("obstacle_silence_policy", "pray", "one of hold, keep"),
            ("sped", 0.1, "did you mean speed?"),
        ],
    )
    def test_bad_ones_at_start_are_refused_by_name(self, bench, planner_options, name, value, hint):
        with pytest.raises(ParameterError, match=name.split("_")[0]) as caught:
            bench.add(PlannerNode, **planner_options | {name: value})
        assert hint in str(caught.value)

    def test_bad_ones_at_run_time_are_refused_all_or_nothing(self, ready):
        wanted = [Parameter("state_timeout", value=1.5), Parameter("obstacle_timeout", value=-1.0)]
        request = SetParametersAtomically.Request(parameters=[p.to_parameter_msg() for p in wanted])
        result = ready.call(SetParametersAtomically, "planner/set_parameters_atomically", request).result
        assert not result.successful
        assert "obstacle_timeout" in result.reason
        assert ready.planner.get_parameter("state_timeout").value == 2.0
        assert ready.planner._cycle.state_timeout == 2.0

    def test_good_ones_at_run_time_take_effect(self, ready, start_joints):
        request = SetParametersAtomically.Request(
            parameters=[Parameter("state_timeout", value=0.011).to_parameter_msg()]
        )
        assert ready.call(SetParametersAtomically, "planner/set_parameters_atomically", request).result.successful
        ready.wait_for_code("STALE_STATE", "allowed are 0.011 s")

    def test_what_cannot_change_is_refused(self, ready):
        assert not ready.planner.set_parameters([Parameter("speed", value=0.1)])[0].successful


class TestSkills:
    def test_a_missing_skill_is_named(self, bench, planner_options, tmp_path):
        with pytest.raises(SkillError, match="nowhere"):
            bench.add(PlannerNode, **planner_options | {"skill": str(tmp_path / "nowhere")})

    def test_a_damaged_skill_is_named_with_the_reason(self, bench, planner_options, skill, tmp_path):
        folder = skill.save(tmp_path / "damaged")
        weights = folder / "weights.safetensors"
        weights.write_bytes(weights.read_bytes()[:-100])
        with pytest.raises(SkillError, match="truncated or altered"):
            bench.add(PlannerNode, **planner_options | {"skill": str(folder)})


def test_nodes_come_and_go_without_leaving_threads(bench, planner_options):
    for repetition in range(5):
        node = PlannerNode(context=bench.context, parameter_overrides=options(planner_options))
        node.start()
        node.stop()
        node.destroy_node()
        if repetition == 0:
            threads = threading.active_count()
    assert threading.active_count() == threads


def options(values) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]
