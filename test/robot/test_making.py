"""A folder out of a URDF: it covers what collides, and is a robot; what is missing is named."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from geodesic_motion_ros.robot import making
from geodesic_motion_ros.robot.collision_bodies import Body, collision_bodies, read_mesh, write_mesh
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance, tool_spheres
from geodesic_motion_ros.robot.convex_parts import hull_triangles
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.making import Limits, cover_bodies, make_robot
from geodesic_motion_ros.robot.self_pairs import draw_self_pairs, separated
from geodesic_motion_ros.robot.sphere_cover import MESH_MARGIN, PROTRUSION
from geodesic_motion_ros.utils.errors import ParameterError, RobotError

BOX = '<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>'
ARM = f"""<robot name="crane">
  <link name="foot">{BOX.format(at="0 0 0.05", size="0.1 0.1 0.1")}</link>
  <link name="mast"><collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.2"/></geometry>
    </collision></link>
  <link name="boom"><collision><origin xyz="0.1 0 0"/><geometry><mesh filename="meshes/boom.stl" scale="2 1 1"/>
    </geometry></collision></link>
  <link name="jib">{BOX.format(at="0.075 0 0", size="0.15 0.05 0.05")}</link>
  <link name="hook"><collision><geometry><sphere radius="0.04"/></geometry></collision></link>
  <link name="claw">{BOX.format(at="0 0 0", size="0.02 0.04 0.06")}</link>
  <joint name="turn" type="revolute"><parent link="foot"/><child link="mast"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="luff" type="revolute"><parent link="mast"/><child link="boom"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 -1 0"/><limit lower="-0.5" upper="1.5" velocity="1" effort="1"/></joint>
  <joint name="bend" type="continuous"><parent link="boom"/><child link="jib"/><origin xyz="0.2 0 0"/>
    <axis xyz="0 1 0"/><limit velocity="1" effort="1"/></joint>
  <joint name="slew" type="revolute"><parent link="jib"/><child link="hook"/><origin xyz="0.18 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="grip" type="prismatic"><parent link="hook"/><child link="claw"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.2" velocity="1" effort="1"/></joint>
