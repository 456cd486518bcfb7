from __future__ import annotations

import base64
import json
import re

import numpy as np
import pytest

from geodesic_motion_ros import cli
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.cli import main, train
from geodesic_motion_ros.cli.report import planner_of
from geodesic_motion_ros.skill.skill import Skill

BRIEFLY = ["--steps", "60", "--kernels", "60"]
#: Exit statuses of a skill that was written: learned so briefly it need not have a motion.
WRITTEN = (0, 1)
pytestmark = pytest.mark.usefixtures("brief_training")


@pytest.fixture(scope="module")
def trained(recording, brief_training, tmp_path_factory):
    """Folder of a skill that was trained and measured by the command, and its JSON."""
    pytest.importorskip("movement_primitives")
    folder = tmp_path_factory.mktemp("trained")
    arguments = ["train", "--demos", str(recording), "--units", "cm", "--out", str(folder / "reach"), *BRIEFLY]
    arguments += ["--held-out", "1", "--licence", "CC0-1.0", "--json", str(folder / "figures" / "reach.json")]
    assert main(arguments) in WRITTEN
    return folder / "reach", folder / "figures" / "reach.json"


def test_a_skill_folder_comes_out_with_its_figures_and_its_picture(trained) -> None:
    folder, figures = trained
    skill = Skill.load(folder)
    assert skill.name == "reach"
    assert skill.provenance["licence"] == "CC0-1.0"
    assert skill.provenance["held_out"] == [1]
    assert skill.provenance["demonstrations"] == ["reach_0", "reach_2", "reach_3"]
    assert 0.0 < skill.quality["held_out_dtw_mm"] < 100.0
    assert skill.quality["held_out_endpoint_after_mm"] < 1e-6
    assert json.loads(figures.read_text())["quality"] == skill.quality
    assert (folder / "report.png").read_bytes().startswith(b"\x89PNG")


def test_a_report_stands_beside_the_skill_with_its_recording_and_its_held_out_figures(trained, capsys) -> None:
    page = (trained[0] / "report.html").read_text()
    quality = Skill.load(trained[0]).quality
    for words in ("Nothing was found in them.", "held out", "mean demonstration", f"{quality['promp_dtw_mm']:.2f}"):
        assert words in page
    picture = base64.b64encode((trained[0] / "report.png").read_bytes()).decode()
    assert picture in page


def test_inspect_writes_the_report_of_a_skill_and_refuses_that_of_a_recording(
    trained, recording, tmp_path, capsys
) -> None:
    page, picture = tmp_path / "new" / "reach.html", tmp_path / "reach.png"
    assert main(["inspect", str(trained[0]), "--html", str(page), "--picture", str(picture)]) == 0
    assert f"wrote its report to {page}" in capsys.readouterr().out
    assert "The recording is not beside the skill" in page.read_text()
    assert main(["inspect", str(recording), "--units", "cm", "--html", str(tmp_path / "no.html")]) == 2
    assert "--html is of skills" in capsys.readouterr().err
    assert not (tmp_path / "no.html").exists()


def test_the_scene_of_the_recording_is_kept_and_refused_where_demonstrations_enter_it(
    recording, tmp_path, capsys
) -> None:
    arguments = ["train", "--demos", str(recording), "--units", "cm", *BRIEFLY]
    assert main([*arguments, "--out", str(tmp_path / "on_a_table"), "--scene", "table"]) in WRITTEN
    said = capsys.readouterr()
    warnings = [line for line in said.err.splitlines() if "warning" in line]
    assert all("moves no arm yet" in line for line in warnings)  # a good recording is not remarked on
    assert said.out.index("samples of 4 demonstrations: 60 steps") < said.out.index("wrote the skill")
    skill = Skill.load(tmp_path / "on_a_table")
    assert DeclaredScene.of_skill(skill).names == ("table",)
    crate = tmp_path / "crate.yaml"
    where = [round(float(number), 3) for number in skill.goal_pose[:3]]
    crate.write_text(f"boxes: [{{name: crate, centre: {where}, size: [0.2, 0.2, 0.2]}}]")
    capsys.readouterr()
    assert main([*arguments, "--out", str(tmp_path / "in_a_crate"), "--scene", str(crate)]) == 2
    assert re.search(r"demonstration \d+ is \d+ mm inside 'crate' of the scene at sample \d+", capsys.readouterr().err)
    assert not (tmp_path / "in_a_crate").exists()


