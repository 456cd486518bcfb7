"""What the twin's parameters stand for, without a node."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geodesic_motion_ros.nodes.parameter_tables import TWIN
from geodesic_motion_ros.nodes.twin_parameters import (
    base_frame,
    check_twin,
    initial_joints,
    scene_around,
    scripted_spheres,
    start_joints,
    steps_per_message,
)
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError

PANDA = Robot.named("panda")
DEFAULTS = {parameter.name: parameter.default for parameter in TWIN}


def values(**changed: Any) -> dict[str, Any]:
    assert changed.keys() <= DEFAULTS.keys()
    return DEFAULTS | changed


@pytest.mark.parametrize("name", ["panda_pouring", "panda_reach_to_grasp"])
def test_a_panda_begins_where_the_skill_does(name: str) -> None:
    skill = Skill.load(name)
    position, _ = PANDA.forward(initial_joints(values(skill=name), PANDA))
    np.testing.assert_allclose(position, skill.start_pose[:3], atol=1e-3)


def test_joints_that_are_given_come_before_the_skill() -> None:
    """The control: without them those of the skill."""
    given = (PANDA.ready + 0.1).tolist()
    chosen = initial_joints(values(skill="panda_pouring", initial_joint_positions=given), PANDA)
    np.testing.assert_array_equal(chosen, given)
    np.testing.assert_array_equal(initial_joints(values(skill="panda_pouring"), PANDA), start_joints("panda_pouring"))
    np.testing.assert_allclose(initial_joints(values(skill=""), PANDA), PANDA.ready, atol=1e-4)


def test_messages_come_no_rarer_than_requested_and_never_at_rate_zero() -> None:
    rates = {"state_rate": 100.0, "obstacle_rate": 240.0, "image_rate": 0.0, "cloud_rate": 15.0}
    steps = steps_per_message(values(physics_rate=240.0, **rates))
    assert steps == {"state_rate": 2, "obstacle_rate": 1, "image_rate": 0, "cloud_rate": 16}


def test_the_default_frame_stands_for_that_of_the_robot() -> None:
    ur5 = Robot.named("ur5")
    assert base_frame(values()) == DEFAULTS["base_frame"] == PANDA.base_link
    assert base_frame(values(skill="ur5_reach")) == base_frame(values(skill="", robot="ur5")) == ur5.base_link
    assert base_frame(values(skill="ur5_reach", base_frame="world")) == "world"


def test_spheres_are_named_or_described_or_none() -> None:
    assert scripted_spheres("").items == {}
    assert len(scripted_spheres("two").items) == 2
    described = scripted_spheres("ball: {kind: static, centre: [0.5, 0.0, 0.5], radius: 0.1}")
    assert list(described.items) == ["ball"]
    with pytest.raises(ParameterError, match="neither a name nor YAML"):
        scripted_spheres("ball: {")


def test_spheres_in_the_place_of_a_scene_are_refused_with_the_name_of_their_parameter() -> None:
    """The control: nothing is declared, and nothing stands there."""
    for text in ("two", "ball: {kind: static, centre: [0.5, 0.0, 0.5], radius: 0.1}"):
        with pytest.raises(ParameterError, match="the parameter `spheres` now"):
            scene_around(text, "")
    assert scene_around("", "").names == ()


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"initial_joint_positions": [0.0] * 7}, "initial_joint_positions: joint 'panda_joint4'"),
        ({"physics_rate": 200.0, "state_rate": 300.0}, "state_rate = 300 Hz: expected at most physics_rate, 200 Hz"),
        ({"spheres": "nobody"}, "there are no spheres 'nobody'"),
    ],
)
def test_values_that_do_not_go_together_are_refused(changed: dict[str, Any], reason: str) -> None:
    check_twin(values())
    with pytest.raises(ParameterError, match=reason):
        check_twin(values(**changed))