</robot>"""
#: The boom and the jib alone have bodies.
SLIGHT = re.sub(r'<link name="(foot|mast|hook|claw)">.*?</link>', r'<link name="\1"/>', ARM, flags=re.DOTALL)
READY = (0.0, 1.0, 1.5, 0.0)
LIMITS = Limits((5.0,) * 4, (500.0,) * 4, "chosen for a test")


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    (tmp_path / "meshes").mkdir()
    corners = [(x, y, z) for x in (-0.05, 0.05) for y in (-0.025, 0.025) for z in (-0.03, 0.03)]
    write_mesh(hull_triangles(np.array(corners)), tmp_path / "meshes/boom.stl")
    (tmp_path / "crane.urdf").write_text(ARM)
    return tmp_path / "crane.urdf"


def test_the_folder_is_a_robot_whose_spheres_hold_all_that_collides(urdf: Path, tmp_path: Path) -> None:
    made = make_robot(urdf, "foot", "hook", tmp_path / "crane", LIMITS, beside={"grip": 0.1})
    assert made.farthest_outside() <= 0.0
    robot, model = Robot.named(made.folder), CollisionModel.named(made.folder)
    assert robot.joint_names == ("turn", "luff", "bend", "slew")
    assert self_clearance(model, robot, robot.ready)[0] > 0.0
    assert len(tool_spheres(made.folder)) == len(made.spheres["hook"])
    # The claw is where its joint puts it, and belongs to the hook.
    claw = next(body for body in made.bodies if body.name == "claw")
    assert claw.link == "hook"
    np.testing.assert_allclose(claw.vertices.mean(axis=0), [0.1, 0.0, 0.0], atol=1e-12)


def test_the_hand_is_the_last_body_where_it_moves_with_the_tip(urdf: Path, tmp_path: Path) -> None:
    """A tip whose joint turns it against the last body has none. The control: a bare tip that is fixed to it."""
    for kind, hand in (("revolute", None), ("fixed", "jib")):
        urdf.write_text(SLIGHT.replace('"slew" type="revolute"', f'"slew" type="{kind}"'))
        count = 4 if hand is None else 3
        limits = Limits((5.0,) * count, (500.0,) * count, "chosen for a test")
        make_robot(urdf, "foot", "hook", tmp_path / kind, limits, ready=READY[:count])
        assert RobotDescription.named(tmp_path / kind).hand == hand


def test_bodies_that_do_meet_are_kept_apart(urdf: Path, tmp_path: Path) -> None:
    """The control: bent back, the jib passes through the mast; links of one joint are never compared."""
    made = make_robot(urdf, "foot", "hook", tmp_path / "crane", LIMITS)
    pairs = {pair.links for pair in made.pairs}
    assert ("mast", "jib") in pairs
    assert ("mast", "boom") not in pairs
    robot, model = Robot.named(made.folder), CollisionModel.named(made.folder)
    assert self_clearance(model, robot, np.array([0.0, -0.4, 2.6, 0.0]))[0] < 0.0


def test_bodies_that_always_meet_are_not_kept_apart(urdf: Path) -> None:
    """No posture would be left. The control: a body that the jib meets in some."""
    robot = Robot.from_urdf(urdf, "foot", "hook")
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    jib = 0.02 * corners + [0.1, 0.0, 0.0]
    for size, always in ((0.5, True), (0.12, False)):
        bodies = [Body("mast", "mast", size * corners), Body("jib", "jib", jib)]
        spheres = {"mast": np.array([[0, 0, 0, 2.0 * size]]), "jib": np.array([[0.1, 0, 0, 0.04]])}
        (pair,) = draw_self_pairs(robot, spheres, bodies, draws=400)
        assert pair.links == ("mast", "jib")
        assert (pair.spheres == ()) == always


@pytest.mark.parametrize("gap", [0.001, 0.02])
def test_bodies_are_separated_by_less_than_their_distance(gap: float) -> None:
    """The control: by more they are not."""
    generator = np.random.default_rng(0)
    one = generator.uniform(-0.1, 0.1, (40, 3))
    other = generator.uniform(-0.1, 0.1, (40, 3))
    other[:, 0] += one[:, 0].max() - other[:, 0].min() + gap
    assert separated(one, other, 0.9 * gap)
    assert not separated(one, one + [0.01, 0.0, 0.0], 0.0)
    assert not separated(one, other, 2.0 * gap + 0.2)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("meshes/boom.stl", "meshes/jib.stl", r"mesh .*meshes/jib\.stl cannot be read"),
        ('scale="2 1 1"', 'scale="2000 1000 1000"', r"link 'boom' is 200 m large, no arm is: a mesh in millimetres"),
        ("<collision>", "<visual>", r"crane\.urdf has no <collision>"),
        ('<box size="0.15 0.05 0.05"/>', '<box size="0.15 0.05 0"/>', "link 'jib' is flat"),
        ('<sphere radius="0.04"/>', '<cone radius="0.04"/>', "link 'hook' is a <cone>: known are mesh, box"),
        ('type="continuous"', 'type="floating"', "joint 'bend' is of type 'floating'"),
        ('"bend" type="continuous">', '"bend" type="continuous"><mimic joint="luff"/>', "joint 'bend' mimics 'luff'"),
        ('<joint name="slew" type="revolute">', '<joint name="slip" type="revolute">', None),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(urdf: Path, tmp_path: Path, before: str, after: str, message: str | None) -> None:
    text = ARM.replace(before, after)
    urdf.write_text(text.replace("</collision>", "</visual>") if after == "<visual>" else text)
    if message is None:
        assert "slip" in Robot.from_urdf(urdf, "foot", "hook").joint_names
        return
    with pytest.raises(RobotError, match=message):
        make_robot(urdf, "foot", "hook", tmp_path / "crane", LIMITS)
    assert not (tmp_path / "crane").exists()


def test_links_that_are_far_from_the_rest_are_named(urdf: Path, tmp_path: Path) -> None:
    """The jib's body as if in another frame, 0.5 m beside its place. The control: the arm as it is."""
    assert make_robot(urdf, "foot", "hook", tmp_path / "whole", LIMITS, ready=READY).adrift() == {}
    urdf.write_text(ARM.replace('<origin xyz="0.075 0 0"/>', '<origin xyz="0.075 0.5 0"/>'))
    adrift = make_robot(urdf, "foot", "hook", tmp_path / "torn", LIMITS, ready=READY).adrift()
    # Both bodies are 0.05 m wide, and spheres of both stick out of them.
    assert 0.45 - 2 * (PROTRUSION + MESH_MARGIN + 3e-4) < adrift["jib"] <= 0.45
    assert not {"foot", "mast", "boom"} & set(adrift)


