"""Bottles carried: the arm pours into every cup in turn, and a sphere that crosses is evaded, tick by tick."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.pose_path import PosePathPlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.pouring_motions import (
    Stream,
    draw_moment,
    past_a_moving_sphere,
    pour_all_cups,
)
from geodesic_motion_studies.experiments.pouring_scene import bottle_settings


def test_the_chain_pours_every_cup(pouring_pose_skill: Skill) -> None:
    chain = pour_all_cups(PosePathPlanner(pouring_pose_skill, bottle_settings()), 0)
    assert chain.reason == ""
    assert len(chain.parts) == len(chain.mouth_off) == 3
    assert max(chain.mouth_off) < 1e-3
    assert chain.behind < 0.005
    assert chain.clearance > 0.0
    for before, after in pairwise(chain.parts):
        np.testing.assert_allclose(before.positions[-1], after.positions[0], atol=1e-6)


def test_a_part_that_is_refused_ends_the_chain_and_is_named(pouring_pose_skill: Skill) -> None:
    strict = PlannerSettings(maximum_offset=1e-4)
    chain = pour_all_cups(PosePathPlanner(pouring_pose_skill, strict), 0)
    assert chain.parts == ()
    assert chain.reason.startswith("part 0: ")
    assert len(chain.joints) == 0


@pytest.fixture(scope="module")
def stream(pouring_pose_skill: Skill) -> Stream:
    return past_a_moving_sphere(ReactivePlanner(pouring_pose_skill, replace(bottle_settings(), avoid="tool")))


def test_the_sphere_is_passed_that_the_path_without_it_meets(stream: Stream) -> None:
    assert stream.reached
    assert stream.unaware < 0.0 < stream.clearance
    early, late = stream.moments
    assert early.time < late.time
    assert len(early.followed) < len(late.followed)


def test_a_moment_shows_sphere_bottle_and_both_geodesics(stream: Stream, pouring_poses: Demonstrations) -> None:
    axes = Figure().add_subplot()
    handles = draw_moment(axes, pouring_poses, stream.nominal, stream.moments[1])
    named = {str(handle.get_label()) for handle in handles}
    assert named == {"moving sphere", "bottle", "geodesic without it", "geodesic at the time", "path followed so far"}


def test_without_a_path_there_is_no_stream(pouring_pose_skill: Skill) -> None:
    with pytest.raises(ParameterError, match="even without the sphere"):
        past_a_moving_sphere(ReactivePlanner(pouring_pose_skill, PlannerSettings(maximum_offset=1e-4)))
