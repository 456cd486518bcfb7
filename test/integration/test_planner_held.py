"""The node `planner` with an object in the hand: attached and detached at run time, shown, refused by name."""

from __future__ import annotations

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.planner_node import PlannerNode

# What moves in real time does so evenly where it has the machine to itself.
pytestmark = pytest.mark.realtime


def ball(number: int = 1, **fields) -> Marker:
    """A ball of 3 cm before the hand."""
    marker = Marker(header=Header(frame_id="panda_grasptarget"), ns="toy", id=number, type=Marker.SPHERE, **fields)
    marker.pose.position.z = 0.05
    marker.scale.x = marker.scale.y = marker.scale.z = 0.06
    return marker


class TestHeldObjects:
    def test_attach_in_motion_and_detach(self, moving):
        moving.listen(MarkerArray, "planner/markers")
        held = moving.publisher(MarkerArray, "planner/held_objects")
        held.publish(MarkerArray(markers=[ball(), ball(2)]))
        moving.wait(lambda: moving.status()["holding"] == "toy/1, toy/2", "two objects in the hand")
        moving.wait_for_code("OK")
        shown = moving.heard["planner/markers"]
        moving.wait(lambda: any(one.ns == "held" for array in shown for one in array.markers), "the objects, shown")
        held.publish(MarkerArray(markers=[ball(2, action=Marker.DELETE)]))
        moving.wait(lambda: moving.status()["holding"] == "toy/1", "one object in the hand")
        moving.wait(moving.at_goal, "rest at the goal")
        held.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
        moving.wait(lambda: moving.status()["holding"] == "", "an empty hand")

    def test_a_mesh_stops_the_arm_until_it_is_known_what_the_hand_holds(self, moving):
        held = moving.publisher(MarkerArray, "planner/held_objects")
        mesh = ball()
        mesh.type = Marker.MESH_RESOURCE
        held.publish(MarkerArray(markers=[mesh]))
        status = moving.wait_for_code("BAD_INPUT", "it is not known what the hand holds: marker toy/1: type 10, a mesh")
        assert status["holding"] == ""
        moving.wait(lambda: moving.status().get("refused_~/held_objects") == "1", "a count of the refusal")
        held.publish(MarkerArray())
        moving.wait_for_code("OK")

    def test_what_is_latched_is_known_to_a_planner_that_starts_later(self, bench, planner_options, start_joints):
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = bench.probe.create_publisher(MarkerArray, "planner/held_objects", latched)
        publisher.publish(MarkerArray(markers=[ball()]))
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options)
        bench.send_joint_states(start_joints)
        bench.wait(lambda: bench.status().get("holding") == "toy/1", "an object in the hand")
