"""All of the arm guarded with a skill of the tool: scenes and judge go by every link, and results are kept apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Stage
from geodesic_motion_studies.comparison.families import FAMILIES, families_of
from geodesic_motion_studies.comparison.guard import guard_of
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.methods.replay import Replay
from geodesic_motion_studies.comparison.results import Results
from geodesic_motion_studies.comparison.run import Bench, BenchmarkSettings
from geodesic_motion_studies.comparison.scene import Scene, draw_scene
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere


@pytest.fixture(scope="module")
def skill() -> Skill:
    return Skill.load("panda_pouring")


@pytest.fixture(scope="module")
def arm(skill: Skill) -> Arena:
    return Arena.of(skill, "arm")


@pytest.fixture(scope="module")
def tool(skill: Skill) -> Arena:
    return Arena.of(skill)


@pytest.fixture(scope="module")
def elbow(arm: Arena, blocked_elbow) -> Scene:
    return blocked_elbow(arm)


def test_a_skill_has_its_own_guard_unless_another_one_is_requested(skill, reach_skill) -> None:
    assert (guard_of(skill), guard_of(skill, "arm"), guard_of(reach_skill)) == ("tool", "arm", "arm")
    with pytest.raises(ParameterError, match="there is no guard 'tool'"):
        guard_of(reach_skill, "tool")
    with pytest.raises(ParameterError, match="choose from arm, tool"):
        guard_of(skill, "elbow")


def test_demonstrations_are_the_same_and_more_of_the_arm_is_guarded(arm, tool) -> None:
    np.testing.assert_array_equal(arm.shown, tool.shown)
    assert set(tool.collision.points.names) < set(arm.collision.points.names)
    assert families_of(arm.guard) == FAMILIES
    assert set(FAMILIES) - set(families_of(tool.guard)) == {"elbow"}


def test_start_and_goal_are_clear_of_standing_spheres_by_the_whole_arm(arm) -> None:
    for number in range(4):
        scene = draw_scene(arm, "static", number, 0)
        body = arm.body(np.stack([scene.start, scene.goal]))
        for sphere in scene.spheres:
            apart = np.linalg.norm(body - sphere.begin, axis=-1) - arm.body_radii - sphere.radius
            assert np.min(apart) >= 0.015 - 1e-6


def test_spheres_chase_tool_or_elbow(arm, tool) -> None:
    assert {draw_scene(arm, "chasing", number, 0).tool_chased for number in range(6)} == {True, False}
    assert {draw_scene(tool, "chasing", number, 0).tool_chased for number in range(6)} == {True}


def test_a_contact_of_the_elbow_ends_the_scene_and_with_the_tool_guarded_it_does_not(arm, tool, elbow) -> None:
    blind, _ = Stage(arm).play(elbow, Replay(arm))
    assert (blind.contact, blind.arm_touched) == ("moving", False)
    same, _ = Stage(tool).play(elbow, Replay(tool))
    assert (same.contact, same.arm_touched) == ("", True)


def test_ours_avoids_with_what_is_guarded(arm, tool) -> None:
    assert [Geodesics(arena).settings["avoid"] for arena in (arm, tool)] == ["arm", "tool"]


def test_success_is_by_the_pose_of_the_tool(arm) -> None:
    scene = draw_scene(arm, "none", 0, 0)
    outcome, postures = Stage(arm).play(scene, Geodesics(arm))
    assert outcome.success
    np.testing.assert_allclose(arm.robot.forward(postures[-1])[0], scene.goal_pose[0], atol=0.01)


def test_an_elbow_s_sphere_leaves_hands_free_and_blocks_the_arm(arm, elbow) -> None:
    (sphere,) = elbow.spheres
    hand = np.array(arm.collision.points.names)[arm.collision.moving] == "panda_hand"
    apart = [
        np.linalg.norm(arm.body(item.positions) - sphere.begin, axis=-1) - arm.body_radii - sphere.radius
        for item in elbow.demonstrations
    ]
    assert np.mean([np.min(item[:, hand]) >= 0.09 for item in apart]) >= 0.5
    assert any(np.min(item[:, ~hand]) < 0.0 for item in apart)


def test_results_of_another_guard_are_kept_apart(skill, tmp_path) -> None:
    usual = BenchmarkSettings(("replay",), ("none",))
    guarded = replace(usual, guard="arm")
    Bench(skill, guarded, tmp_path).scene("none", 0)
    assert Results(tmp_path, skill.name, 0).numbers("replay", "none") == []
    assert guarded.results(tmp_path, skill).numbers("replay", "none") == [0]
    folders = {
        item.results_folder(tmp_path, skill)
        for item in (usual, guarded, replace(usual, held_out=True), replace(guarded, held_out=True))
    }
    assert len(folders) == 4
    # Its own guard, by its name, is no other one.
    assert replace(usual, guard="tool").results_folder(tmp_path, skill) == tmp_path / skill.name


def test_a_sphere_on_the_elbow_is_no_start(arm, elbow) -> None:
    """Control of the judge: it sees the arm that stands."""
    touching = MovingSphere(0.05, 0.0, np.inf, elbow_position(arm.robot, elbow.start), np.zeros(3), False)
    outcome, _ = Stage(arm).play(replace(elbow, spheres=(touching,)), Replay(arm))
    assert outcome.contact
    assert outcome.duration < 0.1
