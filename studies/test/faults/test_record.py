"""What follows from what the planner has said."""

from __future__ import annotations

import pytest

from geodesic_motion_studies.faults.record import Status


@pytest.mark.parametrize(
    ("code", "goal_code", "without"),
    [
        ("NO_GOAL", "NO_GOAL", True),
        ("BAD_INPUT", "BAD_INPUT", True),
        ("OK", "OK", False),
        ("OK", "BAD_INPUT", False),
        ("NO_FEASIBLE_PATH", "OK", False),
    ],
)
def test_without_a_goal_a_planner_says_why_of_itself_too(code: str, goal_code: str, without: bool) -> None:
    """While it serves a goal, a refused one changes nothing of what it says of itself."""
    assert Status(0.0, {"code": code, "goal_code": goal_code}).without_goal is without


def test_an_arm_is_lost_until_it_has_rested() -> None:
    lost = "the arm is 0.2 rad from where it was sent: nothing is commanded until the arm has rested for 0.5 s"
    assert Status(0.0, {"code": "BAD_INPUT", "reason": lost}).lost
    dropped = "goal dropped: the arm was 0.2 rad from where it was sent; send the goal again"
    assert not Status(0.0, {"code": "NO_GOAL", "reason": dropped}).lost
