"""A refusal is a verdict that is not OK, and its reason and figures go on from one to the next."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from geodesic_motion_ros.contract.status import Figures, Refusal, Verdict, VerdictCode

OTHERS = [code for code in VerdictCode if code is not VerdictCode.OK]


@pytest.mark.parametrize("code", OTHERS)
def test_every_code_but_ok_is_of_a_refusal(code: VerdictCode) -> None:
    refusal = Refusal(code, "no")
    assert isinstance(refusal, Verdict)
    assert not refusal.ok
    assert refusal.sentence == f"{code.name}: no"
    with pytest.raises(ValueError, match="a Verdict with the code"):
        Verdict(code)
    with pytest.raises(ValueError, match="a Refusal with the code"):
        replace(refusal, code=VerdictCode.OK)


def test_a_remark_follows_the_reason_and_is_it_where_there_is_none() -> None:
    refusal = Refusal(VerdictCode.NO_FEASIBLE_PATH, "blocked", Figures(cost_gap=0.1))
    assert refusal.with_remark("no detour") == replace(refusal, reason="blocked; no detour")
    assert Verdict().with_remark("at the goal").reason == "at the goal"


def test_figures_change_by_name_and_the_others_stay() -> None:
    refusal = Refusal(VerdictCode.IN_COLLISION, "inside", Figures(goal_offset=0.2))
    changed = refusal.with_figures(clearance=-0.01)
    assert (changed.figures.clearance, changed.figures.goal_offset) == (-0.01, 0.2)
    assert math.isnan(refusal.figures.clearance)
    with pytest.raises(TypeError):
        refusal.with_figures(clearence=-0.01)
