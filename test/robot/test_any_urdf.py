"""Arms as others describe them: what their URDFs leave out is named, and has what stands in for it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from geodesic_motion_ros.robot.collision_bodies import (
    beside_positions,
    collision_bodies,
    drawn_alone,
    read_mesh,
    write_mesh,
)
from geodesic_motion_ros.robot.convex_parts import hull_triangles
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.inertials import (
    DENSITY,
    complete_inertials,
    holding_strengths,
    joints_without_effort,
)
from geodesic_motion_ros.robot.kinematics import Robot, check_takes_poses
from geodesic_motion_ros.robot.making import Limits, make_robot
from geodesic_motion_ros.robot.mounting import is_upright, upward
from geodesic_motion_ros.robot.urdf import read_urdf
from geodesic_motion_ros.utils.errors import RobotError

BOX = '<{tag}><origin xyz="0 0 0.1"/><geometry><box size="0.06 0.06 0.18"/></geometry></{tag}>'
LIMIT = '<limit lower="-2" upper="2" velocity="1" effort="20"/>'


def joint(
    name: str, kind: str, parent: str, child: str, xyz: str = "0 0 0.2", extra: str = "", rpy: str = "0 0 0"
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{extra}</joint>'
    )


def arm(
    folder: Path, mounting: str = "0 0 0", limit: str = LIMIT, body: str = BOX.format(tag="collision"), beside: str = ""
) -> Robot:
    """An arm of three joints, one upright and two level, whose base is mounted on the link `world`."""
    axes = ("0 0 1", "0 1 0", "0 1 0")
    links = "".join(f'<link name="l{i}">{body}</link>' for i in range(4))
    joints = "".join(
        joint(f"j{i}", "revolute", f"l{i}", f"l{i + 1}", extra=f'<axis xyz="{axis}"/>{limit}')
        for i, axis in enumerate(axes)
    )
    mounted = joint("mount", "fixed", "world", "l0", "0 0 1", rpy=mounting)
    tool = joint("flange", "fixed", "l3", "tool")
    (folder / "arm.urdf").write_text(
        f'<robot name="arm"><link name="world"/><link name="tool"/>{links}{joints}{mounted}{tool}{beside}</robot>'
    )
    return Robot.from_urdf(folder / "arm.urdf", "l0", "tool")


def made(robot: Robot, out: Path, base: str = "l0"):
    return make_robot(robot.urdf, base, "tool", out, Limits((5.0,) * 3, (100.0,) * 3, "chosen for a test"))


@pytest.mark.parametrize(
    ("effort", "weak"), [('effort="20"', ()), ('effort="0"', ("j0", "j1", "j2")), ("", ("j0", "j1", "j2"))]
)
def test_joints_without_effort_are_named_and_their_strengths_hold_the_arm(effort, weak, tmp_path: Path) -> None:
    """At full stretch the second joint carries two bodies: it gets more than that takes, and not 30 times as much."""
    robot = arm(tmp_path, limit=LIMIT.replace('effort="20"', effort))
    root = read_urdf(robot.urdf)
    complete_inertials(root, robot.urdf)
    assert joints_without_effort(robot, root) == weak
    mass = DENSITY * 0.06 * 0.06 * 0.18
    needed = 9.81 * mass * (0.1 + 0.3)
    assert needed < holding_strengths(robot, root)[1] < 30.0 * needed


def test_links_without_masses_have_those_of_their_bodies(tmp_path: Path) -> None:
    """The control: a mass that is given stays; a frame alone weighs next to nothing."""
    given = '<inertial><mass value="3"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    robot = arm(tmp_path)
    robot.urdf.write_text(robot.urdf.read_text().replace('<link name="l2">', f'<link name="l2">{given}'))
    folder = made(robot, tmp_path / "made")
    assert folder.without_inertial == ("l0", "l1", "l3")
    root = ElementTree.parse(folder.folder / "arm.urdf")
    masses = {link.get("name"): float(link.find("inertial/mass").get("value")) for link in root.iter("link")}
    assert masses["l1"] == pytest.approx(DENSITY * 0.06 * 0.06 * 0.18, rel=1e-4)
    assert masses["l2"] == 3.0
    assert masses["tool"] == 0.001
    moments = root.find("link[@name='l1']/inertial/inertia")
    assert float(moments.get("ixx")) == pytest.approx(masses["l1"] / 12.0 * (0.06**2 + 0.18**2), rel=1e-4)


FINGER = joint("finger", "prismatic", "l3", "claw", extra='<axis xyz="1 0 0"/><limit lower="0.015" upper="0.037"/>')
OTHER = joint("other", "prismatic", "l3", "thumb", extra='<axis xyz="1 0 0"/><mimic joint="finger" multiplier="-1"/>')
HAND = f'<link name="claw">{BOX.format(tag="collision")}</link><link name="thumb"/>{FINGER}{OTHER}'


def test_fingers_stand_within_their_limits(tmp_path: Path) -> None:
    robot = arm(tmp_path, beside=HAND)
    assert beside_positions(robot) == {"finger": 0.015, "other": -0.015}
    assert beside_positions(robot, {"finger": 0.02}) == {"finger": 0.02, "other": -0.02}
    claw = next(body for body in collision_bodies(robot) if body.name == "claw")
    assert claw.vertices.mean(axis=0)[0] == pytest.approx(0.015)
    folder = made(robot, tmp_path / "made")
    assert folder.beside == {"finger": 0.015, "other": -0.015}
    assert dict(RobotDescription.read(folder.folder).simulated_joints) == folder.beside
    with pytest.raises(RobotError, match=r"joint 'finger' is to stand at 0\.05: its limits are \[0\.015, 0\.037\]"):
        beside_positions(robot, {"finger": 0.05})
    with pytest.raises(RobotError, match="joint 'j1' is not beside the chain"):
        beside_positions(robot, {"j1": 0.0})


def test_a_second_arm_stands_beside_the_chain(tmp_path: Path) -> None:
    """What is not carried by the base link, as another robot of the cell, is not."""
    second = f'<link name="r1">{BOX.format(tag="collision")}</link><link name="away"/>' + joint(
        "right", "revolute", "l0", "r1", "0.5 0 0", f'<axis xyz="0 1 0"/>{LIMIT}'
    ) + joint("far", "revolute", "world", "away", "2 0 0", f'<axis xyz="0 1 0"/>{LIMIT}')
    robot = arm(tmp_path, beside=second)
    assert beside_positions(robot) == {"right": 0.0}
    assert "r1" in {body.name for body in collision_bodies(robot)}


def test_what_is_drawn_but_does_not_collide_is_named(tmp_path: Path) -> None:
    seen = f'<link name="cover">{BOX.format(tag="visual")}</link>{joint("c", "fixed", "l2", "cover")}'
    assert drawn_alone(arm(tmp_path, beside=seen)) == ("cover",)
    assert drawn_alone(arm(tmp_path)) == ()


@pytest.mark.parametrize(
    ("rpy", "up", "upright"),
    [("0 0 0", (0, 0, 1), True), ("0 0 1.2", (0, 0, 1), True), ("0 1.5708 0", (-1, 0, 0), False),
     ("3.14159265 0 0", (0, 0, -1), False)],
)  # fmt: skip
def test_a_mounting_is_read_from_the_joints_below_the_base(rpy, up, upright: bool, tmp_path: Path) -> None:
    robot = arm(tmp_path, mounting=rpy)
    np.testing.assert_allclose(upward(robot.urdf, "l0"), up, atol=1e-5)
    assert is_upright(robot) == upright
    assert is_upright(Robot.from_urdf(robot.urdf, "world", "tool")) == upright


def test_an_arm_on_a_ceiling_has_a_ready_posture_below_it_or_the_refusal_says_so(tmp_path: Path) -> None:
    robot = arm(tmp_path, mounting="3.14159265 0 0")
    folder = made(robot, tmp_path / "made", base="world")
    hung = Robot.named(folder.folder)
    assert hung.forward(hung.ready)[0][2] < 1.0 - 0.1 * hung.reach
    bent = LIMIT.replace("-2", "1.9")  # its tool comes near the ceiling in every posture
    robot = arm(tmp_path, mounting="3.14159265 0 0", limit=bent)
    with pytest.raises(RobotError, match="away from what the arm is mounted on, by 180 deg against 'world'"):
        made(robot, tmp_path / "bent", base="world")


def test_only_what_stands_on_a_table_is_covered_finely_near_it(tmp_path: Path) -> None:
    """The body that the first joint turns is 5 mm above the base frame's z = 0."""
    low = '<collision><origin xyz="0 0 -0.1"/><geometry><cylinder radius="0.05" length="0.19"/></geometry></collision>'
    radii = {}
    for rpy in ("0 0 0", "0 1.5708 0"):
        robot = arm(tmp_path, mounting=rpy)
        text = robot.urdf.read_text().replace(BOX.format(tag="collision"), low)
        robot.urdf.write_text(text)
        spheres = make_robot(
            robot.urdf, "l0", "tool", tmp_path / f"made {rpy}", Limits((5.0,) * 3, (100.0,) * 3, "chosen"),
            ready=(0.3, 0.5, 0.5),
        ).spheres["l1"]  # fmt: skip
        radii[rpy] = np.max(spheres[:, 3])
    assert radii["0 0 0"] < radii["0 1.5708 0"]


