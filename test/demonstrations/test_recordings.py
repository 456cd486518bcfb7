"""Whole recordings: what comes out of a bag is what was demonstrated, and what is wrong in it is stated or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.readers import read_joint_demonstrations, read_joint_takes
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.splitting import STILL, Split
from geodesic_motion_ros.demonstrations.takes import Action
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import DemonstrationError

HZ, REST = 100.0, 4.0
KINDS = ("sqlite3", "storage.mcap", "old.bag")


def in_one_go(curves) -> np.ndarray:
    """Configurations (T, eta): each curve with a standstill before and after, and motions back between them."""
    pieces = []
    for curve in curves:
        if pieces:
            share = 0.5 - 0.5 * np.cos(np.pi * np.arange(400) / 400.0)[:, None]
            pieces.append(pieces[-1][-1] + share * (curve[0] - pieces[-1][-1]))
        pieces += [np.tile(curve[0], (int(REST * HZ), 1)), curve, np.tile(curve[-1], (int(REST * HZ), 1))]
    return np.vstack(pieces)


def joint_states(values: np.ndarray, stamps: np.ndarray | None = None) -> list:
    names = Robot.named("panda").joint_names
    times = 1_700_000_000.0 + np.arange(len(values)) / HZ
    stamps = times if stamps is None else stamps
    random = np.random.default_rng(0)
    messages = []
    for time, stamp, row in zip(times, stamps, values, strict=True):
        order = random.permutation(len(names))
        messages.append((time, stamp, {names[place]: row[place] for place in order}))
    return messages


def read(path: Path, **how) -> Recording:
    return Recording.of_bags([path], None, Split(**how), "panda")


@pytest.fixture(scope="module")
def curves() -> list[np.ndarray]:
    """Five motions of three seconds of a Panda, from starts that vary to one goal."""
    random = np.random.default_rng(1)
    ready = Robot.named("panda").ready
    share = (0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 300)))[:, None]
    goal = ready + np.array([0.9, 0.3, 0.0, 0.2, 0.0, 0.1, 0.4])
    starts = ready + random.normal(0.0, 0.04, (5, 7))
    return [start + share * (goal - start) + 2e-5 * random.standard_normal((300, 7)) for start in starts]


@pytest.mark.parametrize("kind", KINDS)
def test_demonstrations_come_out_of_a_bag_as_they_were_made(kind, curves, bag, tmp_path) -> None:
    path = bag.write(tmp_path / kind, {"/joint_states": joint_states(in_one_go(curves))})
    recording = read(path)
    demonstrations = recording.demonstrations(strict=True)
    assert len(demonstrations) == len(curves)
    assert len(recording.flaws) == 4  # the motions back, which --strict does not refuse
    for item, curve in zip(demonstrations, curves, strict=True):
        # cut where the standstill ends, at a distance of STILL at most; nothing else is changed
        assert np.abs(item.configurations[[0, -1]] - curve[[0, -1]]).max() < 1.5 * STILL["joint"]
        first = int(np.argmin(np.abs(curve - item.configurations[5]).max(axis=1)))
        np.testing.assert_array_equal(item.configurations[5:200], curve[first : first + 195])


def test_real_demonstrations_come_out_of_a_bag_as_they_stand_in_the_file(recordings, bag, tmp_path) -> None:
    shown = read_joint_demonstrations(recordings / "joints" / "panda_plum.csv", "panda")
    resampled = [
        item.resample(1 + round((item.times[-1] - item.times[0]) * HZ), by="time").configurations for item in shown
    ]
    values = in_one_go(resampled)
    path = bag.write(tmp_path / "plum.mcap", {"/joint_states": joint_states(values)})
    demonstrations = read(path).demonstrations(strict=True)
    assert len(demonstrations) == len(shown)
    for item, original in zip(demonstrations, shown, strict=True):
        assert np.abs(item.configurations[[0, -1]] - original.configurations[[0, -1]]).max() < 1.5 * STILL["joint"]
        first = round(item.times[0] * HZ)
        np.testing.assert_array_equal(item.configurations, values[first : first + len(item)])


def test_degrees_are_recognised(curves, bag, tmp_path) -> None:
    path = bag.write(tmp_path / "degrees", {"/joint_states": joint_states(np.degrees(in_one_go(curves)))})
    with pytest.raises(DemonstrationError, match="are these degrees"):
        read(path)


def test_an_interrupted_demonstration_is_left_out_of_a_bag(curves, bag, tmp_path) -> None:
    halved = [*curves[:2], curves[2][:150], *curves[3:]]
    recording = read(bag.write(tmp_path / "half", {"/joint_states": joint_states(in_one_go(halved))}))
    assert recording.left_out_names == {"half_2"}
    assert [item.name for item in recording.demonstrations()] == ["half_0", "half_1", "half_3", "half_4"]
    with pytest.raises(DemonstrationError, match=r"'half_2' is interrupted: .* left out; --strict refuses it"):
        recording.demonstrations(strict=True)


def test_a_bag_of_which_little_remains_is_refused(curves, bag, tmp_path) -> None:
    values = in_one_go(curves)[:: int(HZ)]
    times = 1_700_000_000.0 + np.arange(len(values))
    states = joint_states(values, stamps=times)
    path = bag.write(tmp_path / "slow", {"/joint_states": states})
    with pytest.raises(DemonstrationError, match=r"0 of 5 demonstrations remain: .*samples, 1 a second.*at least 10"):
        read(path).demonstrations()


def test_several_bags_are_one_recording_and_need_names_of_their_own(curves, bag, tmp_path) -> None:
    (tmp_path / "b").mkdir()
    paths = [
        bag.write(tmp_path / folder / name, {"/joint_states": joint_states(in_one_go([curve]))})
        for (folder, name), curve in zip((("a", "one"), ("a", "two.mcap"), ("b", "one.bag")), curves[:3], strict=True)
    ]
    recording = Recording.of_bags(paths[:2], "/joint_states", Split(), "panda")
    assert [item.name for item in recording.demonstrations()] == ["one_0", "two_0"]
    with pytest.raises(DemonstrationError, match="two bags have the same name"):
        Recording.of_bags(paths, "/joint_states", Split(), "panda")


def test_the_good_demonstrations_of_a_file_are_not_changed(recordings) -> None:
    path = recordings / "joints" / "panda_assembly.csv"
    recording = Recording.of_files(read_joint_takes(path, "panda"), "panda")
    assert all(flaw.action is Action.KEPT for flaw in recording.flaws)
    for item, original in zip(recording.demonstrations(), read_joint_demonstrations(path, "panda"), strict=True):
        np.testing.assert_array_equal(item.configurations, original.configurations)
        np.testing.assert_array_equal(item.times, original.times)
