"""Motions that end where they began are refused before they are learned, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.readers import read_joint_takes, read_pose_takes
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.returns import find_returns
from geodesic_motion_ros.demonstrations.takes import POSE, Action, Take
from geodesic_motion_ros.utils.errors import DemonstrationError

SHARE = np.linspace(0.0, 1.0, 200)


def circle(turns: float, name: str = "take", drift: float = 0.0) -> Take:
    angle = 2.0 * np.pi * turns * SHARE
    zeros = np.zeros_like(angle)
    places = [0.5 + 0.1 * np.cos(angle) + drift * SHARE, 0.1 * np.sin(angle), zeros, zeros, zeros + 1.0, zeros, zeros]
    return Take(name, 4.0 * SHARE, np.stack(places, axis=1), POSE)


def actions(*motions: Take) -> list[Action]:
    return [flaw.action for flaw in find_returns(motions)]


@pytest.mark.parametrize(("turns", "found"), [(0.5, []), (0.75, []), (1.0, [Action.REFUSED]), (3.0, [Action.REFUSED])])
def test_laps_are_refused_and_arcs_are_not(turns, found) -> None:
    assert actions(circle(turns)) == found
    motion = circle(turns)
    joints = Take("joints", motion.times, motion.values[:, :2], ("a", "b"))
    assert actions(joints) == found
    assert actions(Take("positions", motion.times, motion.values[:, :3], POSE[:3])) == found


def test_rounds_that_lead_elsewhere_are_kept_with_a_word() -> None:
    assert actions(circle(3.5)) == [Action.KEPT]
    assert actions(circle(3.0, drift=0.9)) == []


def test_a_full_turn_of_the_tool_on_the_spot_returns() -> None:
    """Its quaternion ends as the opposite one. Half a turn does not return."""
    for turn, found in ((2.0 * np.pi, [Action.REFUSED]), (np.pi, [])):
        half, zeros = 0.5 * turn * SHARE, np.zeros(200)
        values = np.stack([zeros + 0.5, zeros, zeros, np.cos(half), zeros, zeros, np.sin(half)], axis=1)
        assert actions(Take("turn", SHARE, values, POSE)) == found


def test_the_recording_is_refused_where_half_of_the_motions_return() -> None:
    laps = [circle(1.0, str(number)) for number in range(3)]
    with pytest.raises(DemonstrationError, match=r"returns to its start \(3 of 3 do\), .* 0\.000 m from .* 0\.63 m"):
        Recording.of_files(laps).demonstrations()
    assert actions(circle(1.0), *(circle(0.5, str(number)) for number in range(3))) == []


def test_real_recordings_lead_elsewhere_but_for_shaking(recordings) -> None:
    poses = [recordings / "robotasks" / f"{task}.npy" for task in ("pouring", "bottle2shelf")]
    arms = [("panda_plum", "panda"), ("panda_assembly", "panda"), ("ur5_reach", "ur5")]
    for takes in (
        *(read_pose_takes(path, "cm") for path in poses),
        *(read_pose_takes(recordings / "hello_world" / f"{letter}.npy", "cm", "px,py") for letter in "he"),
        *(read_joint_takes(recordings / "joints" / f"{name}.csv", robot) for name, robot in arms),
    ):
        assert find_returns(takes) == []
    shaken = read_joint_takes(recordings / "joints" / "iiwa14_shake.csv", "iiwa14")
    assert find_returns(shaken) != []