def test_what_turns_just_above_its_table_is_covered_finely(urdf: Path, tmp_path: Path) -> None:
    """Spheres of a thick mast stick out of it by half. The control: with room below, by more than that."""
    below = {}
    for middle in (-0.055, 0.1):
        mast = f'<origin xyz="0 0 {middle}"/><geometry><cylinder radius="0.05" length="0.08"/>'
        urdf.write_text(ARM.replace('<origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.2"/>', mast))
        made = make_robot(urdf, "foot", "hook", tmp_path / str(middle), LIMITS, ready=READY)
        below[middle] = np.min(made.spheres["mast"][:, 2] - made.spheres["mast"][:, 3]) - (middle - 0.04)
    assert below[0.1] < -0.5 * PROTRUSION - 0.002 < below[-0.055]


def test_where_spheres_raise_many_false_alarms_the_arm_is_covered_finely(urdf: Path, tmp_path: Path) -> None:
    """As if of every pair of links there were many. The control: this arm has few."""
    overlapping, spheres = [], []
    for most in (1.0, -1.0):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(making, "FALSE_ALARMS", most)
            made = make_robot(urdf, "foot", "hook", tmp_path / str(most), LIMITS)
        assert made.farthest_outside() <= 0.0
        overlapping.append(sum(pair.overlapping for pair in made.pairs))
        spheres.append(np.max(made.spheres["mast"][:, 3]))
    assert overlapping[1] < overlapping[0]
    assert spheres[1] < spheres[0]


def test_a_large_body_is_covered_by_spheres_that_stick_out_more(urdf: Path, monkeypatch) -> None:
    """As a mobile base, for which centres as near to each other as of an arm fill the memory. The control: a link."""
    monkeypatch.setattr(making, "MOST_CENTRES", 400)
    robot = Robot.from_urdf(urdf, "foot", "hook")
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for size, larger in ((1.0, True), (0.06, False)):
        box = size * corners * [1.0, 0.8, 0.4]
        spheres = cover_bodies(robot, [Body("foot", "foot", box)])["foot"]
        gaps = np.linalg.norm(box[:, None] - spheres[:, :3], axis=2) - spheres[:, 3]
        assert np.all(gaps.min(axis=1) <= 0.0)
        out = np.max(np.abs(spheres[:, :3]) + spheres[:, 3:] - box.max(axis=0))
        assert (out > 0.1) == larger
        assert len(spheres) < 100


def test_nothing_is_written_over_what_exists(urdf: Path, tmp_path: Path) -> None:
    for place in (tmp_path / "meshes", urdf):
        with pytest.raises(ParameterError, match="exists and is no empty folder"):
            make_robot(urdf, "foot", "hook", place, LIMITS)
    with pytest.raises(ParameterError, match=r"crane\.urdf/arm cannot be made"):
        make_robot(urdf, "foot", "hook", urdf / "arm", LIMITS)
    assert urdf.read_text() == ARM


def test_a_folder_that_could_not_be_read_is_not_left(urdf: Path, tmp_path: Path) -> None:
    urdf.write_text(SLIGHT)
    with pytest.raises(RobotError, match=r"limits_source is 'two\\nlines'"):
        make_robot(urdf, "foot", "hook", tmp_path / "crane", replace(LIMITS, source="two\nlines"), ready=READY)
    assert not (tmp_path / "crane").exists()


def test_a_joint_of_the_chain_is_not_beside_it(urdf: Path) -> None:
    robot = Robot.from_urdf(urdf, "foot", "hook")
    with pytest.raises(RobotError, match="joint 'luff' is not beside the chain in crane"):
        collision_bodies(robot, {"luff": 0.1})


def bent(size: float = 0.2, thickness: float = 0.04) -> np.ndarray:
    """Triangles (24, 3, 3) [m] of two boxes that stand on each other's ends at a right angle."""
    boxes = [[size, thickness, thickness], [thickness, thickness, size]]
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.concatenate([hull_triangles(corners * box) for box in boxes])


