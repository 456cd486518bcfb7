"""Declared scenes: what a file says stands there, errors that name what is wrong, and motions that stay out of it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.output_space import OutputSpace
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import FileError, SkillError
from geodesic_motion_ros.utils.shared_files import find_shared

REACH = 0.25
TABLE = {"name": "table", "centre": [0.5, 0.0, -0.36], "size": [1.0, 1.6, 0.72]}
ALL = {
    "boxes": [TABLE],
    "cylinders": [{"name": "post", "centre": [0.3, 0.6, 0.4], "radius": 0.05, "height": 0.8}],
    "planes": [{"name": "wall", "point": [-0.6, 0.0, 0.0], "normal": [2.0, 0.0, 0.0]}],
    "keep_out": [{"name": "screen", "centre": [0.9, 0.0, 0.5], "size": [0.2, 0.8, 0.5], "quaternion": [1, 0, 0, 0]}],
    "seen": [{"name": "front", "centre": [0.5, 0.0, 0.4], "size": [0.9, 1.4, 0.8], "quaternion": [1, 0, 0, 0]}],
    "workspace": {"lower": [-0.9, -0.9, -0.1], "upper": [0.9, 0.9, 1.3]},
}


def at(scene: DeclaredScene, point: list[float]) -> tuple[float, str]:
    distance, name, _ = scene.nearest(np.array([point]), np.zeros(1))
    return distance, name


def test_a_file_says_what_stands_where(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(ALL))
    scene = DeclaredScene.load(file)
    sides = tuple(f"end of the workspace at {sign}{axis}" for axis in "xyz" for sign in "-+")
    assert scene.names == ("table", "post", "wall", "screen", *sides)
    assert scene.kinds == ("boxes", "cylinders", "planes", "keep_out", *["workspace"] * 6)
    # What is seen is no obstacle.
    assert scene.seen[:, :6].tolist() == [[0.5, 0.0, 0.4, 0.45, 0.7, 0.4]]
    assert at(scene, [0.5, 0.0, 0.02]) == pytest.approx((0.02, "table"), abs=1e-9)
    assert at(scene, [0.5, 0.0, -0.01]) == pytest.approx((-0.01, "table"), abs=1e-9)
    assert at(scene, [0.3, 0.5, 0.4]) == pytest.approx((0.05, "post"), abs=1e-9)
    assert at(scene, [-0.5, 0.0, 0.6]) == pytest.approx((0.1, "wall"), abs=1e-9)
    assert at(scene, [-0.7, 0.3, 0.6]) == pytest.approx((-0.1, "wall"), abs=1e-9)
    assert at(scene, [0.75, 0.0, 0.5]) == pytest.approx((0.05, "screen"), abs=1e-9)
    assert at(scene, [0.0, 0.0, 1.35]) == pytest.approx((-0.05, "end of the workspace at +z"), abs=1e-9)


def test_the_file_on_the_page_is_one() -> None:
    page = (Path(__file__).resolve().parents[2] / "doc" / "surroundings.md").read_text()
    scene = DeclaredScene.of(yaml.safe_load(page.split("```yaml\n")[1].split("```")[0]))
    assert {"table", "shelf", "pillar", "wall", "door"} <= set(scene.names)
    assert set(scene.kinds) == {"boxes", "cylinders", "planes", "keep_out", "workspace"}


def test_the_arm_stands_on_the_shipped_table() -> None:
    scene = DeclaredScene.load(find_shared("config/scenes/table.yaml"))
    assert scene.names == ("table",)
    # Its top is the plane z = 0 of the base.
    assert scene.solids[0, 2] + scene.solids[0, 5] == pytest.approx(0.0, abs=1e-12)


def test_clearances_are_those_of_the_nearest_solid() -> None:
    scene = DeclaredScene.of(ALL)
    random = np.random.default_rng(2)
    spheres, radii = random.uniform(-0.8, 0.8, (20, 4, 3)), random.uniform(0.01, 0.1, 4)
    wanted = [scene.nearest(body, radii)[0] for body in spheres]
    np.testing.assert_allclose(scene.clearances(spheres, radii), wanted)
    assert np.all(np.isinf(DeclaredScene.empty().clearances(spheres, radii)))


def changed(kind: str, **fields: object) -> dict[str, object]:
    return {kind: [{**ALL[kind][0], **fields}]}


@pytest.mark.parametrize(
    ("table", "named"),
    [
        ([], "must be a table with boxes, cylinders, planes, keep_out, seen, workspace"),
        ({"boxs": []}, "did you mean boxes?"),
        ({"boxes": {}}, "boxes must be a list of {name, centre, size}"),
        ({"boxes": [3]}, "boxes[0] must be {name, centre, size}"),
        ({"boxes": [{"centre": [0, 0, 0], "size": [1, 1, 1]}]}, "boxes[0] has no name"),
        ({"boxes": [{"name": "a", "centre": [0, 0, 0]}]}, "'a' in boxes has no size"),
        (changed("boxes", sise=1), "did you mean size?"),
        (changed("boxes", size=[1.0, 0.0, 1.0]), "'table' in boxes: size [1.0, 0.0, 1.0] must be positive"),
        (changed("boxes", centre=[0.0, float("nan"), 1.0]), "'table' in boxes: centre must be three numbers"),
        (changed("boxes", centre="here"), "centre must be three numbers"),
        (changed("boxes", quaternion=[0, 0, 0, 0]), "quaternion must be a unit one"),
        (changed("cylinders", radius=-0.1), "'post' in cylinders: radius must be a positive number"),
        (changed("cylinders", height=True), "height must be a positive number"),
        (changed("planes", normal=[0, 0, 0]), "'wall' in planes: normal [0.0, 0.0, 0.0] has no direction"),
        ({"boxes": [TABLE], "keep_out": [deepcopy(TABLE)]}, "two things are called 'table'"),
        ({"boxes": [TABLE], "seen": [deepcopy(TABLE)]}, "two things are called 'table'"),
        ({"seen": [{"name": "a", "centre": [0, 0, 0]}]}, "'a' in seen has no size"),
        (changed("seen", size=[0.9, -1.4, 0.8]), "'front' in seen: size [0.9, -1.4, 0.8] must be positive"),
        (changed("seen", radius=1.0), "'front' in seen has no 'radius'"),
        ({"workspace": {"lower": [0, 0, 0]}}, "workspace must be {lower: [x, y, z], upper: [x, y, z]}"),
        ({"workspace": {"lower": [0, 0, 0], "upper": [1, 1, 0]}}, "must be less than upper"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(table: object, named: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(table))
    with pytest.raises(FileError) as error:
        DeclaredScene.load(file)
    assert named in str(error.value)
    assert "scene.yaml" in str(error.value)


def test_a_file_that_is_none_is_named(tmp_path: Path) -> None:
    for content in ("boxes: [", "a: &a [*a]", "!!python/object:os.system {}"):
        (tmp_path / "scene.yaml").write_text(content)
        with pytest.raises(FileError, match=r"scene\.yaml"):
            DeclaredScene.load(tmp_path / "scene.yaml")
    with pytest.raises(FileError, match="cannot be read"):
        DeclaredScene.load(tmp_path / "none.yaml")


def between(skill: Skill, scene: DeclaredScene | None, obstacles: Obstacles | None = None, detour: float = 0.0):
    """The planner's answer from the skill's start to its goal, and the planner."""
    planner = ReactivePlanner(skill, PlannerSettings(detour=detour), scene=scene or DeclaredScene.empty())
    planner.take_obstacles(obstacles or Obstacles.none())
    start, goal = skill.start_pose, skill.goal_pose
    return planner.plan(start[:3], start[3:], goal[:3], goal[3:]), planner


def least(planner: ReactivePlanner, postures: np.ndarray, scene: DeclaredScene) -> float:
    moving = planner.collision.moving
    placed = planner.collision.positions(planner.robot, np.ascontiguousarray(postures))[:, moving]
    return float(np.min(scene.clearances(placed, planner.collision.radii[moving])))


@pytest.fixture(scope="module", params=["panda_pouring", "panda_reach_to_grasp"])
def skill(request: pytest.FixtureRequest) -> Skill:
    return Skill.load(request.param)


@pytest.fixture(scope="module")
def alone(skill: Skill) -> tuple[Plan, ReactivePlanner]:
    """The answer where nothing stands around the arm, and its planner."""
    return between(skill, None)


def test_a_path_is_the_same_beside_a_scene_that_is_far_from_it(skill: Skill, alone) -> None:
    far = DeclaredScene.of({"boxes": [{"name": "far", "centre": [-2.0, 0.0, 0.5], "size": [0.1, 0.1, 0.1]}]})
    beside, _ = between(skill, far)
    assert beside.verdict.ok
    np.testing.assert_array_equal(alone[0].reference.positions, beside.reference.positions)


def reaches(spheres: np.ndarray, radii: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """How far spheres (n, S, 3), (S,) reach along directions (k, 3), (k,) [m]."""
    return np.max(spheres @ directions.T + radii[:, None], axis=(0, 1))


def placed(planner: ReactivePlanner, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    moving = planner.collision.moving
    positions = planner.collision.positions(planner.robot, np.ascontiguousarray(postures))
    return positions[:, moving], planner.collision.radii[moving]


def test_a_detour_stays_out_of_the_scene(skill: Skill, alone) -> None:
    """A wall beyond all that was demonstrated, where the arm goes without it."""
    alone, planner = alone
    halfway = alone.reference.sample(0.5 * alone.reference.duration)[0]
    obstacle = Obstacles.of_spheres(planner.robot.forward(halfway)[0][None], np.array([0.06]))
    free, _ = between(skill, None, obstacle, REACH)
    assert free.verdict.ok
    directions = np.random.default_rng(0).normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    shown = OutputSpace.of(skill).demonstrated_spheres(skill, planner.robot, planner.collision)
    within = np.maximum(
        reaches(*shown, directions), reaches(*placed(planner, alone.reference.positions), directions)
    )
    beyond = reaches(*placed(planner, free.reference.positions), directions) - within
    widest = int(np.argmax(beyond))
    assert beyond[widest] > 0.02
    direction, at = directions[widest], within[widest] + 0.01
    scene = DeclaredScene.of({
        "planes": [{"name": "wall", "point": (at * direction).tolist(), "normal": (-direction).tolist()}]
    })
    assert least(planner, alone.reference.positions, scene) > 0.0
    assert least(planner, free.reference.positions, scene) < 0.0
    found, other = between(skill, scene, obstacle, REACH)
    assert found.verdict.ok, found.verdict
    assert least(other, found.reference.positions, scene) >= 0.0


def test_an_arm_that_stands_in_the_scene_is_located(skill: Skill, alone) -> None:
    """Beyond a wall that no demonstration comes to."""
    alone, planner = alone
    start = alone.reference.positions[0]
    beside = start + 0.25 * np.eye(7)[0] + 0.15 * np.eye(7)[5]
    if skill.space == "task":
        beside = start
    shown = OutputSpace.of(skill).demonstrated_spheres(skill, planner.robot, planner.collision)
    candidates = np.random.default_rng(1).normal(size=(300, 3))
    candidates /= np.linalg.norm(candidates, axis=1)[:, None]
    ahead = reaches(*placed(planner, beside[None]), candidates) - reaches(*shown, candidates)
    widest = int(np.argmax(ahead))
    assert ahead[widest] > 0.0
    at = reaches(*placed(planner, beside[None]), candidates[widest : widest + 1])[0] - 0.5 * ahead[widest]
    wall = {"name": "wall", "point": (at * candidates[widest]).tolist(), "normal": (-candidates[widest]).tolist()}
    other = ReactivePlanner(skill, scene=DeclaredScene.of({"planes": [wall]}))
    other.stand_at(beside, 0.0)
    goal = skill.goal_pose
    other.set_goal(goal[:3], goal[3:])
    verdict = other.tick(0.0).verdict
    assert verdict.code is VerdictCode.IN_COLLISION, verdict
    assert "inside 'wall' of the scene where the arm stands" in verdict.reason


def test_a_skill_says_what_it_was_recorded_in(skill: Skill) -> None:
    assert DeclaredScene.of_skill(skill) is None
    recorded = DeclaredScene.of_skill(replace(skill, scene={"boxes": [TABLE]}))
    assert recorded is not None
    assert recorded.names == ("table",)
    np.testing.assert_array_equal(recorded.solids, DeclaredScene.of({"boxes": [TABLE]}).solids)
    with pytest.raises(SkillError, match=f"skill {skill.name}: its scene is none: .* did you mean boxes"):
        DeclaredScene.of_skill(replace(skill, scene={"boxs": []}))


def test_a_skill_that_was_demonstrated_inside_the_scene_is_refused(skill: Skill) -> None:
    goal = skill.goal_pose[:3]
    box = {"name": "crate", "centre": goal.tolist(), "size": [0.1, 0.1, 0.1]}
    with pytest.raises(SkillError, match=r"demonstration .* mm inside 'crate' of the scene at sample \d+, .* % of its"):
        ReactivePlanner(skill, scene=DeclaredScene.of({"boxes": [box]}))
