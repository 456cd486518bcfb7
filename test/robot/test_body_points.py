"""Body points against PyBullet, pytorch-kinematics and finite differences; levers that no configuration exceeds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet_data
import pytest

from geodesic_motion_ros.robot.body_points import (
    BodyPoints,
    body_point_jacobians,
    end_effector_poses,
    lever_bounds,
    place_body_points,
    points_along_links,
)
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.physics_client import PhysicsClient
from geodesic_motion_ros.utils.errors import RobotError

PANDA_URDF = Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf"
CRANE = """<robot name="crane">
  <link name="base"/><link name="mast"/><link name="boom"/><link name="trolley"/><link name="hook"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="mast"/>
    <origin xyz="0.1 0 1" rpy="0.3 0.2 0.1"/><axis xyz="0 1 1"/><limit velocity="1.5" effort="1"/></joint>
  <joint name="lift" type="revolute"><parent link="mast"/><child link="boom"/>
    <origin xyz="0 0.2 0.2" rpy="0 0.4 0"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="2" velocity="1" effort="1"/></joint>
  <joint name="push" type="prismatic"><parent link="boom"/><child link="trolley"/>
    <origin xyz="0.2 0.1 0" rpy="0 0.4 0"/><axis xyz="1 0 0"/>
    <limit lower="0.1" upper="0.6" velocity="0.2" effort="1"/></joint>
  <joint name="mount" type="fixed"><parent link="trolley"/><child link="hook"/>
    <origin xyz="0.1 0 -0.2" rpy="0.5 0 0"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def panda() -> Robot:
    return Robot.named("panda")


@pytest.fixture(params=["panda", "crane"])
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    if request.param == "panda":
        return Robot.named("panda")
    path = tmp_path / "crane.urdf"
    path.write_text(CRANE)
    return Robot.from_urdf(path, "base", "hook")


def scattered(robot: Robot, count: int = 20) -> BodyPoints:
    """Random points all over the arm, beside those that `BodyPoints.of` finds."""
    generator = np.random.default_rng(1)
    links = generator.choice(robot.link_names, count)
    extra = {link: generator.uniform(-0.2, 0.2, (np.sum(links == link), 3)) for link in np.unique(links)}
    return BodyPoints.of(robot, extra)


def place(robot: Robot, points: BodyPoints, configurations: np.ndarray) -> np.ndarray:
    return place_body_points(configurations, points.frames, points.offsets, robot.chain)


def test_the_panda_has_six_points_that_differ(panda: Robot) -> None:
    points = BodyPoints.of(panda)
    joints = [f"panda_joint{number}" for number in (1, 3, 4, 5, 7)]
    assert points.names == (*joints, "panda_grasptarget")
    assert len(points) == 6
    assert [panda.link_names[frame] for frame in points.frames[:-1]] == [
        name.replace("joint", "link") for name in joints
    ]


def test_a_frame_left_out_is_always_where_another_is(panda: Robot) -> None:
    """Joints 2 and 6 turn about axes through the origins of 1 and 5, whatever the configuration; no other pair does."""
    links = [link for link in panda.link_names if link.startswith("panda_link")][1:8]
    origins = BodyPoints.of(panda, {link: [(0.0, 0.0, 0.0)] for link in links})
    placed = place(panda, origins, panda.sample(50, np.random.default_rng(2)))[:, -7:]
    apart = np.linalg.norm(placed[:, :, None] - placed[:, None], axis=-1).max(axis=0)
    together = {(i + 1, j + 1) for i in range(7) for j in range(i) if apart[i, j] < 1e-9}
    assert together == {(2, 1), (6, 5)}


def test_a_joint_on_a_slider_is_a_point_of_its_own(tmp_path: Path) -> None:
    """Same origin at zero, but the slider takes one of the two away."""
    path = tmp_path / "crane.urdf"
    path.write_text(CRANE.replace('<origin xyz="0.2 0.1 0" rpy="0 0.4 0"/>', ""))
    assert BodyPoints.of(Robot.from_urdf(path, "base", "hook")).names == ("turn", "lift", "push", "hook")


