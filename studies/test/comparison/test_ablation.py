"""The worth of a constant: another value is played in its place, and it is back afterwards."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.comparison.ablation import main, measured, parsed
from geodesic_motion_studies.comparison.arena import Arena


def test_what_makes_no_difference_says_so_and_what_does_too() -> None:
    """A margin among what moves that no path keeps; a constant of detours, which no scene of one second needs."""
    before = constants.DYNAMIC_MARGIN_FACTOR
    values = {"DETOUR_SPACING": constants.DETOUR_SPACING, "DYNAMIC_MARGIN_FACTOR": 60.0}
    table = measured(Arena.of(Skill.load("panda_pouring"), "arm"), 1, 3, values)
    as_it_is, same, worse = (line.split() for line in table.splitlines()[2:])
    assert same[1:] == as_it_is[3:]
    assert worse[1:] != same[1:]
    assert before == constants.DYNAMIC_MARGIN_FACTOR


def test_values_are_of_the_kind_of_the_constant() -> None:
    values = parsed(["EVASION_STEPS=12", "SEARCH_PERIOD=1"])
    assert values == {"EVASION_STEPS": 12, "SEARCH_PERIOD": 1.0}
    assert [type(value) for value in values.values()] == [int, float]


@pytest.mark.parametrize(
    "argument", ["NOTHING=1", "math=1", "ATTEMPTS=1", "EVASION_STEPS=1.5", "SEARCH_PERIOD", "SEARCH_PERIOD=often"]
)
def test_what_is_no_constant_or_no_number_is_named(argument: str, capsys) -> None:
    assert main([argument]) == 2
    assert argument.partition("=")[0] in capsys.readouterr().err
