"""Families told apart, and spheres put into the way of some of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.arm_queries import body_spheres, distances
from geodesic_motion_ros.experiments.grasp_joint_scenes import RADIUS, mean_ways, passed_in_turn, sphere_on
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.skill import Skill


def test_stays_are_told_from_brushes() -> None:
    assert passed_in_turn(np.array([0] * 40 + [1] * 60)) == (0, 1)
    assert passed_in_turn(np.array([0] * 40 + [1] * 5 + [0] * 55)) == (0,)
    assert passed_in_turn(np.array([2] * 30)) == (2,)


def test_a_sphere_is_put_into_one_way_and_leaves_the_other_free(reach_skill: Skill) -> None:
    planner = JointSpacePlanner(reach_skill, JointPlannerSettings(grid_shape=(20, 20, 20)))
    blocked, free = mean_ways(reach_skill)
    centre = sphere_on(planner, blocked, free)
    on_blocked, on_free = (distances(planner, body_spheres(planner, way), centre, RADIUS) for way in (blocked, free))
    assert on_blocked.min() < 0.0 < on_free.min()


def test_a_skill_on_the_raw_sheet_is_refused(reach_skill: Skill) -> None:
    with pytest.raises(ParameterError, match="knows no families"):
        mean_ways(replace(reach_skill, canonical=None))
