"""RefusalLog are swallowed, counted by topic and reported once in a while; so are errors that nobody expected."""

from __future__ import annotations

import time

import pytest
from std_srvs.srv import Trigger

from geodesic_motion_ros.nodes.messages import MessageRefused
from geodesic_motion_ros.nodes.refusals import RefusalLog


def test_counts_all_and_warns_of_the_first_of_each_topic():
    warnings: list[str] = []
    refusals = RefusalLog(warnings.append, quiet=3600.0)
    for topic in ("goal_pose", "obstacles", "goal_pose", "goal_pose"):
        with refusals.guard(topic):
            raise MessageRefused(f"bad {topic}")
    assert refusals.counts == {"goal_pose": 3, "obstacles": 1}
    assert warnings == [
        "refused a message on goal_pose: bad goal_pose",
        "refused a message on obstacles: bad obstacles",
    ]
    assert refusals.newest(within=60.0) == "goal_pose: bad goal_pose"
    assert refusals.newest(within=0.0) == ""


def test_warns_again_when_the_quiet_time_is_over():
    warnings: list[str] = []
    refusals = RefusalLog(warnings.append, quiet=0.0)
    refusals.add("goal_pose", "first")
    refusals.add("goal_pose", "second")
    assert len(warnings) == 2


def test_a_reason_that_stays_is_warned_of_less_often_than_a_new_one():
    warnings: list[str] = []
    refusals = RefusalLog(warnings.append, quiet=0.05)
    until = time.monotonic() + 0.3
    while time.monotonic() < until:
        refusals.add("joint_states", "lacks a joint")
        refusals.add("goal_pose", f"at {time.monotonic()}")
    about = [warning.split()[4] for warning in warnings]
    assert about.count("joint_states:") == 1
    assert about.count("goal_pose:") > 1


def test_any_other_error_is_counted_and_reported_with_its_type_and_place():
    warnings: list[str] = []
    refusals = RefusalLog(warnings.append)
    with refusals.guard("goal_pose"):
        raise ZeroDivisionError
    assert refusals.counts == {"goal_pose": 1}
    assert refusals.newest(within=60.0) == "goal_pose: internal error, see the log: ZeroDivisionError()"
    assert warnings[0].startswith("an error in goal_pose: internal error")
    assert "raise ZeroDivisionError" in warnings[0]


def test_a_service_is_answered_with_what_was_done_or_why_not():
    refusals = RefusalLog(lambda text: None)

    def refuse() -> str:
        raise MessageRefused("not now")

    answers = {work: refusals.answer("~/reset", Trigger.Response(), work) for work in (lambda: "done", refuse, fail)}
    assert [(answer.success, answer.message) for answer in answers.values()] == [
        (True, "done"), (False, "not now"), (False, "internal error, see the log: ZeroDivisionError()"),
    ]  # fmt: skip
    assert refusals.counts == {"~/reset": 2}


def fail() -> str:
    raise ZeroDivisionError


def test_what_is_to_end_the_program_passes():
    refusals = RefusalLog(lambda text: None)
    with pytest.raises(KeyboardInterrupt), refusals.guard("goal_pose"):
        raise KeyboardInterrupt
    assert refusals.counts == {}
