"""Scenes on a declared table: things rest on it, methods know of it, and the judge sees who touches it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration
from geodesic_motion_ros.geometry.shapes import solid_distances
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.utils.errors import SkillError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.catalogue import ROWS
from geodesic_motion_studies.comparison.demonstrated_motions import DemonstratedMotions
from geodesic_motion_studies.comparison.execution import Judge, Outcome, Stage
from geodesic_motion_studies.comparison.families import FAMILIES, FREE_END, TALLEST, NoPlaceError, draw_family
from geodesic_motion_studies.comparison.method import Answer, Method
from geodesic_motion_studies.comparison.methods.barriers import from_solids
from geodesic_motion_studies.comparison.methods.free_demonstration import FreeDemonstration
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.motions import TableMotion
from geodesic_motion_studies.comparison.report import Report
from geodesic_motion_studies.comparison.results import Played
from geodesic_motion_studies.comparison.scene import Scene, draw_scene

COARSE = PlannerSettings(grid_shape=(30, 30, 30))


class Uninformed:
    """A method to which nothing is declared."""

    def __init__(self, method: Method) -> None:
        self._method, self.settings = method, method.settings

    def reset(self, scene: Scene) -> None:
        self._method.reset(replace(scene, declared=DeclaredScene.empty()))

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        return self._method.tick(now, obstacles)


def block(centre: np.ndarray, size: float = 0.04) -> DeclaredScene:
    return DeclaredScene.of({"boxes": [{"name": "block", "centre": centre.tolist(), "size": [size] * 3}]})


@pytest.mark.parametrize("number", range(4))
def test_things_rest_on_the_table_and_are_as_tall_as_they_are_said_to_be(arena: Arena, number: int) -> None:
    scene = draw_scene(arena, "table", number, 0)
    top = DeclaredScene.from_name("table").solids[0, [2, 5]].sum()
    things: dict[bytes, list] = {}
    for sphere in scene.spheres:
        things.setdefault(sphere.begin[:2].tobytes(), []).append(sphere)
    assert 3 <= len(things) <= 6
    for spheres in things.values():
        radius = spheres[0].radius
        heights = [sphere.begin[2] - top for sphere in spheres]
        np.testing.assert_allclose(heights, radius * (1.0 + 2.0 * np.arange(len(spheres))), atol=1e-12)
        assert heights[-1] + radius <= TALLEST + 1e-12
        # On it, and not beside it.
        assert solid_distances(spheres[0].begin[None], scene.declared.solids)[0] == pytest.approx(radius)


@pytest.mark.parametrize("number", range(4))
def test_start_and_goal_are_clear_of_table_and_spheres_and_demonstrations_are_spared(arena: Arena, number: int) -> None:
    scene = draw_scene(arena, "table", number, 0)
    ends = arena.body(np.stack([scene.start, scene.goal]))
    assert np.min(scene.declared.clearances(ends, arena.body_radii)) >= FREE_END
    for sphere in scene.spheres:
        apart = np.linalg.norm(ends - sphere.begin, axis=-1) - arena.body_radii - sphere.radius
        assert np.min(apart) >= FREE_END - 1e-9
    assert not np.all(scene.free)
    assert scene.mostly_free or number % 2


def test_no_other_family_declares_anything_and_none_has_changed_its_place(arena: Arena) -> None:
    others = FAMILIES[:-1]
    # A scene's random numbers depend on these places.
    assert others == ("none", "static", "elbow", "crossing", "chasing", "gate", "crowd")
    assert [draw_scene(arena, family, 0, 0).declared.names for family in others] == [()] * len(others)
    assert draw_scene(arena, "table", 0, 0).declared.names == ("table",)


def test_a_demonstration_that_enters_the_declared_scene_is_not_free(arena: Arena) -> None:
    scene = draw_scene(arena, "none", 0, 0)
    middle = arena.robot.forward(scene.demonstrations[0].sample(0.5 * scene.demonstrations[0].duration)[0])[0]
    assert np.all(DemonstratedMotions(arena, scene.demonstrations, True).free_of(()))
    assert not DemonstratedMotions(arena, scene.demonstrations, True, block(middle)).free_of(())[0]


def test_there_is_no_place_where_the_table_reaches_the_goal(arena: Arena) -> None:
    scene, random = draw_scene(arena, "none", 0, 0), np.random.default_rng(0)
    demonstrated = DemonstratedMotions(arena, scene.demonstrations, True, block(scene.goal_pose[0]))
    with pytest.raises(NoPlaceError, match="start or goal"):
        draw_family("table", demonstrated, random, spared=False)


def leaning(arena: Arena, scene: Scene) -> JointDemonstration:
    """The shoulder turns until the hand is well below the table's top."""
    shares, lowered = np.linspace(0.0, 1.0, 100)[:, None], scene.start.copy()
    lowered[1] = arena.limits.upper[1]
    path = scene.start + shares * (lowered - scene.start)
    below = np.flatnonzero(np.min(arena.body(path)[..., 2] - arena.body_radii, axis=1) < -0.05)
    return JointDemonstration(path[: below[0]], 0.05 * np.arange(below[0]), "leaning")


def test_the_judge_sees_the_table_touched_and_nothing_where_none_is_declared(arena: Arena) -> None:
    judge, scene = Judge(arena), replace(draw_scene(arena, "table", 0, 0), spheres=())
    motion = leaning(arena, scene)
    touched, postures = judge.judge(scene, TableMotion(motion))
    assert (touched.contact, touched.success, touched.touched_moving) == ("scene", False, False)
    # It ends there: by the collision spheres, which hold the meshes, the arm is at the top.
    assert abs(np.min(scene.declared.clearances(arena.body(postures[-1:]), arena.body_radii))) < 0.03
    # Control; and what stood around the arm in one scene does not in the next.
    free, _ = judge.judge(replace(scene, declared=DeclaredScene.empty()), TableMotion(motion))
    assert free.contact == ""


