"""What the parameters of the planner stand for, without a node."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import TOOL_LIMITS, PlannerSettings
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.planner_parameters import defaults_of_robot, planner_settings, why_paused
from geodesic_motion_ros.robot.collision_model import tool_spheres
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import PlanningError


def test_defaults_of_a_robot_stand_for_those_of_the_skills_robot() -> None:
    defaults = {parameter.name: parameter.default for parameter in PLANNER}
    skill = Skill.load("ur5_reach")
    own = defaults_of_robot(skill, defaults)
    assert own["base_frame"] == skill.base_frame != defaults["base_frame"]
    np.testing.assert_array_equal(own["tool_spheres"], tool_spheres("ur5").ravel())
    assert own["tool_spheres"] != defaults["tool_spheres"]
    assert defaults_of_robot(skill, defaults | {"base_frame": "world", "tool_spheres": [0.0, 0.0, 0.0, 0.1]}) == {}


@pytest.mark.parametrize(
    ("override", "scale", "rests"),
    [(1.0, 0.3, False), (0.5, 0.3, False), (0.2, 0.05, False), (0.19, 0.05, True), (0.0, 1.0, True)],
)
def test_an_override_that_leaves_too_little_speed_has_the_arm_rest_and_is_no_setting(override, scale, rests) -> None:
    values = {parameter.name: parameter.default for parameter in PLANNER}
    values |= {"speed_override": override, "speed_scale": scale}
    assert bool(why_paused(values)) == rests
    assert planner_settings(values).speed_override == (1.0 if rests else override)
    if rests:
        assert f"until it is {0.01 / scale:.2g} or more" in why_paused(values)


@pytest.mark.parametrize("override", [0.5, 0.1])
def test_an_override_is_a_share_of_the_limits_of_joints_and_of_the_tool(override) -> None:
    values = {parameter.name: parameter.default for parameter in PLANNER}
    full, slow = planner_settings(values), planner_settings(values | {"speed_override": override})
    assert slow.joint_speed_scale == pytest.approx(override * full.joint_speed_scale)
    limits, slower = full.tool_limits(TOOL_LIMITS), slow.tool_limits(TOOL_LIMITS)
    assert slower.speed == pytest.approx(override * limits.speed)
    assert slower.angular_speed == pytest.approx(override * limits.angular_speed)
    # it brakes as hard as before
    assert slower.acceleration == limits.acceleration
    assert slower.angular_acceleration == pytest.approx(limits.angular_acceleration)


@pytest.mark.parametrize("override", [0.0, -0.5, 1.1, np.nan])
def test_a_setting_that_is_no_share_of_the_speed_is_refused(override) -> None:
    with pytest.raises(PlanningError, match="speed_override"):
        PlannerSettings(speed_override=override)
