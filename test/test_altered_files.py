"""Files altered at random, with right checksums: each is read as it is sound, or refused; nothing else happens."""

from __future__ import annotations

import hashlib
import io
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from geodesic_motion_ros.demonstrations.readers import is_of_joints, read_demonstrations, read_joint_demonstrations
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.checked_files import read_arrays, read_tensors, read_yaml
from geodesic_motion_ros.utils.errors import DemonstrationError, FileError, SkillError

MODELS = Path(__file__).resolve().parents[1] / "models"
DESCRIPTION, WEIGHTS, LATENT = "skill.yaml", "weights.safetensors", "latent.npz"
SHARE = np.linspace(0.0, 1.0, 20)[:, None]
POSES = np.hstack([0.4 + 0.0 * SHARE, 0.2 * SHARE, 0.3 + 0.0 * SHARE, np.tile([0.0, 1.0, 0.0, 0.0], (20, 1))])



def altered(content: bytes, random: np.random.Generator) -> bytes:
    """Some bytes replaced, a piece left out, doubled, or cut off."""
    spoiled = bytearray(content)
    first, second = np.sort(random.integers(0, len(spoiled), 2))
    kind = random.integers(5)
    if kind == 0:
        return bytes(spoiled[:first])
    if kind == 1:
        return bytes(spoiled[:first] + spoiled[first + random.integers(1, 50) :])
    if kind == 2:
        return bytes(spoiled[:second] + spoiled[first : first + 50] + spoiled[second:])
    # near the beginning and the end stands what a file declares
    ends = [*range(min(400, len(spoiled))), *range(max(0, len(spoiled) - 600), len(spoiled))]
    places = random.choice(ends, random.integers(1, 9)) if kind == 3 else random.integers(0, len(spoiled), 8)
    for place in places:
        spoiled[place] = random.integers(256)
    return bytes(spoiled)


READERS = {
    DESCRIPTION: read_yaml, WEIGHTS: read_tensors, LATENT: lambda content: read_arrays(io.BytesIO(content)),
}  # fmt: skip


@pytest.mark.parametrize("name", READERS)
def test_an_altered_file_is_read_or_refused(name) -> None:
    random = np.random.default_rng(1)
    content = (MODELS / "panda_reach_to_grasp" / name).read_bytes()
    reasons = []
    for _ in range(500):
        try:
            READERS[name](altered(content, random))
        except FileError as error:
            reasons.append(str(error))
    assert 100 < len(reasons) < 500
    assert not [reason for reason in reasons if len(reason.splitlines()) != 1]


@pytest.mark.parametrize("name", [DESCRIPTION, WEIGHTS, LATENT])
@pytest.mark.parametrize("shipped", ["panda_pouring", "panda_reach_to_grasp"])
def test_a_skill_with_an_altered_file_is_sound_or_refused(name, shipped, tmp_path) -> None:
    random = np.random.default_rng(2)
    for file in (DESCRIPTION, WEIGHTS, LATENT):
        shutil.copy(MODELS / shipped / file, tmp_path)
    content = (tmp_path / name).read_bytes()
    description = yaml.safe_load((tmp_path / DESCRIPTION).read_text())
    reasons = []
    for _ in range(50):
        (tmp_path / name).write_bytes(altered(content, random))
        if name != DESCRIPTION:
            description["sha256"][name] = hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()
            (tmp_path / DESCRIPTION).write_text(yaml.safe_dump(description))
        try:
            skill = Skill.load(tmp_path)
        except SkillError as error:
            reasons.append(str(error))
        else:
            assert np.all(np.isfinite(skill.codes))
    assert reasons
    assert not [reason for reason in reasons if len(reason.splitlines()) != 1]


def write_joints(file: Path) -> None:
    robot = Robot.named("panda")
    arrays = {"configurations": np.tile(robot.ready, (2, 20, 1)), "joint_names": np.array(robot.joint_names)}
    np.savez(file, **arrays, names=np.array(["left", "right"]), robot=np.array("panda"))


def write_rows(file: Path) -> None:
    rows = [",".join(map(str, ("d0", 0.1 * number, *pose))) for number, pose in enumerate(POSES)]
    file.write_text("\n".join(["demonstration,t,px,py,pz,qw,qx,qy,qz", *rows]))


#: Write an honest recording, by the end of its name.
RECORDINGS = {
    ".npy": lambda file: np.save(file, POSES[None]),
    ".npz": lambda file: np.savez(file, positions=POSES[None, :, :3], quaternions=POSES[None, :, 3:]),
    "_compressed.npz": lambda file: np.savez_compressed(file, poses=POSES[None]),
    ".csv": write_rows,
    "_joints.npz": write_joints,
}


@pytest.mark.parametrize("suffix", RECORDINGS)
def test_an_altered_recording_is_read_or_refused(suffix, tmp_path) -> None:
    random = np.random.default_rng(3)
    file = tmp_path / f"recording{suffix}"
    RECORDINGS[suffix](file)
    content = file.read_bytes()
    reasons = []
    for _ in range(300):
        file.write_bytes(altered(content, random))
        is_of_joints(file)
        try:
            read = read_joint_demonstrations(file, "panda") if "joints" in suffix else read_demonstrations(file, "m")
        except DemonstrationError as error:
            reasons.append(str(error))
        else:
            assert all(np.all(np.isfinite(item.times)) for item in read)
    assert reasons
    assert not [reason for reason in reasons if len(reason.splitlines()) != 1]
