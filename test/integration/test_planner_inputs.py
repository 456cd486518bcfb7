"""What the node `planner` is sent: bad messages are refused with the reason, other frames are taken into its own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseStamped
from nav_msgs.srv import GetPlan
from scipy.spatial import cKDTree
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes import listener
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.robot.kinematics import Robot

BASE = "panda_link0"


def bad_marker(radius=0.05, x=0.4, frame=BASE) -> MarkerArray:
    marker = Marker(header=Header(frame_id=frame), type=Marker.SPHERE, ns="bad", id=7)
    marker.pose.position.x = x
    marker.scale.x = marker.scale.y = marker.scale.z = 2.0 * radius
    return MarkerArray(markers=[marker])


def wall_marker(centre, radius) -> Marker:
    marker = Marker(header=Header(frame_id=BASE), type=Marker.SPHERE)
    marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = centre
    marker.scale.x = marker.scale.y = marker.scale.z = 2.0 * radius
    return marker


def goal(x=0.48, w=0.0, frame=BASE, y=0.26) -> PoseStamped:
    message = PoseStamped(header=Header(frame_id=frame))
    message.pose.position.x, message.pose.position.y, message.pose.position.z = x, y, 0.36
    message.pose.orientation.w, message.pose.orientation.x = w, 0.0 if w == 0.0 else 1.0
    return message


def joints(names, positions) -> JointState:
    return JointState(name=list(names), position=positions)


def cut_cloud() -> PointCloud2:
    return PointCloud2(header=Header(frame_id=BASE), height=1, width=5, point_step=12, row_step=60, data=b"123")


PANDA = Robot.named("panda").joint_names

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
    "joint missing": (JointState, "joint_states", joints(PANDA[:-1], [9.0] * 6), "panda_joint1 at 9.000 (limits"),
    "joint beyond its limits": (JointState, "joint_states", joints(PANDA, [0.0] * 7), "panda_joint4 at 0.000 (limits"),
    "NaN joint": (JointState, "joint_states", joints(PANDA, [math.nan] * 7), "joint panda_joint1 holds nan"),
}


class TestBadInput:
    def test_is_refused_with_the_reason_and_changes_nothing(self, moving, make_cloud):
        # An obstacle topic of which nothing was ever usable would stop the arm.
        point = PointStamped(header=Header(frame_id=BASE))
        point.point.x = 9.0
        cloud = make_cloud(np.array([[9.0, 9.0, 0.0]]))
        for kind, topic, message in (
            (MarkerArray, "obstacles", MarkerArray()),
            (PointStamped, "obstacle_point", point),
            (PointCloud2, "obstacle_cloud", cloud),
        ):
            moving.publisher(kind, topic).publish(message)
            moving.wait(lambda topic=topic: topic in moving.planner.inputs.ages(), f"the first message on {topic}")
        moving.wait(moving.at_goal, "an arm at rest")

        def is_where_it_was_sent() -> bool:
            sent = moving.planner.cycle.planner.motion_to_goal()[0].positions[-1]
            return np.array_equal(moving.planner.inputs.snapshot().measured, sent)

        moving.wait(is_where_it_was_sent, "a joint state of the end of the motion")
        before = moving.planner.inputs.snapshot()
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
        after = moving.planner.inputs.snapshot()
        np.testing.assert_array_equal(after.obstacles.centres, before.obstacles.centres)
        np.testing.assert_allclose(after.measured[0], before.measured[0], atol=1e-6)

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

    def test_a_goal_of_navigation_before_any_goal_is_refused_and_the_next_one_taken(self, ready, skill):
        floor = goal(x=2.31, y=-0.84, w=0.925, frame="map")
        floor.pose.position.z, floor.pose.orientation.x, floor.pose.orientation.z = 0.0, 0.0, 0.38
        ready.publisher(PoseStamped, "goal_pose").publish(floor)
        status = ready.wait_for_code("BAD_INPUT", "goal_pose: frame 'map' is unknown here: send it in 'panda_link0'")
        assert "\n" not in status["reason"]
        ready.send_goal(skill.goal_pose)
        ready.wait_for_code("OK")

    def test_a_bad_later_goal_leaves_the_old_one_and_is_reported(self, moving, skill):
        moving.listen_to_log()
        moving.send_goal(np.array([0.30, 0.45, 0.36, 0.0, 1.0, 0.0, 0.0]))
        moving.wait(lambda: moving.status()["goal_code"] == "GOAL_OUT_OF_SUPPORT", "a refused goal")
        assert moving.status()["code"] == "OK"
        assert moving.heard["planner/status"][-1].status[0].message.startswith(
            "OK; newest goal refused: GOAL_OUT_OF_SUPPORT: "
        )
        moving.wait(lambda: moving.logged("newest goal refused: GOAL_OUT_OF_SUPPORT: "), "a line of the log")
        moving.wait(moving.at_goal, "rest at the old goal")
        point = moving.commanded().pose.position
        np.testing.assert_allclose([point.x, point.y, point.z], skill.goal_pose[:3], atol=1e-3)

    def test_a_bad_marker_does_not_hide_the_good_one_beside_it(self, moving, wall):
        moving.publisher(MarkerArray, "obstacles").publish(
            MarkerArray(markers=[*bad_marker(radius=-1.0).markers, wall_marker(*wall)])
        )
        moving.poll(lambda: len(moving.planner.inputs.snapshot().obstacles), "the obstacle at the planner")
        moving.wait_for_code("NO_FEASIBLE_PATH")

    def test_joints_in_another_order_with_fingers_are_the_same_joints(self, bench, planner_options, start_joints):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options)
        names = ["panda_finger_joint1", *reversed(PANDA)]
        bench.send_joint_states(np.array([0.04, *reversed(start_joints)]), names)
        bench.wait_for_code("NO_GOAL")
        point = bench.wait(lambda: bench.heard["target_pose"], "a target pose")[-1].pose.position
        expected, _ = Robot.named("panda").forward(start_joints)
        np.testing.assert_allclose([point.x, point.y, point.z], expected, atol=1e-9)


class TestTaskFrame:
    FRAME = TaskFrame(np.array([0.02, 0.03, 0.01]), np.array([math.cos(0.05), 0.0, 0.0, math.sin(0.05)]))

    def move_frame(self, bench, make_pose) -> None:
        frame = make_pose(np.concatenate([self.FRAME.origin, self.FRAME.quaternion]))
        bench.publisher(PoseStamped, "task_frame").publish(frame)
        bench.wait(lambda: bench.planner.inputs.snapshot().task_frame is not None, "the frame")
        # Statuses that are still in transit are of cycles before.
        ticks = bench.planner.loop.ticks
        bench.wait(lambda: int(bench.status()["tick"]) > ticks + 2, "cycles that have taken it")

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
        moved, there = plan(self.FRAME), self.FRAME.points_to_base(before)
        np.testing.assert_allclose(moved[[0, -1]], there[[0, -1]], atol=1e-6)
        # The same path in another posture, and so at other times: points are 3 mm apart.
        assert np.max(cKDTree(there).query(moved)[0]) < 0.003

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
        before = moving.planner.inputs.snapshot().task_frame
        moving.publisher(PoseStamped, "task_frame").publish(goal(x=0.1, w=0.0))
        moving.wait(lambda: "zero quaternion" in moving.status()["refused_input"], "the refusal of the frame")
        after = moving.planner.inputs.snapshot().task_frame
        np.testing.assert_array_equal(after[0], before[0])
        assert moving.status()["code"] == "OK"


class TestOtherFrames:
    """One frame is known late; `test_tf.py` has frames that come over `/tf`."""

    CAMERA = TaskFrame(np.array([1.2, 0.0, 0.9]), np.array([0.0, 0.6, 0.8, 0.0]))

    @pytest.fixture
    def buffer(self, monkeypatch):
        """Asked for anything, it has nothing until `known`."""

        class Late:
            known = False

            def __call__(self, target: str, source: str, stamp: object) -> object:
                if self.known and (target, source) == (BASE, "camera"):
                    return TestOtherFrames.CAMERA.origin, TestOtherFrames.CAMERA.quaternion
                return Refusal(VerdictCode.BAD_INPUT, f"no {source}")

        late = Late()
        monkeypatch.setattr(listener, "frames_of", lambda *of: late)
        return late

    def test_are_refused_until_their_transform_is_there(self, buffer, ready, skill, make_pose):
        ready.listen(DiagnosticArray, "/diagnostics")
        start, end = (
            np.concatenate(self.CAMERA.to_task(pose[:3], pose[3:])) for pose in (skill.start_pose, skill.goal_pose)
        )
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        centre = self.CAMERA.to_task(np.array([0.465, 0.8, 0.34]), upright)[0]
        obstacles = lambda: ready.planner.inputs.snapshot().obstacles  # noqa: E731
        ready.send_spheres((centre, 0.05), frame="camera")
        ready.wait(lambda: "frame 'camera'" in ready.status()["refused_input"], "the refusal of the obstacle")
        assert "no camera" in ready.status()["refused_input"]
        assert not len(obstacles())
        ready.wait(lambda: int(ready.health().get("refused_obstacles", "0")) > 0, "the refusal among those counted")
        buffer.known = True
        ready.send_spheres((centre, 0.05), frame="camera")
        ready.wait(lambda: len(obstacles()), "the obstacle")
        np.testing.assert_allclose(obstacles().centres, [[0.465, 0.8, 0.34]], atol=1e-9)
        request = GetPlan.Request(start=make_pose(start, "camera"), goal=make_pose(end, "camera"))
        last = ready.call(GetPlan, "plan", request).plan.poses[-1].pose.position
        np.testing.assert_allclose([last.x, last.y, last.z], skill.goal_pose[:3], atol=1e-3)
        ready.send_goal(end, "camera")
        ready.wait_for_code("OK")
