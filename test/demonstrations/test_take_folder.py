"""A folder of takes: what is kept and what is refused, in which words, and that `train` reads the same."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.message_samples import JointSamples
from geodesic_motion_ros.demonstrations.readers import read_joint_takes
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.take_folder import TakeFolder
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import DemonstrationError

ROBOT = Robot.named("panda")
NAMES = ROBOT.joint_names


def motion(shift: float = 0.0, rest: int = 60, samples: int = 300) -> np.ndarray:
    """Configurations (T, 7) [rad] at 100 Hz: a standstill, a turn of 0.8 rad that ends `shift` further, a standstill.
    """
    share = np.concatenate([np.zeros(rest), 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, samples)), np.ones(rest)])
    path = np.tile(ROBOT.ready, (len(share), 1))
    path[:, 0] += (0.8 + shift) * share - 0.4
    path[:, 3] += 0.2 * np.sin(np.pi * share)
    return path


def received(
    path: np.ndarray, names: Sequence[str] = NAMES, stamps: np.ndarray | None = None, heard: Sequence[str] = NAMES
) -> JointSamples:
    """What a node heard of a path (T, eta) at 100 Hz, beside messages of the gripper."""
    samples = JointSamples(heard)
    nanoseconds = 10_000_000 * np.arange(1, len(path) + 1)
    for now, stamp, row in zip(nanoseconds, nanoseconds if stamps is None else stamps, path, strict=True):
        time = SimpleNamespace(stamp=SimpleNamespace(sec=int(stamp) // 10**9, nanosec=int(stamp) % 10**9))
        samples.add(int(now), SimpleNamespace(header=time, name=[*names], position=row.tolist()))
        samples.add(int(now), SimpleNamespace(header=time, name=["finger"], position=[0.04]))
    return samples


@pytest.fixture
def folder(tmp_path: Path) -> TakeFolder:
    """With three takes that end a few centimetres from one another."""
    folder = TakeFolder(tmp_path / "takes", "panda")
    for shift in (0.0, 0.02, 0.04):
        folder.keep(received(motion(shift)))
    return folder


def test_a_take_is_cut_to_its_motion_and_stated_in_one_line(tmp_path: Path) -> None:
    folder = TakeFolder(tmp_path, "panda")
    path = motion(rest=200)
    assert folder.next_name == "take_001"
    line = folder.keep(received(path))
    positions = np.array([ROBOT.forward(row)[0] for row in path])
    length = np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()
    assert re.match(rf"kept take_001: [23]\.\d s, {length:.2f} m", line)
    assert "nearest other" not in line
    (take,) = read_joint_takes(tmp_path, "panda")
    assert np.ptp(take.times) == pytest.approx(3.0, abs=0.4)
    np.testing.assert_allclose(take.values[[0, -1]], path[[0, -1]], atol=0.004)


def test_prefixed_joints_are_kept_under_the_names_of_the_robot(tmp_path: Path) -> None:
    folder = TakeFolder(tmp_path, "panda", "left_")
    prefixed = tuple(f"left_{name}" for name in NAMES)
    assert folder.joint_names == prefixed
    both = [*prefixed, *(f"right_{name}" for name in NAMES)]
    path = motion()
    folder.keep(received(np.hstack([path, path + 0.1]), both, heard=prefixed))
    (take,) = read_joint_takes(tmp_path, "panda")
    np.testing.assert_allclose(take.values[0], path[0], atol=0.004)


def test_distances_from_the_others_are_stated(folder: TakeFolder) -> None:
    ends = [ROBOT.forward(motion(shift)[-1])[0] for shift in (0.04, 0.06)]
    line = folder.keep(received(motion(0.06)))
    assert f"ends {1e3 * np.linalg.norm(ends[1] - ends[0]):.0f} mm from the nearest other" in line


def test_names_count_in_any_order_and_samples_are_kept_as_they_were_recorded(tmp_path: Path) -> None:
    path = motion()
    path[150, 1] += 0.5
    line = TakeFolder(tmp_path, "panda").keep(received(path[:, ::-1], NAMES[::-1]))
    assert "has a spike of 1 sample" in line
    (take,) = read_joint_takes(tmp_path, "panda")
    rows = {tuple(row) for row in path.tolist()}
    assert {tuple(row) for row in take.values.tolist()} <= rows
    assert Recording.of_files([take], "panda").flaws[0].what.startswith("has a spike of 1 sample")


def jumping() -> np.ndarray:
    path = motion()
    path[200:, 1] += 0.5
    return path


@pytest.mark.parametrize(
    ("samples", "reason"),
    [
        (JointSamples(NAMES), "no message has panda_joint1"),
        (received(motion(), [*NAMES[:6], "other"]), "no message has panda_joint7; the joints there are 'panda_joint1"),
        (received(np.tile(ROBOT.ready, (200, 1))), "does not move"),
        (received(jumping()), r"jumps, .* rad/s in panda_joint2: samples are lost, at .*too far for a straight line"),
        (received(motion(1.5)), "is of another task: ends"),
        (received(motion()[:180]), "is interrupted"),
        (received(motion(3.5)), "outside|limit"),
        (received(np.degrees(motion())), "limit.*degrees|faster than an arm"),
        (received(motion()[:62]), "does not move"),
    ],
    ids=["nothing", "no joint 7", "rest", "jump", "another goal", "interrupted", "limits", "degrees", "ended at once"],
)
def test_what_is_refused_is_named_and_not_written(folder: TakeFolder, samples: JointSamples, reason: str) -> None:
    before = sorted(folder.folder.iterdir())
    with pytest.raises(DemonstrationError, match=reason):
        folder.keep(samples)
    assert sorted(folder.folder.iterdir()) == before
    assert len(folder) == 3
    # the control: the next good one takes the same number
    assert folder.keep(received(motion(0.01))).startswith("kept take_004")


def test_stamps_that_stand_leave_the_times_of_the_recorder_and_clocks_that_both_stand_refuse(tmp_path: Path) -> None:
    folder, path = TakeFolder(tmp_path, "panda"), motion()
    assert "has headers without stamps" in folder.keep(received(path, stamps=np.zeros(len(path), dtype=int)))
    standing = JointSamples(NAMES)
    for row in path:
        header = SimpleNamespace(stamp=SimpleNamespace(sec=7, nanosec=0))
        standing.add(7 * 10**9, SimpleNamespace(header=header, name=NAMES, position=row.tolist()))
    with pytest.raises(DemonstrationError, match="samples with a time that repeats or falls"):
        folder.keep(standing)


def test_a_take_during_which_the_simulation_was_reset_is_refused(tmp_path: Path) -> None:
    path = motion()
    stamps = 10_000_000 * np.arange(1, len(path) + 1) + 60 * 10**9
    stamps[200:] -= 60 * 10**9
    with pytest.raises(DemonstrationError, match=r"has stamps that begin again, at 2\.01 s.*was the simulation reset"):
        TakeFolder(tmp_path, "panda").keep(received(path, stamps=stamps))


def test_the_last_one_of_this_session_can_be_deleted_and_none_of_before(folder: TakeFolder) -> None:
    again = TakeFolder(folder.folder, "panda")
    assert (len(again), again.next_name) == (3, "take_004")
    with pytest.raises(DemonstrationError, match="no take of this session to delete; 3 of before"):
        again.delete_last()
    again.keep(received(motion(0.01)))
    assert again.delete_last().endswith("take_004.csv; 3 takes stand there")
    assert [file.stem for file in sorted(folder.folder.iterdir())] == ["take_001", "take_002", "take_003"]
    assert again.next_name == "take_004"


def test_a_take_that_shows_an_earlier_one_to_be_strange_is_kept_and_says_so(tmp_path: Path) -> None:
    folder = TakeFolder(tmp_path, "panda")
    for shift in (1.4, 0.0):
        folder.keep(received(motion(shift)))
    assert "beside it 'take_001' is of another task: ends" in folder.keep(received(motion(0.02)))


def test_two_sessions_at_once_do_not_write_over_one_another(folder: TakeFolder) -> None:
    other = TakeFolder(folder.folder, "panda")
    assert other.keep(received(motion(0.01))).startswith("kept take_004")
    assert folder.keep(received(motion(0.03))).startswith("kept take_005")
    assert len(read_joint_takes(folder.folder, "panda")) == 5


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DemonstrationError, match="file/takes: cannot be written"):
        TakeFolder(tmp_path / "file" / "takes", "panda").keep(received(motion()))


def test_a_file_of_the_folder_that_cannot_be_read_is_named(folder: TakeFolder) -> None:
    (folder.folder / "take_002.csv").write_text("demonstration,t\n")
    with pytest.raises(DemonstrationError, match=r"take_002\.csv: "):
        TakeFolder(folder.folder, "panda")
