"""`benchmark` as a person meets it: refused in one line before anything long, reported from what is kept."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.comparison.execution import Outcome
from geodesic_motion_studies.comparison.held_out import digest
from geodesic_motion_studies.comparison.results import Played, Results
from geodesic_motion_studies.comparison.run import BenchmarkSettings


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["--skill", "no_such_skill"], "no skill 'no_such_skill'"),
        (["--skill", "panda_pouring", "--families", "elbow"], "or guard all of the arm"),
        (["--guard", "tool"], "there is no guard 'tool'"),
        (["--methods", "theirs"], "there is no method 'theirs': choose from ours;"),
        (["--families", "wall"], "choose from none, static"),
        (["--scenes", "0"], "at least 1 is needed"),
        (["--json", "{file}/x.json"], "cannot be written"),
    ],
)
def test_what_cannot_be_done_is_reported_in_one_line(arguments, reported, tmp_path, capsys) -> None:
    file = tmp_path / "file"
    file.touch()
    command = ["benchmark", "--out", str(tmp_path / "out"), *(argument.format(file=file) for argument in arguments)]
    assert main(command) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("geodesic-motion: ")]
    assert reported in line


@pytest.mark.parametrize("scene", ["crossing", "wall:1"])
def test_what_is_no_scene_is_refused(scene, capsys) -> None:
    with pytest.raises(SystemExit):
        main(["benchmark", "--strip", scene])
    assert "like crossing:0" in capsys.readouterr().err


def keep_replays(folder: Path, skill: str, numbers: Sequence[int], held_out: bool = False, apart: str = "") -> None:
    """Results as if those scenes of `crossing` had been played."""
    outcome = Outcome(
        mostly_free=True, reached=True, contact="", refusal="", duration=6.0, clearance=0.05, dtw=0.002,
        orientation=0.1, jerk=10.0, replans=(0.001,), ticks=100, in_time=99,
    )  # fmt: skip
    valid = {"skill": digest(Skill.load(skill))}
    for number in numbers:
        Results(folder, skill, 0, held_out, apart).keep("replay", "crossing", number, valid, outcome)


def test_what_is_kept_is_reported_without_playing(tmp_path, capsys) -> None:
    """All of it, whatever is played without --scenes, and apart for each skill."""
    for skill, count in (("panda_reach_to_grasp", 9), ("panda_pouring", 2)):
        keep_replays(tmp_path, skill, range(count))
        assert main(["benchmark", "--kept", "--skill", skill, "--methods", "replay", "--out", str(tmp_path)]) == 0
        assert f"half or more stay free: {count} scenes" in capsys.readouterr().out
        written = {path.name for path in (tmp_path / skill).iterdir() if path.is_file()}
        assert written == {"table.txt", "table.md", "figures.json", "success.png", "clearance.png"}
        assert f"free: {count} scenes |" in (tmp_path / skill / "table.md").read_text()
    assert {path.name for path in tmp_path.iterdir()} == {"panda_reach_to_grasp", "panda_pouring"}
    assert "free: 9 scenes" in (tmp_path / "panda_reach_to_grasp" / "table.txt").read_text()
    assert main(["benchmark", "--kept", "--scenes", "4", "--methods", "replay", "--out", str(tmp_path)]) == 0
    assert "half or more stay free: 4 scenes" in capsys.readouterr().out


def test_what_is_kept_of_another_guard_is_reported_apart(tmp_path, capsys) -> None:
    keep_replays(tmp_path, "panda_pouring", range(2))
    keep_replays(tmp_path, "panda_pouring", range(3), apart="guard_arm")
    command = ["benchmark", "--kept", "--skill", "panda_pouring", "--methods", "replay", "--out", str(tmp_path)]
    for options, count, guarded in (([], 2, "the hand"), (["--guard", "arm"], 3, "the whole arm")):
        assert main([*command, *options]) == 0
        printed = capsys.readouterr().out
        assert f"half or more stay free: {count} scenes" in printed
        assert f"{guarded} guarded" in printed
    assert (tmp_path / "panda_pouring" / "guard_arm" / "table.txt").is_file()


def test_what_is_kept_of_a_camera_is_reported_apart(tmp_path, capsys) -> None:
    keep_replays(tmp_path, "panda_reach_to_grasp", range(2))
    keep_replays(tmp_path, "panda_reach_to_grasp", range(3), apart="camera")
    command = ["benchmark", "--kept", "--methods", "replay", "--out", str(tmp_path)]
    for options, count in (([], 2), (["--camera"], 3)):
        assert main([*command, *options]) == 0
        printed = capsys.readouterr().out
        assert f"half or more stay free: {count} scenes" in printed
        assert ("seen by a camera" in printed) == bool(options)
    figures = tmp_path / "panda_reach_to_grasp" / "camera" / "figures.json"
    assert json.loads(figures.read_text())["camera"] is True


def test_where_nothing_is_kept_that_is_said_and_no_file_is_touched(tmp_path, capsys) -> None:
    command = ["benchmark", "--kept", "--methods", "replay; ours", "--out", str(tmp_path)]
    assert main(command) == 2
    assert "no scene is kept" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    keep_replays(tmp_path, "panda_reach_to_grasp", [0])
    (tmp_path / "panda_reach_to_grasp" / "table.txt").write_text("of yesterday")
    assert main(command) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "(scenes: replay 1, ours 0)" in line
    assert (tmp_path / "panda_reach_to_grasp" / "table.txt").read_text() == "of yesterday"
    assert {path.name for path in (tmp_path / "panda_reach_to_grasp").iterdir()} == {"table.txt", "seed_0"}


def test_what_is_named_twice_counts_once(tmp_path, capsys) -> None:
    keep_replays(tmp_path, "panda_reach_to_grasp", range(2))
    command = ["benchmark", "--kept", "--methods", "replay;replay", "--families", "crossing,crossing"]
    assert main([*command, "--out", str(tmp_path)]) == 0
    assert "half or more stay free: 2 scenes" in capsys.readouterr().out
    content = json.loads((tmp_path / "panda_reach_to_grasp" / "figures.json").read_text())
    assert [item["number"] for item in content["scenes"]] == [0, 1]


def test_nothing_is_trained_where_nothing_is_kept_of_scenes_held_out(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("geodesic_motion_studies.comparison.run.Bench", None)
    keep_replays(tmp_path, "panda_reach_to_grasp", [0])
    assert main(["benchmark", "--held-out", "--kept", "--methods", "replay", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"no scene is kept in {tmp_path / 'panda_reach_to_grasp' / 'held_out'}" in line


def test_what_is_kept_of_scenes_held_out_is_reported_as_such(tmp_path, capsys, monkeypatch) -> None:
    keep_replays(tmp_path, "panda_reach_to_grasp", [0], held_out=True)
    monkeypatch.setattr("geodesic_motion_studies.comparison.run.Bench", Whatever)
    assert main(["benchmark", "--held-out", "--kept", "--methods", "replay", "--out", str(tmp_path)]) == 0
    assert "from the demonstration held out" in capsys.readouterr().out
    folder = tmp_path / "panda_reach_to_grasp" / "held_out"
    assert json.loads((folder / "figures.json").read_text())["held_out"]
    assert {path.name for path in (tmp_path / "panda_reach_to_grasp").iterdir()} == {"held_out"}


class Whatever:
    """A bench for which all that is kept is valid, so that nothing needs to be trained."""

    def __init__(self, skill: Skill, settings: BenchmarkSettings, folder: Path) -> None:
        self._results = Results(folder, skill.name, settings.seed, settings.held_out)
        self._valid = {"skill": digest(skill)}

    def known(self, row: str, family: str, number: int) -> Played | None:
        outcome = self._results.outcome(row, family, number, self._valid)
        return None if outcome is None else Played(row, family, number, self._valid, outcome)
