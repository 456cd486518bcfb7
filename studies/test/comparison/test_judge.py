"""The judge: contacts in motion, soon after it and of an arm that stands, and whether waiting avoids them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import AFTER_MOTION, Judge, Outcome
from geodesic_motion_studies.comparison.motions import TableMotion
from geodesic_motion_studies.comparison.scene import Scene, draw_scene
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

#: The arm swings about its first joint by so much [rad] in so long [s], and then stands.
SWING, SWINGS_FOR = 0.6, 1.0
#: Of spheres that come [m/s], [m].
SPEED, RADIUS = 0.5, 0.04


@pytest.fixture(scope="module")
def arena(reach_skill: Skill) -> Arena:
    return Arena.of(reach_skill)


@pytest.fixture(scope="module")
def judge(arena: Arena) -> Judge:
    return Judge(arena)


@pytest.fixture(scope="module")
def scene(arena: Arena) -> Scene:
    return draw_scene(arena, "none", 0, 0)


def swung(scene: Scene) -> np.ndarray:
    """Where the arm stands after the swing (eta,) [rad]."""
    return scene.start + SWING * np.eye(len(scene.start))[0]


def sphere_to(arena: Arena, configuration: np.ndarray, arrives: float) -> MovingSphere:
    """A sphere that comes to the tool in a configuration (eta,) [rad] from above, with its centre at a time [s]."""
    place, velocity = arena.robot.forward(configuration)[0], np.array([0.0, 0.0, -SPEED])
    return MovingSphere(RADIUS, 0.0, arrives + 1.0, place - arrives * velocity, velocity, False)


def played(judge: Judge, scene: Scene, *spheres: MovingSphere, swing: bool = True) -> Outcome:
    ends = np.stack([scene.start, swung(scene) if swing else scene.start])
    motion = TableMotion(JointDemonstration(ends, np.array([0.0, SWINGS_FOR]), "swing"))
    return judge.judge(replace(scene, spheres=spheres), motion)[0]


@pytest.mark.parametrize(("arrives", "contact"), [(1.0, "moving"), (1.9, "moving"), (3.0, "standing")])
def test_a_contact_within_half_a_second_after_the_arm_moved_is_one_in_motion(
    arena, judge, scene, arrives, contact
) -> None:
    outcome = played(judge, scene, sphere_to(arena, swung(scene), arrives))
    assert outcome.contact == contact
    assert outcome.touched_moving == (outcome.stood <= AFTER_MOTION)
    if arrives > 1.0:
        # The arm stood, whichever of them it counts as, and it is said for how long.
        assert outcome.stood == pytest.approx(outcome.duration - SWINGS_FOR, abs=0.011)


def test_an_arm_that_has_never_moved_stands_from_the_beginning(arena, judge, scene) -> None:
    outcome = played(judge, scene, sphere_to(arena, scene.start, 0.5), swing=False)
    assert outcome.duration < AFTER_MOTION
    assert (outcome.contact, outcome.stood) == ("standing", outcome.duration)


def test_of_a_standing_contact_it_is_said_whether_waiting_at_the_start_avoids_it(arena, judge, scene) -> None:
    to_the_end, to_the_start = sphere_to(arena, swung(scene), 2.5), sphere_to(arena, scene.start, 5.0)
    assert played(judge, scene, to_the_end).waiting_avoids is True
    # What comes to the start after the contact touches an arm that has waited there.
    assert played(judge, scene, to_the_end, to_the_start).waiting_avoids is False
    in_motion, nothing = played(judge, scene, sphere_to(arena, swung(scene), 1.0)), played(judge, scene)
    assert in_motion.waiting_avoids is nothing.waiting_avoids is None


def test_what_chases_chases_an_arm_that_waits(arena, judge, scene) -> None:
    begin = arena.robot.forward(scene.start)[0] + [0.0, 0.0, 0.5]
    chasing = MovingSphere(RADIUS, 0.0, 5.0, begin, np.array([0.15, 0.0, 0.0]), True)
    assert judge.waiting_is_touched(replace(scene, spheres=(chasing,), tool_chased=True))
    # It gives up before it is there.
    assert not judge.waiting_is_touched(replace(scene, spheres=(replace(chasing, vanishes=1.0),), tool_chased=True))
