"""The node `twin` by itself: a Panda behind topics, with obstacles and a judge."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Float64, String, UInt32
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes import twin_node, twin_parameters
from geodesic_motion_ros.nodes.messages import seconds
from geodesic_motion_ros.nodes.publishers import LATCHED
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError, SkillError

ON_THE_HAND = "{ball: {kind: static, centre: [0.45, -0.28, 0.36], radius: 0.05}}"
TWO = (
    "{ball: {kind: circle, centre: [0.3, 0.5, 0.5], amplitude: 0.1, period: 2.0, radius: 0.05}, "
    "post: {kind: static, centre: [0.0, 0.6, 0.3], radius: 0.04}}"
)


@pytest.fixture
def twin(bench, start_joints):
    """A bench with a twin at the skill's start."""
    bench.twin = bench.add(TwinNode, initial_joint_positions=start_joints.tolist())
    for kind, topic in (
        (JointState, "joint_states"), (PoseStamped, "ee_pose"), (MarkerArray, "obstacles"),
        (PointStamped, "obstacle_point"), (Float64, "twin/clearance"), (UInt32, "twin/contacts"),
    ):  # fmt: skip
        bench.listen(kind, topic)
    bench.wait(lambda: bench.heard["ee_pose"] and bench.heard["joint_states"], "the state of the arm")
    return bench


def position(message: PoseStamped) -> np.ndarray:
    point = message.pose.position
    return np.array([point.x, point.y, point.z])


def spawn(bench, spheres: str) -> Trigger.Response:
    bench.twin.set_parameters([Parameter("spheres", value=spheres)])
    return bench.call(Trigger, "twin/spawn_obstacles", Trigger.Request())


def test_state_is_that_of_the_arm(twin, start_joints):
    state, pose = twin.heard["joint_states"][-1], twin.heard["ee_pose"][-1]
    assert tuple(state.name) == tuple(Robot.named("panda").joint_names)
    np.testing.assert_allclose(state.position, start_joints, atol=0.01)
    assert len(state.velocity) == 7
    assert pose.header.frame_id == "panda_link0"
    np.testing.assert_allclose(position(pose), Robot.named("panda").forward(np.array(state.position))[0], atol=2e-3)
    assert state.header.stamp.sec > 0


def test_who_subscribes_late_receives_the_arm_with_its_meshes(twin):
    twin.listen(String, "robot_description", LATCHED)
    twin.wait(lambda: twin.heard["robot_description"], "the description")
    root = ElementTree.fromstring(twin.heard["robot_description"][-1].data)
    assert {joint.get("name") for joint in root.iter("joint")} >= set(Robot.named("panda").joint_names)
    meshes = [mesh.get("filename") for mesh in root.iter("mesh")]
    assert meshes
    assert all(name.startswith("file:///") and Path(name.removeprefix("file://")).is_file() for name in meshes)


def test_follows_target_poses_and_holds_when_they_stop(twin, skill, make_pose):
    target = skill.start_pose + np.array([0.0, 0.05, 0.03, 0, 0, 0, 0])
    publisher = twin.publisher(PoseStamped, "target_pose")
    timer = twin.repeat(0.02, lambda: publisher.publish(make_pose(target)))
    arrived = lambda: np.linalg.norm(position(twin.heard["ee_pose"][-1]) - target[:3]) < 2e-3  # noqa: E731
    twin.wait(arrived, "the arm at its target")
    twin.probe.destroy_timer(timer)
    held = seconds(twin.heard["ee_pose"][-1].header.stamp) + 2.0 * twin.twin.get_parameter("command_timeout").value
    twin.wait(lambda: seconds(twin.heard["ee_pose"][-1].header.stamp) > held, "states after the last target's time")
    assert arrived()


