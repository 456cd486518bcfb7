"""The comparison, small: scenes that can be survived, a judge who sees contacts, and results that are kept."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.catalogue import ROWS, Row, chosen
from geodesic_motion_studies.comparison.execution import Outcome
from geodesic_motion_studies.comparison.families import FAMILIES
from geodesic_motion_studies.comparison.figures import came_near
from geodesic_motion_studies.comparison.held_out import digest
from geodesic_motion_studies.comparison.method import Answer
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.methods.replay import Replay
from geodesic_motion_studies.comparison.report import IN_VIEW, Report, bootstrap_median, figures, mostly_free, wilson
from geodesic_motion_studies.comparison.results import Played, Results
from geodesic_motion_studies.comparison.run import Bench, BenchmarkSettings, kept_benchmark
from geodesic_motion_studies.comparison.scene import Scene, draw_scene

COARSE = PlannerSettings(grid_shape=(30, 30, 30))


class Waiting:
    """Stays at the start, and says so."""

    def __init__(self) -> None:
        self.settings: dict[str, float] = {}

    def reset(self, scene: Scene) -> None:
        """Nothing to forget."""

    def tick(self, now, obstacles) -> Answer:
        """Whatever comes."""
        return Answer(refusal="waits")


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
        # Control: something blocks one.
        assert not np.all(scene.free)


@pytest.mark.parametrize("family", ["chasing", "gate", "crowd"])
def test_who_waits_at_the_start_is_never_touched(arena, stage, family, monkeypatch) -> None:
    monkeypatch.setattr("geodesic_motion_studies.comparison.execution.LONGEST", 9.0)
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
    results.keep("ours, hard", "gate", 12, {}, outcome())
    results.keep("ours, hard", "none", 5, {}, outcome())
    assert results.numbers("ours, hard", "gate") == [3, 12]
    assert results.numbers("ours", "gate") == []


def test_what_is_kept_is_reported_as_far_as_every_method_would_play_it_so_now(
    reach_skill, tmp_path, monkeypatch
) -> None:
    for row in ("first", "second"):
        monkeypatch.setitem(ROWS, row, Row(lambda arena: Waiting(), ""))
    settings, results = BenchmarkSettings(("first", "second"), ("none", "gate")), Results(tmp_path, reach_skill.name, 0)
    valid = {"skill": digest(reach_skill)}

    def reported(skill: Skill = reach_skill, scenes: int | None = None) -> list[tuple[str, str, int]]:
        played = kept_benchmark(skill, settings, tmp_path, scenes)
        return [(item.row, item.family, item.number) for item in played]

    with pytest.raises(GeodesicMotionError, match=r"no scene is kept in .* \(scenes: first 0, second 0\)"):
        reported()
    assert not list(tmp_path.iterdir())
    for number in (0, 9):
        results.keep("first", "gate", number, valid, outcome())
    with pytest.raises(GeodesicMotionError, match="first 2, second 0"):
        reported()
    # More than are played without --scenes.
    results.keep("second", "gate", 9, valid, outcome())
    assert reported() == [("first", "gate", 9), ("second", "gate", 9)]
    with pytest.raises(GeodesicMotionError, match="first 1, second 0"):
        reported(scenes=9)
    # Neither other settings nor another skill of that name.
    for other in ({**valid, "gain": 2.0}, {"skill": "another"}, {}):
        results.keep("second", "gate", 9, other, outcome())
        with pytest.raises(GeodesicMotionError, match="first 2, second 0"):
            reported()
    results.keep("second", "gate", 9, valid, outcome())
    with pytest.raises(GeodesicMotionError, match="first 0, second 0"):
        reported(replace(reach_skill, codes=reach_skill.codes + 1e-9))


def test_a_skill_trained_anew_is_played_anew(reach_skill, tmp_path) -> None:
    settings = BenchmarkSettings(("replay",), ("none",))
    (played,) = Bench(reach_skill, settings, tmp_path).scene("none", 0)
    changed = replace(played.outcome, duration=99.0)
    Results(tmp_path, reach_skill.name, 0).keep("replay", "none", 0, played.settings, changed)
    assert Bench(reach_skill, settings, tmp_path).scene("none", 0)[0].outcome == changed
    anew = Bench(replace(reach_skill, codes=reach_skill.codes + 1e-9), settings, tmp_path).scene("none", 0)[0]
    assert anew.outcome.duration == played.outcome.duration
    assert anew.settings != played.settings


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
        outcome(reached=False, refusal="no path"), outcome(reached=False), outcome(mostly_free=False),
        outcome(reached=False, contact="no room"),
    ]  # fmt: skip
    played = [Played("ours", "gate", i, {}, item) for i, item in enumerate([outcome(), *failures])]
    report = Report("reach", 0, played, {"ours": "geodesics"})
    content = json.loads(write_json(tmp_path / "x.json", report.as_dict()).read_text())
    own = content["rows"]["ours"]["half_or_more_stay_free"]
    names = ("scenes", "success_percent", "contacts_moving", "contacts_standing", "refused", "lost")
    assert [own[name] for name in names] == [6, 100.0 / 6, 2, 1, 1, 1]
    assert own["in_time_percent"] == 99.0
    assert content["rows"]["ours"]["fewer_stay_free"]["success_percent"] == 100.0
    total = content["rows"]["ours"]["all"]
    assert (total["scenes"], total["success_percent"]) == (7, 200.0 / 7)
    assert report.plain().index("all: 7 scenes") < report.plain().index("half or more stay free: 6 scenes")
    for table in (report.plain(), report.markdown()):
        assert "1/6, 1/1" in table
        assert "from the closest demonstration" in table
        assert "moving" in table
        assert "standing" in table
    assert "from the demonstration held out" in replace(report, held_out=True).plain()


def test_both_kinds_of_tables_say_the_same() -> None:
    played = [Played("ours", "gate", 0, {}, outcome(arm_touched=True)), Played("ours", "static", 1, {}, outcome())]
    report = Report("pouring", 0, played, {"ours": "geodesics"})
    plain = [line.split() for line in report.plain().splitlines() if line.startswith("ours")]
    cells = [line.strip("| ").split(" | ") for line in report.markdown().splitlines() if line.startswith("| ours")]
    assert [" ".join(line).split() for line in cells] == plain
    # 2 scenes in the first table: success, interval, contacts, refused, lost, clearance, DTW, and scenes of an arm.
    assert plain[0][:10] == ["ours", "100.0", "34.2..100.0", "0", "0", "0", "0", "50", "50", "2.0"]
    assert plain[0][-1] == "1"
    assert plain[3] == ["ours", "1/1,", "-", "1/1,", "-"]
    without_arm = replace(report, played=played[1:])
    assert "arm" not in without_arm.markdown().split()
    assert "arm" in report.markdown().split()


def test_scenes_with_a_contact_of_a_standing_arm_are_listed_by_whether_waiting_avoids_it() -> None:
    standing = {"reached": False, "contact": "standing"}
    made = [outcome(waiting_avoids=avoids, **standing) for avoids in (True, False, True)]
    played = [Played("ours", "chasing", number, {}, item) for number, item in enumerate(made)]
    report = Report("reach", 0, [*played, Played("ours", "none", 0, {}, outcome())], {"ours": "geodesics"})
    assert report.markdown().splitlines()[-1] == "| ours | chasing 0, chasing 2 | chasing 1 |"
    assert report.figures("ours", mostly_free)["contacts_standing_where_waiting_avoids"] == 2
    assert [scene["waiting_avoids"] for scene in report.as_dict()["scenes"]] == [True, False, True, None]
    assert "waiting" not in replace(report, played=report.played[-1:]).plain()


def test_scenes_with_a_contact_are_listed_by_how_long_clouds_had_shown_what_touched() -> None:
    made = [outcome(reached=False, contact="moving", in_view=shown) for shown in (0.0, IN_VIEW, 0.9 * IN_VIEW)]
    played = [Played("ours", "gate", number, {}, item) for number, item in enumerate(made)]
    report = Report("reach", 0, [*played, Played("ours", "none", 0, {}, outcome())], {"ours": "geodesics"}, cloud=True)
    assert report.markdown().splitlines()[-1] == "| ours | gate 1 | gate 0, gate 2 |"
    assert "in view" not in replace(report, played=report.played[-1:]).plain()


def test_clearance_is_that_of_successes_among_spheres() -> None:
    played = [
        Played("ours", "none", 0, {}, outcome(clearance=0.3)),
        Played("ours", "gate", 0, {}, outcome(clearance=0.02)),
        Played("ours", "gate", 2, {}, outcome(clearance=0.04)),
        Played("ours", "gate", 4, {}, outcome(reached=False, refusal="no path", clearance=0.3)),
    ]
    own = figures(played)
    assert (own["least_clearance_mm"], own["median_clearance_mm"]) == (20.0, 30.0)
    assert figures(played[:1])["least_clearance_mm"] is None
    assert [came_near(item) for item in played] == [False, True, True, False]


def test_similarity_is_reported_where_something_had_to_be_avoided_too() -> None:
    dtw = {0: 0.001, 1: 0.008, 2: 0.010, 3: 0.5}
    played = [Played("ours", "gate", number, {}, outcome(dtw=value)) for number, value in dtw.items()]
    played[3] = replace(played[3], outcome=replace(played[3].outcome, contact="moving"))
    blind = [Played("replay", "gate", number, {}, outcome(contact="moving" if number else "")) for number in dtw]
    descriptions = {"ours": "geodesics", "replay": "the control"}
    report = Report("reach", 0, [*played, *blind], descriptions)
    assert report.figures("ours", mostly_free)["dtw_mm"] == 8.0
    assert report.figures("ours", mostly_free)["dtw_avoiding_mm"] == 9.0
    assert report.figures("replay", mostly_free)["dtw_avoiding_mm"] is None
    without = Report("reach", 0, played, {"ours": "geodesics"})
    assert without.figures("ours", mostly_free)["dtw_avoiding_mm"] is None


def test_what_cannot_be_compared_is_refused(reach_skill, monkeypatch) -> None:
    with pytest.raises(ParameterError, match="raw sheet"):
        Arena.of(replace(reach_skill, canonical=None))
    with pytest.raises(ParameterError, match="choose from none, static"):
        BenchmarkSettings(("ours",), families=("wall",))
    with pytest.raises(ParameterError, match="at least 1"):
        BenchmarkSettings(("ours",), scenes=0)
    with pytest.raises(ParameterError, match="choose from ours; ours, detour 0; ours, hard"):
        chosen(("theirs",))
    monkeypatch.setitem(ROWS, "absent", Row(lambda arena: Waiting(), "", ("no_such_library",)))
    with pytest.raises(GeodesicMotionError, match="needs no_such_library"):
        chosen(("absent",))
    assert "absent" not in chosen(None)
    assert "paper" not in chosen(None)
