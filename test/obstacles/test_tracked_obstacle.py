"""One obstacle whose detections contradict: outliers, objects put elsewhere, two publishers that use one name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from geodesic_motion_ros.obstacles.tracked_obstacle import AGREEING, REMEMBERED
from geodesic_motion_ros.obstacles.tracker import ObstacleSet, ObstacleTracker
from geodesic_motion_ros.obstacles.velocity_filter import LONGEST_GAP

HERE, THERE = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6])
KEY, RATE, NAME = ("", 0), 30.0, "obstacles//0"


def detect(
    tracker: ObstacleTracker, places: Sequence[np.ndarray], begin: float, rate: float = RATE
) -> list[np.ndarray]:
    """Everywhere that it counts (n, 3) [m] after each detection, so many times a second from a time [s] on."""
    counted = []
    for number, place in enumerate(places):
        tracker.put("obstacles", KEY, place, 0.05, now=begin + number / rate)
        counted.append(tracker.current(begin + number / rate).centres)
    return counted


def covers(centres: np.ndarray, place: np.ndarray, by: float = 1e-9) -> bool:
    return bool(np.min(np.linalg.norm(centres - place, axis=1)) <= by)


@pytest.mark.parametrize("velocity", [np.zeros(3), np.array([0.3, -0.1, 0.1])])
def test_one_detection_elsewhere_does_not_move_it(velocity: np.ndarray) -> None:
    """Both places count until two detections agree; its velocity is not disturbed."""
    tracker, times = ObstacleTracker(), np.arange(40) / RATE
    places = HERE + times[:, None] * velocity
    detections = places.copy()
    detections[20] += [0.3, 0.2, -0.2]
    for number, counted in enumerate(detect(tracker, detections, 0.0)):
        near = places[number - 1] if number == 20 else places[number]
        assert covers(counted, near)
        assert covers(counted, detections[20]) == (20 <= number < 20 + AGREEING)
        assert len(counted) == (2 if 20 <= number < 20 + AGREEING else 1)
    np.testing.assert_allclose(tracker.current(times[-1]).velocities, [velocity], atol=1e-9)
    assert tracker.alternating(times[-1]) == {}


def test_many_detections_elsewhere_are_no_second_publisher() -> None:
    """One in ten is 15 to 80 cm off: where it is counts all the time, however the others scatter."""
    random, tracker = np.random.default_rng(0), ObstacleTracker()
    times = np.arange(3000) / RATE
    places = HERE + np.stack([0.3 * np.sin(times), 0.0 * times, 0.0 * times], axis=1)
    wrong = random.random(len(times)) < 0.1
    off = random.normal(size=(len(times), 3))
    off *= random.uniform(0.15, 0.8, size=(len(times), 1)) / np.linalg.norm(off, axis=1, keepdims=True)
    detections = places + np.where(wrong[:, None], off, 0.0)
    named = 0
    for number, counted in enumerate(detect(tracker, detections, 0.0)):
        # Where the newest detections are wrong, the last right one counts, 1 cm ago each.
        assert covers(counted, places[number], 0.05) or wrong[number - 4 : number + 1].all()
        named += bool(tracker.alternating(times[number]))
    assert named < 0.05 * len(times)


def test_what_is_put_elsewhere_counts_there_at_once_and_no_more_where_it_was() -> None:
    tracker = ObstacleTracker()
    detect(tracker, [HERE] * 10, 0.0)
    first, second, third = detect(tracker, [THERE] * 3, 10 / RATE)
    assert covers(first, THERE)
    assert covers(first, HERE)
    for counted in (second, third):
        np.testing.assert_array_equal(counted, [THERE])


def test_what_is_put_elsewhere_once_leaves_its_place_after_a_while() -> None:
    tracker = ObstacleTracker()
    detect(tracker, [HERE, THERE], 0.0)
    assert len(tracker.current(1.0 / RATE + 0.9 * LONGEST_GAP).radii) == 2
    np.testing.assert_array_equal(tracker.current(0.1 + LONGEST_GAP).centres, [THERE])


@pytest.mark.parametrize("rates", [(30.0, 30.0), (30.0, 10.0), (5.0, 5.0), (1.0, 1.0), (10.0, 1.0)])
def test_two_publishers_of_one_name_are_named_and_both_places_count(rates: tuple[float, float]) -> None:
    """One stands. The other one moves slowly, where it is detected often enough."""
    tracker, velocity = ObstacleTracker(), np.array([0.02 if min(rates) > 5.0 else 0.0, 0.0, 0.0])
    events = [(number / rate, which) for which, rate in enumerate(rates) for number in range(int(12.0 * rate))]
    for time, which in sorted((time + 0.4 * which / max(rates), which) for time, which in events):
        places = [HERE, THERE + time * velocity]
        tracker.put("obstacles", KEY, places[which], 0.05, now=time)
        if time > 4.0:
            assert list(tracker.alternating(time)) == [NAME]
            counted = tracker.current(time).centres
            assert all(covers(counted, place, by=0.02 / min(rates) + 1e-9) for place in places)
    # One of them ends: the other one alone goes on.
    last = time + REMEMBERED + 2.0
    for now in np.arange(time, last, 0.1):
        tracker.put("obstacles", KEY, HERE, 0.05, now)
    assert tracker.alternating(last) == {}
    np.testing.assert_array_equal(tracker.current(last).centres, [HERE])


@pytest.mark.parametrize("rate", [5.0, 30.0])
def test_what_moves_to_and_fro_has_one_place(rate: float) -> None:
    """30 cm, in 1.5 s: up to 0.6 m/s."""
    tracker, times = ObstacleTracker(), np.arange(0.0, 12.0, 1.0 / rate)
    places = HERE + 0.15 * np.sin(2.0 * np.pi / 1.5 * times)[:, None] * [1.0, 0.0, 0.0]
    detect(tracker, places, 0.0, rate)
    assert tracker.alternating(times[-1]) == {}
    assert len(np.unique(tracker.current(times[-1]).centres, axis=0)) == 1


def test_what_is_deleted_and_sent_again_in_one_message_goes_on_moving() -> None:
    """DELETEALL and ADD, as many displays are updated. The control is deleted before."""
    velocities = []
    for earlier in (0.0, 0.01):
        tracker = ObstacleTracker()
        for now in np.arange(0.0, 0.5, 1.0 / RATE):
            tracker.delete_all("obstacles", now - earlier)
            tracker.put("obstacles", KEY, HERE + [0.3 * now, 0.0, 0.0], 0.05, now)
        velocities.append(tracker.current(now).velocities[0])
    np.testing.assert_allclose(velocities, [[0.3, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_what_speeds_up_on_a_line_is_expected_along_it_and_leaves_room_beside_it(noise: float) -> None:
    """All that constant accelerations from none to the present one lead to within 1.2 s is covered; 20 cm beside the
    line is not. The control turns meanwhile, and is covered to every side.
    """
    random, straight, ahead = np.random.default_rng(0), None, np.linspace(0.0, 1.2, 13)
    for turn in (0.0, 1.0):
        tracker, times = ObstacleTracker(), np.arange(0.0, 1.4, 1.0 / RATE)
        lengths = 0.2 * times**2
        places = np.stack([lengths * np.cos(turn * times), lengths * np.sin(turn * times), 0.0 * times], axis=1)
        for time, place in zip(times, places + random.normal(scale=noise, size=places.shape), strict=True):
            tracker.put("obstacles", KEY, place, 0.05, now=time)
        seen, now = tracker.current(times[-1]), times[-1]
        if not turn:
            straight = seen
            assert len(seen) == 1
            assert len(seen.radii) > 5
            for share in np.linspace(0.0, 1.0, 5):
                assert all(_inside(seen, passed, _straight_on(now, passed, share)) for passed in ahead)
            beside = [places[-1] + [x, 0.2, 0.0] for x in np.linspace(0.0, 1.2, 25)]
            assert not any(_inside(seen, passed, point) for passed in ahead for point in beside)
        else:
            assert len(seen.radii) == 1
            assert seen.velocity_errors[0] > 3.0 * straight.velocity_errors[0]


def _straight_on(now: float, passed: float, share: float) -> np.ndarray:
    """Where an obstacle is that was accelerated along x at 0.4 m/s^2 until now, and at a share of that since."""
    return np.array([0.2 * now**2 + 0.4 * now * passed + share * 0.2 * passed**2, 0.0, 0.0])


def _inside(seen: ObstacleSet, passed: float, point: np.ndarray) -> bool:
    """Whether an obstacle may be at a point (3,) [m] after a time [s]."""
    gaps = np.linalg.norm(seen.centres + passed * seen.velocities - point, axis=1)
    return bool(np.any(gaps <= seen.radii + passed * seen.velocity_errors))


@pytest.mark.parametrize("radius", [0.0, 0.15])
def test_what_moves_to_and_fro_is_expected_back_where_it_turns(radius: float) -> None:
    """On a line, and on a circle: from half a period on, all that follows within 0.4 s is covered. The control is no
    faster in the prediction than it is now, which is next to nothing where it turns.
    """
    tracker, missed, ahead = ObstacleTracker(), 0, np.linspace(0.0, 0.4, 9)
    swing = lambda at: np.array([0.15 * np.sin(3.0 * at), radius * np.cos(3.0 * at), 0.0])  # noqa: E731
    for time in np.arange(0.0, 5.0, 1.0 / RATE):
        tracker.put("obstacles", KEY, swing(time), 0.01, now=time)
        if time < np.pi / 3.0:
            continue
        seen = tracker.current(time)
        assert all(_inside(seen, passed, swing(time + passed)) for passed in ahead)
        velocity = np.mean(seen.velocities, axis=0)
        off = np.linalg.norm(swing(time) + ahead[-1] * velocity - swing(time + ahead[-1]))
        missed += off > 0.01 + ahead[-1] * np.linalg.norm(velocity)
    assert missed > 0 or radius


def test_one_detection_shows_how_fast_it_may_have_started() -> None:
    """The first that shows a whole interval of motion."""
    tracker, started = ObstacleTracker(), 30
    for number in range(started + 2):
        passed = max(0, number - started) / RATE
        tracker.put("obstacles", KEY, HERE + [0.2 * passed, 0.0, 0.0], 0.01, now=number / RATE)
    seen = tracker.current(number / RATE)
    ends = [HERE + [0.2 * (1.0 / RATE + passed), 0.0, 0.0] for passed in (0.1, 0.5, 1.0)]
    assert all(_inside(seen, passed, end) for passed, end in zip((0.1, 0.5, 1.0), ends, strict=True))


def test_many_that_speed_up_share_the_velocities_at_which_they_are_expected() -> None:
    tracker = ObstacleTracker()
    for time in np.arange(0.0, 1.0, 1.0 / RATE):
        for number in range(40):
            tracker.put("obstacles", ("", number), HERE + [0.2 * time**2, 0.1 * number, 0.0], 0.05, now=time)
    assert len(tracker.current(1.0)) == len(tracker.current(1.0).radii) == 40


@pytest.mark.parametrize("rate", [10.0, 30.0, 60.0])
def test_noise_is_no_change_of_speed(rate: float) -> None:
    """1 cm, at 0.3 m/s: one place in 99 % of all cases."""
    random, tracker, times = np.random.default_rng(0), ObstacleTracker(), np.arange(0.0, 60.0, 1.0 / rate)
    places = HERE + times[:, None] * [0.3, 0.0, 0.0] + random.normal(scale=0.01, size=(len(times), 3))
    counted = np.array([len(centres) for centres in detect(tracker, places, 0.0, rate)])
    assert np.mean(counted[int(2.0 * rate) :] > 1) < 0.01