@pytest.mark.parametrize(
    ("change", "frame", "reason"),
    [
        ([math.nan, 0, 0, 0, 0, 0, 0], "panda_link0", "position holds nan"),
        ([5.0, 0, 0, 0, 0, 0, 0], "panda_link0", "the arm reaches"),
        ([0, 0, 0, 0, -1.0, 0, 0], "panda_link0", "zero quaternion"),
        ([0.1, 0, 0, 0, 0, 0, 0], "camera", "frame 'camera'"),
    ],
    ids=["NaN", "out of reach", "zero quaternion", "unknown frame"],
)
def test_bad_targets_are_refused_and_do_not_move_the_arm(twin, skill, make_pose, change, frame, reason):
    before = position(twin.heard["ee_pose"][-1])
    twin.listen_to_log()
    target = skill.start_pose + np.array(change)
    target[3:] = np.round(target[3:], 12)
    twin.publisher(PoseStamped, "target_pose").publish(make_pose(target, frame))
    twin.wait(lambda: twin.logged(reason), f"a refusal: {reason}")
    heard = len(twin.heard["ee_pose"])
    twin.wait(lambda: len(twin.heard["ee_pose"]) > heard + 20, "further states")
    np.testing.assert_allclose(position(twin.heard["ee_pose"][-1]), before, atol=1e-3)


def test_obstacles_move_and_are_published_as_markers_and_as_points(twin):
    assert spawn(twin, TWO).message.startswith("2 obstacles: ball, post")
    twin.wait(lambda: len(twin.heard["obstacle_point"]) > 30, "the moving obstacle as a point")
    markers = twin.heard["obstacles"][-1].markers
    assert [(marker.ns, marker.id, marker.action, marker.scale.x) for marker in markers] == [
        ("twin", 0, Marker.ADD, 0.1), ("twin", 1, Marker.ADD, 0.08),
    ]  # fmt: skip
    points = np.array([[p.point.x, p.point.y, p.point.z] for p in twin.heard["obstacle_point"]])
    assert np.linalg.norm(points[-1] - points[0]) > 0.01
    np.testing.assert_allclose(np.linalg.norm(points - [0.3, 0.5, 0.5], axis=1), 0.1, atol=1e-9)
    clearance = twin.wait(lambda: [c.data for c in twin.heard["twin/clearance"] if c.data < 10.0], "a clearance")
    assert 0.1 < clearance[-1] < 1.0
    assert twin.heard["twin/contacts"][-1].data == 0


def test_contacts_and_penetration_are_noticed_until_reset(twin):
    assert spawn(twin, ON_THE_HAND).success
    twin.wait(lambda: twin.heard["twin/contacts"] and twin.heard["twin/contacts"][-1].data > 0, "contacts")
    assert min(c.data for c in twin.heard["twin/clearance"]) < 0.0
    assert spawn(twin, "").message == "0 obstacles: none"
    assert twin.call(Trigger, "twin/reset", Trigger.Request()).success
    heard = len(twin.heard["twin/contacts"])
    twin.wait(lambda: len(twin.heard["twin/contacts"]) > heard + 2, "further counts")
    assert twin.heard["twin/contacts"][-1].data == 0
    assert twin.heard["twin/clearance"][-1].data == math.inf


def test_spheres_that_go_delete_their_markers_and_it_falls_silent(twin):
    spawn(twin, TWO)
    twin.wait(lambda: twin.heard["obstacles"], "obstacles")
    spawn(twin, "empty")
    twin.wait(lambda: twin.heard["obstacles"][-1].markers[0].action == Marker.DELETE, "deletions")
    deleted = {(marker.ns, marker.id) for marker in twin.heard["obstacles"][-1].markers}
    assert deleted == {("twin", 0), ("twin", 1)}


def test_reset_puts_the_arm_back(twin, skill, start_joints, make_pose):
    target = skill.start_pose + np.array([0.0, 0.05, 0.0, 0, 0, 0, 0])
    publisher = twin.publisher(PoseStamped, "target_pose")
    timer = twin.repeat(0.02, lambda: publisher.publish(make_pose(target)))
    twin.wait(lambda: position(twin.heard["ee_pose"][-1])[1] > target[1] - 0.01, "the arm away from its start")
    twin.probe.destroy_timer(timer)
    assert twin.call(Trigger, "twin/reset", Trigger.Request()).success
    back = lambda: np.abs(np.array(twin.heard["joint_states"][-1].position) - start_joints).max() < 1e-3  # noqa: E731
    twin.wait(back, "the arm back at its start")