def test_points_along_links_are_named_after_them(panda: Robot) -> None:
    points = BodyPoints.of(panda, {"panda_link4": [(0.0, 0.1, 0.0), (0.0, 0.2, 0.0)]})
    assert points.names[-2:] == ("panda_link4 0", "panda_link4 1")
    np.testing.assert_array_equal(points.offsets[-2:], [(0.0, 0.1, 0.0), (0.0, 0.2, 0.0)])


def test_long_links_have_points_no_farther_apart_than_asked(panda: Robot) -> None:
    """On the straight line between the joint origins at the link's two ends; short links have none."""
    found = points_along_links(panda, 0.1)
    assert list(found) == ["panda_link2", "panda_link4", "panda_link7", "panda_hand"]
    for link, end in (("panda_link2", (0.0, -0.316, 0.0)), ("panda_link4", (-0.0825, 0.384, 0.0))):
        line = np.array([(0.0, 0.0, 0.0), *found[link], end])
        steps = np.diff(line, axis=0)
        np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-12)
        assert 0.05 < np.linalg.norm(steps[0]) <= 0.1


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ({"elbow": [(0, 0, 0)]}, r"'elbow'.*panda_link0, .*panda_grasptarget"),
        ({"panda_link4": [(0, 0)]}, r"'panda_link4' have shape \(1, 2\)"),
        ({"panda_link4": [(0, 0, np.inf)]}, "'panda_link4'.*finite"),
        ({"panda_link4": [(0, 0, "x")]}, "'panda_link4' are no numbers"),
    ],
)
def test_points_that_do_not_fit_are_named(panda: Robot, extra: dict, message: str) -> None:
    with pytest.raises(RobotError, match=message):
        BodyPoints.of(panda, extra)


def test_points_are_where_their_link_frames_take_them(robot: Robot) -> None:
    points = scattered(robot)
    configurations = robot.sample(50, np.random.default_rng(3))
    for q, placed in zip(configurations, place(robot, points, configurations), strict=True):
        rotations, origins = robot.link_frames(q)
        expected = np.einsum("kij,kj->ki", rotations[points.frames], points.offsets) + origins[points.frames]
        np.testing.assert_allclose(placed, expected, atol=1e-12)


def test_joint_frames_agree_with_pytorch_kinematics(panda: Robot) -> None:
    torch = pytest.importorskip("torch")
    pytorch_kinematics = pytest.importorskip("pytorch_kinematics")
    chain = pytorch_kinematics.build_serial_chain_from_urdf(PANDA_URDF.read_bytes(), "panda_grasptarget")
    configurations = panda.sample(50, np.random.default_rng(4))
    frames = chain.to(dtype=torch.float64).forward_kinematics(torch.tensor(configurations), end_only=False)
    points = scattered(panda)
    placed = place(panda, points, configurations)
    for k, (frame, offset) in enumerate(zip(points.frames, points.offsets, strict=True)):
        theirs = frames[panda.link_names[frame]].get_matrix().numpy() @ np.append(offset, 1.0)
        np.testing.assert_allclose(placed[:, k], theirs[:, :3], atol=1e-6)


def test_jacobians_are_the_derivatives_of_the_positions(robot: Robot) -> None:
    points, step = scattered(robot), 1e-5
    configurations = robot.sample(20, np.random.default_rng(5))
    jacobians = body_point_jacobians(configurations, points.frames, points.offsets, robot.chain)
    assert jacobians.shape == (20, len(points), 3, len(robot.joint_names))
    for joint, shift in enumerate(step * np.eye(len(robot.joint_names))):
        after, before = (place(robot, points, configurations + sign * shift) for sign in (1.0, -1.0))
        np.testing.assert_allclose(jacobians[..., joint], (after - before) / (2.0 * step), atol=1e-8)


