"""What rows on states and obstacles are worth: each passes a made planner that is right, and fails every flaw."""

from __future__ import annotations

import pytest

from geodesic_motion_studies.faults.catalogue import chosen
from geodesic_motion_studies.faults.message_faults import MESSAGE_FAULTS
from geodesic_motion_studies.faults.obstacle_faults import OBSTACLE_FAULTS
from geodesic_motion_studies.faults.state_faults import STATE_FAULTS
from geodesic_motion_studies.faults.suite import Case, run_case

#: A planner that has one of these fails the row, and for that reason: a part of what is said then.
FLAWS: dict[str, dict[str, str]] = {
    "state_stops": {
        "does not mind silence": "waiting for STALE_STATE", "reacts late": "STALE_STATE after",
        "rolls on": "at rest after", "stays": "goal is not reached",
    },
    "state_late_200": {"reacts late": "STALE_STATE after", "takes old for new": "with late messages"},
    "state_late_50": {"knows no patience": "waiting for arrival", "hesitates": "were not OK"},
    "state_jitter": {"knows no patience": "waiting for arrival", "hesitates": "were not OK"},
    "state_reordered": {"reads in order": "waiting for arrival", "hesitates": "were not OK"},
    "state_lacks_joint": {"does not say why": "waiting for STALE_STATE", "reacts late": "STALE_STATE after"},
    "state_not_finite": {
        "does not count": "messages of joint_states refused", "stops for nonsense": "waiting for arrival",
        "hesitates": "were not OK",
    },
    "state_glitch": {"stays": "goal is not reached"},
    "obstacles_silent": {
        "does not mind silence": "waiting for STALE_OBSTACLES", "reacts late": "STALE_OBSTACLES after",
        "names nothing": "waiting for STALE_OBSTACLES", "rolls on": "at rest after",
    },
    "obstacles_silent_kept": {"always holds": "waiting for arrival", "hesitates": "were not OK"},
    "obstacle_forgotten": {"does not mind silence": "waiting for", "names nothing": "waiting for"},
    "obstacles_not_finite": {
        "does not count": "messages of obstacles refused", "does not say why": "does not name",
        "stops for nonsense": "were not OK",
    },
    "obstacle_teleports": {"is blind": "waiting for an answer", "answers late": "ticks", "rolls on": "still moves"},
    "obstacle_on_robot": {
        "is blind": "waiting for IN_COLLISION", "answers late": "IN_COLLISION after", "rolls on": "at rest after",
        "never deletes": "waiting for OK",
    },
    "all_blocked": {
        "is blind": "waiting for NO_FEASIBLE_PATH", "answers late": "NO_FEASIBLE_PATH after",
        "rolls on": "at rest after", "never deletes": "waiting for OK",
    },
    "goal_covered": {"is blind": "waiting for NO_FEASIBLE_PATH", "never deletes": "waiting for OK"},
    "many_obstacles": {"plans otherwise": "plan afterwards"},
    "obstacles_deleted": {"is blind": "waiting for NO_FEASIBLE_PATH", "never deletes": "waiting for OK"},
    "obstacles_lag": {
        "takes old for new": "waiting for STALE_OBSTACLES", "reacts late": "STALE_OBSTACLES after",
        "names nothing": "waiting for STALE_OBSTACLES", "rolls on": "at rest after",
    },
    "obstacles_lossy": {"is blind": "contact in", "rolls on": "contact in"},
    "obstacles_five_a_second": {"is blind": "contact in", "forgets early": "contact in", "rolls on": "contact in"},
    "obstacles_misstamped": {"is blind": "contact in", "rolls on": "contact in"},
}  # fmt: skip


def test_all_rows_on_states_and_obstacles_are_looked_at() -> None:
    assert list(FLAWS) == [fault.name for fault in (*STATE_FAULTS, *OBSTACLE_FAULTS, *MESSAGE_FAULTS)]


@pytest.mark.parametrize("name", FLAWS)
def test_a_row_passes_a_planner_that_is_right_and_fails_one_with_a_flaw(made_bench, name: str) -> None:
    (fault,) = chosen([name], False)
    right = run_case(made_bench(), Case(fault, "motion", 0))
    assert right.passed, right.measured
    for flaw, said in FLAWS[name].items():
        row = run_case(made_bench(flaw), Case(fault, "motion", 0))
        assert row.passed is False, f"{flaw}: {row.measured}"
        assert any(said in failure for failure in row.measured.split("; ") if failure.startswith("NOT: ")), row.measured


@pytest.mark.parametrize(("fresh", "ended"), [(True, 1), (False, 0)])
def test_nodes_that_had_to_be_fresh_serve_no_other_row(made_bench, monkeypatch, fresh: bool, ended: int) -> None:
    (fault,) = chosen(["goal_sign_flipped"], False)
    fault.fresh, stopped, made = fresh, [], made_bench()
    monkeypatch.setattr(made, "stop_nodes", lambda: stopped.append(0))
    run_case(made, Case(fault, "start", 0))
    assert len(stopped) == ended


@pytest.mark.parametrize("name", ["state_stops", "obstacles_silent", "obstacle_on_robot", "all_blocked"])
@pytest.mark.parametrize("phase", ["start", "goal"])
def test_in_other_phases_a_planner_that_is_right_passes_too(made_bench, name: str, phase: str) -> None:
    (fault,) = chosen([name], False)
    row = run_case(made_bench(), Case(fault, phase, 0))
    assert row.passed, row.measured
