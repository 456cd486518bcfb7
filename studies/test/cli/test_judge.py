"""Scenes out of the benchmark into a file, and motions of another program judged in them, as a person does it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.cli import main
from geodesic_motion_studies.comparison.scene_file import SceneFile

SKILL = ["--skill", "panda_pouring", "--guard", "arm"]


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenes") / "scenes.npz"
    options = ["--families", "none,elbow", "--scenes", "1", "--seed", "4", "--save-scenes", str(path)]
    assert main(["benchmark", *SKILL, *options]) == 0
    return path


def test_scenes_of_a_file_are_played_and_reported_apart(scenes, tmp_path, capsys) -> None:
    command = ["benchmark", *SKILL, "--methods", "replay", "--scenes-from", str(scenes), "--out", str(tmp_path)]
    assert main([*command, "--strip", "gate:0"]) == 2
    assert "no scene gate-0" in capsys.readouterr().err
    assert main([*command, "--json", str(tmp_path / "x.json")]) == 0
    assert "all: 2 scenes" in capsys.readouterr().out
    content = json.loads((tmp_path / "x.json").read_text())
    assert (content["seed"], content["guard"]) == (4, "arm")
    assert [(item["family"], item["number"]) for item in content["scenes"]] == [("elbow", 0), ("none", 0)]
    (folder,) = (tmp_path / "panda_pouring" / "guard_arm").iterdir()
    assert folder.name.startswith("scenes_")
    assert (folder / "table.txt").is_file()
    assert main([*command, "--kept"]) == 0
    assert "all: 2 scenes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "reported"),
    [
        (["--skill", "panda_pouring"], "of the guard 'arm', not of 'tool' (--guard)"),
        (["--skill", "panda_bottle2shelf", "--guard", "arm"], "of the skill 'panda_pouring'"),
        ([*SKILL, "--seed", "0"], "--scenes-from and --seed exclude each other"),
        ([*SKILL, "--held-out"], "--scenes-from and --held-out exclude each other"),
        ([*SKILL, "--save-scenes", "x.npz"], "--scenes-from and --save-scenes exclude each other"),
    ],
)
def test_scenes_that_do_not_fit_are_refused_in_a_line(scenes, options, reported, tmp_path, capsys) -> None:
    assert main(["benchmark", *options, "--scenes-from", str(scenes), "--out", str(tmp_path)]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("geodesic-motion: ")]
    assert reported in line
    assert not list(tmp_path.iterdir())


def test_motions_are_judged_without_a_planner(scenes, tmp_path, capsys) -> None:
    file = SceneFile.read(scenes)
    names = [f"{scene.family}-{scene.number}" for scene in file.scenes]
    straight = np.stack([np.linspace(scene.start, scene.goal, 400) for scene in file.scenes])
    joints = np.array([f"panda_joint{number}" for number in range(1, 8)])
    motions = tmp_path / "straight.npz"
    np.savez(motions, configurations=straight, joint_names=joints, names=names, times=np.linspace(0.0, 4.0, 400))
    command = ["judge", "--scenes", str(scenes), "--motions", str(motions)]
    assert main([*command, "--json", str(tmp_path / "x.json")]) == 0
    assert "the whole arm guarded" in capsys.readouterr().out
    content = json.loads((tmp_path / "x.json").read_text())
    row = content["rows"]["straight"]["all"]
    assert (row["scenes"], row["in_time_percent"], row["replan_p99_ms"]) == (2, None, None)
    (free,) = [item for item in content["scenes"] if item["family"] == "none"]
    assert free["reached"]
    assert main([*command[:-1], str(tmp_path / "none.npz")]) == 2
    assert "cannot be read" in capsys.readouterr().err
