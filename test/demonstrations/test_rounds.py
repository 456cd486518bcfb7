"""Motions that end where they began are found, cut into rounds and closed, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.readers import read_joint_takes, read_pose_takes
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.rounds import LARGEST_GAP, close_rounds, find_returns, find_rounds
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


def test_a_recording_of_rounds_is_read_as_one_and_refused_where_it_is_not_to_be() -> None:
    laps = [circle(1.0, str(number)) for number in range(3)]
    recording = Recording.of_files(laps)
    assert recording.rounds is not None
    assert [len(item) for item in recording.demonstrations(strict=True)] == [len(lap) for lap in laps]
    with pytest.raises(DemonstrationError, match=r"returns to its start \(3 of 3 do\), .* 0\.000 m from .* 0\.63 m"):
        Recording.of_files(laps, closed=False).demonstrations()
    arcs = [circle(0.5, str(number)) for number in range(3)]
    assert Recording.of_files([circle(1.0), *arcs]).rounds is None
    with pytest.raises(DemonstrationError, match=r"no demonstration is a round: ends 0\.200 m from its start"):
        Recording.of_files(arcs, closed=True)


def test_rounds_one_after_the_other_are_cut_at_one_place_of_all_recordings() -> None:
    """One motion begins a quarter of a round later than the other, another drifts; what is no round is left out."""
    quarter = circle(5.0, "late").values.copy()
    quarter[:, :3] = quarter[:, :3] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + [0.5, -0.5, 0.0]
    late = Take("late", 4.0 * SHARE, quarter, POSE)
    found = find_rounds([circle(5.0, "first"), late, circle(4.0, "drifts", drift=0.1), circle(0.4, "arc")])
    assert found is not None
    assert {flaw.demonstration: flaw.action for flaw in found.flaws} == {
        "first": Action.READ, "late": Action.READ, "drifts": Action.READ, "arc": Action.LEFT_OUT,
    }  # fmt: skip
    names = "first", "late", "drifts"
    by_take = {name: [item for item in found.motions if item.name.startswith(name)] for name in names}
    assert all(len(rounds) >= 3 for rounds in by_take.values())
    for rounds in by_take.values():
        for one in rounds:
            places = one.values[:, :3] - one.values[:, :3].mean(axis=0)
            extent = np.linalg.norm(places - places[0], axis=1).max()
            assert np.linalg.norm(places[-1] - places[0]) < LARGEST_GAP * extent
    begins = [rounds[1].values[0, :3] - rounds[1].values[:, :3].mean(axis=0) for rounds in by_take.values()]
    # within the samples of the grid and of the motion: a circle of 0.1 m in 40 samples
    for begin in begins[1:]:
        assert np.linalg.norm(begin - begins[0]) < 2.5 * 0.1 * 2.0 * np.pi / 40.0


def test_rounds_are_closed_by_what_lies_between_their_ends() -> None:
    values = circle(1.0).values.copy()
    values[:, :3] += 0.03 * SHARE[:, None]
    half = 0.05 * SHARE
    values[:, 3:] = np.stack([np.sin(half), np.cos(half), 0.0 * half, 0.0 * half], axis=1)
    given = Recording.of_files([Take("gap", 4.0 * SHARE, values, POSE)], closed=True).demonstrations()
    (closed,) = close_rounds(given, 0.1)
    np.testing.assert_allclose(closed.positions[0], closed.positions[-1], atol=1e-12)
    np.testing.assert_allclose(closed.quaternions[0], closed.quaternions[-1], atol=1e-12)
    # no sample moves by more than half of the gap
    moved = np.linalg.norm(closed.positions - given[0].positions, axis=1)
    assert moved.max() <= 0.5 * np.sqrt(3.0) * 0.03 + 1e-12
    again = close_rounds(close_rounds(given, 0.1), 0.1)[0]
    np.testing.assert_allclose(again.positions, closed.positions, atol=1e-12)


def test_what_is_no_round_and_a_whole_turn_of_the_tool_are_refused_by_name() -> None:
    arc = Recording.of_files([circle(0.5, "arc")]).demonstrations()
    with pytest.raises(DemonstrationError, match="'arc' is no round: it ends 100% of its extent"):
        close_rounds(arc, 0.1)
    half = np.pi * SHARE
    values = circle(1.0).values.copy()
    values[:, 3:] = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=1)
    screw = Recording.of_files([Take("screw", 4.0 * SHARE, values, POSE)], closed=True).demonstrations()
    with pytest.raises(DemonstrationError, match="'screw' turns the tool by a whole turn"):
        close_rounds(screw, 0.1)


def test_real_recordings_lead_elsewhere_but_for_shaking(recordings) -> None:
    poses = [recordings / "robotasks" / f"{task}.npy" for task in ("pouring", "bottle2shelf")]
    arms = [("panda_plum", "panda"), ("panda_assembly", "panda"), ("ur5_reach", "ur5")]
    for takes in (
        *(read_pose_takes(path, "cm") for path in poses),
        *(read_pose_takes(recordings / "hello_world" / f"{letter}.npy", "cm", "px,py") for letter in "he"),
        *(read_joint_takes(recordings / "joints" / f"{name}.csv", robot) for name, robot in arms),
    ):
        assert find_returns(takes) == []
        assert find_rounds(takes) is None
    shaken = read_joint_takes(recordings / "joints" / "iiwa14_shake.csv", "iiwa14")
    assert find_returns(shaken) != []
    found = find_rounds(shaken)
    assert found is not None
    assert len({motion.name.split("_")[0] for motion in found.motions}) == 3
