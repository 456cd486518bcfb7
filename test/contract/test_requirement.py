"""The safety contract: doc/behaviour.md prints it, and a margin yields to the clearance that there is already."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.contract.requirement import Margin, Requirement, Requirements
from geodesic_motion_ros.contract.settings import ATTEMPTS, PlannerSettings
from geodesic_motion_ros.obstacles.obstacles import Obstacles

PAGE = Path(__file__).resolve().parents[2] / "doc" / "behaviour.md"
#: An exact margin, so that multiples of it are printed as such.
SETTINGS = PlannerSettings(obstacle_margin=1.0)
#: The rows of the page's table: a motion, and what of `Requirements` it must satisfy.
ROWS = {
    "new path to the goal": "goal",
    "*optimistic* path to the goal": "optimistic",
    "detour": "detour",
    "what is offered to a [filter](filter.md)": "offer",
    "evasion": "evasion",
    "evasion beside the graph": "beside_graph",
    "approach to a covered goal": "approach",
    "stop": "stop",
}


#: What is not searched or followed where all obstacles stand.
AMONG_MOVING = ("optimistic", "evasion", "beside_graph")


def multiple(margin: Margin) -> str:
    """A margin as the page has it: multiples of m, and shares of c, the clearance that there is already."""
    if margin.clearance <= 0.0:
        return "no contact" if margin.clearance == 0.0 else "nothing"
    kept = "m" if margin.clearance == 1.0 else f"{margin.clearance:g} m"
    return kept if math.isinf(margin.share) else f"{kept}, or {margin.share:.3g} c where that is less"


def row(motion: str, name: str) -> str:
    """A line of the page's table."""
    required: Requirement = getattr(Requirements.of(SETTINGS), name)
    moving, searched = multiple(required.certified), multiple(required.searched)
    standing = "nothing" if moving == "nothing" else multiple(required.standing)
    standing = "not tried" if name in AMONG_MOVING else standing
    horizon = "`prediction`" if required.horizon == SETTINGS.prediction else f"{required.horizon:g} s"
    after = "stands" if required.stands_after else "does not count"
    return f"| {motion} | {searched.replace('no contact', '')} | {standing} | {moving} | {horizon} | {after} |"


def table() -> list[str]:
    head = "motion", "the search keeps", "certified: all obstacles standing", "one moving", "moves on for", "and then"
    return [f"| {' | '.join(head)} |", "|---|---|---|---|---|---|", *(row(*each) for each in ROWS.items())]


def test_the_page_prints_the_contract() -> None:
    page = PAGE.read_text().splitlines()
    begin = next((i for i, line in enumerate(page) if line.startswith("| motion | the search keeps")), len(page))
    end = next(i for i in range(begin, len(page) + 1) if i == len(page) or not page[i].startswith("|"))
    assert page[begin:end] == table(), "doc/behaviour.md wants this table:\n" + "\n".join(table())
    assert f"a second attempt keeps {ATTEMPTS[1].multiple:g} m" in " ".join(page)
    kept = multiple(Requirements.of(SETTINGS).later_stop)
    assert f"leaves a stop a moment later that keeps {kept} from wherever" in " ".join(page)


def test_every_requirement_has_a_row() -> None:
    assert {*ROWS.values(), "later_stop"} == set(vars(Requirements.of(SETTINGS)))


@pytest.mark.parametrize("present", [0.0, 0.001, 0.004, 0.03, math.inf])
def test_what_is_nearer_than_a_margin_may_stay_so_and_no_more(present: float) -> None:
    margin = Margin(0.01, 0.5)
    assert margin.of(present) == min(0.01, 0.5 * present)
    assert Margin(0.01).of(present) == 0.01


def test_a_margin_is_required_among_what_moves_and_not_to_go_on() -> None:
    requirements = Requirements.of(replace(SETTINGS, obstacle_margin=0.005))
    required = requirements.goal
    standing = Obstacles.of_spheres(np.zeros((1, 3)), np.array([0.1]))
    moving = Obstacles.of_spheres(np.zeros((1, 3)), np.array([0.1]), np.array([[0.1, 0.0, 0.0]]), time=0.0)
    assert required.margin(moving) == 0.01
    assert required.margin(moving, 0.01) == 0.005
    assert required.margin(standing) == 0.0
    # Nothing searches for what is offered.
    assert requirements.offer.margin(standing) == 0.005
    for purpose, begun in (
        (Purpose.GOAL, requirements.goal), (Purpose.EVASION, requirements.evasion),
        (Purpose.APPROACH, requirements.approach),
    ):  # fmt: skip
        going_on = requirements.to_go_on(purpose, optimistic=False)
        assert going_on.margin(moving) == going_on.margin(standing) == 0.0
        assert (going_on.horizon, going_on.stands_after) == (begun.horizon, begun.stands_after)
    assert not requirements.to_go_on(Purpose.GOAL, optimistic=True).stands_after
    assert required.until(0.3).horizon == 0.3
