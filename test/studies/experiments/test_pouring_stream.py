"""A sphere that crosses under the bottle: passed clear of it, where the geodesic without it would have met it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from matplotlib.figure import Figure

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.studies.experiments.held_bottle import bottle_settings
from geodesic_motion_ros.studies.experiments.pouring_stream import Stream, draw_moment, past_a_moving_sphere
from geodesic_motion_ros.utils.errors import ParameterError


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
