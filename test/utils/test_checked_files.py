"""Files that lie: each kind is refused in one line that names file and field, without hanging and within its memory."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from safetensors.numpy import load_file, save_file

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.demonstrations.readers import is_of_joints, read_demonstrations, read_joint_demonstrations
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils import checked_files
from geodesic_motion_ros.utils.checked_files import DEEPEST, read_yaml
from geodesic_motion_ros.utils.errors import DemonstrationError, FileError, SkillError

MODELS = Path(__file__).resolve().parents[2] / "models"
DESCRIPTION, WEIGHTS, LATENT = "skill.yaml", "weights.safetensors", "latent.npz"

Spoil = Callable[[Path], object]
"""Spoils a file, or a copy of a shipped skill's folder."""


def skill_folder(folder: Path, name: str = "panda_pouring") -> Path:
    """A copy of a shipped skill."""
    folder.mkdir()
    for file in (DESCRIPTION, WEIGHTS, LATENT):
        shutil.copy(MODELS / name / file, folder)
    return folder


def sign(folder: Path) -> None:
    """Make the checksums right again."""
    entries = yaml.safe_load((folder / DESCRIPTION).read_text())
    entries["sha256"] = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in (WEIGHTS, LATENT)}
    (folder / DESCRIPTION).write_text(yaml.safe_dump(entries))


# ---------------------------------------------------------------- files of another kind


def pipe(file: Path) -> None:
    file.unlink(missing_ok=True)
    os.mkfifo(file)


def endless_device(file: Path) -> None:
    file.unlink(missing_ok=True)
    file.symlink_to("/dev/zero")


def directory(file: Path) -> None:
    file.unlink(missing_ok=True)
    file.mkdir()


def broken_link(file: Path) -> None:
    file.unlink(missing_ok=True)
    file.symlink_to("nowhere")


def sparse(file: Path) -> None:
    """A terabyte that takes no place on the disk."""
    with file.open("wb") as stream:
        stream.truncate(1 << 40)


def containing(content: bytes) -> Spoil:
    return lambda file: file.write_bytes(content)


#: What else can be called like a file, and the words that must be said of it.
KINDS: dict[str, tuple[Spoil, str]] = {
    "pipe": (pipe, "is a pipe"),
    "endless device": (endless_device, "is a device"),
    "directory": (directory, "is a directory"),
    "terabyte of nothing": (sparse, "is 1099511.6 MB large"),
    "file of nothing": (containing(b""), ""),
    "file of rubbish": (containing(np.random.default_rng(0).bytes(5000)), ""),
}


# ---------------------------------------------------------------- arrays that are not there


def npy(header: str, content: bytes = b"", version: int = 1) -> bytes:
    """A file in numpy's format with any header."""
    line = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY" + bytes([version, 0]) + len(line).to_bytes(2 if version == 1 else 4, "little") + line + content


def declaring(shape: str, descr: str = "'<f8'", content: bytes = b"") -> bytes:
    return npy(f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}", content)


#: Contents of a `.npy` file, by what is wrong with them.
LYING_ARRAYS: dict[str, bytes] = {
    "declares 15 TiB": declaring("(1000, 290000, 7, 1000)"),
    "declares more than a number can say": declaring(f"({'9' * 30}, {'9' * 30})"),
    "cut short": declaring("(3, 40, 7)", content=bytes(3 * 40 * 7 * 8 - 1)),
    "holds more than it declares": declaring("(3, 40, 7)", content=bytes(2 * 3 * 40 * 7 * 8)),
    "negative sizes": declaring("(-3, -40, 7)", content=bytes(3 * 40 * 7 * 8)),
    "endless beside a zero": declaring(f"({10**12}, 0, 7)"),
    "endless by several beside a zero": declaring("(1000, 1000, 0, 1000)"),
    "endless and of no length": declaring(f"({10**12},)", "'<U0'"),
    "records": declaring("(4,)", "[('x', '<f8')]", bytes(32)),
    "dates": declaring("(4,)", "'<M8[s]'", bytes(32)),
    "pickled": declaring("(1,)", "'|O'", b"cos\nsystem\n(S'touch pwned'\ntR."),
    "header in parentheses": npy("(" * 5000 + ")" * 5000),
    "header of minus signs": npy("{'descr': " + "-" * 9000 + "1}"),
    "header of four gigabytes": b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}",
    "header of text": npy("import os"),
    "another version": npy("{}", version=9),
    "no format": b"PICKLE" * 100,
}


