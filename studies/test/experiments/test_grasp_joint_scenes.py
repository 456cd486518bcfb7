"""Families distinguished, and spheres put on the paths of some of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.arm_players import Families
from geodesic_motion_studies.experiments.arm_queries import body_spheres, distances
from geodesic_motion_studies.experiments.grasp_joint_scenes import (
    RADIUS,
    Stage,
    mean_paths,
    passed_in_turn,
    sphere_on,
)


def test_stays_are_distinguished_from_brushes() -> None:
    assert passed_in_turn(np.array([0] * 40 + [1] * 60)) == (0, 1)
    assert passed_in_turn(np.array([0] * 40 + [1] * 5 + [0] * 55)) == (0,)
    assert passed_in_turn(np.array([2] * 30)) == (2,)


def test_a_sphere_is_put_on_one_path_and_leaves_the_other_free(reach_skill: Skill) -> None:
    planner = ReactivePlanner(reach_skill, PlannerSettings(grid_shape=(20, 20, 20)))
    blocked, free = mean_paths(reach_skill)
    centre = sphere_on(planner, blocked, free)
    on_blocked, on_free = (distances(planner, body_spheres(planner, path), centre, RADIUS) for path in (blocked, free))
    assert on_blocked.min() < 0.0 < on_free.min()


def test_a_skill_on_the_raw_sheet_is_refused(reach_skill: Skill) -> None:
    with pytest.raises(ParameterError, match="knows no families"):
        mean_paths(replace(reach_skill, canonical=None))


def test_spheres_are_drawn_in_the_arm_and_some_start_is_not_covered(separated_demonstrations) -> None:
    families = Families.of(separated_demonstrations, 2)
    drawn = Stage(families, connected=False).drawn(4, 1)
    assert [scene.start for scene in drawn] == [(0,), (1,)] * 4
    for first, second in zip(drawn[::2], drawn[1::2], strict=True):
        np.testing.assert_array_equal(first.centres, second.centres)
        # It is in the motion of one of both.
        assert not (first.covered and second.covered)
        assert not (first.left and second.left)
    again = Stage(families, connected=False).drawn(4, 1)
    np.testing.assert_array_equal([scene.centres for scene in drawn], [scene.centres for scene in again])


def test_what_is_left_of_families_that_meet_may_be_a_hybrid(reach_demonstrations) -> None:
    stage = Stage(Families.of(reach_demonstrations, 2), connected=True)
    ((start, goals),) = stage.ends()
    everything = stage.scene(start, goals, np.empty((0, 3)))
    assert everything.left == ((0,), (0, 1), (1, 0), (1,))
    assert not everything.hybrids_alone
    far = stage.scene(start, goals, np.array([[0.0, 0.0, 5.0]]))
    assert far.left == everything.left
    at_start = stage.scene(start, goals, np.array([[0.0, 0.0, 0.2]]))
    assert at_start.covered
    assert at_start.left == ()