def test_starts_where_its_skill_does(bench, skill_folder, start_joints):
    bench.add(TwinNode, skill=str(skill_folder))
    bench.listen(JointState, "joint_states")
    state = bench.wait(lambda: bench.heard["joint_states"], "the state of the arm")[0]
    np.testing.assert_allclose(state.position, start_joints, atol=0.01)


def test_starts_at_the_mean_configuration_of_a_joint_space_skill(bench, reach_skill, tmp_path):
    bench.add(TwinNode, skill=str(reach_skill.save(tmp_path / "reach")))
    bench.listen(JointState, "joint_states")
    state = bench.wait(lambda: bench.heard["joint_states"], "the state of the arm")[0]
    np.testing.assert_allclose(state.position, reach_skill.mean_configuration("start"), atol=0.01)


def test_starts_at_the_ready_pose_without_a_skill(bench):
    bench.add(TwinNode, skill="")
    bench.listen(JointState, "joint_states")
    state = bench.wait(lambda: bench.heard["joint_states"], "the state of the arm")[0]
    np.testing.assert_allclose(state.position, Robot.named("panda").ready, atol=0.01)


def test_a_missing_skill_is_named(bench, tmp_path):
    with pytest.raises(SkillError, match="nowhere"):
        bench.add(TwinNode, skill=str(tmp_path / "nowhere"))


@pytest.mark.parametrize(("kind", "topic"), [(PoseStamped, "target_pose"), (JointTrajectory, "joint_trajectory")])
def test_two_commanders_are_warned_of(twin, kind, topic):
    twin.listen_to_log()
    for _ in range(2):
        twin.probe.create_publisher(kind, topic, 1)
    twin.wait(lambda: twin.logged(f"{topic} is published by /probe and /probe"), "the warning")


def test_unknown_spheres_are_refused_by_name(twin):
    result = twin.twin.set_parameters([Parameter("spheres", value="volcano")])[0]
    assert not result.successful
    assert "volcano" in result.reason
    result = twin.twin.set_parameters([Parameter("spheres", value="{ball: {kind: static, radius: 0.1}}")])[0]
    assert not result.successful
    assert "no 'centre'" in result.reason


@pytest.mark.parametrize("spheres", ["2001-13-45", "{ball: {kind: [static]}}"])
def test_spheres_that_yaml_makes_something_strange_of_are_refused(twin, spheres):
    result = twin.twin.set_parameters([Parameter("spheres", value=spheres)])[0]
    assert not result.successful
    assert "internal error" not in result.reason


class TestFaults:
    """Errors that nobody expected are reported and counted, and the twin goes on."""

    @pytest.mark.parametrize("service", ["reset", "spawn_obstacles"])
    def test_in_a_service(self, twin, monkeypatch, service):
        with monkeypatch.context() as patch:
            patch.setattr(twin.twin.world, "reset", fail)
            patch.setattr(twin_node, "scripted_spheres", fail)
            answer = twin.call(Trigger, f"twin/{service}", Trigger.Request())
        assert not answer.success
        assert answer.message == "internal error, see the log: ZeroDivisionError()"
        assert twin.twin.refusals.counts[f"~/{service}"] == 1
        assert twin.call(Trigger, f"twin/{service}", Trigger.Request()).success
        assert not twin.twin.failure.is_set()

    def test_in_a_command(self, twin, monkeypatch, skill, make_pose):
        monkeypatch.setattr(twin.twin.world, "set_target_pose", fail)
        twin.listen_to_log()
        twin.publisher(PoseStamped, "target_pose").publish(make_pose(skill.start_pose))
        refused = "an error in target_pose: internal error, see the log: ZeroDivisionError()"
        twin.wait(lambda: twin.logged(refused), "the error")
        assert twin.twin.refusals.counts["target_pose"] == 1
        heard = len(twin.heard["joint_states"])
        twin.wait(lambda: len(twin.heard["joint_states"]) > heard + 5, "further states")

    def test_in_a_timer(self, twin, monkeypatch):
        monkeypatch.setattr(twin_node, "publishers_of", fail)
        topic = "the search for other commanders"
        twin.wait(lambda: twin.twin.refusals.counts.get(topic, 0) > 1, "the timer to fail twice")

    def test_in_a_parameter(self, twin, monkeypatch):
        with monkeypatch.context() as patch:
            patch.setattr(twin_parameters, "scripted_spheres", fail)
            result = twin.twin.set_parameters([Parameter("spheres", value="two")])[0]
        assert (result.successful, result.reason) == (False, "internal error, see the log: ZeroDivisionError()")
        assert twin.twin.get_parameter("spheres").value == ""


