"""Pairs of parts that the shipped file leaves out never meet; the spheres that it names tell every contact."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations, product

import numpy as np
import pytest

from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_studies.tools import self_collision
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry, Part
from geodesic_motion_studies.tools.self_collision import joints_between, never_meet, telling_sphere_pairs


@pytest.fixture(scope="module")
def geometry() -> Iterator[CollisionGeometry]:
    with CollisionGeometry("panda") as geometry:
        yield geometry


def part(geometry: CollisionGeometry, name: str) -> Part:
    return next(part for part in geometry.parts if part.name == f"panda_{name}")


def test_joints_between_parts(geometry: CollisionGeometry) -> None:
    forearm, hand, finger = (part(geometry, name) for name in ("link5", "hand", "leftfinger"))
    np.testing.assert_array_equal(joints_between(geometry, forearm, hand), [5, 6])
    np.testing.assert_array_equal(joints_between(geometry, finger, forearm), [5, 6])
    assert len(joints_between(geometry, hand, finger)) == 0


def test_pairs_that_the_file_leaves_out_never_meet(geometry: CollisionGeometry) -> None:
    """All but neighbours, whose meshes overlap at their joint, and parts that no joint moves against each other.

    Where forearm and flange touch, the hand does too: the spheres chosen for the two are the hand's.
    """
    model = CollisionModel.named("panda")
    checked = {(model.link_of(one), model.link_of(other)) for one, other in model.self_pairs}
    assert len(checked) == 13
    checked.add(("panda_link5", "panda_link7"))
    left_out = 0
    for one, other in combinations(geometry.parts, 2):
        joints = joints_between(geometry, one, other)
        neighbours = len(joints) == 1 and other.link != "panda_hand"
        if len(joints) and not neighbours and (one.link, other.link) not in checked:
            left_out += 1
            assert never_meet(geometry, one, other), f"{one.name} and {other.name}"
    assert left_out == 20


def test_parts_that_meet_are_not_said_never_to(geometry: CollisionGeometry) -> None:
    for one, other in (("link0", "hand"), ("link2", "link6"), ("link5", "link7")):
        assert not never_meet(geometry, part(geometry, one), part(geometry, other))


def test_chosen_spheres_tell_every_contact(geometry: CollisionGeometry, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of forearm against flange and hand, whose spheres nearly always overlap; on a coarse grid, checked in between."""
    monkeypatch.setattr(self_collision, "GRID_STEP", 0.03)
    model, robot = CollisionModel.named("panda"), geometry.robot
    forearm, others = part(geometry, "link5"), [part(geometry, name) for name in ("link7", "hand")]
    rows = {body.name: np.flatnonzero(np.array(model.points.names) == body.name) for body in (forearm, *others)}
    table = np.column_stack([model.points.offsets, model.radii])
    spheres = {name: table[numbers] for name, numbers in rows.items()}
    configurations = np.tile(robot.ready, (4000, 1))
    configurations[:, 5:] = np.random.default_rng(0).uniform(robot.lower[5:], robot.upper[5:], (4000, 2))
    placed = place_body_points(configurations, model.points.frames, model.points.offsets, robot.chain)
    touching = np.zeros(len(configurations), dtype=bool)
    for number, configuration in enumerate(configurations):
        geometry.place(configuration)
        touching[number] = any(geometry.distance(forearm, other, cutoff=0.0) <= 0.0 for other in others)

    def alarms(pairs: Iterable[tuple[tuple[str, int], tuple[str, int]]]) -> np.ndarray:
        first, second = np.array([[rows[name][number] for name, number in pair] for pair in pairs]).T
        apart = np.linalg.norm(placed[:, first] - placed[:, second], axis=-1)
        return np.any(apart <= model.radii[first] + model.radii[second], axis=1)

    ours = [(forearm.name, number) for number in range(len(spheres[forearm.name]))]
    theirs = [(other.name, number) for other in others for number in range(len(spheres[other.name]))]
    few, all_of_them = (
        alarms(pairs)
        for pairs in (
            telling_sphere_pairs(geometry, [(forearm, other) for other in others], spheres),
            product(ours, theirs),
        )
    )
    assert np.sum(touching) > 300
    assert np.all(few[touching])
    assert np.sum(few & ~touching) < 0.3 * np.sum(all_of_them & ~touching)
