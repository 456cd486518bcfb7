"""Scenes of arms that are no Panda: drawn on their skill, played and judged by their own meshes."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Stage
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.methods.replay import Replay
from geodesic_motion_studies.comparison.scene import draw_scene
from geodesic_motion_studies.comparison.scene_file import SceneFile

SEED = 1


@pytest.fixture(scope="module", params=["fr3_reach_to_grasp", "ur5_reach", "iiwa14_reach_to_grasp"])
def arena(request: pytest.FixtureRequest) -> Arena:
    return Arena.of(Skill.load(request.param))


def test_who_is_blind_touches_what_blocks_its_demonstration_and_ours_does_not(arena) -> None:
    scenes = (draw_scene(arena, "static", number, SEED) for number in range(20))
    scene = next(scene for scene in scenes if not scene.free[arena.nearest(scene.start, scene.goal)])
    stage = Stage(arena)
    blind, _ = stage.play(scene, Replay(arena))
    ours, _ = stage.play(scene, Geodesics(arena))
    assert blind.contact == "moving"
    assert ours.contact == ""


def test_chasing_spheres_and_files_know_the_arm(arena, tmp_path) -> None:
    """Half of them chase the elbow, which six joints have too."""
    drawn = [draw_scene(arena, "chasing", number, SEED) for number in range(4)]
    assert {scene.tool_chased for scene in drawn} == {True, False}
    SceneFile.of(arena.skill, arena.guard, SEED, drawn).write(tmp_path / "scenes.npz")
    read = SceneFile.read(tmp_path / "scenes.npz")
    assert read.robot == arena.name
    assert [scene.start.tolist() for scene in read.scenes] == [scene.start.tolist() for scene in drawn]
