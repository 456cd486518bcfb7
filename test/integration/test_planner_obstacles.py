"""The node `planner` among obstacles: every topic counts, falls silent, and is shown again."""

from __future__ import annotations

import copy
import threading
from functools import partial

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.planner_node import PlannerNode

BASE = "panda_link0"


def sphere(centre: np.ndarray, radius: float = 0.2) -> Marker:
    marker = Marker(header=Header(frame_id=BASE), type=Marker.SPHERE)
    marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = map(float, centre)
    marker.scale.x = marker.scale.y = marker.scale.z = 2.0 * radius
    return marker


def spheres_at(x: float) -> MarkerArray:
    return MarkerArray(markers=[sphere(np.array([x, 2.0, 2.0]))])


def wait_until_known(bench) -> None:
    """Wait until the planner knows of an obstacle, while the arm stands in the nodes' time."""
    bench.poll(lambda: len(bench.planner.inputs.snapshot().obstacles), "the obstacle at the planner")


class TestObstacles:
    def test_all_paths_blocked_then_freed(self, moving, wall):
        moving.send_spheres(wall)
        wait_until_known(moving)
        moving.wait_for_code("NO_FEASIBLE_PATH")
        moving.delete_spheres()
        moving.wait_for_code("OK")

    def test_obstacle_on_the_robot(self, moving, skill):
        moving.send_spheres((skill.start_pose[:3], 0.45))
        status = moving.wait_for_code("IN_COLLISION", "published by /probe")
        assert float(status["clearance"]) < 0.0
        assert "overlaps obstacles/test/0, published by /probe, by" in status["reason"]

    @pytest.mark.parametrize("policy", ["hold", "keep"])
    def test_policy_when_an_obstacle_topic_falls_silent(self, bench, planner_options, start_joints, skill, policy):
        bench.watch_planner()
        silence = {"obstacle_timeout": 0.5, "obstacle_silence_policy": policy}
        bench.add(PlannerNode, **planner_options | silence)
        bench.listen(DiagnosticArray, "/diagnostics")
        bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")
        bench.send_spheres(([2.0, 2.0, 2.0], 0.1))
        if policy == "hold":
            bench.wait_for_code("STALE_OBSTACLES", "silent: obstacles;")
            bench.call(Trigger, "planner/clear_obstacles", Trigger.Request())
            bench.wait_for_code("OK")
        else:
            bench.wait(lambda: float(bench.health().get("age_obstacles", "0")) > 1.0, "a silent obstacle topic")
            assert bench.status()["code"] == "OK"

    def test_a_topic_whose_stamps_lag_is_not_believed(self, bench, planner_options, start_joints, skill):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options | {"obstacle_timeout": 1.0})
        bench.send_joint_states(start_joints)
        late = 2.0
        bench.publisher(MarkerArray, "obstacles")
        bench.repeat(0.02, lambda: bench.send_spheres(([2.0, 2.0, 2.0], 0.1), late=late))
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("STALE_OBSTACLES", "stamps lag: obstacles;")
        late = 0.0
        bench.wait_for_code("OK")

    def test_a_required_topic_is_waited_for(self, bench, planner_options, start_joints, skill):
        bench.watch_planner()
        node = bench.add(PlannerNode, **planner_options | {"required_obstacle_topics": ["obstacles"]})
        bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        unheard = "obstacles: nothing has been received yet (required_obstacle_topics)"
        bench.wait_for_code("STALE_OBSTACLES", unheard)
        bench.publisher(MarkerArray, "obstacles").publish(MarkerArray())
        bench.wait_for_code("OK")
        bench.call(Trigger, "planner/clear_obstacles", Trigger.Request())
        bench.wait_for_code("STALE_OBSTACLES", unheard)
        refused = node.set_parameters([Parameter("required_obstacle_topics", value=["obstacle"])])[0]
        assert not refused.successful

    @pytest.mark.parametrize("policy", ["hold", "keep"])
    @pytest.mark.parametrize("topic", ["obstacles", "obstacle_marker", "obstacle_point", "obstacle_cloud"])
    def test_a_topic_of_which_nothing_is_usable_stops_the_arm(self, moving, wall, make_cloud, topic, policy):
        moving.planner.set_parameters([Parameter("obstacle_silence_policy", value=policy)])
        marker = sphere(wall[0])
        kind, good = {
            "obstacles": (MarkerArray, MarkerArray(markers=[marker])),
            "obstacle_marker": (Marker, marker),
            "obstacle_point": (PointStamped, PointStamped(header=Header(frame_id=BASE), point=marker.pose.position)),
            "obstacle_cloud": (PointCloud2, make_cloud(np.array([[9.0, 9.0, 0.0]]))),
        }[topic]
        bad = copy.deepcopy(good)
        header = bad.markers[0].header if topic == "obstacles" else bad.header
        header.frame_id = "camera_link"
        moving.publisher(kind, topic).publish(bad)
        status = moving.wait_for_code("STALE_OBSTACLES", f"{topic}: received, never usable: ")
        assert "frame 'camera_link' is unknown here: send it in 'panda_link0'" in status["reason"]
        moving.publisher(kind, topic).publish(good)
        moving.wait(lambda: moving.status()["code"] != "STALE_OBSTACLES", "the end of it")
        # What was usable once is refused without a stop.
        moving.call(Trigger, "planner/clear_obstacles", Trigger.Request())
        moving.wait_for_code("OK")

    @pytest.mark.parametrize("topic", ["obstacle_point", "obstacle_cloud"])
    def test_what_falls_silent_is_forgotten_after_its_lifetime(self, moving, wall, make_cloud, topic):
        changes = {"obstacle_timeout": 0.2, "obstacle_lifetime": 0.6, "obstacle_point_radius": 0.2}
        for name, value in changes.items():
            assert moving.planner.set_parameters([Parameter(name, value=value)])[0].successful
        grid = np.arange(-0.3, 0.3, 0.05)
        point = PointStamped(header=Header(frame_id=BASE), point=sphere(wall[0]).pose.position)
        cloud = make_cloud(np.array([wall[0] + np.array([x, 0.0, z]) for x in grid for z in grid]))
        kind, message = {"obstacle_point": (PointStamped, point), "obstacle_cloud": (PointCloud2, cloud)}[topic]
        moving.publisher(kind, topic).publish(message)
        status = moving.wait_for_code("STALE_OBSTACLES", f"silent: {topic};")
        assert "call ~/clear_obstacles" in status["reason"]
        moving.wait_for_code("OK")
        assert len(moving.planner.inputs.snapshot().obstacles) == 0

    def test_latched_obstacles_of_before_the_start_count(self, bench, planner_options, start_joints, skill, wall):
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        bench.probe.create_publisher(MarkerArray, "obstacles", latched).publish(MarkerArray(markers=[sphere(wall[0])]))
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options)
        bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("NO_FEASIBLE_PATH")

    def test_a_latched_obstacle_stands_as_long_as_its_publisher_lives(
        self, bench, planner_options, start_joints, skill
    ):
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        context = rclpy.Context()
        rclpy.init(context=context)
        table = rclpy.create_node("table", context=context)
        table.create_publisher(Marker, "obstacle_marker", latched).publish(sphere([2.0, 2.0, 2.0]))
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options | {"obstacle_timeout": 0.5})
        bench.listen(DiagnosticArray, "/diagnostics")
        bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")
        bench.wait(lambda: float(bench.health().get("age_obstacle_marker", "0")) > 1.0, "one that was sent long ago")
        assert bench.status()["code"] == "OK"
        table.destroy_node()
        rclpy.try_shutdown(context=context)
        bench.wait_for_code("STALE_OBSTACLES", "silent: obstacle_marker//0;")

    def test_two_publishers_of_one_name_are_named_and_both_places_count(self, moving):
        for x in (2.0, 3.0):
            moving.repeat(0.1, partial(moving.publisher(MarkerArray, "obstacles").publish, spheres_at(x)))
        said = "obstacles: obstacles//0: two places alternate, [2.0, 2.0, 2.0] and [3.0, 2.0, 2.0] m: two publishers?"
        moving.wait(lambda: moving.status()["refused_input"].startswith(said), "the name of the obstacle")
        assert len(moving.planner.inputs.snapshot().obstacles.radii) == 2

    def test_obstacles_of_a_best_effort_publisher_count(self, moving, wall):
        profile = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
        publisher = moving.probe.create_publisher(Marker, "obstacle_marker", profile)

        def known() -> bool:
            # Best effort: what is published before the planner is connected is lost.
            publisher.publish(sphere(wall[0]))
            return len(moving.planner.inputs.snapshot().obstacles) > 0

        moving.poll(known, "the obstacle at the planner")
        moving.wait_for_code("NO_FEASIBLE_PATH")

    def test_every_kind_of_obstacle_counts(self, moving, wall, make_cloud):
        """Each topic alone blocks the path, and its obstacle vanishes when it is deleted."""
        grid = np.arange(-0.3, 0.3, 0.05)
        points = np.array([wall[0] + np.array([x, 0.0, z]) for x in grid for z in grid])
        cloud = make_cloud(points)
        marker = sphere(wall[0])
        cube, cylinder = (Marker(header=Header(frame_id=BASE), type=kind) for kind in (Marker.CUBE, Marker.CYLINDER))
        for solid in (cube, cylinder):
            solid.pose.position.x, solid.pose.position.y, solid.pose.position.z = wall[0]
            solid.pose.orientation.w = 1.0
            solid.scale.x = solid.scale.y = solid.scale.z = 0.4
        point = PointStamped(header=Header(frame_id=BASE))
        point.point.x, point.point.y, point.point.z = wall[0]
        moving.planner.set_parameters([Parameter("obstacle_point_radius", value=0.2)])
        for kind, topic, message in (
            (Marker, "obstacle_marker", marker),
            (Marker, "obstacle_marker", cube),
            (Marker, "obstacle_marker", cylinder),
            (PointStamped, "obstacle_point", point),
            (PointCloud2, "obstacle_cloud", cloud),
        ):
            moving.publisher(kind, topic).publish(message)
            wait_until_known(moving)
            moving.wait_for_code("NO_FEASIBLE_PATH")
            moving.call(Trigger, "planner/clear_obstacles", Trigger.Request())
            moving.wait_for_code("OK")
        moving.listen(DiagnosticArray, "/diagnostics")
        moving.wait(lambda: moving.health().get("cloud_points") == str(len(points)), "the figures of the cloud")

    def test_an_obstacle_vanishes_with_its_lifetime(self, moving, wall):
        marker = sphere(wall[0])
        marker.lifetime.nanosec = 300_000_000
        moving.publisher(Marker, "obstacle_marker").publish(marker)
        wait_until_known(moving)
        moving.wait_for_code("NO_FEASIBLE_PATH")
        moving.wait_for_code("OK")

    def test_solids_and_clouds_are_shown_as_the_planner_sees_them(self, moving, make_cloud):
        moving.listen(MarkerArray, "planner/markers")
        cube = Marker(header=Header(frame_id=BASE), type=Marker.CUBE)
        cube.pose.position.y, cube.pose.orientation.w = 0.8, 1.0
        cube.scale.x, cube.scale.y, cube.scale.z = 0.1, 0.2, 0.3
        moving.publisher(Marker, "obstacle_marker").publish(cube)
        points = np.array([[0.0, 0.7, 0.5], [0.0, 0.7, 0.6], [9.0, 9.0, 0.0], [np.nan, 0.0, 0.0]])
        moving.publisher(PointCloud2, "obstacle_cloud").publish(make_cloud(points))

        def shown(namespace: str) -> Marker | None:
            newest = moving.heard["planner/markers"][-1:]
            return next((m for array in newest for m in array.markers if m.ns == namespace), None)

        moving.wait(lambda: shown("solids") and shown("cloud"), "both among the markers")
        assert (shown("solids").type, shown("solids").scale.z) == (Marker.CUBE, 0.3)
        assert len(shown("cloud").points) == 2
        figures = moving.planner.inputs.obstacles.clouds.figures
        assert (figures.points, figures.out_of_reach, figures.not_finite) == (2, 1, 1)


@pytest.mark.parametrize(("output", "early"), [("joint_trajectory", True), ("target_pose", False)])
def test_an_obstacle_hurries_the_tick_where_trajectories_are_sent(bench, planner_options, monkeypatch, output, early):
    """Poses are to be followed at once: their ticks stay even."""
    node, hurried = bench.add(PlannerNode, **planner_options | {"output": output}), threading.Event()
    monkeypatch.setattr(node.loop, "hurry", hurried.set)
    bench.watch_planner()
    bench.wait_for_code("STALE_STATE")
    assert not hurried.is_set()
    bench.send_spheres(([2.0, 2.0, 2.0], 0.1))
    bench.wait(lambda: len(node.inputs.snapshot().obstacles), "the obstacle")
    assert hurried.wait(20.0 if early else 0.2) is early
