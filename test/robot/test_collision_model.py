"""The spheres against PyBullet's exact geometry: never too optimistic, rarely too strict; files that do not fit."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import configuration_clearance
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance, self_clearances
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

ARM = """<robot name="arm">
  <link name="base"/><link name="upper"/><link name="tool"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.5"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="push" type="prismatic"><parent link="upper"/><child link="tool"/>
    <axis xyz="1 0 0"/><limit lower="0.2" upper="0.6" velocity="1" effort="1"/></joint>
</robot>"""
SPHERES = """spheres:
  base:
    - [0, 0, 0.2, 0.1]
    - [0, 0, 0, 0.2]
  tool:
    - [0.1, 0, 0, 0.05]
self_collision:
  - {links: [base, tool]}
"""


@pytest.fixture(scope="module")
def panda() -> Robot:
    return Robot.named("panda")


@pytest.fixture(scope="module")
def model() -> CollisionModel:
    return CollisionModel.named("panda")


@pytest.fixture(scope="module")
def geometry() -> Iterator[CollisionGeometry]:
    with CollisionGeometry("panda") as geometry:
        yield geometry


@pytest.fixture
def arm(tmp_path: Path) -> Robot:
    (tmp_path / "arm.urdf").write_text(ARM)
    return Robot.from_urdf(tmp_path / "arm.urdf", "base", "tool")


def load(folder: Path, robot: Robot, text: str = SPHERES) -> CollisionModel:
    path = folder / "spheres.yaml"
    path.write_text(text)
    return CollisionModel.load(path, robot)


def own_contact(geometry: CollisionGeometry, configuration: np.ndarray) -> bool:
    """Whether links that are no neighbours touch; hand and fingers move with the last link."""
    geometry.place(configuration)
    joint = {link: min(row, 7) for row, link in enumerate(geometry.robot.link_names)}
    return any(
        joint[other.link] - joint[one.link] >= 2 and geometry.distance(one, other, cutoff=0.0) <= 0.0
        for number, one in enumerate(geometry.parts)
        for other in geometry.parts[number + 1 :]
    )


def test_no_point_of_the_meshes_lies_outside_the_spheres(model: CollisionModel, geometry: CollisionGeometry) -> None:
    """Vertices and random points of every hull, and the millimetre that PyBullet adds around it."""
    generator = np.random.default_rng(0)
    for part in geometry.parts:
        mine = model.points.frames == geometry.robot.link_names.index(part.link)
        weights = generator.dirichlet(np.full(4, 0.2), 5000)
        corners = part.vertices[generator.integers(len(part.vertices), size=(5000, 4))]
        points = np.concatenate([part.vertices, np.einsum("nk,nkj->nj", weights, corners)])
        gaps = np.linalg.norm(points[:, None] - model.points.offsets[mine], axis=-1) - model.radii[mine]
        assert gaps.min(axis=1).max() <= -0.001 + 1e-9


def test_clearance_is_never_larger_than_that_of_the_meshes(
    panda: Robot, model: CollisionModel, geometry: CollisionGeometry
) -> None:
    generator = np.random.default_rng(1)
    gains = []
    for configuration in panda.sample(600, generator):
        sphere = generator.choice(np.flatnonzero(model.moving))
        direction = generator.normal(size=3)
        distance = model.radii[sphere] + generator.uniform(-0.02, 0.3)
        centre = model.positions(panda, configuration[None])[0, sphere]
        centre = centre + distance * direction / np.linalg.norm(direction)
        radius = float(generator.choice([0.02, 0.05, 0.1]))
        ours, nearest = configuration_clearance(model, panda, configuration, centre[None], np.array([radius]))
        geometry.place(configuration)
        theirs = min(
            geometry.sphere_distance(part, centre, radius) for part in geometry.parts if part.link != panda.base_link
        )
        assert model.moving[nearest]
        if theirs > 0.0:
            assert ours <= theirs + 1e-6
            gains.append(theirs - ours)
        else:
            assert ours <= 0.0
    assert len(gains) >= 300
    assert np.median(gains) < 0.02


def test_no_self_collision_is_missed_and_few_are_imagined(
    panda: Robot, model: CollisionModel, geometry: CollisionGeometry
) -> None:
    configurations = panda.sample(1500, np.random.default_rng(2))
    touching = np.array([own_contact(geometry, configuration) for configuration in configurations])
    positions = model.positions(panda, configurations)
    alarmed = self_clearances(positions, model.radii, model.self_pairs)[0] <= 0.0
    assert np.sum(touching) > 150
    assert not np.any(touching & ~alarmed)
    assert np.sum(alarmed & ~touching) < 0.13 * np.sum(~touching)
    # nearly all of them where the hand is folded back to the forearm, and touches it a little further on
    unfolded = configurations[:, 5] > 1.1
    assert np.sum(alarmed & ~touching & unfolded) < 0.04 * np.sum(~touching & unfolded)


def test_no_contact_of_hand_and_forearm_is_missed(
    panda: Robot, model: CollisionModel, geometry: CollisionGeometry
) -> None:
    """Of their spheres only some are checked; where the hand is folded back, between the points they were chosen on."""
    configurations = np.tile(panda.ready, (3000, 1))
    generator = np.random.default_rng(3)
    configurations[:, 5] = generator.uniform(panda.lower[5], 0.8, len(configurations))
    configurations[:, 6] = generator.uniform(panda.lower[6], panda.upper[6], len(configurations))
    touching = np.array([own_contact(geometry, configuration) for configuration in configurations])
    positions = model.positions(panda, configurations)
    clearances, _ = self_clearances(positions, model.radii, model.self_pairs)
    assert np.sum(touching) > 500
    assert np.all(clearances[touching] <= 0.0)


def test_ordinary_configurations_are_free(panda: Robot, model: CollisionModel) -> None:
    generator = np.random.default_rng(4)
    shifts = generator.uniform(-0.3, 0.3, (1000, 7))
    for configuration in panda.ready + shifts:
        assert self_clearance(model, panda, configuration)[0] > 0.0
    assert self_clearance(model, panda, panda.ready)[0] > 0.03


def test_the_nearest_pair_is_that_of_the_clearance(panda: Robot, model: CollisionModel) -> None:
    for configuration in panda.sample(50, np.random.default_rng(5)):
        clearance, (one, other) = self_clearance(model, panda, configuration)
        placed = model.positions(panda, configuration[None])[0]
        first, second = model.self_pairs.T
        gaps = np.linalg.norm(placed[first] - placed[second], axis=1) - model.radii[first] - model.radii[second]
        assert clearance == pytest.approx(gaps.min(), abs=1e-12)
        (pair,) = np.flatnonzero(np.all(model.self_pairs == [one, other], axis=1))
        assert gaps[pair] == pytest.approx(gaps.min(), abs=1e-12)


def test_the_base_counts_for_the_arm_itself_alone(panda: Robot, model: CollisionModel) -> None:
    base = np.flatnonzero(~model.moving)
    assert {model.link_of(sphere) for sphere in base} == {"panda_link0"}
    assert np.isin(base, model.self_pairs).all()
    at_the_base = (np.array([[-0.1, 0.0, 0.02]]), np.array([0.02]))
    clearance, nearest = configuration_clearance(model, panda, panda.ready, *at_the_base)
    assert clearance > 0.05
    assert model.link_of(nearest) == "panda_link1"


def test_one_link_alone(panda: Robot, model: CollisionModel) -> None:
    hand = model.of_link("panda_hand")
    own = np.array(model.points.names) == "panda_hand"
    placed = model.positions(panda, panda.ready[None])
    np.testing.assert_allclose(hand.positions(panda, panda.ready[None]), placed[:, own], rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(hand.radii, model.radii[own])
    assert self_clearance(hand, panda, panda.ready)[0] == np.inf
    with pytest.raises(RobotError, match="'panda_elbow' has no spheres; there are spheres of panda_link0, panda_link1"):
        model.of_link("panda_elbow")


def test_without_obstacles_all_is_clear(panda: Robot, model: CollisionModel) -> None:
    assert configuration_clearance(model, panda, panda.ready, np.empty((0, 3)), np.empty(0)) == (np.inf, -1)


def test_robots_are_known_by_name(model: CollisionModel) -> None:
    assert len(CollisionModel.named("panda")) == len(model)
    with pytest.raises(RobotError, match=r"'ur55'.*'panda'"):
        CollisionModel.named("ur55")


def test_a_file_for_another_arm(tmp_path: Path, arm: Robot) -> None:
    """The tool slides out along the turning arm: distances worked out by hand."""
    model = load(tmp_path, arm)
    np.testing.assert_array_equal(model.moving, [False, False, True])
    np.testing.assert_array_equal(model.self_pairs, [[0, 2], [1, 2]])
    level, down = np.array([0.0, 0.4]), np.array([0.5 * np.pi, 0.4])
    np.testing.assert_allclose(model.positions(arm, level[None])[0, 2], [0.5, 0.0, 0.5])
    assert self_clearance(model, arm, level) == (pytest.approx(np.hypot(0.5, 0.3) - 0.15), (0, 2))
    assert self_clearance(model, arm, down) == (pytest.approx(-0.25), (1, 2))
    obstacles = (np.array([[0.5, 0.0, 1.0], [0.0, 0.0, -0.5]]), np.array([0.1, 0.2]))
    assert configuration_clearance(model, arm, level, *obstacles) == (pytest.approx(0.35), 2)
    assert configuration_clearance(model, arm, down, *obstacles) == (pytest.approx(0.25), 2)


def test_chosen_spheres_alone_are_checked(tmp_path: Path, arm: Robot) -> None:
    model = load(tmp_path, arm, SPHERES.replace("tool]}", "tool], spheres: [[1, 0]]}"))
    np.testing.assert_array_equal(model.self_pairs, [[1, 2]])


def test_an_arm_that_cannot_meet_itself(tmp_path: Path, arm: Robot) -> None:
    model = load(tmp_path, arm, SPHERES.replace("\n  - {links: [base, tool]}", " []"))
    assert self_clearance(model, arm, arm.ready) == (np.inf, (-1, -1))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tool:", "gripper:", r"'gripper'.*base, upper, tool"),
        ("0.05]", "0]", r"'tool'.*positive radii, not \[0.0\]"),
        ("0.05]", ".nan]", "'tool'.*positive radii"),
        ("0.05]", "thick]", "'tool'.*numbers"),
        (", 0.05]", "]", r"'tool'.*\[x, y, z, radius\]"),
        ("[0.1, 0, 0, 0.05]", "[.inf, 0, 0, 0.05]", "'tool'.*finite"),
        ("links: [base, tool]", "links: [base, upper]", r"'upper', which has no spheres.*base, tool"),
        ("links: [base, tool]", "links: [base]", r"expected \{links: \[one, other\]\}"),
        ("tool]}", "tool], spheres: [[2, 0]]}", r"\[2, 0\].*below 2 and 1"),
        ("tool]}", "tool], spheres: [[0]]}", r"\[0\].*below 2 and 1"),
        ("tool]}", "tool], spheres: [7]}", r"spheres 7 of.*below 2 and 1"),
        ("tool]}", "tool], spheres: [[[0], 0]]}", r"\[\[0\], 0\].*below 2 and 1"),
        ("self_collision:", "self_collisions:", "`self_collision`"),
        ("spheres:", "balls:", "`spheres`"),
        ("spheres:", "spheres: [", "cannot read"),
    ],
)
def test_a_file_that_does_not_fit_is_answered_with_what_would(
    tmp_path: Path, arm: Robot, old: str, new: str, message: str
) -> None:
    with pytest.raises(RobotError, match=message):
        load(tmp_path, arm, SPHERES.replace(old, new))


def test_a_missing_file_is_named(tmp_path: Path, arm: Robot) -> None:
    with pytest.raises(RobotError, match=r"absent\.yaml"):
        CollisionModel.load(tmp_path / "absent.yaml", arm)
