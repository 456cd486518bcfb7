"""Every flaw is found where it is, and nothing in a good demonstration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.flaws import find_strangers, repair_demonstration, repair_samples
from geodesic_motion_ros.demonstrations.takes import Action, Take
from geodesic_motion_ros.geometry.quaternions import rotate_by

SHARE = np.linspace(0.0, 1.0, 301)
GOOD = Take("good", 0.01 * np.arange(301), np.stack([SHARE, np.sin(3.0 * SHARE)], axis=1), ("a", "b"))
DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def changed(samples, **values) -> Take:
    """The good one with other values of joint a, added, or times in some samples."""
    times, joints = GOOD.times.copy(), GOOD.values.copy()
    times[samples] = values.get("times", times[samples])
    joints[samples, 0] += values.get("add", 0.0)
    return Take("bad", times, joints, GOOD.names)


def found_in(take: Take) -> tuple[Take, list[tuple[str, Action, float]]]:
    take, flaws = repair_samples(take)
    take, more = repair_demonstration(take)
    return take, [(flaw.what, flaw.action, flaw.time) for flaw in [*flaws, *more]]


def test_a_good_demonstration_has_no_flaws_and_stays_as_it_is() -> None:
    take, flaws = found_in(GOOD)
    assert flaws == []
    np.testing.assert_array_equal(take.values, GOOD.values)
    np.testing.assert_array_equal(take.times, GOOD.times)


@pytest.mark.parametrize("size", [1, 3, 5])
def test_a_spike_is_replaced_by_a_straight_line(size) -> None:
    take, ((what, action, time),) = found_in(changed(slice(100, 100 + size), add=0.4))
    assert what.startswith(f"has a spike of {size} sample")
    assert "40.3 rad/s in a" in what
    assert (action, time) == (Action.REPAIRED, pytest.approx(0.99))
    np.testing.assert_allclose(take.values, GOOD.values, atol=2e-3)


@pytest.mark.parametrize("sample", [0, 300])
def test_a_spike_at_an_end_is_cut(sample) -> None:
    take, ((what, action, _),) = found_in(changed(sample, add=0.5))
    assert "spike of 1 sample" in what
    assert action is Action.REPAIRED
    assert len(take) == 300
    assert np.abs(take.values - 0.5).max() < 0.6


def test_lost_samples_are_bridged_or_leave_the_demonstration_out() -> None:
    lost = np.delete(np.arange(301), np.arange(100, 150))
    short = Take("lost", GOOD.times[: len(lost)], GOOD.values[lost], GOOD.names)
    take, ((what, action, time),) = found_in(short)
    assert what == "jumps, 17 rad/s in a: samples are lost"
    assert (action, time) == (Action.REPAIRED, pytest.approx(0.99))
    assert np.max(np.abs(np.diff(take.values, axis=0)) / np.diff(take.times)[:, None]) <= 8.0 + 1e-9
    _, ((what, action, _),) = found_in(changed(slice(100, None), add=0.6))
    assert (what, action) == ("jumps, 60.3 rad/s in a: samples are lost", Action.LEFT_OUT)


def test_a_jump_that_an_arm_could_make_but_that_nothing_beside_it_explains_leaves_the_demonstration_out() -> None:
    """Ten samples a second. The control: as large a step of a motion that is as fast before and after it."""
    slow = replace(GOOD, times=10.0 * GOOD.times)
    values = slow.values + np.where(np.arange(301) < 100, 0.0, 0.5)[:, None] * [1.0, 0.0]
    _, ((what, action, time),) = found_in(replace(slow, values=values))
    assert what == "jumps, 5.03 rad/s in a: samples are lost, or these are two demonstrations"
    assert (action, time) == (Action.LEFT_OUT, pytest.approx(9.9))
    swing = np.stack([0.5 * np.arange(301), np.zeros(301)], axis=1)
    assert found_in(replace(slow, values=swing))[1] == []


def test_gaps_are_bridged_or_leave_the_demonstration_out() -> None:
    for end, action in ((150, Action.REPAIRED), (220, Action.LEFT_OUT)):
        kept = np.delete(np.arange(301), np.arange(100, end))
        _, ((what, done, time),) = found_in(GOOD.part(kept))
        assert (what, done) == (f"has a gap of {0.01 * (end - 99):.2f} s", action)
        assert time == pytest.approx(0.99)


def test_times_that_repeat_or_fall_are_left_out_or_refused() -> None:
    take, flaws = found_in(changed([50, 51, 120], times=0.3))
    assert flaws[0][:2] == ("has 3 of 301 samples with a time that repeats or falls", Action.REPAIRED)
    assert np.all(np.diff(take.times) > 0.0)
    _, flaws = repair_samples(changed(slice(50, 150), times=0.3))
    assert flaws[0].action is Action.REFUSED


def test_jitter_is_stated_and_messages_that_come_together_are_no_spikes() -> None:
    late = np.sort(GOOD.times + np.random.default_rng(0).exponential(0.01, 301))
    _, ((what, action, _),) = found_in(changed(slice(None), times=late))
    assert what.startswith("has jitter: ")
    assert action is Action.KEPT


def test_a_wrong_rate_is_asked_about_and_nothing_is_repaired() -> None:
    take, ((what, action, _),) = found_in(replace(GOOD, times=GOOD.times / 50.0))
    assert "steps faster than an arm" in what
    assert action is Action.KEPT
    np.testing.assert_array_equal(take.values, GOOD.values)


def test_few_samples_are_stated_or_leave_the_demonstration_out() -> None:
    slow = replace(GOOD, times=10.0 * GOOD.times)
    assert found_in(slow.part(slice(None, None, 20)))[1] == [("has 16 samples, 0.5 a second", Action.KEPT, 0.0)]
    assert found_in(slow.part(slice(None, None, 60)))[1] == [("has 6 samples, 0.17 a second", Action.LEFT_OUT, 0.0)]


def test_standstills_at_the_ends_are_stated() -> None:
    rested = Take("rested", 0.01 * np.arange(901), np.pad(GOOD.values, ((300, 300), (0, 0)), "edge"), GOOD.names)
    flaws = found_in(rested)[1]
    assert [what.split()[0] for what, _, _ in flaws] == ["begins", "ends"]
    assert all(action is Action.KEPT for _, action, _ in flaws)


def test_what_does_not_move_is_refused() -> None:
    for take in (replace(GOOD, values=0.01 * GOOD.values), Take("p", GOOD.times, 5e-4 * GOOD.values, ("px", "py"))):
        _, ((what, action, _),) = found_in(take)
        assert what.startswith("does not move: ")
        assert action is Action.REFUSED


# ---------------------------------------------------------------- demonstrations among each other


def reach(start, goal, name: str, share: float = 1.0, turn: float = 0.0) -> Demonstration:
    """A straight motion of the tool, which turns by `turn` [rad], or its first `share`."""
    along = np.linspace(0.0, share, 101)[:, None]
    positions = np.asarray(start) + along * (np.asarray(goal) - np.asarray(start))
    quaternions = rotate_by(along * [0.0, 0.0, turn], np.tile(DOWN, (101, 1)))
    return Demonstration(positions, quaternions, 0.05 * np.arange(101), name)


def reaches(count: int = 6, seed: int = 0) -> list[Demonstration]:
    """Motions over half a metre whose starts vary by some centimetres."""
    random = np.random.default_rng(seed)
    return [
        reach(random.normal((0.5, -0.25, 0.3), 0.03), random.normal((0.5, 0.25, 0.3), 0.003), f"d{number}")
        for number in range(count)
    ]


def strangers(*more: Demonstration, ends=()) -> list[tuple[str, str, Action]]:
    flaws = find_strangers(Demonstrations((*reaches(), *more)), ends)
    return [(flaw.demonstration, flaw.what, flaw.action) for flaw in flaws]


def test_demonstrations_of_one_task_are_no_strangers() -> None:
    assert strangers() == []


def test_an_interrupted_demonstration_is_left_out() -> None:
    ((name, what, action),) = strangers(reach((0.5, -0.24, 0.3), (0.5, 0.25, 0.3), "half", share=0.6))
    assert (name, action) == ("half", Action.LEFT_OUT)
    assert what.startswith("is interrupted: ends 1")


@pytest.mark.parametrize(
    ("other", "what"),
    [
        (reach((0.5, 0.25, 0.6), (0.5, 0.25, 0.3), "x"), "is of another task: starts 5"),
        (reach((0.5, -0.25, 0.3), (0.8, -0.2, 0.3), "x"), "is of another task: ends "),
        (reach((0.5, -0.25, 0.3), (0.5, 0.25, 0.3), "x", turn=2.0), "is of another task: ends 400 mm"),
    ],
)
def test_a_demonstration_of_another_task_is_left_out(other, what) -> None:
    ((name, found, action),) = strangers(other)
    assert (name, action) == ("x", Action.LEFT_OUT)
    assert found.startswith(what)


def test_two_tasks_are_refused_and_the_demonstrations_of_each_are_listed() -> None:
    others = [reach((0.3, 0.4, 0.5 + 0.01 * number), (0.7, 0.0, 0.1), f"o{number}") for number in range(3)]
    ((_, what, action),) = strangers(*others)
    assert what == "is of another of 2 tasks, apart at both ends: d0, d1, d2, d3, d4, d5; o0, o1, o2"
    assert action is Action.REFUSED


def test_two_groups_of_starts_or_of_goals_are_one_task() -> None:
    assert strangers(*(reach((0.2, -0.2, 0.3 + 0.02 * n), (0.5, 0.25, 0.3), f"o{n}") for n in range(3))) == []


def test_another_posture_is_left_out_and_two_of_it_are_a_mode() -> None:
    random = np.random.default_rng(0)
    ends = random.normal(0.0, 0.05, (7, 2, 6))
    ends[6] += 1.0
    extra = reach((0.5, -0.25, 0.3), (0.5, 0.25, 0.3), "x")
    ((name, what, action),) = strangers(extra, ends=ends)
    assert (name, action) == ("x", Action.LEFT_OUT)
    assert what.startswith("is in another posture: ends 2.")
    again = np.concatenate([ends, ends[6:] + 0.05])
    assert strangers(extra, reach((0.5, -0.25, 0.3), (0.5, 0.25, 0.3), "y"), ends=again) == []
