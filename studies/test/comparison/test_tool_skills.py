"""Scenes of a skill of the tool: the arm carries it along what was shown, and the hand alone is guarded and judged."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.swivel import elbow_position, solve_with_swivel, swivel_angle
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import RESTING, Stage
from geodesic_motion_studies.comparison.families import families_of
from geodesic_motion_studies.comparison.method import Answer
from geodesic_motion_studies.comparison.methods.detoured_base import DetouredBase
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.methods.replay import Replay
from geodesic_motion_studies.comparison.run import BenchmarkSettings, play_benchmark
from geodesic_motion_studies.comparison.scene import Scene, draw_scene
from geodesic_motion_studies.comparison.tool_demonstrations import followed
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere


@pytest.fixture(scope="module")
def arena() -> Arena:
    return Arena.of(Skill.load("panda_pouring"))


@pytest.fixture(scope="module")
def stage(arena: Arena) -> Stage:
    return Stage(arena)


@pytest.fixture(scope="module")
def ours(arena: Arena) -> Geodesics:
    return Geodesics(arena)


@pytest.fixture(scope="module")
def blocked(arena: Arena) -> Scene:
    """A scene in which the nearest demonstration is blocked, and at least half of them are not."""
    scenes = (draw_scene(arena, "static", number, 0) for number in range(0, 40, 2))
    return next(scene for scene in scenes if not scene.free[arena.nearest(scene.start, scene.goal)])


def among(scene: Scene, *spheres: MovingSphere) -> Scene:
    return replace(scene, spheres=spheres)


def standing(centre: np.ndarray, radius: float) -> MovingSphere:
    return MovingSphere(radius, 0.0, np.inf, centre, np.zeros(3), False)


def test_demonstrations_begin_and_end_in_one_configuration_and_are_the_tool_s(arena) -> None:
    start, goal = arena.shown[2, 0], arena.shown[5, -1]
    moved = arena.moved(start, goal)
    np.testing.assert_allclose(moved[:, 0], np.tile(start, (len(moved), 1)), atol=1e-5)
    np.testing.assert_allclose(moved[:, -1], np.tile(goal, (len(moved), 1)), atol=1e-5)
    # To its own start and goal a demonstration is not moved at all.
    np.testing.assert_allclose(arena.moved(arena.shown[4, 0], arena.shown[4, -1])[4], arena.shown[4], atol=1e-5)
    assert np.max(np.abs(np.diff(moved, axis=1))) < 0.3


def test_a_posture_is_as_near_to_the_ready_one_as_its_pose_allows(arena) -> None:
    posture, robot = arena.shown[0, 50], arena.robot
    free = np.linalg.svd(robot.jacobian(posture))[2][6]
    assert abs(free @ (robot.ready - posture)) < 1e-4


def test_what_the_arm_cannot_follow_is_refused(arena) -> None:
    curve = arena.tool_curve(arena.shown[0])
    far = replace(curve, positions=curve.positions + [0.6, 0.0, 0.0])
    with pytest.raises(ParameterError, match="does not hold its tool"):
        followed(arena.robot, far, arena.shown[0, 0])
    with pytest.raises(ParameterError, match="another posture"):
        followed(arena.robot, curve, arena.shown[0, 0], arena.shown[0, 0])


def test_scenes_are_drawn_on_the_hand_and_again_the_same(arena) -> None:
    assert set(arena.collision.points.names) == {"panda_hand"}
    first, again = (draw_scene(arena, "chasing", 2, 3) for _ in range(2))
    np.testing.assert_array_equal(first.start, again.start)
    assert [sphere.begin.tolist() for sphere in first.spheres] == [sphere.begin.tolist() for sphere in again.spheres]
    # What chases has only the tool to chase.
    assert all(draw_scene(arena, "chasing", number, 0).tool_chased for number in range(4))


def test_there_is_no_elbow_to_be_guarded(arena, tmp_path) -> None:
    assert "elbow" not in families_of(arena.guard)
    with pytest.raises(ParameterError, match="no 'elbow' with 'panda_pouring' while the tool alone"):
        draw_scene(arena, "elbow", 0, 0)
    with pytest.raises(ParameterError, match="choose from none, static, crossing"):
        next(play_benchmark(arena.skill, BenchmarkSettings(("replay",), families=("elbow",)), tmp_path))


def test_the_tool_reaches_the_goal(arena, stage, ours) -> None:
    scene = draw_scene(arena, "none", 0, 0)
    outcome, postures = stage.play(scene, ours)
    assert outcome.success
    assert outcome.dtw < 0.02
    position, quaternion = arena.robot.forward(postures[-1])
    np.testing.assert_allclose(position, scene.goal_pose[0], atol=0.01)
    assert angle_between(quaternion, scene.goal_pose[1]) < 0.1


def test_the_control_is_hit_where_ours_is_not(arena, stage, ours, blocked) -> None:
    assert blocked.mostly_free
    blind, _ = stage.play(blocked, Replay(arena))
    assert (blind.contact, blind.success) == ("moving", False)
    outcome, _ = stage.play(blocked, ours)
    assert outcome.success
    assert 0.0 < outcome.clearance < 0.3


def test_a_detour_from_another_base_keeps_the_hand_alone_clear(arena, stage, blocked) -> None:
    method = DetouredBase(arena, "nearest demonstration")
    outcome, _ = stage.play(blocked, method)
    assert outcome.success
    assert 0.0 < outcome.clearance < 0.3
    elbow = standing(elbow_position(arena.robot, blocked.start), 0.05)
    outcome, _ = stage.play(among(blocked, elbow), method)
    assert outcome.success
    assert outcome.arm_touched


def test_the_elbow_may_be_touched_and_that_is_said_and_the_hand_may_not(arena, stage, blocked) -> None:
    start = blocked.start
    replay = Replay(arena)
    outcome, _ = stage.play(among(blocked, standing(elbow_position(arena.robot, start), 0.05)), replay)
    assert outcome.success
    assert outcome.arm_touched
    outcome, _ = stage.play(among(blocked, standing(arena.robot.forward(start)[0], 0.05)), replay)
    assert outcome.contact


class Holding:
    """Holds the hand where it is. The arm comes back to its ready posture meanwhile, elbow alone."""

    settings: ClassVar[dict[str, object]] = {}

    def __init__(self, arena: Arena) -> None:
        self._robot = arena.robot

    def reset(self, scene: Scene) -> None:
        self._pose = self._robot.forward(scene.start)

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        return Answer(pose=self._pose, refusal="it holds")


def test_a_hand_that_rests_while_the_elbow_swings_is_touched_as_it_stands(arena, stage, blocked) -> None:
    robot, start = arena.robot, blocked.start
    swung = solve_with_swivel(robot, *robot.forward(start), swivel_angle(robot, start) + 0.4, start)
    towards = np.array([0.2, 0.0, 0.0])
    coming = MovingSphere(0.04, 0.0, 10.0, robot.forward(start)[0] - 1.5 * towards, towards, False)
    outcome, postures = stage.play(replace(among(blocked, coming), start=swung), Holding(arena))
    # 50 postures a second: as it is touched, joints are faster than those of an arm that rests.
    assert np.max(np.abs(postures[-2] - postures[-3])) * 50.0 > 2.0 * RESTING
    assert outcome.contact == "standing"


def test_without_the_hard_part_ours_goes_into_what_it_cannot_avoid(arena, stage, ours, blocked) -> None:
    ahead = blocked.demonstrations[0].sample(0.5 * blocked.demonstrations[0].duration)[0]
    wall = among(blocked, standing(arena.robot.forward(ahead)[0], 0.15))
    assert stage.play(wall, ours)[0].refused
    assert stage.play(wall, Geodesics(arena, "soft"))[0].contact == "moving"


def test_parts_say_which_they_are(arena, ours) -> None:
    parts = [method.settings for method in (ours, Geodesics(arena, "hard"))]
    assert [part["part"] for part in parts] == ["whole", "hard"]
    assert [part["ambient_law"] for part in parts] == ["gaussian", "hard"]
    assert len(parts[0]["tool_points"]) == len(arena.collision)
