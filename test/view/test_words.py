"""What a status says in words."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.view.words import SaidStatus, StatusReader

VALUES = {
    "code": "OK", "mode": "following", "time_to_goal": "2.34", "speed": "0.5", "clearance": "0.0481",
    "detour_mm": "12.4", "tracking_error": "0.001", "tick": "100", "last_tick_work_ms": "1.73",
}  # fmt: skip


def said(message: str = "OK", **changed: str) -> SaidStatus:
    return StatusReader().read(10.0, message, VALUES | changed)


def test_a_moving_arm_says_how_long_it_has_to_go() -> None:
    status = said()
    assert status.title == "Moving, 2.3 s to go"
    assert status.reason == ""
    assert not status.has_arrived
    assert [status.figures[name] for name in ("clearance", "detour", "off its path")] == ["48 mm", "12 mm", "1 mm"]


@pytest.mark.parametrize(
    ("changed", "title", "has_arrived"),
    [
        ({"time_to_goal": "0.0", "speed": "0.0"}, "At the goal", True),
        ({"time_to_goal": "0.0", "speed": "0.1"}, "Moving", False),
        ({"code": "NO_FEASIBLE_PATH", "mode": "waiting", "time_to_goal": "nan", "speed": "0.0"},
         "Waiting: no path is free", False),
        ({"code": "NO_GOAL", "mode": "idle", "time_to_goal": "nan", "speed": "0.0"}, "Standing, without a goal", False),
        ({"code": "STALE_STATE", "mode": "", "time_to_goal": "nan", "speed": "0.0"}, "Standing", False),
    ],
)  # fmt: skip
def test_the_title_is_what_the_arm_does(changed: dict[str, str], title: str, has_arrived: bool) -> None:
    status = said(**changed)
    assert (status.title, status.has_arrived) == (title, has_arrived)
    assert title in status.markdown


def test_the_reason_stands_without_its_code_and_with_a_goal_that_was_refused() -> None:
    message = "HOLD_REQUESTED: ~/hold was called; newest goal refused: GOAL_OUT_OF_SUPPORT: too far"
    status = said(message, code="HOLD_REQUESTED", mode="holding")
    assert status.reason == "~/hold was called; newest goal refused: GOAL_OUT_OF_SUPPORT: too far"
    assert "`HOLD_REQUESTED`" in status.markdown


def test_what_is_not_known_is_no_number() -> None:
    assert said(clearance="inf").figures["clearance"] == said(clearance="nan").figures["clearance"] == "-"


def test_the_rate_is_that_of_the_last_second_and_begins_anew_with_another_planner() -> None:
    reader = StatusReader()

    def rate(stamp: float, tick: int) -> str:
        return reader.read(stamp, "OK", VALUES | {"tick": str(tick)}).figures["planning"].partition(",")[0]

    assert rate(0.0, 0) == "..."
    rates = [rate(0.2 * number, 20 * number) for number in range(1, 20)]
    assert rates[-1] == "100 Hz"
    slower = [rate(3.8 + 0.2 * number, 380 + 10 * number) for number in range(1, 10)]
    assert slower[-1] == "50 Hz"
    assert rate(6.0, 3) == "..."
