"""The curve over reaches: a longer reach wins scenes that a shorter one does not, and the table says how many."""

from __future__ import annotations

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.detour_curve import REACHES, main, measured


def test_a_scene_that_blocks_all_demonstrations_is_won_by_a_long_reach_alone() -> None:
    lines = measured(Arena.of(Skill.load("panda_pouring"), "arm"), 2, 0).splitlines()
    rows = [line.split() for line in lines[2:]]
    assert [row[0] for row in rows] == [f"{100 * reach:.0f}" for reach in REACHES]
    shares = [tuple(map(int, row[4].split("/"))) for row in rows]
    assert shares[0][0] == 0 < shares[0][1]
    assert shares[-1][0] == shares[-1][1]
    assert all(row[-1] == "0" for row in rows)


def test_a_number_of_scenes_that_makes_no_sense_is_named(capsys) -> None:
    assert main(["--scenes", "0"]) == 2
    assert "--scenes 0" in capsys.readouterr().err