def test_jacobians_agree_with_pybullet(panda: Robot) -> None:
    points = scattered(panda)
    client = PhysicsClient()
    try:
        arm = client.loadURDF(str(PANDA_URDF), useFixedBase=True)
        infos = [client.getJointInfo(arm, index) for index in range(client.getNumJoints(arm))]
        links = {info[12].decode(): info[0] for info in infos}
        for q in panda.sample(10, np.random.default_rng(6)):
            ours = body_point_jacobians(q[None], points.frames, points.offsets, panda.chain)[0]
            for jacobian, frame, offset in zip(ours, points.frames, points.offsets, strict=True):
                if frame == 0:
                    np.testing.assert_array_equal(jacobian, 0.0)
                    continue
                link = links[panda.link_names[frame]]
                rest = [0.0] * 9
                linear, _ = client.calculateJacobian(arm, link, offset.tolist(), [*q.tolist(), 0.0, 0.0], rest, rest)
                np.testing.assert_allclose(jacobian, np.array(linear)[:, :7], atol=1e-6)
    finally:
        client.disconnect()


def test_end_effector_poses_are_those_of_the_single_kernel(robot: Robot) -> None:
    configurations = robot.sample(100, np.random.default_rng(7))
    positions, quaternions = end_effector_poses(configurations, robot.chain)
    for q, position, quaternion in zip(configurations, positions, quaternions, strict=True):
        expected_position, expected_quaternion = robot.forward(q)
        np.testing.assert_allclose(position, expected_position, atol=1e-12)
        assert abs(quaternion @ expected_quaternion) == pytest.approx(1.0, abs=1e-12)


def axis_distances(robot: Robot, points: BodyPoints, q: np.ndarray) -> np.ndarray:
    """Distances (eta, K) [m] of points from the joints' axes; zero where the joint comes after the point."""
    rotations, origins = robot.link_frames(q)
    placed = place(robot, points, q[None])[0]
    rows = np.flatnonzero(robot.chain[3] >= 0)
    distances = np.zeros((len(rows), len(points)))
    for joint, row in enumerate(rows):
        axis = rotations[row + 1] @ robot.chain[2][row]
        moved = points.frames > row
        distances[joint, moved] = np.linalg.norm(np.cross(axis, placed[moved] - origins[row + 1]), axis=1)
    return distances


def test_no_configuration_exceeds_the_levers_and_some_come_near(robot: Robot) -> None:
    points = scattered(robot)
    levers = lever_bounds(robot, points.frames, points.offsets)
    turning = ~robot.chain[4][robot.chain[3] >= 0]
    generator = np.random.default_rng(8)
    # revolute joints throughout: the bounds do not rest on their limits
    configurations = robot.sample(3000, generator)
    configurations[:, turning] = generator.uniform(-np.pi, np.pi, (3000, np.sum(turning)))
    largest = np.max([axis_distances(robot, points, q) for q in configurations], axis=0)[turning]
    assert np.all(largest <= levers[turning] + 1e-12)
    assert np.all(levers[turning] <= 1.5 * largest + 1e-6)


def test_levers_bound_the_jacobians(robot: Robot) -> None:
    points = scattered(robot)
    levers = lever_bounds(robot, points.frames, points.offsets)
    configurations = robot.sample(300, np.random.default_rng(9))
    jacobians = body_point_jacobians(configurations, points.frames, points.offsets, robot.chain)
    speeds = np.linalg.norm(jacobians, axis=2).max(axis=0).T
    assert np.all(speeds <= levers + 1e-12)
    np.testing.assert_array_equal(speeds > 1e-9, levers > 1e-9)
    prismatic = robot.chain[4][robot.chain[3] >= 0]
    assert set(np.unique(levers[prismatic])) <= {0.0, 1.0}


def test_levers_of_a_wrist_are_exact(panda: Robot) -> None:
    """Axes 5 and 6 cross; a point on axis 7 is 88 mm beside axis 6 and 212 mm along axis 7 from its foot."""
    points = BodyPoints.of(panda)
    levers = lever_bounds(panda, points.frames, points.offsets)[:, -1]
    np.testing.assert_allclose(levers[[4, 5]], np.hypot(0.088, 0.107 + 0.105), atol=1e-12)
    assert levers[6] == pytest.approx(0.0, abs=1e-12)
