"""Recordings of joints on the command line: recognised, learned, measured, inspected; options of poses refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.cli.recorded import evenly_sampled
from geodesic_motion_ros.demonstrations.writers import save_joint_demonstrations
from geodesic_motion_ros.skill.skill import Skill

BRIEFLY = ["--steps", "60", "--kernels", "60"]
#: Exit statuses of a skill that was written: learned so briefly it need not have a motion.
WRITTEN = (0, 1)
pytestmark = pytest.mark.usefixtures("brief_training")


@pytest.fixture(scope="module")
def joint_recording(reach_demonstrations, tmp_path_factory) -> Path:
    """Four demonstrations of each family, which differ halfway."""
    path = tmp_path_factory.mktemp("joints") / "reach.npz"
    save_joint_demonstrations(evenly_sampled(reach_demonstrations.resample(100, by="time")), path)
    return path


@pytest.fixture(scope="module")
def trained(joint_recording, brief_training, tmp_path_factory) -> tuple[Path, Path]:
    """Folder of a small skill that was trained and measured by the command, and its JSON."""
    folder = tmp_path_factory.mktemp("trained")
    arguments = ["train", "--demos", str(joint_recording), "--out", str(folder / "reach"), *BRIEFLY]
    arguments += ["--held-out", "3", "--json", str(folder / "reach.json"), "--joint-weight", "0.04"]
    assert main(arguments) in WRITTEN
    return folder / "reach", folder / "reach.json"


def test_a_recording_of_joints_becomes_a_joint_space_skill_without_an_option(trained) -> None:
    folder, figures = trained
    skill = Skill.load(folder)
    assert (skill.space, skill.sheet, skill.metric.joint_weight) == ("joint", "canonical", 0.04)
    assert skill.provenance["held_out"] == [3]
    assert len(skill.provenance["demonstrations"]) == 7
    quality = json.loads(figures.read_text())["quality"]
    assert quality == skill.quality
    measured = [f"{row}_{what}" for row in ("held_out", "joint_line") for what in ("dtw_mm", "joint_dtw_rad")]
    assert all(quality[name] > 0.0 for name in (*measured, "reconstruction_pointwise_mm"))
    assert (folder / "report.png").read_bytes().startswith(b"\x89PNG")
    page = (folder / "report.html").read_text()
    for row in ("people among themselves", "mean demonstration", "ProMP", "straight line in joint space"):
        assert row in page


def test_inspect_shows_families_and_graph(trained, tmp_path, capsys) -> None:
    described, picture = tmp_path / "reach.json", tmp_path / "reach.png"
    assert main(["inspect", str(trained[0]), "--json", str(described), "--picture", str(picture)]) == 0
    shown, content = capsys.readouterr().out, json.loads(described.read_text())
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert content["robot"]["space"] == "joint"
    assert content["motion"]["demonstrations_per_family"] == [3, 4]
    assert (content["motion"]["start_groups"], content["motion"]["goal_groups"]) == (1, 1)
    graph = content["graph"]
    assert sum(graph["nodes_per_family"]) == graph["nodes"]
    assert min(graph["nodes_per_family"]) > 0
    assert sum(graph["nodes_per_piece"]) <= graph["nodes"]
    assert graph["built_in_s"] > 0.0
    for name in ("energy_per_edge", "sigma_limit", "nodes_per_family", "held_out_joint_dtw_rad"):
        assert name in shown


def test_evaluate_prints_the_table_of_joints(joint_recording, trained, tmp_path, capsys, monkeypatch) -> None:
    from geodesic_motion_studies.experiments import trained as cache

    asked = []

    def taken(task, shown, settings, folder, progress):
        asked.append((task, len(shown), settings.seed, folder))
        return Skill.load(trained[0])

    monkeypatch.setattr(cache, "trained_once", taken)
    file = tmp_path / "reach.json"
    arguments = ["evaluate", "--demos", str(joint_recording), "--folds", "3", "--seeds", "5", "--json", str(file)]
    assert main([*arguments, "--skills", str(tmp_path / "skills")]) == 0
    assert asked == [("reach", 7, 5, tmp_path / "skills")]
    content = json.loads(file.read_text())
    assert (content["task"], content["folds"], content["families"]) == ("reach", [[3]], [0] * 4 + [1] * 4)
    assert set(content["rows"]["geodesic"]) == {"all", "0", "1"}
    quality = json.loads(trained[1].read_text())["quality"]
    assert content["rows"]["geodesic"]["all"]["dtw_mm"] == pytest.approx(quality["held_out_dtw_mm"])
    printed = capsys.readouterr().out
    assert all(f"\n{row} " in printed for row in content["rows"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["train", "--units", "m", "--out", "{tmp}/s"], "reach.npz has joints, in rad or deg"),
        (["train", "--orientation-model", "sign_blind", "--out", "{tmp}/s"], "--orientation-model is for recordings"),
        (["train", "--space", "task", "--volume-weight", "1", "--out", "{tmp}/s"], "--volume-weight is for recordings"),
        (["train", "--space", "task", "--out", "{tmp}/s"], "say the units of the positions"),
        (["train", "--space", "task", "--units", "m", "--out", "{tmp}/s"], "it needs keys positions"),
        (["train", "--demos", "{tmp}/absent.csv", "--out", "{tmp}/s"], "absent.csv: cannot be read (No such file"),
        (["train", "--robot", "kuka", "--out", "{tmp}/s"], "robot 'kuka' is not known here; known: "),
        (["train", "--held-out", "8", "--out", "{tmp}/s"], "numbered 0 to 7"),
        (["evaluate", "--sheets", "raw"], "--sheets is for recordings of the tool"),
        (["evaluate", "--folds", "0,9"], "there is no demonstration 9"),
        (["evaluate", "--folds", "0,1,2,3"], "leaves no demonstration of family 0"),
    ],
)  # fmt: skip
def test_what_does_not_fit_joints_is_said_in_one_line(arguments, said, joint_recording, tmp_path, capsys) -> None:
    command, *rest = (argument.format(tmp=tmp_path) for argument in arguments)
    assert main([command, "--demos", str(joint_recording), *rest]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("geodesic-motion: ")]
    assert said in line
    assert not (tmp_path / "s").exists()


def test_the_papers_model_is_learned_and_what_is_given_beside_it_counts(joint_recording, tmp_path) -> None:
    arguments = ["train", "--demos", str(joint_recording), "--out", str(tmp_path / "paper"), "--paper"]
    given = ["--steps", "40", "--kernels", "40", "--latent-dimension", "2", "--far-sigma", "5"]
    assert main([*arguments, *given]) in WRITTEN
    skill = Skill.load(tmp_path / "paper")
    settings = skill.provenance["settings"]
    assert (skill.sheet, skill.metric.sigma_weight, settings["schedule"]) == ("raw", 1.0, "joint")
    assert (settings["kl_weight"], settings["volume_weight"], settings["body_sigma"]) == (1.0, 1.0, 0.0)
    assert (settings["steps"], settings["latent_dimension"]) == (40, 2)
    np.testing.assert_allclose(skill.decoder.uncertainty(np.full((1, 2), 1e3)), 5.0, rtol=1e-6)


def test_options_of_joints_are_refused_for_poses(recording, tmp_path, capsys) -> None:
    given = ["--demos", str(recording), "--units", "cm", "--out", str(tmp_path / "s")]
    for option, value in (("--joint-weight", "0.1"), ("--volume-weight", "0.1")):
        assert main(["train", *given, option, value]) == 2
        assert f"{option} is for recordings of joints" in capsys.readouterr().err


def test_an_arm_that_stands_still_is_refused_by_name(reach_demonstrations, tmp_path, capsys) -> None:
    short = reach_demonstrations.resample(50, by="time")
    first = short[0].configurations
    still = replace(short[1], configurations=np.tile(first[0], (50, 1)), name="idle")
    save_joint_demonstrations(replace(short, items=(short[0], still, *short.items[2:])), tmp_path / "still.npz")
    assert main(["train", "--demos", str(tmp_path / "still.npz"), "--out", str(tmp_path / "s")]) == 2
    assert "demonstration 'idle' does not move" in capsys.readouterr().err


@pytest.mark.parametrize("space", [["--space", "joint"], []], ids=["said", "recognised"])
def test_a_recording_of_another_arm_is_refused_with_both_arms_joints(space, tmp_path, capsys) -> None:
    joints = "shoulder_pan_joint,shoulder_lift_joint,elbow_joint,wrist_1_joint,wrist_2_joint,wrist_3_joint"
    rows = [f"d0,{0.1 * step:.1f},{0.1 * step:.2f},-1.1,-1.6,-2.0,1.6,-2.4" for step in range(20)]
    recording = tmp_path / "reach.csv"
    recording.write_text("\n".join([f"demonstration,t,{joints}", *rows]))
    assert main(["train", *space, "--demos", str(recording), "--out", str(tmp_path / "s")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    for said in (str(recording), joints.replace(",", ", "), "'panda'", "panda_joint7", "Say whose they are: --robot"):
        assert said in line
