"""A robot's file, URDF or xacro, becomes a URDF whose meshes are found; what is missing is named, and what gives it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from geodesic_motion_ros.robot.collision_bodies import write_mesh
from geodesic_motion_ros.robot.convex_parts import hull_triangles
from geodesic_motion_ros.robot.robot_file import limit_velocities, plain_urdf
from geodesic_motion_ros.robot.urdf import read_chain
from geodesic_motion_ros.utils.errors import RobotError

XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="$(find arm_parts)/joint.xacro"/>
  <xacro:arg name="height" default="0.5"/>
  <link name="base"/><link name="tool"/>
  <xacro:turn height="$(arg height)"/>
</robot>"""
PART = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="turn" params="height">
    <joint name="turn" type="revolute"><parent link="base"/><child link="tool"/><origin xyz="0 0 ${height}"/>
      <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  </xacro:macro>
</robot>"""
MESH = """<robot name="arm"><link name="base">
  <collision><geometry><mesh filename="{}"/></geometry></collision>
</link></robot>"""


def written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.fixture
def scratch(tmp_path: Path) -> Path:
    (tmp_path / "scratch").mkdir()
    return tmp_path / "scratch"


@pytest.mark.parametrize("place", ["called", "beside", "manifest", "sourced", "given"])
def test_xacro_is_expanded_with_its_arguments_wherever_its_packages_are(
    place: str, tmp_path: Path, scratch: Path, monkeypatch
) -> None:
    robot, package = {
        "called": ("arm_parts/robots", "arm_parts"),
        "beside": ("arm", "arm_parts"),
        "manifest": ("arm_parts-2.1", "arm_parts-2.1"),
        "sourced": ("arm", "ros/share/arm_parts"),
        "given": ("arm", "elsewhere"),
    }[place]
    file = written(tmp_path / robot / "arm.urdf.xacro", XACRO)
    written(tmp_path / package / "joint.xacro", PART)
    if place == "manifest":
        written(tmp_path / package / "package.xml", "<package><name>arm_parts</name></package>")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))
    packages = {"arm_parts": tmp_path / package} if place == "given" else {}
    for arguments, height in (({}, 0.5), ({"height": "0.7"}, 0.7)):
        urdf = plain_urdf(file, scratch, arguments, packages)
        assert urdf.name == "arm.urdf"
        np.testing.assert_array_equal(read_chain(urdf, "base", "tool").translations, [[0.0, 0.0, height]])


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        (XACRO, {"hight": "1"}, r"arm\.xacro has no argument hight; it has height"),
        (XACRO.replace("arm_parts", "parts"), {}, r"package 'parts', which arm\.xacro needs, .*--package parts=FOLDER"),
        (XACRO.replace(' default="0.5"', ""), {}, r"arm\.xacro cannot be expanded .*missing attribute 'default'"),
        (XACRO.replace("joint.xacro", "none.xacro"), {}, r"arm\.xacro cannot be expanded by xacro: .*none\.xacro"),
        (XACRO.removesuffix("</robot>"), {}, r"arm\.xacro cannot be expanded by xacro: no element found"),
        (XACRO.replace("$(arg height)", "${2 * hight}"), {}, r"arm\.xacro cannot be expanded by xacro: .*'hight'"),
        (PART, {}, "link 'base' is not in arm.urdf; it has no links"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_xacro_file_is_named(text: str, arguments, message: str, tmp_path, scratch) -> None:
    written(tmp_path / "arm_parts/joint.xacro", PART)
    with pytest.raises(RobotError, match=message):
        read_chain(plain_urdf(written(tmp_path / "arm.xacro", text), scratch, arguments), "base", "tool")


def test_a_urdf_has_no_arguments(tmp_path: Path, scratch: Path) -> None:
    with pytest.raises(RobotError, match=r"arm\.urdf is no xacro file: it has no argument height"):
        plain_urdf(written(tmp_path / "arm.urdf", '<robot name="arm"/>'), scratch, {"height": "1"})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is no URDF: it is empty"),
        (b"<robot>", "is no URDF: no element found"),
        (b"\xff\xfe\x00", "it is not text"),
        (b"<html/>", "its root element is <html>, expected <robot>"),
        (None, "No such file"),
        ("folder", "Is a directory"),
    ],
)
def test_what_is_no_urdf_is_named(content: bytes | str | None, message: str, tmp_path: Path, scratch: Path) -> None:
    file = tmp_path / "arm.urdf"
    if content == "folder":
        file.mkdir()
    elif content is not None:
        file.write_bytes(content)
    with pytest.raises(RobotError, match=f"arm.urdf.*{message}"):
        plain_urdf(file, scratch)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("meshes/a part.stl", "arm/robots/meshes/a part.stl"),
        ("file://{}/other/part.stl", "other/part.stl"),
        ("package://arm/meshes/part.stl", "arm/meshes/part.stl"),
        ("model://parts/part.stl", "parts/part.stl"),
        ("package://renamed/meshes/part.stl", "arm/meshes/part.stl"),
        ("package://far/part.stl", "other/far-1.0/part.stl"),
    ],
)
def test_meshes_are_found_by_path_and_by_package(name: str, place: str, tmp_path: Path, scratch: Path) -> None:
    """The control: without the file the mesh is named, and what says where it is."""
    file = written(tmp_path / "arm/robots/arm.urdf", MESH.format(name.format(tmp_path)))
    packages = {"far": tmp_path / "other/far-1.0"} if "far" in name else {}
    with pytest.raises(RobotError, match=r"mesh '.*part\.stl' of arm\.urdf is (not|in no)"):
        plain_urdf(file, scratch, packages=packages)
    mesh = written(tmp_path / place, "")
    write_mesh(hull_triangles(np.eye(4, 3)), mesh)
    root = ElementTree.parse(plain_urdf(file, scratch, packages=packages)).getroot()
    assert root.find("link/collision/geometry/mesh").get("filename") == str(mesh)


def test_velocities_are_written_where_there_are_none_and_where_they_are_wrong(tmp_path: Path, scratch: Path) -> None:
    written(tmp_path / "arm_parts/joint.xacro", PART.replace("<limit", "<limit2").replace("revolute", "continuous"))
    urdf = plain_urdf(written(tmp_path / "arm.xacro", XACRO), scratch)
    for velocity in (2.0, 3.0):
        limit_velocities(urdf, {"turn": velocity})
        np.testing.assert_array_equal(read_chain(urdf, "base", "tool").velocity, [velocity])
