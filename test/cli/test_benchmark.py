"""`benchmark` as a person meets it: refused in one line before anything long, reported from what is kept."""

from __future__ import annotations

import json

import pytest

from geodesic_motion_ros.cli import main


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--skill", "no_such_skill"], "no skill 'no_such_skill'"),
        (["--skill", "panda_pouring", "--families", "elbow"], "elbow"),
        (["--methods", "theirs"], "there is no method 'theirs': choose from ours;"),
        (["--families", "wall"], "choose from none, static"),
        (["--scenes", "0"], "at least 1 is needed"),
        (["--json", "{file}/x.json"], "cannot be written"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(arguments, said, tmp_path, capsys) -> None:
    file = tmp_path / "file"
    file.touch()
    command = ["benchmark", "--out", str(tmp_path / "out"), *(argument.format(file=file) for argument in arguments)]
    assert main(command) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("geodesic-motion: ")]
    assert said in line


@pytest.mark.parametrize("scene", ["crossing", "wall:1"])
def test_what_is_no_scene_is_refused(scene, capsys) -> None:
    with pytest.raises(SystemExit):
        main(["benchmark", "--strip", scene])
    assert "like crossing:0" in capsys.readouterr().err


def test_what_is_kept_is_reported_without_playing(tmp_path, capsys) -> None:
    assert main(["benchmark", "--kept", "--methods", "ours; replay", "--out", str(tmp_path)]) == 0
    assert "replay" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"table.txt", "figures.json", "success.png", "clearance.png"}


def test_what_is_kept_of_scenes_held_out_is_reported_as_such(tmp_path, capsys) -> None:
    command = ["benchmark", "--held-out", "--kept", "--methods", "replay", "--out", str(tmp_path)]
    assert main(command) == 0
    assert "from the demonstration held out" in capsys.readouterr().out
    assert json.loads((tmp_path / "figures.json").read_text())["held_out"]
    # Nothing was trained for that.
    assert not (tmp_path / "panda_reach_to_grasp").exists()
