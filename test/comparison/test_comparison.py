"""The comparison, small: scenes that can be survived, a judge who sees contacts, and results that are kept."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.comparison.arena import Arena
from geodesic_motion_ros.comparison.catalogue import ROWS, Row, chosen
from geodesic_motion_ros.comparison.execution import Outcome, Stage
from geodesic_motion_ros.comparison.families import FAMILIES
from geodesic_motion_ros.comparison.method import Answer
from geodesic_motion_ros.comparison.methods.geodesic import Geodesics
from geodesic_motion_ros.comparison.methods.replay import Replay
from geodesic_motion_ros.comparison.report import Report, bootstrap_median, wilson
from geodesic_motion_ros.comparison.results import Played, Results
from geodesic_motion_ros.comparison.run import BenchmarkSettings
from geodesic_motion_ros.comparison.scene import Scene, draw_scene
from geodesic_motion_ros.errors import GeodesicMotionError, ParameterError
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import write_json

COARSE = JointPlannerSettings(grid_shape=(30, 30, 30))


class Waiting:
    """Stays at the start, and says so."""

    def __init__(self) -> None:
        self.settings: dict[str, float] = {}

    def reset(self, scene: Scene) -> None:
        """Nothing to forget."""

    def tick(self, now, obstacles, state) -> Answer:
        """Whatever comes."""
        return Answer(refusal="waits")


@pytest.fixture(scope="module")
def arena(reach_skill: Skill) -> Arena:
    return Arena.of(reach_skill)


@pytest.fixture(scope="module")
def stage(arena: Arena) -> Stage:
    return Stage(arena)


@pytest.fixture(scope="module")
def elbow(arena: Arena) -> Scene:
    """A scene in which the nearest demonstration is blocked, and at least half of them are not."""
    scenes = (draw_scene(arena, "elbow", number, 0) for number in range(0, 40, 2))
    return next(scene for scene in scenes if not scene.free[arena.nearest(scene.start, scene.goal)])


def outcome(**changes) -> Outcome:
    made = Outcome(
        mostly_free=True, reached=True, contact="", refusal="", duration=6.0, clearance=0.05, dtw=0.002,
        orientation=0.1, jerk=10.0, replans=(0.001, 0.002), ticks=100, in_time=99,
    )  # fmt: skip
    return replace(made, **changes)


def test_demonstrations_are_those_that_were_shown(arena, reach_demonstrations) -> None:
    for shown, item in zip(arena.shown, reach_demonstrations, strict=True):
        np.testing.assert_allclose(shown[[0, -1]], item.configurations[[0, -1]], atol=1e-6)


def test_a_scene_depends_on_its_family_its_number_and_the_seed_alone(arena) -> None:
    first, again = (draw_scene(arena, "crossing", 1, 5) for _ in range(2))
    for one, other in zip(first.spheres, again.spheres, strict=True):
        np.testing.assert_array_equal(one.begin, other.begin)
    assert not np.array_equal(draw_scene(arena, "crossing", 1, 6).start, first.start) or len(first.spheres) != len(
        draw_scene(arena, "crossing", 1, 6).spheres
    )


@pytest.mark.parametrize("family", FAMILIES)
def test_half_of_the_demonstrations_are_spared_in_scenes_of_even_number(arena, family) -> None:
    scene = draw_scene(arena, family, 2, 0)
    assert scene.mostly_free
    assert len(scene.spheres) == {"none": 0, "elbow": 1, "gate": 4, "crowd": 10}.get(family, len(scene.spheres))
    assert family == "none" or scene.spheres
    if family in ("static", "elbow", "crossing"):
        # Control: something is in the way.
        assert not np.all(scene.free)


@pytest.mark.parametrize("family", ["chasing", "gate", "crowd"])
def test_who_waits_at_the_start_is_never_touched(arena, stage, family, monkeypatch) -> None:
    monkeypatch.setattr("geodesic_motion_ros.comparison.execution.LONGEST", 9.0)
    waited, _ = stage.play(draw_scene(arena, family, 1, 0), Waiting())
    assert waited.contact == ""
    assert waited.refused


def test_the_judge_sees_the_contact_of_one_who_is_blind_and_none_of_ours(arena, stage, elbow) -> None:
    blind, _ = stage.play(elbow, Replay(arena))
    assert (blind.contact, blind.success) == ("moving", False)
    assert blind.clearance <= 0.0
    ours, postures = stage.play(elbow, Geodesics(arena, planner=COARSE))
    assert ours.success
    assert 0.0 < ours.clearance < 0.3
    assert ours.dtw < 0.03
    np.testing.assert_allclose(arena.robot.forward(postures[-1])[0], elbow.goal_pose[0], atol=0.01)


def test_a_replayed_demonstration_is_one(arena, stage) -> None:
    replayed, _ = stage.play(draw_scene(arena, "none", 0, 0), Replay(arena))
    assert replayed.success
    assert replayed.dtw < 2e-3
    assert replayed.orientation < 0.02


def test_ours_has_parts_and_says_which(arena) -> None:
    parts = [Geodesics(arena, part, COARSE).settings for part in ("hard", "soft")]
    assert [part["part"] for part in parts] == ["hard", "soft"]
    assert [part["ambient_law"] for part in parts] == ["hard", "gaussian"]


def test_what_was_played_is_kept_for_the_settings_it_was_played_with(tmp_path) -> None:
    results = Results(tmp_path, "reach", 0)
    assert results.outcome("ours, hard", "gate", 3, {"a": (1, 2)}) is None
    results.keep("ours, hard", "gate", 3, {"a": (1, 2)}, outcome())
    assert Results(tmp_path, "reach", 0).outcome("ours, hard", "gate", 3, {"a": (1, 2)}) == outcome()
    assert results.outcome("ours, hard", "gate", 3, {"a": (1, 3)}) is None
    assert results.outcome("ours", "gate", 3, {"a": (1, 2)}) is None
    assert Results(tmp_path, "reach", 1).outcome("ours, hard", "gate", 3, {"a": (1, 2)}) is None
    # A row that has not played a scene yet keeps it out of a comparison.
    assert [item.outcome for item in results.complete(["ours, hard"], ["gate"], 5)] == [outcome()]
    assert results.complete(["ours, hard", "ours"], ["gate"], 5) == []


def test_intervals_are_those_of_the_books() -> None:
    # E. B. Wilson's interval as in A. Agresti, B. Coull, The American Statistician 52 (1998): 0 of 10, 5 of 10.
    np.testing.assert_allclose(wilson(0, 10), (0.0, 0.2775), atol=1e-4)
    np.testing.assert_allclose(wilson(5, 10), (0.2366, 0.7634), atol=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)
    low, high = bootstrap_median([1.0, 2.0, 3.0, 4.0, 5.0])
    assert low < 3.0 < high
    assert np.isnan(bootstrap_median([])[0])


def test_the_table_tells_successes_hits_and_refusals_apart(tmp_path) -> None:
    failures = [
        outcome(reached=False, contact="moving"), outcome(reached=False, contact="standing", refusal="stood"),
        outcome(reached=False, refusal="no way"), outcome(reached=False), outcome(mostly_free=False),
    ]  # fmt: skip
    played = [Played("ours", "gate", i, {}, item) for i, item in enumerate([outcome(), *failures])]
    report = Report("reach", 0, played, {"ours": "geodesics"})
    content = json.loads(write_json(tmp_path / "x.json", report.as_dict()).read_text())
    told = content["rows"]["ours"]["half_or_more_stay_free"]
    names = ("scenes", "success_percent", "contacts_moving", "contacts_standing", "refused", "lost")
    assert [told[name] for name in names] == [5, 20.0, 1, 1, 1, 1]
    assert told["rate_held_percent"] == 99.0
    assert content["rows"]["ours"]["fewer_stay_free"]["success_percent"] == 100.0
    assert "1/5  1/1" in report.table()
    assert "from the closest demonstration" in report.table()
    assert "from the demonstration held out" in replace(report, held_out=True).table()


def test_what_cannot_be_compared_is_refused(reach_skill, monkeypatch) -> None:
    with pytest.raises(ParameterError, match="raw sheet"):
        Arena.of(replace(reach_skill, canonical=None))
    with pytest.raises(ParameterError, match="choose from none, static"):
        BenchmarkSettings(("ours",), families=("wall",))
    with pytest.raises(ParameterError, match="at least 1"):
        BenchmarkSettings(("ours",), scenes=0)
    with pytest.raises(ParameterError, match="choose from ours; ours, hard"):
        chosen(("theirs",))
    monkeypatch.setitem(ROWS, "absent", Row(lambda arena: Waiting(), "", ("no_such_library",)))
    with pytest.raises(GeodesicMotionError, match="needs no_such_library"):
        chosen(("absent",))
    assert "absent" not in chosen(None)
