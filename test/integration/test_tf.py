"""Frames of `/tf` and `/tf_static`: where they were at the stamp of a message, late ones too, in each namespace."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from bench import BASE, Bench, pose_of
from geometry_msgs.msg import PoseStamped, Transform, TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.marker_messages import sphere_marker
from geodesic_motion_ros.nodes.planner_node import PlannerNode

TFMessage = pytest.importorskip("tf2_msgs.msg", reason="make ros-extras builds it").TFMessage
CAMERA = TaskFrame(np.array([0.4, -0.6, 0.7]), np.array([0.0, 1.0, 0.0, 0.0]))
SECOND = 10**9


def transform(frame: str, parent: str, stamp: int, place: TaskFrame) -> TransformStamped:
    header = Header(frame_id=parent, stamp=Time(nanoseconds=stamp).to_msg())
    made = TransformStamped(header=header, child_frame_id=frame)
    made.transform = Transform()
    there, turn = made.transform.translation, made.transform.rotation
    there.x, there.y, there.z = place.origin.tolist()
    turn.w, turn.x, turn.y, turn.z = place.quaternion.tolist()
    return made


def send_static(bench: Bench, *transforms: TransformStamped, topic: str = "/tf_static") -> Any:
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = bench.probe.create_publisher(TFMessage, topic, latched)
    publisher.publish(TFMessage(transforms=list(transforms)))
    return publisher


def send(bench: Bench, *transforms: TransformStamped) -> None:
    bench.publisher(TFMessage, "/tf").publish(TFMessage(transforms=list(transforms)))


def spheres(frame: str, stamp: int, *centres: Sequence[float]) -> MarkerArray:
    return MarkerArray(markers=[
        sphere_marker("test", n, np.array(at), 0.05, (1.0, 0.0, 0.0, 1.0), frame, Time(nanoseconds=stamp).to_msg())
        for n, at in enumerate(centres)
    ])  # fmt: skip


def obstacles(planner: PlannerNode) -> np.ndarray:
    return planner.inputs.snapshot().obstacles.centres


def test_goals_obstacles_and_task_frame_in_a_frame_that_stands(ready, skill):
    in_camera = np.concatenate(CAMERA.to_task(skill.goal_pose[:3], skill.goal_pose[3:]))
    centre = CAMERA.to_task(np.array([0.465, 0.8, 0.34]), CAMERA.quaternion)[0]
    mast = TaskFrame(np.array([0.1, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    lens = TaskFrame(*mast.to_task(CAMERA.origin, CAMERA.quaternion))
    publisher = send_static(ready, transform("mast", BASE, 0, mast), transform("camera", "mast", 0, lens))
    ready.poll(lambda: publisher.get_subscription_count() > 0, "a planner that hears of frames")
    ready.publisher(MarkerArray, "obstacles").publish(spheres("camera", 0, centre))
    ready.wait(lambda: len(obstacles(ready.planner)), "the obstacle")
    np.testing.assert_allclose(obstacles(ready.planner), [[0.465, 0.8, 0.34]], atol=1e-9)
    ready.publisher(PoseStamped, "task_frame").publish(pose_of(np.concatenate([np.zeros(3), [1.0, 0, 0, 0]]), "mast"))
    ready.wait(lambda: np.any(ready.planner.inputs.snapshot().task_frame[0]), "the task frame")
    np.testing.assert_allclose(ready.planner.inputs.snapshot().task_frame[0], mast.origin)
    ready.publisher(PoseStamped, "task_frame").publish(pose_of(np.array([0.0, 0, 0, 1.0, 0, 0, 0])))
    ready.wait(lambda: not np.any(ready.planner.inputs.snapshot().task_frame[0]), "the task frame where it was")
    ready.send_goal(in_camera, "camera")
    ready.wait_for_code("OK")
    ready.wait(ready.at_goal, "the arm at the goal")


def test_what_is_seen_from_a_moving_frame_is_where_it_was_at_its_stamp(ready):
    now = ready.clock.nanoseconds
    for step in range(5):
        place = TaskFrame(np.array([0.1 * step, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0]))
        send(ready, transform("camera", BASE, now - (4 - step) * SECOND // 10, place))
    ready.publisher(MarkerArray, "obstacles").publish(spheres("camera", now - 15 * SECOND // 100, [0.0, 0.9, 0.0]))
    ready.wait(lambda: len(obstacles(ready.planner)), "the obstacle")
    np.testing.assert_allclose(obstacles(ready.planner), [[0.25, 0.9, 1.0]], atol=1e-6)


def test_a_message_waits_a_moment_for_a_late_transform_and_those_after_it_wait_their_turn(ready):
    # Far enough ahead of the transforms that none of them is in time, whatever the machine does meanwhile.
    inputs, now = ready.planner.inputs, ready.clock.nanoseconds
    publisher = ready.publisher(MarkerArray, "obstacles")
    place = TaskFrame(np.array([0.2, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    send(ready, transform("camera", BASE, now - SECOND, place))
    before = Time(nanoseconds=now - SECOND).to_msg()
    ready.poll(lambda: not isinstance(inputs.listener.frames(BASE, "camera", before), Refusal), "the first transform")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("geodesic_motion_ros.nodes.frames.PATIENCE", 1e3)
        publisher.publish(spheres("camera", now, [0.0, 0.9, 0.0]))
        deleted = Marker(header=Header(frame_id=BASE), ns="test", id=7, action=Marker.DELETE)
        publisher.publish(MarkerArray(markers=[deleted]))
        publisher.publish(MarkerArray(markers=[*spheres(BASE, now, [0.0, 0.9, 0.5], [0.3, 0.9, 0.5]).markers[1:]]))
        ready.poll(lambda: sum(map(len, inputs.listener.late._waiting.values())) == 3, "messages that wait")
        assert not len(obstacles(ready.planner))
        send(ready, transform("camera", BASE, now, place))
        ready.poll(lambda: len(obstacles(ready.planner)) == 2, "the obstacles")
    np.testing.assert_allclose(obstacles(ready.planner), [[0.2, 0.9, 1.0], [0.3, 0.9, 0.5]], atol=1e-6)
    assert "refused_obstacles" not in ready.status()


def test_a_message_whose_transform_does_not_come_is_refused_by_name(ready, skill):
    now = ready.clock.nanoseconds
    place = TaskFrame(np.array([0.2, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    send(ready, transform("camera", BASE, now - SECOND, place))
    ready.publisher(MarkerArray, "obstacles").publish(spheres("camera", now, [0.0, 0.9, 0.0]))
    expected = "frame 'camera' is unknown here: send it in 'panda_link0' (tf has camera in panda_link0 up to 1.000 s"
    ready.wait(lambda: expected in ready.status()["refused_input"], "the refusal of the obstacle")
    ready.send_goal(skill.goal_pose, "attic")
    ready.wait(lambda: "tf tells nothing of attic" in ready.status()["goal_reason"], "the refusal of the goal")


def test_two_planners_hear_each_their_own_frames(bench, planner_options):
    remapped = {"/tf": "tf", "/tf_static": "tf_static"}
    planners = {
        side: bench.add(PlannerNode, namespace=side, remapped=remapped, **planner_options) for side in ("left", "right")
    }
    offsets = {"left": 0.5, "right": -0.5}
    publishers = []
    for side, x in offsets.items():
        place = TaskFrame(np.array([x, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
        publishers.append(send_static(bench, transform("camera", BASE, 0, place), topic=f"/{side}/tf_static"))
        bench.poll(lambda: publishers[-1].get_subscription_count() == 1, f"the planner {side}")
    for side in offsets:
        bench.publisher(MarkerArray, f"/{side}/obstacles").publish(spheres("camera", 0, [0.0, 0.9, 0.0]))
    for side, x in offsets.items():
        bench.wait(lambda: len(obstacles(planners[side])), f"the obstacle of {side}")  # noqa: B023
        np.testing.assert_allclose(obstacles(planners[side]), [[x, 0.9, 0.0]], atol=1e-9)