def test_an_old_skill_is_replaced_by_the_papers_form_of_it(recording, tmp_path) -> None:
    folder = tmp_path / "skill"
    arguments = ["train", "--demos", str(recording), "--units", "cm", "--out", str(folder)]
    arguments += ["--steps", "60", "--kernels", "20", "--seed", "5", "--sheet", "raw"]
    assert main(arguments) in WRITTEN
    assert Skill.load(folder).orientation_model == "two_cluster"
    floors = ["--far-sigma", "100", "--far-kappa", "0.02", "--bandwidth-factor", "3"]
    assert main([*arguments, "--paper", *floors, "--name", "as published"]) in WRITTEN
    skill = Skill.load(folder)
    assert (skill.name, skill.orientation_model, skill.metric.sigma_weight) == ("as published", "sign_blind", 1.0)
    assert skill.metric.orientation_scale == "kappa"
    settings = skill.provenance["settings"]
    assert (skill.provenance["seed"], settings["kl_weight"], settings["schedule"]) == (5, 1.0, "joint")
    assert (settings["kl_warm_up"], settings["position_resolution"], settings["angular_resolution"]) == (0.0, 0.0, 0.0)
    assert settings["bandwidth_factor"] == 3.0
    far = skill.decoder.decode(np.full((1, 2), 1e3))
    np.testing.assert_allclose(far.sigma, 100.0, rtol=1e-6)
    np.testing.assert_allclose(far.kappa, 0.02, rtol=1e-6)


def test_densities_are_chosen_and_the_papers_are_not_changed(recording, tmp_path, capsys) -> None:
    arguments = ["train", "--demos", str(recording), "--units", "cm", "--out", str(tmp_path / "skill")]
    arguments += ["--steps", "60", "--kernels", "20"]
    chosen = ["--position-density", "full", "--orientation-density", "angular_central_gaussian"]
    assert main([*arguments, *chosen]) in WRITTEN
    decoder = Skill.load(tmp_path / "skill").decoder
    assert decoder.full
    assert decoder.kappa_weights.shape == (3, len(decoder.rbf_centres))
    capsys.readouterr()
    assert main([*arguments, *chosen, "--paper"]) == 2
    assert "schedule joint learns diagonal and von_mises_fisher densities alone" in capsys.readouterr().err


@pytest.mark.parametrize("dimension", ["1", "4"])
def test_it_learns_in_as_many_dimensions_as_it_is_asked_to(recording, tmp_path, dimension) -> None:
    folder = tmp_path / "skill"
    arguments = ["train", "--demos", str(recording), "--units", "cm", "--out", str(folder), *BRIEFLY]
    assert main([*arguments, "--latent", dimension]) in WRITTEN
    assert len(Skill.load(folder).latent_lower) == int(dimension)
    assert (folder / "report.png").read_bytes().startswith(b"\x89PNG")
    assert main(["inspect", str(folder), "--picture", str(tmp_path / "again.png")]) == 0


def test_the_data_choose_the_dimension_and_the_skill_keeps_why(recording, tmp_path, capsys) -> None:
    folder = tmp_path / "skill"
    arguments = ["train", "--demos", str(recording), "--units", "cm", "--out", str(folder), *BRIEFLY]
    assert main([*arguments, "--latent", "auto"]) in WRITTEN
    said, skill = capsys.readouterr().out, Skill.load(folder)
    compared = skill.provenance["dimension"]
    assert compared["dimensions"] == [1, 2, 3, 4, 5, 6]
    assert len(skill.latent_lower) == compared["chosen"] == skill.provenance["settings"]["latent_dimension"]
    assert said.index("choosing the latent dimension") < said.index(f"chosen: {compared['chosen']}")
    assert "over the number of latent dimensions" in (folder / "report.html").read_text()


def test_a_number_of_dimensions_that_is_none_is_refused(recording, tmp_path, capsys) -> None:
    arguments = ["train", "--demos", str(recording), "--units", "cm", "--out", str(tmp_path / "no")]
    for wrong in ("0", "7", "many"):
        with pytest.raises(SystemExit):
            main([*arguments, "--latent", wrong])
        assert "from 1 to 6, nor auto" in capsys.readouterr().err


def test_inspect_shows_what_the_skill_holds(trained, tmp_path, capsys) -> None:
    described, picture = tmp_path / "reach.json", tmp_path / "reach.png"
    assert main(["inspect", str(trained[0]), "--json", str(described), "--picture", str(picture)]) == 0
    shown, content = capsys.readouterr().out, json.loads(described.read_text())
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert content["motion"]["demonstrations"] == 3
    assert content["motion"]["distance"] == pytest.approx(0.54, abs=0.02)
    assert 0 < content["graph"]["nodes"] < 100 * 100
    assert content["thresholds"]["sigma_limit"] == pytest.approx(5.0 * content["thresholds"]["sigma_support"])
    for name in ("demonstrations", "nodes", "energy_per_edge", "held_out_dtw_mm", "CC0-1.0"):
        assert name in shown


