"""The meshes are those of the twin, where they should be."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.description import RobotDescription, shipped_robots
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.utils.errors import RobotError
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry


@pytest.fixture(scope="module")
def geometry() -> Iterator[CollisionGeometry]:
    with CollisionGeometry("panda") as geometry:
        yield geometry


def test_every_mesh_of_the_panda_is_there(geometry: CollisionGeometry) -> None:
    links = [f"panda_link{number}" for number in range(8)]
    assert [part.name for part in geometry.parts] == [*links, "panda_hand", "panda_leftfinger", "panda_rightfinger"]
    assert {part.link for part in geometry.parts} == {*links, "panda_hand"}


def test_fingers_are_as_far_apart_as_in_the_twin(geometry: CollisionGeometry) -> None:
    left, right = (part.vertices for part in geometry.parts[-2:])
    opened = RobotDescription.named("panda").simulated_joints
    assert left[:, 1].min() == pytest.approx(opened["panda_finger_joint1"], abs=1e-3)
    assert right[:, 1].max() == pytest.approx(-opened["panda_finger_joint2"], abs=1e-3)
    half_turn = np.array([-1.0, -1.0, 1.0])
    np.testing.assert_allclose(np.sort(left * half_turn, axis=0), np.sort(right, axis=0), atol=1e-6)


def test_vertices_are_where_the_meshes_are(geometry: CollisionGeometry) -> None:
    """A small sphere at any vertex touches its part, in any configuration."""
    robot, generator = geometry.robot, np.random.default_rng(0)
    for configuration in robot.sample(5, generator):
        geometry.place(configuration)
        rotations, origins = robot.link_frames(configuration)
        for part in geometry.parts:
            row = robot.link_names.index(part.link)
            vertex = rotations[row] @ part.vertices[generator.integers(len(part.vertices))] + origins[row]
            assert geometry.sphere_distance(part, vertex, 0.002) == pytest.approx(-0.003, abs=2e-3)


def test_distances_to_spheres_are_those_of_the_twin(geometry: CollisionGeometry) -> None:
    centre, radius = np.array([0.6, 0.1, 0.4]), 0.08
    with ArmWorld() as world:
        world.set_obstacles({"ball": (centre, radius)})
        clearance, link = world.clearance()
    geometry.place(geometry.robot.ready)
    distances = {part.name: geometry.sphere_distance(part, centre, radius) for part in geometry.parts}
    assert min(distances, key=distances.get) == link
    assert distances[link] == pytest.approx(clearance, abs=1e-4)


def test_the_arm_is_as_far_as_its_nearest_moving_part(geometry: CollisionGeometry) -> None:
    geometry.place(geometry.robot.ready)
    base, *moving = geometry.parts
    for centre in np.array([[0.6, 0.1, 0.4], [-0.2, 0.0, 0.05]]):
        nearest = min(geometry.sphere_distance(part, centre, 0.05) for part in moving)
        assert geometry.clearance(centre, 0.05) == pytest.approx(nearest, abs=1e-9)
        of_links = geometry.clearances(centre, 0.05)
        hand = [part for part in moving if part.link == "panda_hand"]
        assert [part.name for part in hand] == ["panda_hand", "panda_leftfinger", "panda_rightfinger"]
        on_hand = min(geometry.sphere_distance(part, centre, 0.05) for part in hand)
        assert of_links["panda_hand"] == pytest.approx(on_hand, abs=1e-9)
        assert geometry.robot.base_link not in of_links
    # The last sphere is nearest to the base, which does not count.
    assert geometry.sphere_distance(base, centre, 0.05) < nearest


def test_far_away_is_infinite(geometry: CollisionGeometry) -> None:
    first, *_, last = geometry.parts
    geometry.place(geometry.robot.ready)
    assert geometry.distance(first, last, cutoff=0.1) == np.inf
    assert 0.1 < geometry.distance(first, last) < 1.0


def test_a_joint_that_the_urdf_lacks_is_named() -> None:
    with pytest.raises(RobotError, match=r"'thumb' is not in .*panda\.urdf.*panda_finger_joint1"):
        CollisionGeometry("panda", {"thumb": 0.1})


def test_bodies_of_a_declared_scene_stand_where_they_are_declared_until_others_do(geometry: CollisionGeometry) -> None:
    """Below the hand: a table, a higher one, and a keep-out box, which is no body."""
    geometry.place(geometry.robot.ready)
    ground = {"centre": [0.3, 0.0, -0.03], "size": [2.0, 2.0, 0.06]}
    above = {"centre": [0.3, 0.0, 0.10], "size": [2.0, 2.0, 0.06]}
    geometry.surround(DeclaredScene.of({"boxes": [{"name": "table", **ground}]}))
    apart = geometry.surrounding_clearances()
    assert apart["panda_hand"] > 0.0
    geometry.surround(DeclaredScene.of({"boxes": [{"name": "table", **above}]}))
    assert apart["panda_hand"] - geometry.surrounding_clearances()["panda_hand"] == pytest.approx(0.13, abs=1e-3)
    geometry.surround(DeclaredScene.of({"keep_out": [{"name": "screen", **above}]}))
    assert geometry.surrounding_clearances() == {}


@pytest.mark.parametrize("name", shipped_robots())
def test_the_links_that_joints_move_are_judged_and_the_base_is_not(name: str) -> None:
    with CollisionGeometry(name) as geometry:
        judged = geometry.clearances(np.zeros(3), 0.05, cutoff=10.0)
    spheres = CollisionModel.named(name)
    assert set(judged) == {link for link, moves in zip(spheres.points.names, spheres.moving, strict=True) if moves}