def test_a_bent_mesh_is_kept_as_its_convex_parts(urdf: Path, tmp_path: Path) -> None:
    """What its hull would fill stays free. The control: the same arm with the hull in the mesh's place."""
    poked = np.array([0.1, 0.02, 0.13])
    for name, triangles in {"bent": bent(), "filled": hull_triangles(bent().reshape(-1, 3))}.items():
        write_mesh(triangles, tmp_path / "meshes/boom.stl")
        made = make_robot(urdf, "foot", "hook", tmp_path / name, LIMITS, ready=READY)
        assert made.farthest_outside() <= 0.0
        parts = sorted(file.name for file in (tmp_path / name / "meshes").iterdir())
        assert parts == (["boom_1.stl", "boom_2.stl"] if name == "bent" else ["boom_1.stl"])
        boom = made.spheres["boom"]
        in_link = poked * [2.0, 1.0, 1.0] + [0.1, 0.0, 0.0]
        held = np.any(np.linalg.norm(boom[:, :3] - in_link, axis=1) < boom[:, 3])
        assert held == (name == "filled")


def test_meshes_of_one_name_in_two_folders_stay_two(urdf: Path, tmp_path: Path) -> None:
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    (tmp_path / "jib").mkdir()
    write_mesh(hull_triangles(0.03 * corners), tmp_path / "jib/boom.stl")
    box = '<box size="0.15 0.05 0.05"/>'
    assert box in SLIGHT
    urdf.write_text(SLIGHT.replace(box, '<mesh filename="jib/boom.stl"/>'))
    made = make_robot(urdf, "foot", "hook", tmp_path / "crane", LIMITS, ready=READY)
    sizes = {body.name: np.ptp(body.vertices, axis=0) for body in made.bodies}
    np.testing.assert_allclose(sizes["boom"], [0.2, 0.05, 0.06], atol=1e-6)
    np.testing.assert_allclose(sizes["jib"], 0.06, atol=1e-6)


def test_meshes_are_read_in_their_formats(tmp_path: Path) -> None:
    triangles = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]]], dtype="<f4")
    rows = [b"\0" * 12 + triangle.tobytes() + b"\0\0" for triangle in triangles]
    (tmp_path / "binary.stl").write_bytes(b"\0" * 80 + len(rows).to_bytes(4, "little") + b"".join(rows))
    corners = [" ".join(map(str, corner)) for corner in triangles.reshape(-1, 3)]
    facets = [
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {corner}\n" for corner in three) + "endloop\nendfacet\n"
        for three in (corners[:3], corners[3:])
    ]
    (tmp_path / "text.stl").write_text(f"solid two\n{''.join(facets)}endsolid two\n")
    vertices = "".join(f"v {corner}\n" for corner in corners)
    (tmp_path / "counted.obj").write_text(f"# two\n{vertices}\nf 1/7 2/7 3/7\nf 4//1 5//1 6//1\n")
    (tmp_path / "back.obj").write_text(f"{vertices}f -6 -5 -4\nf -3 -2 -1\n")
    write_mesh(triangles, tmp_path / "written.stl")
    for name in ("binary.stl", "text.stl", "counted.obj", "back.obj", "written.stl"):
        np.testing.assert_array_equal(read_mesh(tmp_path / name), triangles)
    (tmp_path / "square.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    assert read_mesh(tmp_path / "square.obj").shape == (2, 3, 3)
    for broken in ("v 0 0 0\nf 1 2 3\n", "v 0 0\nv 1 0 0\n", "v 0 0 0\n"):
        (tmp_path / "broken.obj").write_text(broken)
        with pytest.raises(RobotError, match=r"mesh .*broken\.obj (cannot be read|holds no body)"):
            read_mesh(tmp_path / "broken.obj")
    for broken in ("mesh.dae", "mesh.stl", "mesh.step", "mesh"):
        (tmp_path / broken).write_bytes(b"\xff" * 300)
        # With a library at hand that guesses encodings the text of an .stl is read, and there is nothing in it.
        with pytest.raises(RobotError, match=rf"mesh .*{broken} (cannot be read .*: convert it to STL|holds no body)"):
            read_mesh(tmp_path / broken)


@pytest.mark.parametrize(("unit", "metres"), [("meter", 1.0), ("centimeter", 0.01)])
def test_dae_is_read_in_its_own_unit_whichever_axis_it_calls_up(unit: str, metres: float, tmp_path: Path) -> None:
    triangles = hull_triangles(np.eye(4, 3))
    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles), process=False)
    text = mesh.export(file_type="dae").decode()
    asset = f'<unit name="{unit}" meter="{metres}"/><up_axis>Y_UP</up_axis>'
    text = re.sub(r"<unit [^>]*/>|<up_axis>.*</up_axis>", "", text).replace("</asset>", f"{asset}</asset>")
    (tmp_path / "part.dae").write_text(text)
    np.testing.assert_allclose(read_mesh(tmp_path / "part.dae"), metres * triangles, atol=1e-9)
