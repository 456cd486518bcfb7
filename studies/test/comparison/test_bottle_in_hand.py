"""The bottle in the hand: where it is judged to be, and that a planner which knows of it touches nothing with it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import rotate
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.bottle_in_hand import (
    BOTTLE,
    ROOM,
    TAKEN,
    BottleStage,
    Holding,
    MeshesAndBottle,
)
from geodesic_motion_studies.comparison.scene import Scene, draw_scene
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

RADIUS, HEIGHT = BOTTLE.dimensions
#: A sphere that the end of the bottle meets, after so long [s], and its radius [m].
MEETING, SPHERE = 2.0, 0.02


@pytest.fixture(scope="module")
def arena() -> Arena:
    return Arena.of(Skill.load("panda_pouring"), "arm")


def bottle_points(posture: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) of the bottle's own frame, in the base frame [m]."""
    position, quaternion = Robot.named("panda").forward(posture)
    in_tool = np.array(BOTTLE.position) + rotate(np.array(BOTTLE.quaternion), points)
    return position + rotate(quaternion, in_tool)


def test_the_bottle_is_where_the_hand_is() -> None:
    angles, heights = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 400), np.linspace(-0.5, 0.5, 200) * HEIGHT)
    side = np.stack([RADIUS * np.cos(angles), RADIUS * np.sin(angles), heights], axis=-1).reshape(-1, 3)
    disc = (np.linspace(0.0, 1.0, 60)[:, None, None] * side[:400] * [1.0, 1.0, 0.0]).reshape(-1, 3)
    end = np.array([0.0, 0.0, 0.5 * HEIGHT])
    posture = Robot.named("panda").ready
    surface = bottle_points(posture, np.concatenate([side, disc + end, disc - end]))
    random = np.random.default_rng(0)
    with MeshesAndBottle("panda") as meshes:
        meshes.place(posture)
        for centre in bottle_points(posture, random.uniform(-0.25, 0.25, size=(40, 3))):
            nearest = np.min(np.linalg.norm(surface - centre, axis=1))
            assert abs(meshes.bottle_clearance(centre, 0.0)) == pytest.approx(nearest, abs=1e-3)
            assert meshes.bottle_clearance(centre, 0.01) == pytest.approx(meshes.bottle_clearance(centre, 0.0) - 0.01)
        middle, beyond = bottle_points(posture, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, HEIGHT]]))
        assert meshes.bottle_clearance(middle, 0.0) == pytest.approx(-RADIUS)
        assert meshes.bottle_clearance(beyond, 0.0) == pytest.approx(0.5 * HEIGHT)
        assert BOTTLE.name not in meshes.clearances(beyond, 0.01)
        meshes.holds = True
        assert meshes.clearances(beyond, 0.01)[BOTTLE.name] == pytest.approx(0.5 * HEIGHT - 0.01)


def test_what_only_the_bottle_would_touch_is_touched_by_the_control_alone(arena: Arena) -> None:
    stage, free = BottleStage(arena), draw_scene(arena, "none", 0, 0)
    ours, control = Holding(arena), Holding(arena, knows_bottle=False)
    outcome, postures = stage.play(free, ours)
    assert outcome.success
    scene = with_sphere_at_the_end_of_the_bottle(stage, free, postures)
    outcome, _ = stage.play(scene, control)
    assert outcome.contact == "moving"
    assert outcome.duration > TAKEN
    outcome, _ = stage.play(scene, ours)
    assert outcome.contact == ""
    assert outcome.clearance > 0.0


def with_sphere_at_the_end_of_the_bottle(stage: BottleStage, free: Scene, postures: np.ndarray) -> Scene:
    """One that stands where an end of the bottle comes by, and no mesh of the arm ever does."""
    times = np.linspace(0.0, len(postures) / 50.0, len(postures))
    met = postures[np.searchsorted(times, MEETING)]
    geometry = stage.geometry
    for centre in bottle_points(met, np.array([[0.0, 0.0, 0.5 * HEIGHT], [0.0, 0.0, -0.5 * HEIGHT]])):
        of_arm, of_bottle = [], []
        for posture in postures:
            geometry.place(posture)
            geometry.holds = False
            of_arm.append(geometry.clearance(centre, SPHERE))
            of_bottle.append(geometry.bottle_clearance(centre, SPHERE))
        before = np.array(of_bottle)[times <= TAKEN + 0.1]
        if min(of_arm) > 0.01 and np.min(before) > ROOM:
            sphere = MovingSphere(SPHERE, 0.0, math.inf, centre, np.zeros(3), chases=False, rests=0.0)
            return replace(free, spheres=(sphere,))
    raise AssertionError("an end of the bottle is to come by where the arm does not")
