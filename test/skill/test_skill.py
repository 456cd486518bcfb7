"""A skill comes back from disk as it was, and a damaged folder is refused with the reason."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import LearnedModel, Skill
from geodesic_motion_ros.utils.errors import SkillError


@pytest.fixture
def canonical_folder(canonical_fan_skill, tmp_path) -> Path:
    return canonical_fan_skill.save(tmp_path / "canonical")


@pytest.fixture
def folder(fan_skill, tmp_path) -> Path:
    return fan_skill.save(tmp_path / "fan")


def edit(folder: Path, **changes) -> None:
    described = yaml.safe_load((folder / "skill.yaml").read_text())
    for name, value in changes.items():
        if value is None:
            del described[name]
        else:
            described[name] = value
    (folder / "skill.yaml").write_text(yaml.safe_dump(described))


def test_round_trip_is_exact(fan_skill, folder):
    loaded = Skill.load(folder)
    for name, array in fan_skill.decoder.arrays().items():
        np.testing.assert_array_equal(loaded.decoder.arrays()[name], array)
    for name in ("codes", "latent_lower", "latent_upper", "start_pose", "goal_pose"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(fan_skill, name))
    for name in ("name", "robot", "metric", "sigma_support", "energy_per_edge", "orientation_model", "quality"):
        assert getattr(loaded, name) == getattr(fan_skill, name)


def test_what_it_was_recorded_in_comes_back_and_may_be_left_out(fan_skill, folder):
    assert "scene" not in yaml.safe_load((folder / "skill.yaml").read_text())
    assert Skill.load(folder).scene is None
    scene = {"boxes": [{"name": "table", "centre": [0.15, 0.0, -1e-5], "size": [1.5, 1.8, 0.06]}]}
    assert Skill.load(replace(fan_skill, scene=scene).save(folder)).scene == scene
    # Nothing stood there, which is more than not to say what did.
    assert Skill.load(replace(fan_skill, scene={}).save(folder)).scene == {}
    too_long = {"boxes": [{"name": f"box {i}", "centre": [1.0, 0.0, 0.0], "size": [0.1] * 3} for i in range(1000)]}
    with pytest.raises(SkillError, match="no more than 64 kB are read: its scene"):
        replace(fan_skill, scene=too_long).save(folder)
    assert Skill.load(folder).scene == {}
    edit(folder, scene=["table"])
    with pytest.raises(SkillError, match=r"scene is .*; it must hold names with their values"):
        Skill.load(folder)


def test_a_skill_finds_the_folder_of_its_robot_from_everywhere(fan_skill, tmp_path, monkeypatch):
    lab, elsewhere = tmp_path / "lab", tmp_path / "elsewhere"
    arm = shutil.copytree(RobotDescription.named("panda").folder, lab / "robots" / "arm")
    elsewhere.mkdir()
    monkeypatch.chdir(lab)
    saved = replace(fan_skill, robot="robots/arm").save("skills/fan")
    assert yaml.safe_load((saved / "skill.yaml").read_text())["robot"] == "../../robots/arm"
    monkeypatch.chdir(elsewhere)
    loaded = Skill.load(saved)
    assert Path(loaded.robot) == arm
    assert Path(Skill.load(loaded.save("copies/of/fan")).robot) == arm
    monkeypatch.chdir(tmp_path)
    moved = lab.rename(tmp_path / "moved")
    assert Path(Skill.load(moved / "skills" / "fan").robot) == moved / "robots" / "arm"
    shutil.rmtree(moved / "robots")
    with pytest.raises(SkillError, match=f"'../../robots/arm' is not known here.*no folder {moved}/robots/arm nor "):
        Skill.load(moved / "skills" / "fan")


def test_a_skill_of_a_shipped_robot_names_it(fan_skill, folder, tmp_path, monkeypatch):
    (tmp_path / "panda").mkdir()
    monkeypatch.chdir(tmp_path)
    assert yaml.safe_load((fan_skill.save(folder) / "skill.yaml").read_text())["robot"] == "panda"
    assert Skill.load(folder).robot == "panda"


def test_a_canonical_skill_comes_back_bit_by_bit(canonical_fan_skill, canonical_folder):
    for skill in (canonical_fan_skill, with_modes(canonical_fan_skill)):
        loaded = Skill.load(skill.save(canonical_folder))
        assert loaded.sheet == "canonical"
        for name in ("positions", "quaternions", "start_offsets", "goal_offsets", "modes"):
            saved, read = getattr(skill.canonical, name), getattr(loaded.canonical, name)
            assert read.tobytes() == saved.tobytes()
            assert read.dtype == saved.dtype
        assert (loaded.canonical.penalty, loaded.fade) == (skill.canonical.penalty, skill.fade)
        np.testing.assert_array_equal(loaded.pace, skill.pace)
        np.testing.assert_array_equal(loaded.mean_paths.centres, skill.mean_paths.centres)
        np.testing.assert_array_equal(loaded.mean_paths.precisions, skill.mean_paths.precisions)


def with_modes(skill: Skill) -> Skill:
    """The same skill with two modes, a regression, a fade and times."""
    modes, times = np.array([0, 1, 0, 1, 0, 1, 0]), np.linspace(2.0, 5.0, 7)[:, None] * np.linspace(0.0, 1.0, 100)
    return replace(skill, canonical=replace(skill.canonical, modes=modes, penalty=0.3, fade=4.0, times=times))


def test_offsets_of_skills_of_earlier_releases_fade_linearly(canonical_fan_skill, canonical_folder):
    with_modes(canonical_fan_skill).save(canonical_folder)
    assert Skill.load(canonical_folder).fade == 4.0
    edit(canonical_folder, offset_fade=None)
    assert Skill.load(canonical_folder).fade == 1.0


def test_the_pace_is_the_mean_of_the_demonstrations_and_nobody_knows_that_of_earlier_skills(
    canonical_fan_skill, canonical_folder
):
    with_modes(canonical_fan_skill).save(canonical_folder)
    np.testing.assert_allclose(Skill.load(canonical_folder).pace, np.linspace(0.0, 3.5, 100))
    rewritten(canonical_folder, canonical_times=None)
    assert Skill.load(canonical_folder).pace is None


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_skill_of_poses_has_no_mean_configuration(canonical_fan_skill, end) -> None:
    with pytest.raises(SkillError, match=f"is of poses of the tool.*{end}_pose"):
        canonical_fan_skill.mean_configuration(end)


def test_a_raw_skill_has_no_sheet_to_carry(fan_skill, folder):
    loaded = Skill.load(folder)
    assert (loaded.sheet, loaded.canonical, loaded.mean_paths) == ("raw", None, None)


def rewritten(folder: Path, **changes: np.ndarray | None) -> None:
    """Change arrays of latent.npz, or leave them out, and mend the checksum."""
    with np.load(folder / "latent.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays |= changes
    np.savez(folder / "latent.npz", **{name: array for name, array in arrays.items() if array is not None})
    described = yaml.safe_load((folder / "skill.yaml").read_text())
    described["sha256"]["latent.npz"] = hashlib.sha256((folder / "latent.npz").read_bytes()).hexdigest()
    edit(folder, sha256=described["sha256"])


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("positions", np.zeros((7, 3, 3))),
        ("quaternions", np.full((7, 100, 4), np.nan)),
        ("start_offsets", np.zeros((6, 6))),
        ("goal_offsets", np.full((7, 6), np.inf)),
        ("modes", np.array([0, 0, 2, 2, 0, 0, 0])),
        ("modes", np.zeros(3, dtype=int)),
        ("modes", None),
        ("times", np.zeros((7, 3))),
        ("times", np.full((7, 100), np.nan)),
        ("times", np.tile(np.linspace(1.0, 2.0, 100), (7, 1))),
        ("times", np.tile(np.linspace(0.0, -1.0, 100), (7, 1))),
        ("times", np.tile(np.append(0.0, np.linspace(2.0, 1.0, 99)), (7, 1))),
    ],
)
def test_broken_arrays_of_the_sheet_are_named(canonical_folder, name, array):
    rewritten(canonical_folder, **{f"canonical_{name}": array})
    with pytest.raises(SkillError, match=name):
        Skill.load(canonical_folder)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sheet": "flat"}, "sheets of kind 'flat' are not known here; known: 'canonical', 'raw'"),
        ({"sheet": None}, "lacks sheet"),
        ({"regression_penalty": -1.0}, "regression_penalty is -1.0"),
        ({"regression_penalty": "none"}, "regression_penalty is 'none'"),
        ({"regression_penalty": None}, "regression_penalty"),
        ({"offset_fade": 0.5}, "offset_fade is 0.5; it must be a number between 1 and 16"),
        ({"offset_fade": "slow"}, "offset_fade is 'slow'"),
    ],
)
def test_broken_descriptions_of_the_sheet_are_named(canonical_folder, changes, words):
    edit(canonical_folder, **changes)
    with pytest.raises(SkillError, match=words):
        Skill.load(canonical_folder)


@pytest.mark.parametrize(("name", "value"), [("sigma_support", 11.0), ("energy_per_edge", np.inf)])
def test_a_model_that_no_file_could_hold_becomes_no_skill(fan_skill, name, value):
    """As where kernels miss the codes, and sigma there is far_sigma."""
    wrong = replace(fan_skill, **{name: value})
    others = {item.name for item in fields(Skill)} - {item.name for item in fields(LearnedModel)} - {"energy_per_edge"}
    model = LearnedModel(**{item.name: getattr(wrong, item.name) for item in fields(LearnedModel)})
    with pytest.raises(SkillError, match=name):
        Skill.of(model, wrong.energy_per_edge, **{each: getattr(wrong, each) for each in others})


def test_a_skill_of_the_first_format_is_refused_with_what_to_do(canonical_folder):
    edit(canonical_folder, format_version=1)
    with pytest.raises(SkillError, match=r"format version 1, this release reads 2: .* train the skill again"):
        Skill.load(canonical_folder)


def test_what_is_on_disk_is_small_and_holds_no_pickle(folder):
    assert {file.name for file in folder.iterdir()} == {"skill.yaml", "weights.safetensors", "latent.npz"}
    assert sum(file.stat().st_size for file in folder.iterdir()) < 20e6
    with np.load(folder / "latent.npz", allow_pickle=False) as archive:
        assert all(archive[name].dtype == float for name in archive.files)


def test_saving_again_replaces_the_old_skill_and_keeps_what_lies_beside_it(fan_skill, folder):
    (folder / "README.md").write_text("card")
    (folder / "pictures").mkdir()
    (folder / "pictures" / "arm.png").write_bytes(b"png")
    replace(fan_skill, name="second").save(folder)
    assert Skill.load(folder).name == "second"
    assert (folder / "README.md").read_text() == "card"
    assert (folder / "pictures" / "arm.png").read_bytes() == b"png"
    assert [entry.name for entry in folder.parent.iterdir()] == ["fan"]


def test_a_save_that_fails_leaves_the_old_skill(fan_skill, folder):
    with pytest.raises(yaml.YAMLError):
        replace(fan_skill, provenance={"unwritable": object()}).save(folder)
    assert Skill.load(folder).name == "fan"
    assert [entry.name for entry in folder.parent.iterdir()] == ["fan"]


def test_a_folder_of_something_else_is_not_overwritten(fan_skill, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(SkillError, match="not a skill folder"):
        fan_skill.save(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def flip_a_byte(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 0xFF
    file.write_bytes(bytes(content))


def truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-100])


@pytest.mark.parametrize("damage", [flip_a_byte, truncate])
@pytest.mark.parametrize("name", ["weights.safetensors", "latent.npz"])
def test_altered_and_truncated_files_are_named(folder, damage, name):
    damage(folder / name)
    with pytest.raises(SkillError, match=rf"{name} differs from its checksum"):
        Skill.load(folder)


@pytest.mark.parametrize("name", ["skill.yaml", "weights.safetensors", "latent.npz"])
def test_missing_files_are_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(SkillError, match=f"{name} is missing"):
        Skill.load(folder)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format_version": 99}, "format version 99, this release reads 2"),
        ({"format_version": None}, "no format_version"),
        ({"robot": None}, "lacks robot"),
        ({"sha256": {}}, "sha256 must list exactly"),
        ({"sigma_support": -1.0}, "sigma_support is -1.0"),
        ({"energy_per_edge": "much"}, "energy_per_edge is 'much'"),
        ({"space": "dream"}, "space 'dream'"),
        ({"metric": {"colour": 3}}, "colour"),
    ],
)
def test_wrong_descriptions_say_what_is_wrong(folder, changes, words):
    edit(folder, **changes)
    with pytest.raises(SkillError, match=words):
        Skill.load(folder)


@pytest.mark.parametrize("content", ["", "just text", "{", "- a\n- list"])
def test_a_foreign_yaml_is_refused(folder, content):
    (folder / "skill.yaml").write_text(content)
    with pytest.raises(SkillError, match=r"skill\.yaml"):
        Skill.load(folder)


def test_who_mistypes_a_skill_is_given_the_shipped_ones():
    shipped = r"\(fr3_reach_to_grasp, .*panda_pouring, panda_reach_to_grasp, panda_wide_reach, .*, ur5_reach\)$"
    with pytest.raises(SkillError, match=shipped):
        Skill.load("bottle2shelf")


@pytest.mark.parametrize("name", ["no_such_skill", "no/such/folder"])
def test_a_skill_that_does_not_exist_is_named(name):
    with pytest.raises(SkillError, match=name):
        Skill.load(name)


def test_a_loaded_skill_decodes_to_the_same_graph(fan_skill, folder):
    moved = shutil.copytree(folder, folder.parent / "copy")
    first, second = fan_skill.graph((40, 40)), Skill.load(moved).graph((40, 40))
    np.testing.assert_array_equal(first.latent, second.latent)
    np.testing.assert_array_equal(first.edges, second.edges)
    np.testing.assert_array_equal(first.decoded.positions, second.decoded.positions)


@pytest.fixture
def joint_folder(reach_skill, tmp_path) -> Path:
    return reach_skill.save(tmp_path / "reach")


def test_a_joint_skill_comes_back_bit_by_bit_and_as_the_same_graph(reach_skill, joint_folder):
    loaded = Skill.load(joint_folder)
    for name, array in reach_skill.decoder.arrays().items():
        np.testing.assert_array_equal(loaded.decoder.arrays()[name], array)
    for field in fields(reach_skill.canonical):
        saved, read = (getattr(skill.canonical, field.name) for skill in (reach_skill, loaded))
        np.testing.assert_array_equal(read, saved)
    assert (loaded.space, loaded.metric, loaded.quality) == ("joint", reach_skill.metric, reach_skill.quality)
    first, second = reach_skill.graph((25, 25, 25)), loaded.graph((25, 25, 25))
    np.testing.assert_array_equal(first.configurations, second.configurations)
    np.testing.assert_array_equal(first.edges, second.edges)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("configurations", np.zeros((8, 3, 7))),
        ("start_offsets", np.zeros((8, 6))),
        ("goal_groups", np.array([0, 0, 0, 0, 3, 3, 3, 3])),
        ("start_poles", np.full((1, 7), np.nan)),
        ("start_poles", None),
    ],
)
def test_broken_arrays_of_a_joint_sheet_are_named(joint_folder, name, array):
    rewritten(joint_folder, **{f"canonical_{name}": array})
    with pytest.raises(SkillError, match=name):
        Skill.load(joint_folder)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"robot": "kuka"}, "robot 'kuka' is not known here; known: "),
        ({"space": "task"}, "orientation_model is 'none'"),
        ({"metric": {"sigma_weight": 1.0, "orientation_scale": "spread"}}, "orientation_scale"),
    ],
)
def test_a_joint_skill_of_another_kind_is_refused(joint_folder, changes, words):
    edit(joint_folder, **changes)
    with pytest.raises(SkillError, match=words):
        Skill.load(joint_folder)


def test_a_skill_of_an_arm_with_other_joints_is_refused_with_both_numbers(reach_skill, tmp_path):
    decoder = reach_skill.decoder
    without_last = {name: getattr(decoder, name)[:6] for name in ("W3", "b3", "joint_offset", "sigma_weights")}
    shorter = replace(decoder, **without_last, sigma_floor=decoder.sigma_floor[:6])
    folder = replace(reach_skill, decoder=shorter).save(tmp_path / "six")
    with pytest.raises(SkillError, match=r"the decoder is of 6 joints; the robot has 7"):
        Skill.load(folder)
    sheet = reach_skill.canonical
    sheet = replace(sheet, configurations=sheet.configurations[..., :6])
    folder = replace(reach_skill, canonical=sheet).save(tmp_path / "sheet")
    with pytest.raises(SkillError, match="the canonical sheet is of 6 joints"):
        Skill.load(folder)


@pytest.mark.parametrize("damage", [flip_a_byte, truncate])
def test_an_altered_joint_skill_is_refused(joint_folder, damage):
    damage(joint_folder / "weights.safetensors")
    with pytest.raises(SkillError, match=r"weights.safetensors differs from its checksum"):
        Skill.load(joint_folder)


@pytest.mark.parametrize(
    "name",
    ["panda_reach_to_grasp", "panda_wide_reach", "panda_insertion", "fr3_reach_to_grasp", "ur5_reach",
     "iiwa14_reach_to_grasp"],
)  # fmt: skip
def test_where_a_demonstration_starts_or_ends_the_arm_does_not_touch_itself(name):
    """An arm stood there, so that spheres which overlap would refuse it without cause."""
    skill = Skill.load(name)
    sheet, robot, model = skill.canonical, Robot.named(skill.robot), CollisionModel.named(skill.robot)
    starts, goals = sheet.start_poles[sheet.start_groups], sheet.goal_poles[sheet.goal_groups]
    for posture in (*(starts + sheet.start_offsets), *(goals + sheet.goal_offsets)):
        assert self_clearance(model, robot, posture)[0] > 0.0