def test_a_mirrored_mesh_has_mirrored_spheres_and_normals_outward(tmp_path: Path) -> None:
    """An L, not symmetric, on two links; the left arm's meshes are the right one's with a negative scale."""
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    boxes = [hull_triangles(corners * [90, 60, 30]), hull_triangles(corners * [30, 60, 130] + [0, 0, 30])]
    write_mesh(np.concatenate(boxes) - [15, 20, 0], tmp_path / "bent.stl")
    spheres = []
    for scale in ("0.001 0.001 0.001", "0.001 -0.001 0.001"):
        mesh = f'<collision><geometry><mesh filename="bent.stl" scale="{scale}"/></geometry></collision>'
        folder = made(arm(tmp_path, body=mesh), tmp_path / f"made {scale}")
        spheres.append(folder.spheres)
        for file in (folder.folder / "meshes").iterdir():
            triangles = read_mesh(file)
            outward = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            away = triangles.mean(axis=1) - triangles.reshape(-1, 3).mean(axis=0)
            assert np.all(np.einsum("ij,ij->i", outward, away) > 0.0)
    for link, right in spheres[0].items():
        left = spheres[1][link]
        assert len(left) == len(right)
        assert np.sum(left[:, 3]) == pytest.approx(np.sum(right[:, 3]), rel=0.02)
        assert np.sum(left[:, 1]) == pytest.approx(-np.sum(right[:, 1]), abs=0.005 * len(right))


def test_an_arm_of_fewer_than_six_joints_is_refused_for_skills_of_poses(tmp_path: Path) -> None:
    check_takes_poses(Robot.named("ur5"))
    with pytest.raises(RobotError, match="needs an arm of six joints or more, to 'tool' there are 3: teach j0, j1, j2"):
        check_takes_poses(arm(tmp_path))
