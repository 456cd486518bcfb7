"""Clouds: methods are handed what the node makes of them, as late as they are, and the judge knows nothing of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.obstacles.cloud_memory import STOOD
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.camera import DELAY, PLACE, RATE
from geodesic_motion_studies.comparison.cloud import CloudStage, SeenInClouds, node_settings
from geodesic_motion_studies.comparison.method import TICK, Answer
from geodesic_motion_studies.comparison.run import BenchmarkSettings
from geodesic_motion_studies.comparison.scene import Scene, draw_scene
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

RADIUS, BEGIN, VELOCITY = 0.05, np.array([0.45, -0.5, 0.6]), np.array([0.0, 0.1, 0.05])
VANISHES, TICKS = 3.0, 400
#: What was there at the first cloud counts as standing until its memory ends [s].
KNOWN = STOOD + 0.1


class Standing:
    """Notes what it is handed, and lets the arm stand."""

    def reset(self, scene: Scene) -> None:
        self.handed: list[Obstacles] = []

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        self.handed.append(obstacles)
        return Answer()


@pytest.fixture(scope="module")
def handed(arena: Arena) -> list[Obstacles]:
    """What a method is handed in every tick of 4 s in which a ball passes and vanishes."""
    scene = replace(
        draw_scene(arena, "none", 0, 0), spheres=(MovingSphere(RADIUS, 0.0, VANISHES, BEGIN, VELOCITY, False),)
    )
    method, stage = Standing(), CloudStage(arena)
    motion = SeenInClouds(stage.world, method, arena)
    motion.reset(scene)
    for tick in range(TICKS):
        there = int(tick * TICK < VANISHES)
        place, velocity = (np.tile(one, (there, 1)) for one in (BEGIN + tick * TICK * VELOCITY, VELOCITY))
        motion.tick(tick * TICK, Obstacles.of_spheres(place, np.full(there, RADIUS), velocity, tick * TICK))
    motion.close()
    return method.handed


def test_nothing_is_known_before_the_first_cloud_arrives(handed):
    first = round(DELAY / TICK)
    assert [len(one.radii) for one in handed[:first]] == [0] * first
    assert len(handed[first].radii) == 1


def test_the_arm_is_no_obstacle_and_the_ball_is_where_it_is_now(handed):
    for tick in range(60, round(VANISHES / TICK)):
        place, known = BEGIN + tick * TICK * VELOCITY, handed[tick]
        reached = np.linalg.norm(known.centres - place, axis=1) + RADIUS
        assert np.any(reached <= known.radii)
        # All that is known besides is where the ball was.
        was = BEGIN + np.linspace(0.0, tick * TICK, 100)[:, None] * VELOCITY
        away = cdist(np.concatenate([known.centres, known.cloud.occupied]), was)
        assert np.max(np.min(away, axis=1)) < RADIUS + 0.03


def test_a_ball_that_has_always_moved_has_its_velocity(handed):
    for tick in range(round(KNOWN / TICK), round(VANISHES / TICK)):
        known = handed[tick]
        off = np.linalg.norm(known.velocities - VELOCITY, axis=1)
        assert np.min(off) < 0.06


def test_what_has_vanished_is_forgotten_after_a_moment(handed):
    # Seen a period before at least, published later, and remembered for half a second.
    forgotten = round((VANISHES + DELAY + MOMENT + 1.0 / RATE) / TICK) + 2
    assert len(handed[round((VANISHES + DELAY) / TICK) - 1].radii) > 0
    assert [(len(one.radii), len(one.cloud.occupied)) for one in handed[forgotten:]] == [(0, 0)] * (TICKS - forgotten)


def test_of_a_sphere_that_touches_it_is_known_for_how_long_pictures_have_shown_it(arena: Arena):
    """The nearest to the arm, since it appeared; the control: one that is nearer, and behind the camera's back."""
    shown, beside = 0.4, np.array([0.45, -0.3, 0.6])
    ball = MovingSphere(RADIUS, 0.0, VANISHES, beside, np.zeros(3), False)
    far = replace(ball, begin=PLACE + [0.5, -0.5, 0.0])
    stage = CloudStage(arena)
    for spheres, expected in (((ball, far), shown), ((far,), 0.0)):
        scene = replace(draw_scene(arena, "none", 0, 0), spheres=spheres)
        motion = SeenInClouds(stage.world, Standing(), arena)
        motion.reset(scene)
        for tick in range(round(shown / TICK)):
            places = np.stack([sphere.begin for sphere in spheres])
            motion.tick(tick * TICK, Obstacles.of_spheres(places, np.full(len(spheres), RADIUS), time=tick * TICK))
        stage.geometry.place(motion.joint_positions)
        assert motion.in_view(stage.geometry) == pytest.approx(expected, abs=1.0 / RATE)
        motion.close()


def test_clouds_are_read_as_the_node_reads_them_by_default():
    values = {parameter.name: parameter.default for parameter in PLANNER}
    assert node_settings().voxel == values["obstacle_cloud_voxel"]
    assert node_settings().padding == values["self_filter_padding"]


def test_clouds_are_not_played_with_a_camera_or_a_lag():
    for other in ({"camera": True}, {"lag": 0.1}):
        with pytest.raises(ParameterError, match="not played together"):
            BenchmarkSettings(("ours",), cloud=True, **other)
