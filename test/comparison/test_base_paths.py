"""Other base paths of detours: they meet the scene's ends, and the same planner goes from them."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.comparison.arena import Arena
from geodesic_motion_ros.comparison.base_paths import BASES, BaseDetours, main
from geodesic_motion_ros.comparison.scene import Scene, draw_scene
from geodesic_motion_ros.skill import Skill

NAMES = [name for name in BASES if name != "ProMP"]


@pytest.fixture(scope="module")
def arena() -> Arena:
    return Arena.of(Skill.load("panda_reach_to_grasp"), "arm")


@pytest.fixture(scope="module")
def blocked(arena: Arena) -> Scene:
    scenes = (draw_scene(arena, "static", number, 800) for number in range(1, 40, 2))
    return next(scene for scene in scenes if not np.any(scene.free))


@pytest.mark.parametrize("name", NAMES)
def test_they_lead_from_the_scenes_start_to_its_goal(name: str, arena: Arena, blocked: Scene) -> None:
    path = BASES[name](arena, blocked)
    np.testing.assert_allclose(path[[0, -1]], [blocked.start, blocked.goal], atol=1e-6)


def test_promp_meets_the_ends(arena: Arena, blocked: Scene) -> None:
    pytest.importorskip("movement_primitives")
    path = BASES["ProMP"](arena, blocked)
    np.testing.assert_allclose(path[[0, -1]], [blocked.start, blocked.goal], atol=1e-6)


def test_from_each_of_them_a_blocked_scene_is_passed_or_refused_for_a_reason(arena: Arena, blocked: Scene) -> None:
    detours = BaseDetours(arena)
    outcomes = [detours.ours(blocked), *(detours.based(blocked, BASES[name]) for name in NAMES)]
    for outcome in outcomes:
        assert outcome.verdict.ok == (outcome.similarity is not None)
        assert outcome.verdict.ok or outcome.verdict.reason
    assert any(outcome.verdict.ok and outcome.verdict.displacement > 0.0 for outcome in outcomes)


def test_where_nothing_is_in_the_way_the_base_is_followed(arena: Arena) -> None:
    scene = draw_scene(arena, "none", 0, 800)
    outcome = BaseDetours(arena).based(scene, BASES["nearest demonstration"])
    assert outcome.verdict.ok
    assert outcome.verdict.displacement == pytest.approx(0.0, abs=1e-6)
    assert outcome.similarity.dtw < 0.003


def test_the_table_has_a_row_for_each_base(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("movement_primitives")
    assert main(["--skill", "panda_reach_to_grasp", "--scenes", "1", "--seed", "800"]) == 0
    lines = capsys.readouterr().out.splitlines()[2:]
    assert all(line.startswith(name) for line, name in zip(lines, ["ours", *BASES], strict=True))


def test_a_skill_that_does_not_exist_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--skill", "no_such_skill"]) == 2
    assert "no_such_skill" in capsys.readouterr().err
