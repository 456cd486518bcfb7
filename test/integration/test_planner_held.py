"""The node `planner` with an object in the hand: attached and detached at run time, shown, refused by name."""

from __future__ import annotations

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.planner_node import PlannerNode


def ball(number: int = 1, **fields) -> Marker:
    """A ball of 3 cm before the hand."""
    marker = Marker(header=Header(frame_id="panda_grasptarget"), ns="toy", id=number, type=Marker.SPHERE, **fields)
    marker.pose.position.z = 0.05
    marker.scale.x = marker.scale.y = marker.scale.z = 0.06
    return marker


MESH = ball()
MESH.type = Marker.MESH_RESOURCE


class TestHeldObjects:
    def test_attach_replace_detach(self, ready):
        ready.listen(MarkerArray, "planner/markers")
        held = ready.publisher(MarkerArray, "planner/held_objects")
        held.publish(MarkerArray(markers=[ball(), ball(2)]))
        ready.wait(lambda: ready.status()["holding"] == "toy/1, toy/2", "two objects in the hand")
        shown = ready.heard["planner/markers"]
        ready.wait(lambda: any(one.ns == "held" for array in shown for one in array.markers), "the objects, shown")
        held.publish(MarkerArray(markers=[ball(2, action=Marker.DELETE)]))
        ready.wait(lambda: ready.status()["holding"] == "toy/1", "one object in the hand")
        held.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))
        ready.wait(lambda: ready.status()["holding"] == "", "an empty hand")

    def test_a_goal_is_reached_with_what_is_attached_in_motion(self, bench, planner_options, start_joints, skill):
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options)
        bench.send_joint_states(start_joints)
        bench.send_goal(skill.goal_pose)
        bench.wait_for_code("OK")
        bench.publisher(MarkerArray, "planner/held_objects").publish(MarkerArray(markers=[ball()]))
        bench.wait(lambda: bench.status()["holding"] == "toy/1", "an object in the hand")
        bench.wait_for_code("OK")
        bench.wait(bench.at_goal, "rest at the goal")

    @pytest.mark.parametrize(
        ("marker", "reason"), [(MESH, "type 10, a mesh"), (ball(action=7), "action 7")], ids=["mesh", "action"]
    )
    def test_a_marker_of_no_use_stops_the_arm_until_it_is_known_what_the_hand_holds(self, ready, marker, reason):
        held = ready.publisher(MarkerArray, "planner/held_objects")
        held.publish(MarkerArray(markers=[marker]))
        status = ready.wait_for_code("BAD_INPUT", f"it is not known what the hand holds: marker toy/1: {reason}")
        assert status["holding"] == ""
        ready.wait(lambda: ready.status().get("refused_~/held_objects") == "1", "a count of the refusal")
        held.publish(MarkerArray(markers=[ball(action=Marker.DELETE)]))
        ready.wait_for_code("NO_GOAL")

    def test_what_is_latched_is_known_to_a_planner_that_starts_later(self, bench, planner_options, start_joints):
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = bench.probe.create_publisher(MarkerArray, "planner/held_objects", latched)
        publisher.publish(MarkerArray(markers=[ball()]))
        bench.watch_planner()
        bench.add(PlannerNode, **planner_options)
        bench.send_joint_states(start_joints)
        bench.wait(lambda: bench.status().get("holding") == "toy/1", "an object in the hand")