def test_a_single_small_and_badly_learned_demonstration_is_remarked_on(recording, tmp_path, capsys) -> None:
    small = np.load(recording)[:1]
    small[..., :3] = 40.0 + 0.03 * (small[..., :3] - 40.0)  # less than two centimetres in all
    np.save(tmp_path / "small.npy", small)
    arguments = ["train", "--demos", str(tmp_path / "small.npy"), "--units", "cm", "--out", str(tmp_path / "skill")]
    assert main([*arguments, "--steps", "1", "--kernels", "10"]) in WRITTEN
    said = capsys.readouterr().err
    assert "one demonstration only" in said
    assert "mm large: is --units right?" in said
    assert "a poor skill" in said


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--name", "", "--name is ''; it must be one line of 1 to 200 characters"),
        ("--name", 201 * "x", "1 to 200"),
        ("--licence", "CC0\n", "--licence is 'CC0\\n'; it must be one line of 1 to 2000"),
        ("--source", 2001 * "x", "1 to 2000"),
        ("--sigma-weight", "nan", "must be positive and finite: metric.sigma_weight"),
    ],
)
def test_what_a_skill_cannot_hold_is_refused_before_the_training(recording, tmp_path, capsys, option, value, said):
    arguments = ["train", "--demos", str(recording), "--units", "cm", "--out", str(tmp_path / "s")]
    assert main([*arguments, option, value]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_a_skill_that_the_arm_cannot_hold_is_written_and_warned_of(recording, tmp_path, capsys) -> None:
    """The same reaches half a metre farther away, where the tool of a Panda does not come."""
    moved = np.load(recording)
    moved[..., 0] += 50.0
    np.save(tmp_path / "far.npy", moved)
    arguments = ["train", "--demos", str(tmp_path / "far.npy"), "--units", "cm", "--out", str(tmp_path / "skill")]
    assert main([*arguments, *BRIEFLY, "--json", str(tmp_path / "skill.json")]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    objection = json.loads((tmp_path / "skill.json").read_text())["unusable"]
    assert said == f"geodesic-motion: warning: the skill in {tmp_path / 'skill'} moves no arm yet: {objection}"
    assert "_OUT_OF_SUPPORT: " in said
    assert "are --robot, --units and the frame of the recording right" in said
    assert objection.split(": ")[1].split("; are --robot")[0] in (tmp_path / "skill" / "report.html").read_text()
    Skill.load(tmp_path / "skill")


def test_a_shipped_skill_has_a_motion_of_its_own() -> None:
    for name in ("panda_pouring", "ur5_reach"):
        planner = planner_of(Skill.load(name))
        assert train.own_objection(planner) == ""
        # the control: with a sphere in the hand's place at the goal it has none
        planner.set_obstacles(centres=[planner.skill.goal_pose[:3]], radii=[0.03])
        assert "NO_FEASIBLE_PATH: " in train.own_objection(planner)


def poured(tmp_path, order: str) -> list[str]:
    """Arguments to train on a tool that tips over from level, its quaternions in an order."""
    share = np.linspace(0.0, 1.0, 40)[:, None]
    half = np.pi / 4.0 * (1.0 + share)
    quaternions = {"qw": np.cos(half), "qx": np.sin(half), "qy": 0.0 * share, "qz": 0.0 * share}
    start = np.array([0.4, -0.2, 0.3]) + np.array([-0.02, 0.0, 0.02])[:, None, None]
    positions = start + share * [0.05, 0.4, 0.0]
    turned = np.broadcast_to(np.hstack([quaternions[name] for name in order.split(",")]), (3, 40, 4))
    np.save(tmp_path / "pour.npy", np.concatenate([positions, turned], axis=2))
    out = ["--demos", str(tmp_path / "pour.npy"), "--units", "m", "--out", str(tmp_path / "skill")]
    return ["train", *out, "--steps", "1", "--kernels", "10"]


def test_a_recording_in_the_order_of_ros_is_refused_until_the_order_is_said(tmp_path, capsys) -> None:
    arguments = poured(tmp_path, "qx,qy,qz,qw")
    shown = ["inspect", arguments[2], "--units", "m", "--picture", str(tmp_path / "p.png")]
    for command in (arguments, shown):
        assert main(command) == 2
        error = capsys.readouterr().err
        assert "say --columns px,py,pz,qx,qy,qz,qw; otherwise say --columns px,py,pz,qw,qx,qy,qz" in error
    assert not (tmp_path / "skill").exists()
    for columns, begins, ends in (("px,py,pz,qx,qy,qz,qw", 90, 0), ("px,py,pz,qw,qx,qy,qz", 180, 180)):
        assert main([*arguments, "--columns", columns]) in WRITTEN
        assert f"the tool's z axis begins {begins} and ends {ends} deg from straight down" in capsys.readouterr().out
        assert main([*shown, "--columns", columns]) == 0


def test_a_recording_in_the_order_of_the_scalar_first_is_not_asked_about(tmp_path, capsys) -> None:
    assert main(poured(tmp_path, "qw,qx,qy,qz")) in WRITTEN
    assert "--columns" not in capsys.readouterr().err


def test_the_product_alone_does_not_measure_on_held_out_demonstrations(recording, tmp_path, capsys) -> None:
    arguments = ["train", "--demos", str(recording), "--units", "cm", "--out", str(tmp_path / "s"), *BRIEFLY]
    assert cli.main([*arguments, "--held-out", "1"], [cli.PRODUCT]) == 2
    assert "nothing here measures" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()
