"""An arm on the page: its links stand where its kinematics have them, and what cannot be drawn is named."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.robot_file import published_urdf

viser = pytest.importorskip("viser", reason="viser is not installed: `make view`")

from geodesic_motion_ros.view.drawn_arm import DrawnArm  # noqa: E402

MOUNTED = """<robot name="arm">
<link name="world"/><link name="base"/><link name="palm"><visual><geometry><box size="0.1 0.2 0.3"/></geometry></visual>
<visual><geometry><mesh filename="package://nowhere/lost.stl"/></geometry></visual></link><link name="left"/>
<link name="right"/>
<joint name="mount" type="fixed"><parent link="world"/><child link="base"/><origin xyz="1 2 3" rpy="0 1 0"/></joint>
<joint name="j" type="revolute"><parent link="base"/><child link="palm"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="finger" type="prismatic"><parent link="palm"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0.01" upper="0.04" velocity="1" effort="1"/></joint>
<joint name="other" type="prismatic"><parent link="palm"/><child link="right"/><axis xyz="0 1 0"/>
<mimic joint="finger" multiplier="-1"/><limit lower="-0.04" upper="0" velocity="1" effort="1"/></joint></robot>"""


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def shown_at(server: viser.ViserServer, link: str) -> tuple[np.ndarray, np.ndarray]:
    """Where a link is on the page: rotation (3, 3), origin (3,) [m], by the nodes above it."""
    nodes = server.scene._handle_from_node_name
    (name,) = (name for name in nodes if name.endswith(f"/{link}"))
    rotation, origin = np.eye(3), np.zeros(3)
    while name:
        turned = to_rotation(np.array(nodes[name].wxyz)).as_matrix()
        rotation, origin = turned @ rotation, turned @ origin + nodes[name].position
        name = name.rpartition("/")[0]
    return rotation, origin


@pytest.mark.parametrize("name", ["panda", "ur5", "fr3", "iiwa14"])
def test_links_stand_where_the_kinematics_have_them(server: viser.ViserServer, name: str) -> None:
    robot = Robot.named(name)
    arm = DrawnArm(server.scene, published_urdf(robot.urdf), robot.base_link)
    for joints in robot.sample(3, np.random.default_rng(0)):
        arm.place(dict(zip(robot.joint_names, joints.tolist(), strict=True)))
        rotations, origins = robot.link_frames(joints)
        for link, rotation, origin in zip(robot.link_names, rotations, origins, strict=True):
            shown = shown_at(server, link)
            np.testing.assert_allclose(shown[0], rotation, atol=1e-3)
            np.testing.assert_allclose(shown[1], origin, atol=1e-3)


def test_the_base_is_where_the_arm_is_mounted_and_fingers_follow(server: viser.ViserServer) -> None:
    arm = DrawnArm(server.scene, MOUNTED, "base")
    np.testing.assert_allclose(shown_at(server, "base")[1], 0.0, atol=1e-9)
    np.testing.assert_allclose(shown_at(server, "palm")[1], (0.0, 0.0, 0.5), atol=1e-9)
    # Nothing is reported of them: they stand as near to 0 as they can.
    np.testing.assert_allclose(shown_at(server, "left")[1], (0.0, 0.01, 0.5), atol=1e-9)
    arm.place({"finger": 0.03})
    np.testing.assert_allclose(shown_at(server, "left")[1], (0.0, 0.03, 0.5), atol=1e-9)
    np.testing.assert_allclose(shown_at(server, "right")[1], (0.0, -0.03, 0.5), atol=1e-9)


def test_a_mesh_that_is_nowhere_is_named_and_the_others_are_drawn(server: viser.ViserServer) -> None:
    arm = DrawnArm(server.scene, MOUNTED, "base")
    (missing,) = arm.missing
    assert "package://nowhere/lost.stl" in missing
    assert any(node.endswith("/palm/drawn_0") for node in server.scene._handle_from_node_name)


def test_the_meshes_of_the_twin_are_all_drawn(server: viser.ViserServer) -> None:
    from geodesic_motion_ros.simulation.loading import simulated_urdf

    urdf = published_urdf(simulated_urdf(RobotDescription.named("panda")))
    assert DrawnArm(server.scene, urdf, "panda_link0").missing == []