def fail(*arguments):
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("recorded", "scene", "stands"),
    [(False, "table", True), (True, "", True), (False, "", False), (True, "none", False)],
    ids=["table", "the skill's table", "control: nothing declared", "control: none, whatever the skill says"],
)
def test_an_arm_that_is_pressed_on_the_declared_table_is_reported(
    bench, make_pose, table_skill_folder, recorded, scene, stands
):
    bench.add(TwinNode, skill=str(table_skill_folder) if recorded else "", scene=scene)
    for topic, kind in {"ee_pose": PoseStamped, "twin/contacts": UInt32, "twin/clearance": Float64}.items():
        bench.listen(kind, topic)
    bench.listen_to_log()
    publisher = bench.publisher(PoseStamped, "target_pose")
    below = make_pose(np.array([0.55, 0.0, -0.03, 0.0, 1.0, 0.0, 0.0]))
    bench.repeat(0.02, lambda: publisher.publish(below))
    if stands:
        bench.wait(lambda: bench.heard["twin/contacts"] and bench.heard["twin/contacts"][-1].data > 0, "contacts")
        assert bench.wait(lambda: bench.logged("touches 'table'"), "the warning")[0].startswith("panda_")
        assert min(position(pose)[2] for pose in bench.heard["ee_pose"]) > -0.01
    else:
        bench.wait(lambda: bench.heard["ee_pose"] and position(bench.heard["ee_pose"][-1])[2] < -0.025, "the arm below")
        assert bench.heard["twin/contacts"][-1].data == 0
    # of obstacles alone: the scene stands in a file
    assert bench.heard["twin/clearance"][-1].data == math.inf


@pytest.mark.parametrize("scene", ["two", ON_THE_HAND, "ball:\n  kind: circle"])
def test_spheres_as_the_scene_are_refused_with_the_name_of_their_parameter(bench, scene):
    with pytest.raises(ParameterError, match=r"parameter scene = .*the parameter `spheres` now"):
        bench.add(TwinNode, skill="", scene=scene)


@pytest.mark.parametrize(
    ("scene", "reason"),
    [("nowhere", "give none, table, or a"), ("/nowhere/scene.yaml", "cannot be read"), ("crate.yaml", "did you mean")],
)
def test_a_scene_that_cannot_be_used_is_named_at_the_start(bench, tmp_path, monkeypatch, scene, reason):
    monkeypatch.chdir(tmp_path)
    Path("crate.yaml").write_text("boxs: []")
    with pytest.raises(ParameterError, match="parameter scene: ") as error:
        bench.add(TwinNode, skill="", scene=scene)
    assert reason in str(error.value)


def test_start_outside_the_joint_limits_is_refused(bench):
    with pytest.raises(ParameterError, match="initial_joint_positions: joint 'panda_joint4'"):
        bench.add(TwinNode, initial_joint_positions=[0.0] * 7)


def test_rates_above_physics_are_refused(bench):
    with pytest.raises(ParameterError, match="state_rate"):
        bench.add(TwinNode, skill="", physics_rate=200.0, state_rate=300.0)


def test_image_on_request(bench):
    bench.add(TwinNode, skill="", image_rate=2.0)
    bench.listen(Image, "twin/image")
    image = bench.wait(lambda: bench.heard["twin/image"], "an image")[-1]
    assert (image.height, image.width, image.encoding) == (240, 320, "rgb8")
    pixels = np.frombuffer(image.data, np.uint8).reshape(240, 320, 3)
    assert pixels.std() > 5.0
