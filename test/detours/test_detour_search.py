"""The search of detours: the base path where nothing obstructs it, the cheapest one around what is, or which part of
the arm cannot pass.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.arm_in_scene import ArmInScene, clearance_at
from geodesic_motion_ros.contract.settings import DETOUR_FELT_CLEARANCE, DETOUR_LARGEST_JOINT_STEP
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.detours.detour_frame import DetourFrame
from geodesic_motion_ros.detours.detour_search import (
    Lattice,
    cheapest_detour,
    move_length,
    nearness_factor,
    stretch,
)
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.geometry.shapes import solid_rows
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.posture import solve_displaced
from geodesic_motion_ros.robot.body_points import BodyPoints
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

PANDA, ARM = Robot.named("panda"), CollisionModel.named("panda")
MARGIN, REACH = 0.005, 0.22


def model_of(robot: Robot) -> CollisionModel:
    """Spheres of 5 cm along the links of the arm of six joints, or five; none is kept from another."""
    links, offsets = ["l3", "l3", "l4", "l5"], [[0, 0, 0.15], [0, 0, 0.0], [0, 0, 0.1], [0, 0, 0.1], [0, 0, 0.0]]
    links.append(robot.tool_link)
    frames = np.array([robot.link_names.index(link) for link in links])
    points = BodyPoints(tuple(links), frames, np.array(offsets, dtype=float))
    return CollisionModel(points, np.full(5, 0.05), np.ones(5, dtype=bool), np.empty((0, 2), dtype=np.int64))


def frame_along(robot: Robot) -> DetourFrame:
    """Beside a path on which the tool moves around the base by 2 rad."""
    count = len(robot.joint_names)
    middle = robot.ready if count == 7 else np.array([0.0, 0.4, 0.9, 0.3, 0.8, 0.1])[:count]
    path = middle + np.linspace(-1.0, 1.0, 60)[:, None] * np.eye(len(middle))[0]
    return DetourFrame.of_base_path(robot, path, np.zeros((60, 2)), np.zeros((60, 3, 3)))


FRAME = frame_along(PANDA)
MIDDLE = FRAME.positions[len(FRAME) // 2]


def of_kind(kind: str, centre: np.ndarray) -> Obstacles:
    if kind == "none":
        return Obstacles.none()
    if kind == "sphere":
        return Obstacles.of_spheres(centre[None], np.array([0.04]))
    if kind == "cloud":
        points = centre + np.random.default_rng(0).uniform(-0.03, 0.03, (400, 3))
        return replace(Obstacles.none(), cloud=DistanceField.of(points, 0.01, 0.005, 0.04))
    extents, radius = ([[0.03, 0.03, 0.05]], [0.0]) if kind == "box" else ([[0.0, 0.0, 0.05]], [0.03])
    solids = solid_rows(centre[None], np.eye(3)[None], np.array(extents), np.array(radius))
    return replace(Obstacles.none(), solids=solids, solid_velocities=np.zeros((1, 3)))


def arm_of(joints: int, six: Robot) -> tuple[Robot, CollisionModel]:
    """The Panda, the arm of six joints, or that without its last one."""
    if joints == 7:
        return PANDA, ARM
    robot = six if joints == 6 else Robot.from_urdf(six.urdf, "l0", "l5")
    return robot, model_of(robot)


def in_scene(obstacles: Obstacles, robot: Robot = PANDA, collision: CollisionModel = ARM) -> ArmInScene:
    return ArmInScene.of(robot, collision, obstacles)


def test_clearance_at_is_that_of_the_collision_model_up_to_what_is_asked_for() -> None:
    random = np.random.default_rng(3)
    obstacles = replace(
        of_kind("box", MIDDLE), centres=random.uniform(-0.7, 0.7, (6, 3)), radii=np.full(6, 0.05),
        velocities=np.zeros((6, 3)), cloud=of_kind("cloud", MIDDLE + 0.1).cloud, ages=np.zeros(6),
        velocity_errors=np.zeros(6),
    )  # fmt: skip
    arm = in_scene(obstacles)
    for q in PANDA.ready + random.uniform(-0.3, 0.3, (50, 7)):
        wanted, _ = obstacle_clearance(ARM, PANDA, q, obstacles)
        found = clearance_at(q, arm, 10.0)
        if np.isfinite(found):
            assert found == pytest.approx(wanted, abs=1e-9)
            assert clearance_at(q, arm, 0.01) == pytest.approx(min(wanted, 0.01), abs=1e-9)
    beyond = PANDA.ready.copy()
    beyond[3] = PANDA.upper[3] + 0.01
    assert clearance_at(beyond, arm, 1.0) == -np.inf


@pytest.mark.parametrize("joints", [7, 6, 5])
def test_without_obstacles_the_base_path_is_found_and_no_node_beside_it_looked_at(joints: int, six: Robot) -> None:
    robot, model = arm_of(joints, six)
    frame = frame_along(robot)
    path = cheapest_detour(frame, in_scene(Obstacles.none(), robot, model), REACH, MARGIN)
    np.testing.assert_array_equal(path.samples, np.arange(len(frame)))
    assert not np.any(path.displacements)
    assert not np.any(path.swivels)
    assert path.evaluated == len(frame) - 1
    assert path.cost == pytest.approx(frame.step * (len(frame) - 1))
    np.testing.assert_allclose(path.configurations, frame.configurations, atol=2e-5)


@pytest.mark.parametrize("kind", ["sphere", "box", "capsule", "cloud"])
@pytest.mark.parametrize("joints", [7, 6, 5])
def test_around_an_obstacle_all_nodes_and_middles_are_clear_and_hold_their_poses(kind, joints, six: Robot) -> None:
    robot, model = arm_of(joints, six)
    frame = frame_along(robot)
    arm = in_scene(of_kind(kind, frame.positions[len(frame) // 2]), robot, model)
    assert min(clearance_at(q, arm, 1.0) for q in frame.configurations) < 0.0
    path = cheapest_detour(frame, arm, REACH, MARGIN)
    assert not isinstance(path, Refusal), path
    between = [0.5 * (one + other) for one, other in pairwise(path.configurations)]
    for q in [*path.configurations, *between]:
        assert clearance_at(q, arm, 1.0) >= MARGIN
    assert np.max(np.abs(np.diff(path.configurations, axis=0))) <= DETOUR_LARGEST_JOINT_STEP
    assert np.max(np.linalg.norm(path.displacements, axis=1)) <= REACH + 1e-9
    assert np.all(np.diff(path.samples) >= 0)
    assert not np.any(path.displacements[[0, -1]])
    for sample, displacement, swivel, q in zip(
        path.samples, path.displacements, path.swivels, path.configurations, strict=True
    ):
        position, quaternion = robot.forward(q)
        np.testing.assert_allclose(position, frame.positions[sample] + displacement, atol=1e-5)
        if joints > 5:  # with fewer the tool turns as it must
            assert angle_between(quaternion, frame.quaternions[sample]) < 1e-5
        if joints == 7:
            off = frame.nulls[sample] @ (q - frame.configurations[sample])
            assert off == pytest.approx(swivel, abs=1e-5)


def cheapest_by_dijkstra(frame: DetourFrame, arm: ArmInScene, reach: float, margin: float) -> float:
    """The cost of the cheapest path where all nodes and all edges are worked out beforehand.

    A node's configuration follows from the base path by small steps of its displacement.
    """
    lattice = Lattice.of(len(frame), reach, False)
    middle, solved = lattice.side // 2, {}
    for t in range(len(frame)):
        for index in np.ndindex(*[lattice.side] * 3):
            displacement = lattice.spacing * (np.array(index) - middle)
            if np.linalg.norm(displacement) > reach * (1.0 + 1e-9):
                continue
            q, there = frame.configurations[t].copy(), True
            for share in np.linspace(0.25, 1.0, 4):
                there = there and solve_displaced(
                    frame.positions[t] + share * displacement, frame.quaternions[t], frame.nulls[t],
                    frame.configurations[t], 0.0, q, arm.chain,
                )  # fmt: skip
            clearance = clearance_at(q, arm, DETOUR_FELT_CLEARANCE) if there else -np.inf
            if clearance >= margin:
                price = nearness_factor(clearance) * stretch(frame.precisions[t], *displacement, 0.0)
                solved[(t, *index)] = (len(solved), q, price)
    rows, columns, weights = [], [], []
    for node, (number, q, price) in solved.items():
        for b, move in enumerate(lattice.moves):
            other = solved.get(tuple(np.array(node) + move[:4]))
            if other is None or np.max(np.abs(other[1] - q)) > DETOUR_LARGEST_JOINT_STEP:
                continue
            if clearance_at(0.5 * (q + other[1]), arm, margin) >= margin:
                rows.append(number)
                columns.append(other[0])
                weights.append(0.5 * (price + other[2]) * move_length(lattice.moves, b, frame.step, lattice))
    graph = coo_matrix((weights, (rows, columns)), shape=(len(solved), len(solved)))
    source, goal = (solved[(t, middle, middle, middle)][0] for t in (0, len(frame) - 1))
    return float(dijkstra(graph, indices=source)[goal])


@pytest.mark.parametrize("kind", ["sphere", "box"])
def test_it_costs_what_the_cheapest_of_all_paths_costs(kind, six: Robot) -> None:
    """With six joints a pose is reached in one configuration near the base path, however it is come to."""
    frame, model = frame_along(six), model_of(six)
    arm = in_scene(of_kind(kind, frame.positions[len(frame) // 2]), six, model)
    path = cheapest_detour(frame, arm, 0.2, MARGIN)
    assert not isinstance(path, Refusal), path
    assert path.cost == pytest.approx(cheapest_by_dijkstra(frame, arm, 0.2, MARGIN), rel=1e-6)


def test_a_wider_reach_and_a_smaller_margin_cost_no_more() -> None:
    arm = in_scene(of_kind("sphere", MIDDLE))
    near, wide = (cheapest_detour(FRAME, arm, reach, 0.0) for reach in (0.15, 0.30))
    # Displacements of 0.30 m are those of 0.15 m and more: both are of steps of 7.5 cm.
    assert not isinstance(wide, Refusal)
    assert isinstance(near, Refusal) or wide.cost <= near.cost + 1e-9
    kept = [cheapest_detour(FRAME, arm, REACH, margin).cost for margin in (0.0, 0.01, 0.03)]
    assert kept == sorted(kept)


def test_what_cannot_pass_is_named() -> None:
    def wall(centre: np.ndarray, half_extents: list[float]) -> ArmInScene:
        solids = solid_rows(centre[None], np.eye(3)[None], np.array([half_extents]), np.zeros(1))
        return in_scene(replace(Obstacles.none(), solids=solids, solid_velocities=np.zeros((1, 3))))

    across = wall(MIDDLE, [1.0, 0.02, 1.0])
    assert cheapest_detour(FRAME, across, REACH, MARGIN).reason == "the hand cannot pass"
    # The forearm's height, above the hand.
    elbow = PANDA.link_frames(FRAME.configurations[len(FRAME) // 2])[1][4]
    above = wall(np.array([*(0.5 * (elbow + MIDDLE))[:2], 0.95]), [0.3, 0.02, 0.33])
    assert cheapest_detour(FRAME, above, 0.08, MARGIN).reason == "the arm cannot pass"