def test_a_contact_of_what_is_not_guarded_ends_no_scene(arena: Arena) -> None:
    judge, scene = Judge(arena), replace(draw_scene(arena, "table", 0, 0), spheres=())
    judge.guarded = frozenset({"panda_link5"})
    outcome, _ = judge.judge(scene, TableMotion(leaning(arena, scene)))
    assert (outcome.contact, outcome.arm_touched) == ("", True)


def test_ours_detours_around_what_is_declared_and_into_it_where_nothing_is(arena: Arena, stage: Stage) -> None:
    """A block where an uninformed detour leads, clear of all that was demonstrated."""
    scenes = (draw_scene(arena, "static", number, 0) for number in range(1, 40, 2))
    blocked = next(scene for scene in scenes if not np.any(scene.free))
    detour, postures = stage.play(blocked, Geodesics(arena, planner=COARSE))
    assert detour.success
    tool = arena.tool_curve(postures).positions
    shown = np.concatenate([curve.positions for curve in blocked.compared])
    farthest = int(np.argmax(np.min(np.linalg.norm(tool[:, None] - shown, axis=-1), axis=1)))
    scene = replace(blocked, declared=block(tool[farthest]))
    assert stage.play(scene, Uninformed(Geodesics(arena, planner=COARSE)))[0].contact == "scene"
    assert stage.play(scene, Geodesics(arena, planner=COARSE))[0].success


def test_a_free_demonstration_is_free_of_what_is_declared(arena: Arena, stage: Stage) -> None:
    """A block on the nearest demonstration that leaves those of the other mode free."""
    scene = draw_scene(arena, "none", 0, 0)
    nearest = arena.nearest(scene.start, scene.goal)
    body = arena.body(arena.moved(scene.start, scene.goal)[nearest])
    scenes = (replace(scene, declared=block(place)) for place in body[30:70:10].reshape(-1, 3))
    others = arena.modes != arena.modes[nearest]
    scene = next(
        scene
        for scene in scenes
        if np.all(DemonstratedMotions(arena, scene.demonstrations, True, scene.declared).free_of(())[others])
    )
    assert stage.play(scene, Uninformed(FreeDemonstration(arena)))[0].contact == "scene"
    assert stage.play(scene, FreeDemonstration(arena))[0].success


@pytest.mark.parametrize("row", [name for name in ROWS if name.endswith("+ detour")])
def test_a_detour_from_another_base_leads_round_what_is_declared(arena: Arena, stage: Stage, row: str) -> None:
    """A block in the middle of the base path."""
    for library in ROWS[row].needs:
        pytest.importorskip(library)
    method, scene = ROWS[row].make(arena), draw_scene(arena, "none", 0, 0)
    _, postures = stage.play(scene, method)
    scene = replace(scene, declared=block(arena.robot.forward(postures[len(postures) // 2])[0]))
    assert stage.play(scene, Uninformed(method))[0].contact == "scene"
    assert stage.play(scene, method)[0].success


def test_ours_refuses_a_table_that_stands_in_the_demonstrations(arena: Arena) -> None:
    scene = draw_scene(arena, "none", 0, 0)
    middle = arena.robot.forward(arena.shown[0, 50])[0]
    with pytest.raises(SkillError, match=r"mm inside 'block' of the scene"):
        Geodesics(arena, planner=COARSE).reset(replace(scene, declared=block(middle, 0.1)))


def test_barriers_count_distances_from_solids_and_normals_away_from_them() -> None:
    random = np.random.default_rng(0)
    table = {"centre": [0.1, -0.2, 0.3], "size": [0.4, 0.6, 0.2], "quaternion": [0.8, 0.1, -0.5, 0.3], "name": "box"}
    solids = np.concatenate([DeclaredScene.of({"boxes": [table]}).solids, DeclaredScene.from_name("table").solids])
    points, step = random.uniform(-0.5, 0.6, (200, 3)), 1e-6
    distances, normals = from_solids(points, solids)
    assert np.any(distances < 0.0)
    for number, row in enumerate(solids):
        np.testing.assert_allclose(distances[:, number], solid_distances(points, row[None]), atol=1e-12)
        slopes = [
            solid_distances(points + axis, row[None]) - solid_distances(points - axis, row[None])
            for axis in step * np.eye(3)
        ]
        np.testing.assert_allclose(normals[:, number], np.stack(slopes, axis=1) / (2.0 * step), atol=1e-4)
    assert from_solids(points, solids[:0])[0].shape == (200, 0)


@pytest.fixture
def table_of() -> Callable[[str, str], str]:
    def table(family: str, contact: str) -> str:
        outcome = Outcome(
            mostly_free=True, reached=False, contact=contact, refusal="", duration=6.0, clearance=0.05, dtw=0.002,
            orientation=0.1, jerk=10.0, replans=(), ticks=100, in_time=99,
        )  # fmt: skip
        return Report("reach", 0, [Played("ours", family, 0, {}, outcome)], {"ours": "geodesics"}).markdown()

    return table


def test_contacts_with_the_table_are_a_column_of_their_own(table_of) -> None:
    head, _, row = table_of("table", "scene").splitlines()[2:5]
    cells = dict(zip(head.split(" | "), row.split(" | "), strict=True))
    assert cells["touched, scene |"] == "1 |"
    assert [cells[name] for name in ("touched, moving", "touched, standing", "refused", "lost")] == ["0"] * 4
    assert "touched, scene" not in table_of("static", "moving")