def archive(file: Path, members: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> None:
    with zipfile.ZipFile(file, "w", compression) as stream:
        for name, content in members.items():
            stream.writestr(f"{name}.npy", content)


def archived(name: str, content: bytes) -> Spoil:
    return lambda file: archive(file, {name: content})


def bomb(file: Path) -> None:
    """160 MB of zeros in 0.16 MB, all of them declared."""
    count = 20_000_000
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as stream, stream.open("configurations.npy", "w") as member:
        member.write(declaring(f"({count},)"))
        for _ in range(count // 1_000_000):
            member.write(bytes(8_000_000))


def crowded(file: Path) -> None:
    archive(file, {f"{number:0100d}": b"" for number in range(1000)})


def otherwise_compressed(file: Path) -> None:
    archive(file, {"positions": declaring("(4,)", content=bytes(32))}, zipfile.ZIP_LZMA)


def encrypted(file: Path) -> None:
    archive(file, {"positions": declaring("(4,)", content=bytes(32))}, zipfile.ZIP_STORED)
    content = bytearray(file.read_bytes())
    content[6] |= 1
    content[content.index(b"PK\1\2") + 8] |= 1
    file.write_bytes(bytes(content))


def understated(file: Path) -> None:
    """An archive whose directory says that a member inflates to fewer bytes than it does."""
    archive(file, {"positions": declaring("(20, 40, 7)", content=bytes(20 * 40 * 7 * 8))})
    content = bytearray(file.read_bytes())
    at = content.index(b"PK\1\2") + 24
    content[at : at + 4] = (128 + 7 * 8).to_bytes(4, "little")
    file.write_bytes(bytes(content))


#: Archives of arrays, by what is wrong with them.
LYING_ARCHIVES: dict[str, tuple[Spoil, str]] = {
    "bomb": (bomb, "inflates from"),
    "crowd": (crowded, "too many arrays"),
    "archive compressed by another method": (otherwise_compressed, "compressed otherwise"),
    "encrypted archive": (encrypted, "'positions': is damaged"),
    "archive of an understated size": (understated, "'positions'"),
}


# ---------------------------------------------------------------- skill folders


def described(**changes: object) -> Spoil:
    """Change entries of skill.yaml."""

    def spoil(folder: Path) -> None:
        entries = yaml.safe_load((folder / DESCRIPTION).read_text()) | changes
        (folder / DESCRIPTION).write_text(yaml.safe_dump(entries))

    return spoil


def appended(text: str) -> Spoil:
    """Append to skill.yaml."""

    def spoil(folder: Path) -> None:
        with (folder / DESCRIPTION).open("a") as stream:
            stream.write(text)

    return spoil


def replaced(name: str, spoil_file: Spoil) -> Spoil:
    """Put something else in the place of a file; with its checksum where it has one."""

    def spoil(folder: Path) -> None:
        spoil_file(folder / name)
        if name != DESCRIPTION and (folder / name).is_file() and (folder / name).stat().st_size < 1e9:
            sign(folder)

    return spoil


def latent(**changes: Callable[[np.ndarray], np.ndarray] | None) -> Spoil:
    """Change arrays of latent.npz, or leave them out."""

    def spoil(folder: Path) -> None:
        with np.load(folder / LATENT) as stored:
            arrays = dict(stored)
        for name, change in changes.items():
            array = arrays.pop(name)
            if change is not None:
                arrays[name] = change(array)
        np.savez(folder / LATENT, **arrays)
        sign(folder)

    return spoil


def weights(prefix: str, change: Callable[[np.ndarray], np.ndarray] | None) -> Spoil:
    """Change the arrays of weights.safetensors whose names begin so, or leave them out."""

    def spoil(folder: Path) -> None:
        arrays = load_file(folder / WEIGHTS)
        for name in [name for name in arrays if name.startswith(prefix)]:
            array = arrays.pop(name)
            if change is not None:
                arrays[name] = np.ascontiguousarray(change(array))
        save_file(arrays, folder / WEIGHTS)
        sign(folder)

    return spoil


def filled(value: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda array: np.full_like(array, value)


def scaled(factor: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda array: factor * array


def metric(**changes: object) -> Spoil:
    return described(metric={"sigma_weight": 10.0, "orientation_scale": "spread"} | changes)


LAUGHS = "\nlaugh0: &laugh0 [lol]" + "".join(
    f"\nlaugh{level}: &laugh{level} [{', '.join([f'*laugh{level - 1}'] * 9)}]" for level in range(1, 10)
)
TERABYTES = b'{"decoder.W1":{"dtype":"F64","shape":[2000000000000],"data_offsets":[0,16000000000000]}}'

#: What spoils a skill of poses, and the file and the words that must be said, by its name.
TASK_SKILLS: dict[str, tuple[Spoil, str, str]] = {
    **{
        f"{name} in the place of {file}": (replaced(file, spoil), file, words)
        for file in (DESCRIPTION, WEIGHTS, LATENT)
        for name, (spoil, words) in (KINDS | {"broken link": (broken_link, "is missing")}).items()
    },
    **{
        f"codes: {name}": (replaced(LATENT, archived("codes", content)), LATENT, "'codes'")
        for name, content in LYING_ARRAYS.items()
    },
    **{
        f"{name} of arrays": (replaced(LATENT, spoil), LATENT, words) for name, (spoil, words) in LYING_ARCHIVES.items()
    },
    "lists in lists": (appended("more: " + "[" * 20_000), DESCRIPTION, "nested more than 20 deep"),
    "lists in lists by lines": (appended("more:\n  " + "- " * 20_000 + "1\n"), DESCRIPTION, "nested more than 20 deep"),
    "a billion laughs": (appended(LAUGHS), DESCRIPTION, "anchor, alias or tag"),
    "a list in itself": (appended("more: &a [*a]"), DESCRIPTION, "anchor, alias or tag"),
    "a command": (appended("more: !!python/object/apply:os.system ['touch pwned']"), DESCRIPTION, "alias or tag"),
    "a tag": (appended("more: !!timestamp 5"), DESCRIPTION, "anchor, alias or tag"),
    "a month that is none": (appended("more: 2026-13-41"), DESCRIPTION, "month"),
    "a long description": (appended("# " * 100_000), DESCRIPTION, "is 0.2 MB large"),
    "two descriptions": (appended("\n---\na: 1\n"), DESCRIPTION, "is no readable YAML"),
    "quality that is a number": (described(quality=5), DESCRIPTION, "quality is 5"),
    "quality under a number": (described(quality={5: 1.0}), DESCRIPTION, "a name in quality is 5"),
    "provenance that is a list": (described(provenance=["me"]), DESCRIPTION, "provenance is ['me']"),
    "a date": (appended("\nquality: {date: 2026-01-02}\n"), DESCRIPTION, "quality.date is datetime.date(2026, 1, 2)"),
    "support without end": (described(sigma_support=np.inf), DESCRIPTION, "sigma_support is inf"),
    "support that is no number": (described(sigma_support=np.nan), DESCRIPTION, "sigma_support is nan"),
    "support in words": (described(sigma_support="wide"), DESCRIPTION, "sigma_support is 'wide'"),
    "support that is true": (described(sigma_support=True), DESCRIPTION, "sigma_support is True"),
    "energy without end": (described(energy_per_edge=np.inf), DESCRIPTION, "energy_per_edge is inf"),
    "an invented orientation model": (described(orientation_model="dice"), DESCRIPTION, "orientation_model is 'dice'"),
    "that of joint space": (described(orientation_model="none"), DESCRIPTION, "orientation_model is 'none'"),
    "a metric in words": (metric(sigma_weight="x"), DESCRIPTION, "metric.sigma_weight is 'x'"),
    "a metric that is no number": (metric(sigma_weight=np.nan), DESCRIPTION, "metric.sigma_weight is nan"),
    "an invented metric": (metric(orientation_scale="x"), DESCRIPTION, "metric.orientation_scale is 'x'"),
    "a metric that is a list": (described(metric=[1.0]), DESCRIPTION, "metric is [1.0]"),
    "a regression that is no number": (described(regression_penalty=np.nan), DESCRIPTION, "regression_penalty is nan"),
    "a name in two lines": (described(name="a\nb"), DESCRIPTION, "name is 'a\\nb'"),
    "a space that is a list": (described(space=["task"]), DESCRIPTION, "space is ['task']"),
    "a robot that is a table": (described(robot={"a": 1}), DESCRIPTION, "robot is {'a': 1}"),
    "a version of a thousand words": (described(format_version="long " * 1000), DESCRIPTION, "format version 'long"),
    "checksums that are a list": (described(sha256=[1, 2]), DESCRIPTION, "sha256 must list"),
    "weights with an endless header": (replaced(WEIGHTS, containing(b"\xff" * 7 + b"\x00{}")), WEIGHTS, "header"),
    "weights beyond the file": (
        replaced(WEIGHTS, containing(len(TERABYTES).to_bytes(8, "little") + TERABYTES)), WEIGHTS, "declared sizes"
    ),
    "weights that are no numbers": (weights("decoder.W1", filled(np.nan)), WEIGHTS, "decoder weight W1 holds NaN"),
    "weights without measure": (weights("decoder.W", scaled(1e200)), WEIGHTS, "decoder weight W"),
    "weights of another shape": (weights("decoder.b1", lambda a: np.zeros((3, *a.shape))), WEIGHTS, "decoder weight"),
    "weights of many dimensions": (weights("decoder.W1", lambda a: np.zeros((len(a), 4))), WEIGHTS, "rbf_centres"),
    "a decoder out of reach": (weights("decoder.W3", scaled(1e3)), WEIGHTS, "a tool position [m] of"),
    "a deviation below zero": (weights("decoder.sigma_floor", scaled(-1.0)), WEIGHTS, "decoder weight sigma_floor"),
    "kernels without width": (weights("decoder.rbf_rate", scaled(0.0)), WEIGHTS, "decoder weight rbf_rate"),
    "no decoder": (weights("decoder.", None), WEIGHTS, "decoder weights lack W1"),
    "an encoder that is no number": (weights("encoder.W2", filled(np.nan)), WEIGHTS, "encoder weight W2 holds NaN"),
    "an encoder in part": (weights("encoder.b3", None), WEIGHTS, "encoder weights lack b3"),
    "codes that are no numbers": (latent(codes=filled(np.nan)), LATENT, "codes holds nan; its numbers must be finite"),
    "codes outside the box": (latent(codes=scaled(2.0)), LATENT, "codes lie outside the box"),
    "codes in a row": (latent(codes=np.ravel), LATENT, "codes have shape"),
    "codes in words": (latent(codes=lambda a: a.astype(str)), LATENT, "codes holds elements of type"),
    "no codes": (latent(codes=None), LATENT, "lacks codes"),
    "a box upside down": (latent(latent_lower=scaled(-1.0)), LATENT, "above latent_lower"),
    "a box without end": (latent(latent_upper=filled(1e6)), LATENT, "latent_upper holds 1e+06"),
    "a start of zeros": (latent(start_pose=scaled(0.0)), LATENT, "start_pose holds a quaternion of length 0"),
    "a goal 100 m away": (latent(goal_pose=lambda a: np.array([100.0, *a[1:]])), LATENT, "goal_pose is 100 m from"),
    "a goal that is no number": (latent(goal_pose=filled(np.nan)), LATENT, "goal_pose holds nan"),
    "turns of another length": (latent(canonical_quaternions=scaled(2.0)), LATENT, "canonical quaternions holds"),
    "positions out of reach": (latent(canonical_positions=scaled(1e4)), LATENT, "canonical positions holds"),
    "offsets out of reach": (latent(canonical_goal_offsets=scaled(1e9)), LATENT, "canonical goal_offsets holds"),
    "modes that are halves": (latent(canonical_modes=lambda a: a + 0.5), LATENT, "canonical modes must be whole"),
    "no modes": (latent(canonical_modes=None), LATENT, "lacks canonical_modes"),
}  # fmt: skip

#: The same of a skill of the whole arm.
JOINT_SKILLS: dict[str, tuple[Spoil, str, str]] = {
    "more digits than a float has": (described(energy_per_edge=10**400), DESCRIPTION, "energy_per_edge is 1000"),
    "a penalty of as many": (described(regression_penalty=10**400), DESCRIPTION, "regression_penalty is 1000"),
    "points closer than atoms": (
        described(metric={"sigma_weight": 1.0, "joint_weight": 0.05, "point_spacing": 1e-12}), DESCRIPTION,
        "metric.point_spacing is 1e-12",
    ),
    "an orientation model": (described(orientation_model="sign_blind"), DESCRIPTION, "it must be one of 'none'"),
    "a metric of poses": (
        metric(), DESCRIPTION,
        "it must hold joint_weight, orientation_weight, point_spacing, progress_length, sigma_weight",
    ),
    "a decoder of many turns": (weights("decoder.W3", scaled(1e3)), WEIGHTS, "a joint angle [rad] of"),
    "one configuration": (latent(canonical_configurations=np.sum), LATENT, "canonical sheet is of 0 joints"),
    "many turns": (latent(canonical_configurations=scaled(100.0)), LATENT, "canonical configurations holds"),
    "poles that are no numbers": (latent(canonical_start_poles=filled(np.nan)), LATENT, "canonical start_poles"),
    "groups that are fractions": (latent(canonical_goal_groups=lambda a: a + 0.5), LATENT, "canonical goal_groups"),
    "groups of fewer": (latent(canonical_start_groups=lambda a: a[:3]), LATENT, "canonical start_groups"),
}  # fmt: skip

SKILLS = {f"poses: {name}": ("panda_pouring", *case) for name, case in TASK_SKILLS.items()}
SKILLS |= {f"joints: {name}": ("panda_reach_to_grasp", *case) for name, case in JOINT_SKILLS.items()}


@pytest.fixture(scope="module")
def hostile_skills(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A folder of every kind."""
    place, folders = tmp_path_factory.mktemp("skills"), {}
    for number, (kind, (shipped, spoil, _, _)) in enumerate(SKILLS.items()):
        folders[kind] = skill_folder(place / str(number), shipped)
        spoil(folders[kind])
    return folders


@pytest.mark.parametrize("kind", SKILLS)
def test_a_hostile_skill_is_refused_in_one_line_with_file_and_field(hostile_skills, kind) -> None:
    _, _, file, words = SKILLS[kind]
    with pytest.raises(SkillError) as refused:
        Skill.load(hostile_skills[kind])
    said = str(refused.value)
    assert said.startswith(str(hostile_skills[kind]))
    assert file in said
    assert words in said
    assert len(said.splitlines()) == 1
    assert len(said) < 1000


@pytest.mark.parametrize("kind", [*SKILLS][::15])
def test_a_command_says_in_one_line_why_a_hostile_skill_is_refused(hostile_skills, kind, capsys) -> None:
    with pytest.raises(SkillError) as refused:
        Skill.load(hostile_skills[kind])
    said = str(refused.value)
    assert main(["inspect", str(hostile_skills[kind])]) == 2
    assert capsys.readouterr().err == f"geodesic-motion: {' '.join(said.split())}\n"


@pytest.mark.parametrize("name", ["panda_pouring", "panda_bottle2shelf", "panda_reach_to_grasp"])
def test_a_shipped_skill_is_read_and_read_again_after_saving(name, tmp_path) -> None:
    skill = Skill.load(skill_folder(tmp_path / "copy", name))
    assert Skill.load(skill.save(tmp_path / "saved")).name == name


def test_a_list_that_stands_twice_in_a_skill_is_read_again(tmp_path) -> None:
    skill, chosen = Skill.load(skill_folder(tmp_path / "copy")), [0, 3]
    skill.quality["held_out"], skill.provenance["held_out"] = chosen, chosen
    assert Skill.load(skill.save(tmp_path / "saved")).provenance["held_out"] == chosen


def test_a_folder_whose_name_is_too_long_is_refused() -> None:
    with pytest.raises(SkillError, match="cannot be opened"):
        Skill.load("a" * 5000)


@pytest.mark.parametrize("loader", [yaml.SafeLoader, getattr(yaml, "CSafeLoader", yaml.SafeLoader)])
def test_yaml_is_read_alike_with_libyaml_and_without(loader: type, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checked_files, "_SAFE_LOADER", loader)
    values = {"a": [1, 2.5, True, None, "x y"], "b": {"c": {}, 3: "4"}}
    assert read_yaml(yaml.safe_dump(values).encode()) == values
    deepest = b"[" * DEEPEST + b"]" * DEEPEST
    assert read_yaml(deepest) == [[[[[[[[[[[[[[[[[[[[]]]]]]]]]]]]]]]]]]]]
    refused = {
        b"a:\n  b: &x 1": "line 2: has an anchor", b"- *x": "line 1: has an anchor", b"- !!str 1": "line 1: has an",
        b"[" + deepest + b"]": "line 1: lists and tables are nested", b"a: b: c": "is no readable YAML",
        b"\xff": "is no readable YAML",
    }  # fmt: skip
    for content, words in refused.items():
        with pytest.raises(FileError, match=words):
            read_yaml(content)


# ---------------------------------------------------------------- recordings


HEADER = "demonstration,t,px,py,pz,qw,qx,qy,qz\n"
ROW = "d0,{},0.4,0.{:03d},0.3,0,1,0,0\n"
JOINTS = ",".join(("demonstration", "t", *Robot.named("panda").joint_names))


def text(content: str) -> Spoil:
    return containing(content.encode())


def rows(count: int = 20) -> str:
    return "".join(ROW.format(0.1 * number, number) for number in range(count))


def joint_arrays(**changes: np.ndarray) -> Spoil:
    robot = Robot.named("panda")
    arrays = {"configurations": np.tile(robot.ready, (2, 20, 1)), "joint_names": np.array(robot.joint_names)}
    return lambda file: np.savez(file, **arrays | changes)


#: By its name: the end of the file's name, what writes the file, and what must be named.
RECORDINGS: dict[str, tuple[str, Spoil, str]] = {
    **{
        f"{name} in the place of a {suffix}": (suffix, spoil, words)
        for suffix in (".npy", ".npz", ".csv")
        for name, (spoil, words) in (KINDS | {"broken link": (broken_link, "No such file")}).items()
    },
    **{f"an array: {name}": (".npy", containing(content), "") for name, content in LYING_ARRAYS.items()},
    **{
        f"positions: {name}": (".npz", archived("positions", content), "'positions'")
        for name, content in LYING_ARRAYS.items()
    },
    **{f"{name} of arrays": (".npz", spoil, words) for name, (spoil, words) in LYING_ARCHIVES.items()},
    "complex numbers": (".npy", containing(declaring("(1, 20, 7)", "'<c16'", bytes(20 * 7 * 16))), "complex128"),
    "numbers beyond doubles": (".npy", lambda file: np.save(file, np.full((1, 20, 7), np.finfo("f16").max)), "px: inf"),
    "demonstrations without end": (".npy", lambda file: np.save(file, np.zeros((20_000, 2, 7), "f4")), "at most 10000"),
    "a line without end": (".csv", text(HEADER + "d0," + "1" * 1_000_000), "line 2: longer than 10000 characters"),
    "a header without end": (".csv", text("," * 1_000_000), "line 1: longer than"),
    "semicolons": (".csv", text(HEADER.replace(",", ";") + rows().replace(",", ";")), "semicolons"),
    "tabs": (".csv", text(HEADER.replace(",", "\t") + rows().replace(",", "\t")), "tabs"),
    "a quotation without end": (".csv", text(HEADER + '"' + "d0\n" * 100_000), "not a csv text file"),
    "demonstrations of one line each": (
        ".csv", text(HEADER + "".join(rows(1).replace("d0", f"d{number}") for number in range(20_000))), "than 10000"
    ),
    "a demonstration of two lines": (".csv", text(HEADER + rows(1).replace("d0", '"d\n0"')), "called 'd\\n0'"),
    "a long cell": (".csv", text(HEADER + rows(1).replace("0.3", "x" * 5000)), "line 2, column pz: 'xxx"),
    "nanoseconds": (".csv", text(HEADER + ROW.format(17e17, 0) + ROW.format(18e17, 1)), "times must be in seconds"),
    "joints: a bomb": (".npz", bomb, "inflates from"),
    "joints: endless names": (".npz", joint_arrays(names=np.array(["x"] * 20_000)), "at most 10000"),
    "joints: endless joints": (".npz", joint_arrays(joint_names=np.array(["x"] * 101)), "at most 100"),
    "joints: a robot of many lines": (".npz", joint_arrays(robot=np.array("pan\nda" * 1000)), "the robot 'pan\\nda"),
    "joints: names of two lines": (".npz", joint_arrays(names=np.array(["a", "b\nc"])), "called 'b\\nc'"),
    "joints: semicolons": (".csv", text(f"{JOINTS.replace(',', ';')}\nd0;0,1;0;0;0;0;0;0;0\n"), "semicolons"),
}  # fmt: skip


@pytest.fixture(scope="module")
def hostile_recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A file of every kind."""
    place = tmp_path_factory.mktemp("recordings")
    files = {}
    for number, (kind, (suffix, spoil, _)) in enumerate(RECORDINGS.items()):
        files[kind] = place / f"{number}{suffix}"
        spoil(files[kind])
    return files


def refusal(file: Path, of_joints: bool) -> str:
    """Why a recording is refused, which it must be."""
    with pytest.raises(DemonstrationError) as refused:
        read_joint_demonstrations(file, "panda") if of_joints else read_demonstrations(file, "m")
    return str(refused.value)


@pytest.mark.parametrize("kind", RECORDINGS)
def test_a_hostile_recording_is_refused_in_one_line_with_the_place(hostile_recordings, kind) -> None:
    said = refusal(hostile_recordings[kind], kind.startswith("joints: "))
    assert said.startswith(str(hostile_recordings[kind]))
    assert RECORDINGS[kind][2] in said
    assert len(said.splitlines()) == 1
    assert len(said) < 1000
    assert "allow_pickle" not in said


@pytest.mark.parametrize("kind", [*[*RECORDINGS][::10], "joints: a bomb"])
def test_a_command_says_in_one_line_why_a_hostile_recording_is_refused(
    hostile_recordings, kind, tmp_path, capsys
) -> None:
    file, of_joints = hostile_recordings[kind], kind.startswith("joints: ")
    options = ["--space", "joint"] if of_joints else ["--space", "task", "--units", "m"]
    assert main(["train", "--demos", str(file), "--out", str(tmp_path / "skill"), *options]) == 2
    said = " ".join(refusal(file, of_joints).split())
    assert capsys.readouterr().err == f"geodesic-motion: {said}\n"


@pytest.mark.parametrize("kind", RECORDINGS)
def test_the_kind_of_a_hostile_recording_is_found_without_reading_it(hostile_recordings, kind) -> None:
    assert is_of_joints(hostile_recordings[kind]) == (kind.startswith("joints: ") and "bomb" not in kind)


def test_a_joint_recording_with_semicolons_is_taken_for_one(tmp_path, capsys) -> None:
    RECORDINGS["joints: semicolons"][1](tmp_path / "reach.csv")
    assert main(["train", "--demos", str(tmp_path / "reach.csv"), "--out", str(tmp_path / "skill")]) == 2
    assert "semicolons" in capsys.readouterr().err


def test_real_recordings_are_read(recordings) -> None:
    for name in ("pouring", "bottle2shelf"):
        assert len(read_demonstrations(recordings / "robotasks" / f"{name}.npy", "cm")) == 9
    for name, count in (("plum", 10), ("assembly", 9)):
        assert len(read_joint_demonstrations(recordings / "joints" / f"panda_{name}.csv", "panda")) == count


# ---------------------------------------------------------------- memory

#: Reads the files of a list, [kind, path] each, in an address space that may not grow by more than MARGIN over that of
#: a process that has read an honest skill and an honest recording. Prints what came out, by the kind.
CHILD = """
import json, resource, signal, sys
from geodesic_motion_ros.demonstrations.readers import read_demonstrations, read_joint_demonstrations
from geodesic_motion_ros.utils.errors import GeodesicMotionError
from geodesic_motion_ros.skill.skill import Skill

def read(kind, path):
    if kind == "skill":
        Skill.load(path)
    elif kind == "joints":
        read_joint_demonstrations(path, "panda")
    else:
        read_demonstrations(path, "m")

honest, files = json.load(sys.stdin)
for kind, path in honest:
    read(kind, path)
pages = int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MARGIN, resource.RLIM_INFINITY))
signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(TimeoutError("it hangs")))
for kind, path in files:
    signal.alarm(60)
    try:
        read(kind, path)
        print("read")
    except GeodesicMotionError:
        print("refused")
    except BaseException as error:
        print(path, type(error).__name__)
    signal.alarm(0)
"""
#: The largest hostile file is 1 MB of text.
MARGIN = 64 << 20


def test_hostile_files_are_refused_within_their_memory(hostile_skills, hostile_recordings, tmp_path) -> None:
    text(HEADER + rows())(tmp_path / "honest.csv")
    honest = [("skill", skill_folder(tmp_path / name, name)) for name in ("panda_pouring", "panda_reach_to_grasp")]
    files = [("skill", path) for path in hostile_skills.values()]
    for kind, path in hostile_recordings.items():
        files.append(("joints" if kind.startswith("joints: ") else "poses", path))
    honest.append(("poses", tmp_path / "honest.csv"))
    given = [[(kind, str(path)) for kind, path in group] for group in (honest, files)]
    done = subprocess.run(
        [sys.executable, "-c", CHILD.replace("MARGIN", str(MARGIN))],
        input=json.dumps(given), capture_output=True, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["refused"] * len(files)
    assert not (tmp_path / "touch pwned").exists()
