"""Moving spheres and the tool, small: no contact that could be avoided, and the judge knows whom to blame."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.moving_spheres import DISTANCE_AT_REST, MovingSphere, draw_spheres
from geodesic_motion_ros.experiments.moving_tool import (
    MovingToolReport,
    MovingToolRun,
    MovingToolSettings,
    MovingToolStage,
    draw_ends,
    draw_moving_tool,
    measure_moving_tool,
    nominal_tool,
)
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import write_json

#: Two spheres across.
TOOL = PlannerSettings(tool_points=((0.0, -0.02, 0.0), (0.0, 0.02, 0.0)), tool_radii=(0.03, 0.03))
NEVER = 30.0


@pytest.fixture(scope="module")
def stage(canonical_fan_skill: Skill) -> MovingToolStage:
    return MovingToolStage(canonical_fan_skill, TOOL, (0, 3))


@pytest.fixture(scope="module")
def report(stage: MovingToolStage) -> MovingToolReport:
    settings = MovingToolSettings({"small": TOOL}, scenes=1, seeds=stage.seeds)
    scenes = [stage.scene(number) for number in range(2)]
    return MovingToolReport("fan", settings, {"small": scenes})


def standing(radius: float, appears: float, place: np.ndarray) -> MovingSphere:
    return MovingSphere(radius, appears, NEVER, place, np.zeros(3), False)


def test_moving_spheres_touch_no_moving_tool_and_it_keeps_its_acceleration(report) -> None:
    for scene in report.scenes["small"]:
        assert "moving" not in scene.contacts
        assert scene.clearance > 0.0
        assert scene.freezes == 0
        assert scene.strain < 1.12
        assert scene.lag < 0.005
    # The control: without being told of them the tool runs into them.
    assert sum(scene.control for scene in report.scenes["small"]) > 0


def test_a_scene_depends_on_its_seed_and_number_alone(report, stage) -> None:
    first, other = report.scenes["small"]
    assert (first.seed, first.number, other.seed, other.number) == (0, 0, 3, 0)
    # Whatever was played in between.
    assert stage.scene(0).told() == first.told()
    assert other.told() != first.told()


def test_spheres_begin_clear_of_the_tool(stage) -> None:
    random = np.random.default_rng(5)
    _, _, reference = draw_ends(stage.planner, random)
    nominal = nominal_tool(TOOL, reference)
    for sphere in draw_spheres(nominal, random):
        apart = nominal.distances(np.array([sphere.appears]), sphere.begin[None], sphere.radius)
        assert apart[0] >= DISTANCE_AT_REST


def test_who_is_to_blame_for_a_contact_is_told(stage) -> None:
    start, goal, reference = draw_ends(stage.planner, np.random.default_rng(0))
    ends = stage.planner, stage.world, start, goal
    # Into a tool that has nowhere to go, for its goal is covered, and no time to give way.
    driven = MovingSphere(0.04, 0.0, NEVER, start[0] + [0.0, 0.0, 0.4], np.array([0.0, 0.0, -1.0]), False)
    scene = MovingToolRun(*ends, [standing(0.06, 0.0, goal[0]), driven]).play(0, 0, longest=1.2)
    assert scene.contacts == ("standing",)
    assert not scene.reached
    # Out of nothing, where one that moves is; and on the way of one that is not told of it but might have braked.
    half = 0.5 * reference.duration
    sudden = standing(0.05, half, reference.sample(half)[0])
    assert MovingToolRun(*ends, [sudden]).play(0, 0, longest=half + 0.2).contacts == ("no room",)
    ahead = standing(0.05, 0.0, reference.sample(half)[0])
    assert MovingToolRun(*ends, [ahead], told=False).play(0, 0).contacts == ("moving",)


def test_nothing_in_the_way_changes_nothing(stage) -> None:
    start, goal, reference = draw_ends(stage.planner, np.random.default_rng(0))
    scene = MovingToolRun(stage.planner, stage.world, start, goal, []).play(0, 0)
    assert scene.reached
    assert scene.contacts == ()
    assert scene.stood < 0.1
    assert scene.duration == pytest.approx(reference.duration, abs=0.3)
    assert scene.lag < 0.005
    assert (scene.stops, scene.freezes) == (0, 0)


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "moving.json", report.as_dict()).read_text())
    small = content["tools"]["small"]
    assert small["planner"]["tool_radii"] == [0.03, 0.03]
    assert small["summary"]["scenes"] == len(small["scenes"]) == 2
    assert small["summary"]["contacts_moving"] == 0
    assert "contacts moving without avoidance" in report.table()
    draw_moving_tool(report, tmp_path / "moving.png")
    assert (tmp_path / "moving.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [({"scenes": 0}, "at least 1"), ({"processes": 0}, "at least 1"), ({"seeds": (0, -1)}, "none negative"),
     ({"tools": {}}, "no tool")],
)  # fmt: skip
def test_impossible_settings_are_refused(wrong, said) -> None:
    with pytest.raises(ParameterError, match=said):
        MovingToolSettings(**({"tools": {"small": TOOL}} | wrong))


def test_skills_of_joint_space_are_refused(canonical_fan_skill) -> None:
    with pytest.raises(ParameterError, match="part of whole-arm"):
        measure_moving_tool(replace(canonical_fan_skill, space="joint"), MovingToolSettings({"small": TOOL}))


def test_skills_on_the_raw_sheet_are_refused(stage, monkeypatch, canonical_fan_skill) -> None:
    monkeypatch.setattr(stage.planner, "skill", replace(canonical_fan_skill, canonical=None))
    with pytest.raises(ParameterError, match="raw sheet"):
        draw_ends(stage.planner, np.random.default_rng(0))
