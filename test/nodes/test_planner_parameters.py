"""What the parameters of the planner stand for, without a node."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.planner_parameters import defaults_of_robot
from geodesic_motion_ros.robot.collision_model import tool_spheres
from geodesic_motion_ros.skill.skill import Skill


def test_defaults_of_a_robot_stand_for_those_of_the_skills_robot() -> None:
    defaults = {parameter.name: parameter.default for parameter in PLANNER}
    skill = Skill.load("ur5_reach")
    own = defaults_of_robot(skill, defaults)
    assert own["base_frame"] == skill.base_frame != defaults["base_frame"]
    np.testing.assert_array_equal(own["tool_spheres"], tool_spheres("ur5").ravel())
    assert own["tool_spheres"] != defaults["tool_spheres"]
    assert defaults_of_robot(skill, defaults | {"base_frame": "world", "tool_spheres": [0.0, 0.0, 0.0, 0.1]}) == {}
