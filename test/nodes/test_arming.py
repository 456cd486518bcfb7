"""Arming: by hand where the planner does not begin armed, with what must be heard said, and anew after a surprise."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.nodes.arming import Arming
from geodesic_motion_ros.utils.errors import ParameterError


def test_a_planner_that_begins_armed_stays_so_but_for_a_person():
    arming = Arming(True, [""])
    assert not arming.disarm("the arm was pushed")
    assert arming.unarmed == ""
    assert arming.disarm("~/arm was called with false", by_itself=False)
    assert "~/arm was called with false" in arming.unarmed
    assert arming.arm() == "armed: the arm moves with the next goal"
    assert arming.unarmed == ""


def test_one_that_is_armed_by_hand_is_disarmed_by_a_surprise_and_states_it():
    arming = Arming(False, ["obstacles"])
    assert "call ~/arm with data: true" in arming.unarmed
    arming.arm()
    assert arming.unarmed == ""
    assert arming.arm() == "armed already"
    assert arming.disarm("the arm was pushed")
    assert arming.unarmed.startswith("disarmed: the arm was pushed; call ~/arm")
    assert not arming.disarm("the arm is silent")
    assert arming.unarmed.startswith("disarmed: the arm was pushed;")


@pytest.mark.parametrize(
    ("armed", "topics", "refused"),
    [(False, [""], True), (False, ["none"], False), (False, ["obstacle_cloud", ""], False), (True, [""], False)],
)
def test_what_must_be_heard_before_an_arm_moves_has_to_be_said(armed, topics, refused):
    arming = Arming(armed, topics)
    assert arming.required == tuple(topic for topic in topics if topic not in ("", "none"))
    if refused:
        with pytest.raises(ParameterError, match=r"required_obstacle_topics names nothing: .* or with \['none'\]"):
            arming.arm()
        assert arming.unarmed
    else:
        arming.arm()
        assert arming.unarmed == ""


def test_nothing_and_something_contradict_each_other():
    with pytest.raises(ParameterError, match="name topics, or none alone"):
        Arming(True, ["none", "obstacles"])
