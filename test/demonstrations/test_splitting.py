"""One take into demonstrations: between standstills, marks, times; motions that lead back are none."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.splitting import Split, find_moving_spans, split_take
from geodesic_motion_ros.demonstrations.takes import Action, Take
from geodesic_motion_ros.utils.errors import DemonstrationError

HZ = 100.0


def moved(places, rest: float = 4.0, motion: float = 3.0, noise: float = 2e-4, names=("a", "b")) -> Take:
    """A take that stands at each place (2,) for `rest` seconds, and moves to the next in `motion` seconds."""
    share = 0.5 - 0.5 * np.cos(np.pi * np.arange(int(motion * HZ)) / (motion * HZ))[:, None]
    pieces = []
    for number, place in enumerate(np.asarray(places, dtype=float)):
        if number:
            pieces.append(pieces[-1][-1] + share * (place - pieces[-1][-1]))
        pieces.append(np.tile(place, (int(rest * HZ), 1)))
    values = np.vstack(pieces)
    values += noise * np.random.default_rng(0).standard_normal(values.shape)
    return Take("take", np.arange(len(values)) / HZ, values, names)


START, GOAL = (0.0, 0.0), (1.0, 0.5)


def test_standstills_are_between_demonstrations_and_the_motions_back_are_none() -> None:
    take = moved([START, GOAL, (0.1, 0.05), GOAL, (-0.1, 0.02), GOAL])
    parts, flaws = split_take(take, Split())
    assert [part.name for part in parts] == ["take_0", "take_1", "take_2"]
    for number, part in enumerate(parts):
        begin = 4.0 + 14.0 * number
        assert begin - 0.1 < part.times[0] < begin + 0.3
        assert begin + 2.7 < part.times[-1] < begin + 3.1
        np.testing.assert_allclose(part.values[-1], GOAL, atol=0.006)
    assert [(flaw.what, flaw.action) for flaw in flaws] == 2 * [("leads back", Action.PASSED_OVER)]


def test_starts_on_both_sides_of_one_goal_are_starts() -> None:
    parts, _ = split_take(moved([(-1.0, 0.0), START, (1.0, 0.2), START, (0.0, -1.0), START]), Split())
    assert len(parts) == 3
    assert all(np.linalg.norm(part.values[-1]) < 0.01 for part in parts)


def test_an_interrupted_motion_does_not_exchange_demonstrations_and_returns() -> None:
    half = (0.5, 0.25)
    parts, _ = split_take(moved([START, GOAL, START, half, START, GOAL, START, GOAL]), Split())
    ends = [np.round(part.values[-1], 1).tolist() for part in parts]
    assert ends == [[1.0, 0.5], [0.5, 0.2], [1.0, 0.5], [1.0, 0.5]]


def test_the_arm_may_be_brought_to_the_start_first() -> None:
    take = moved([GOAL, START, GOAL, START, GOAL])
    parts, flaws = split_take(take, Split(first=2))
    assert len(parts) == len(flaws) == 2
    assert all(np.allclose(part.values[-1], GOAL, atol=0.01) for part in parts)
    with pytest.raises(DemonstrationError, match="motion 9 cannot be the first demonstration: there are 4 motions"):
        split_take(take, Split(first=9))


def test_a_short_pause_within_a_demonstration_splits_nothing() -> None:
    (part,), flaws = split_take(moved([START, (0.5, 0.4), GOAL], rest=1.5), Split())
    assert flaws == []
    np.testing.assert_allclose(part.values[[0, -1]], [START, GOAL], atol=0.006)


def test_a_recorder_that_was_paused_splits_too() -> None:
    take = moved([START, GOAL], rest=0.5)
    times = np.concatenate([take.times, take.times + 60.0, take.times + 120.0])
    parts, flaws = split_take(Take("take", times, np.tile(take.values, (3, 1)), take.names), Split())
    assert len(parts) == 3
    assert flaws == []


def test_loops_lead_nowhere_back() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 300)
    loop = np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
    rest = np.zeros((400, 2))
    values = np.vstack([rest, loop, rest, loop, rest, loop, rest])
    parts, flaws = split_take(Take("take", np.arange(len(values)) / HZ, values, ("a", "b")), Split())
    assert (len(parts), flaws) == (3, [])


@pytest.mark.parametrize(
    ("markers", "names"),
    [
        ([(3.0, None), (8.0, None), (17.0, None), (22.0, None)], ["take_0", "take_1"]),
        ([(3.0, True), (8.0, False), (9.0, False), (17.0, True), (22.0, False)], ["take_0", "take_1"]),
        ([(3.0, "left"), (8.0, ""), (17.0, "right"), (22.0, "")], ["left", "right"]),
        ([(3.0, "one"), (8.0, ""), (17.0, "one"), (22.0, "")], ["one", "one_1"]),
    ],
)
def test_marks_begin_and_end_demonstrations_which_are_cut_to_their_motion(markers, names) -> None:
    parts, flaws = split_take(moved([START, GOAL, START, GOAL]), Split(marker="/mark"), markers)
    assert [part.name for part in parts] == names
    assert flaws == []
    for part, begin in zip(parts, (4.0, 18.0), strict=True):
        assert begin - 0.2 < part.times[0]
        assert part.times[-1] < begin + 3.2


def test_what_no_mark_ends_is_stated_and_ends_with_the_recording() -> None:
    parts, (flaw,) = split_take(moved([START, GOAL]), Split(marker="/mark"), [(3.0, True)])
    assert len(parts) == 1
    assert (flaw.what, flaw.action) == ("has no marker that ends it", Action.REPAIRED)
    with pytest.raises(DemonstrationError, match="2 markers, and none of them begins"):
        split_take(moved([START, GOAL]), Split(marker="/mark"), [(3.0, False), (4.0, False)])


def test_no_motion_leads_past_a_break() -> None:
    take = moved([START, GOAL])
    middle = float(take.times[len(take) // 2])
    (whole,), (before, after) = find_moving_spans(take, 2.5), find_moving_spans(take, 2.5, [middle])
    assert (before.begin, after.end) == (whole.begin, whole.end)
    assert before.end < middle <= after.begin


def test_times_split_and_what_does_not_move_is_left_out() -> None:
    take = moved([START, GOAL, START, GOAL])
    parts, (flaw,) = split_take(take, Split.parse("3-8, 8.5-10,17-22"))
    assert len(parts) == 2
    assert (flaw.what, flaw.action, flaw.time) == ("does not move", Action.LEFT_OUT, 8.5)
    with pytest.raises(DemonstrationError, match=r"nothing was recorded from 90 to 95 s; .* from 0.00 to 24.99 s"):
        split_take(take, Split.parse("90-95"))


def test_poses_stand_still_as_joints_do() -> None:
    take = moved([START, GOAL, START, GOAL], names=("px", "py"))
    assert len(split_take(take, Split())[0]) == 2


@pytest.mark.parametrize("text", ["5", "5-3", "a-b", "3-4;5-6", ""])
def test_what_is_no_split_is_refused(text) -> None:
    with pytest.raises(DemonstrationError, match="give standstill, a topic of markers as /mark, or the beginning"):
        Split.parse(text)


@pytest.mark.parametrize("values", [(0.0, 1), (float("nan"), 1), (1.0, 0)])
def test_pauses_and_numbers_are_positive(values) -> None:
    with pytest.raises(DemonstrationError, match="must be positive"):
        Split.parse("standstill", *values)


def test_a_take_that_stands_still_is_refused() -> None:
    with pytest.raises(DemonstrationError, match="nothing in it moves"):
        split_take(moved([START]), Split())
