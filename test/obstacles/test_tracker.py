"""Book-keeping of obstacles: identity, deletion, lifetimes, overtaken messages, silence."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.clusters import Cluster
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.shapes import solid_distances, solid_rows
from geodesic_motion_ros.obstacles.track import MOTION_LASTS, REORDER_WINDOW
from geodesic_motion_ros.obstacles.tracker import ObstacleSet, ObstacleTracker

HERE, THERE = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6])


def box(centre: np.ndarray) -> np.ndarray:
    return solid_rows(centre[None], np.eye(3)[None], np.array([[0.1, 0.2, 0.3]]), np.zeros(1))[0]


def test_same_key_moves_the_obstacle_another_key_adds_one():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("a", 1), HERE, 0.05, now=0.0)
    tracker.put("obstacles", ("a", 1), THERE, 0.04, now=1.0)
    tracker.put("obstacles", ("b", 1), HERE, 0.03, now=1.0)
    seen = tracker.current(1.1)
    np.testing.assert_array_equal(seen.centres, [THERE, HERE])
    np.testing.assert_array_equal(seen.radii, [0.04, 0.03])
    assert seen.labels == ("obstacles/a/1", "obstacles/b/1")


def test_sources_do_not_share_keys():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("a", 1), HERE, 0.05, now=0.0)
    tracker.put("obstacle_marker", ("a", 1), THERE, 0.05, now=0.0)
    tracker.delete_all("obstacles", now=0.1)
    assert tracker.current(0.1).labels == ("obstacle_marker/a/1",)


def test_delete_removes_one_and_only_one():
    tracker = ObstacleTracker()
    for number in range(3):
        tracker.put("obstacles", ("", number), HERE, 0.05, now=0.0)
    assert tracker.delete("obstacles", ("", 1), now=0.1)
    assert not tracker.delete("obstacles", ("", 1), now=0.1)
    assert not tracker.delete("obstacles", ("", 9), now=0.1)
    assert tracker.current(0.1).labels == ("obstacles//0", "obstacles//2")


def test_delete_all_may_be_limited_to_a_namespace():
    tracker = ObstacleTracker()
    for namespace in "aab":
        tracker.put("obstacles", (namespace, 0), HERE, 0.05, now=0.0)
    assert tracker.delete_all("obstacles", now=0.1, namespace="a") == 1
    assert tracker.current(0.1).labels == ("obstacles/b/0",)
    assert tracker.delete_all("obstacles", now=0.1) == 1
    assert len(tracker.current(0.1).radii) == 0


def test_lifetime_counts_from_the_last_update():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0, lifetime=0.5)
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.4, lifetime=0.5)
    tracker.put("obstacles", ("", 1), HERE, 0.05, now=0.4)
    assert len(tracker.current(0.89).radii) == 2
    assert tracker.current(0.9).labels == ("obstacles//1",)


def test_overtaken_messages_are_ignored_until_the_window_closes():
    tracker = ObstacleTracker()
    assert tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0)
    assert not tracker.put("obstacles", ("", 0), THERE, 0.05, now=0.01, transit=0.02)
    np.testing.assert_array_equal(tracker.current(0.01).centres, [HERE])
    # a clock that was set back further than any message is late
    assert tracker.put("obstacles", ("", 0), THERE, 0.05, now=0.02, transit=5.0)
    np.testing.assert_array_equal(tracker.current(0.02).centres, [THERE])


@pytest.mark.parametrize("set_back", [0.1, 0.4, 0.9])
def test_a_clock_that_was_set_back_a_little_silences_nobody(set_back):
    tracker = ObstacleTracker()
    moved(tracker, 0.5)
    for time in (0.5, 0.52, 0.54, 0.56, 0.58):
        place = np.array([0.4 * time, 0.0, 0.0])
        taken = tracker.put("obstacles", ("", 0), place, 0.05, now=time, transit=set_back)
        assert taken == (time > 0.53)
    seen = tracker.current(0.6)
    np.testing.assert_allclose(seen.centres, [place])
    np.testing.assert_allclose(seen.velocities, [[0.4, 0.0, 0.0]], atol=1e-6)


def test_one_stamp_of_the_future_silences_nobody():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0)
    assert tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.02, transit=-0.95)
    assert tracker.put("obstacles", ("", 0), THERE, 0.05, now=0.04, transit=0.01)
    np.testing.assert_array_equal(tracker.current(0.04).centres, [THERE])
    assert tracker.ages(0.04) == {"obstacles": pytest.approx(0.01)}
    assert tracker.delete("obstacles", ("", 0), now=0.05, transit=0.01)


def test_what_is_overtaken_is_no_sign_of_life():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0)
    assert not tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.6, transit=0.7)
    assert tracker.silent(0.6, timeout=0.5) == {"obstacles": 0.6}


def test_an_overtaken_cloud_is_ignored():
    tracker, cloud = ObstacleTracker(), DistanceField.of(np.array([HERE]), 0.02, 0.02, 0.05)
    assert tracker.replace_cloud("obstacle_cloud", cloud, 1.0)
    assert not tracker.replace_cloud("obstacle_cloud", DistanceField.none(), 1.01, transit=0.1)
    assert len(tracker.current(1.01)) == 1
    assert tracker.replace_cloud("obstacle_cloud", DistanceField.none(), 1.1, transit=0.01)
    assert len(tracker.current(1.1)) == 0


def test_an_overtaken_add_does_not_revive_a_deleted_obstacle():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0)
    tracker.delete("obstacles", ("", 0), now=0.02)
    assert not tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.03, transit=0.02)
    assert len(tracker.current(0.03).radii) == 0
    assert tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.04, transit=0.01)
    assert len(tracker.current(0.04).radii) == 1


def test_deleted_keys_are_forgotten_after_the_window():
    """From then on messages from before the deletion count; until then none does."""
    tracker = ObstacleTracker()
    for number in range(100):
        tracker.put("obstacles", ("", number), HERE, 0.05, now=0.0)
    tracker.delete_all("obstacles", now=0.1)
    for share, forgotten in ((0.9, False), (1.01, True)):
        now = 0.1 + share * REORDER_WINDOW
        tracker.current(now)
        added = [tracker.put("obstacles", ("", number), HERE, 0.05, now, transit=now - 0.05) for number in range(100)]
        assert all(added) if forgotten else not any(added)


def test_without_stamps_every_message_counts():
    tracker = ObstacleTracker()
    tracker.put("obstacle_point", ("", 0), HERE, 0.05, now=0.0)
    assert tracker.put("obstacle_point", ("", 0), HERE + 0.01, 0.05, now=0.0)
    np.testing.assert_array_equal(tracker.current(0.0).centres, [HERE + 0.01])


def test_a_source_that_stops_talking_is_silent_until_its_obstacles_were_to_vanish():
    """The control gives signs of life besides: it is expected to go on."""
    tracker = ObstacleTracker()
    for now in np.arange(0.0, 0.31, 0.1):
        for source in ("obstacles", "obstacle_marker"):
            tracker.put(source, ("", 0), HERE, 0.05, now=now, lifetime=0.8)
        tracker.hear("obstacle_marker", now, empty=True)
    assert tracker.silent(0.8, timeout=0.5) == {}
    assert tracker.silent(1.0, timeout=0.5) == pytest.approx({"obstacles": 0.7, "obstacle_marker": 0.7})
    assert len(tracker.current(1.2).radii) == 0
    assert tracker.silent(1.2, timeout=0.5) == pytest.approx({"obstacle_marker": 0.9})


def test_a_required_source_is_expected_to_go_on_when_its_obstacles_have_vanished():
    tracker = ObstacleTracker(["obstacles"])
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0, lifetime=0.8)
    assert tracker.silent(0.7, timeout=0.5) == {}
    assert len(tracker.current(0.8).radii) == 0
    assert tracker.silent(0.9, timeout=0.5) == {"obstacles": 0.9}
    tracker.refuse("obstacles", "bad")
    assert list(tracker.unusable()) == ["obstacles"]


class TestLatched:
    """Of obstacles that were latched by publishers "a" and "b"."""

    def put(self, tracker: ObstacleTracker, number: int, now: float, *publishers: str, lifetime: float = 0.0) -> None:
        tracker.put("obstacles", ("", number), HERE, 0.05, now=now, lifetime=lifetime)
        tracker.answer_for("obstacles", [("", number)], publishers)

    def test_what_was_latched_stands_as_long_as_its_publisher_lives(self) -> None:
        tracker = ObstacleTracker()
        self.put(tracker, 0, 0.0, "a")
        self.put(tracker, 1, 0.0, "b")
        assert tracker.silent(100.0, 0.5) == tracker.late(100.0, 0.5) == {}
        tracker.end("obstacles", "a", 100.0)
        assert tracker.silent(100.4, 0.5) == {}
        assert tracker.silent(101.0, 0.5) == {"obstacles//0": 1.0}
        assert len(tracker.current(101.0)) == 2
        # Its publisher has come back.
        self.put(tracker, 0, 102.0, "a")
        assert tracker.silent(200.0, 0.5) == {}

    def test_of_two_publishers_of_whom_one_has_ended_it_may_have_been_that_one(self) -> None:
        tracker = ObstacleTracker()
        self.put(tracker, 0, 0.0, "a", "b")
        tracker.end("obstacles", "b", 1.0)
        assert list(tracker.silent(2.0, 0.5)) == ["obstacles//0"]

    def test_what_is_published_again_and_again_must_go_on(self) -> None:
        """A detector that latches what it sends. The control sends no more often than the timeout."""
        for period, silent in ((0.1, ["obstacles"]), (0.6, [])):
            tracker = ObstacleTracker()
            for number in range(10):
                self.put(tracker, 0, period * number, "a")
            assert list(tracker.silent(9.0 * period + 1.0, 0.5)) == silent

    def test_what_was_not_latched_beside_it_must_go_on(self) -> None:
        tracker = ObstacleTracker()
        self.put(tracker, 0, 0.0, "a")
        self.put(tracker, 1, 0.0)
        assert tracker.silent(2.0, 0.5) == {"obstacles": 2.0}
        tracker.delete("obstacles", ("", 1), 3.0)
        assert tracker.silent(9.0, 0.5) == {}

    def test_a_sign_of_life_must_be_followed_by_others_whatever_stands_beside_it(self) -> None:
        tracker = ObstacleTracker()
        self.put(tracker, 0, 0.0, "a")
        tracker.hear("obstacles", 1.0, empty=True)
        assert tracker.silent(2.0, 0.5) == {"obstacles": 1.0}

    def test_what_moved_must_go_on(self) -> None:
        tracker = ObstacleTracker()
        for number in range(2):
            tracker.put("obstacles", ("", 0), HERE + 0.1 * number, 0.05, now=0.4 * number)
            tracker.answer_for("obstacles", [("", 0)], ["a"])
        assert list(tracker.silent(2.0, 0.5)) == ["obstacles//0"]

    def test_what_vanishes_by_itself_needs_no_publisher(self) -> None:
        tracker = ObstacleTracker()
        self.put(tracker, 0, 0.0, "a", lifetime=9.0)
        tracker.end("obstacles", "a", 1.0)
        assert tracker.silent(8.0, 0.5) == {}

    def test_a_latched_message_of_long_ago_does_not_lag(self) -> None:
        tracker = ObstacleTracker()
        tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0, transit=3600.0)
        assert tracker.late(0.1, 0.5) == {"obstacles": 3600.1}
        tracker.answer_for("obstacles", [("", 0)], ["a"])
        assert tracker.late(0.1, 0.5) == tracker.silent(10.0, 0.5) == {}


def test_a_source_that_deletes_its_last_obstacle_has_said_goodbye():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0)
    tracker.put("obstacles", ("", 1), HERE, 0.05, now=0.0)
    tracker.delete("obstacles", ("", 0), now=0.1)
    assert "obstacles" in tracker.silent(5.0, timeout=0.5)
    tracker.delete("obstacles", ("", 1), now=0.2)
    assert tracker.silent(5.0, timeout=0.5) == {}
    tracker.put("obstacles", ("", 2), HERE, 0.05, now=6.0)
    assert "obstacles" in tracker.silent(7.0, timeout=0.5)


def test_never_heard_means_never_silent():
    assert ObstacleTracker().silent(1e9, timeout=0.5) == {}


def test_a_cloud_replaces_the_one_before_and_is_cleared_with_the_rest():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0)
    first, second = (DistanceField.of(place[None], 0.02, 0.02, 0.05) for place in (HERE, THERE))
    tracker.replace_cloud("obstacle_cloud", first, now=0.0)
    before = tracker.current(0.0)
    assert len(before) == 2
    assert before.cloud is first
    tracker.replace_cloud("obstacle_cloud", second, now=0.1)
    seen = tracker.current(0.1)
    assert seen.cloud is second
    assert seen.version > before.version
    np.testing.assert_array_equal(seen.centres, [HERE])
    assert tracker.silent(1.0, 0.5)["obstacle_cloud"] == pytest.approx(0.9)
    tracker.replace_cloud("obstacle_cloud", DistanceField.none(), now=0.2)
    assert len(tracker.current(0.2)) == 1
    tracker.replace_cloud("obstacle_cloud", first, now=0.3)
    tracker.clear()
    assert len(tracker.current(0.3)) == 0


@pytest.mark.parametrize("stands", [True, False], ids=["stands", "control: may move"])
def test_a_cluster_that_stands_counts_in_the_clouds_that_show_it_alone(stands):
    """What is remembered of it is shown, until something is seen through it or a moment has passed."""
    tracker = ObstacleTracker()
    for now in (0.0, 0.1, 0.2):
        cluster = Cluster.of(HERE + 0.05 * np.eye(3), 1, None)._replace(stands=stands)
        tracker.replace_cloud("obstacle_cloud", DistanceField.none(), now, clusters=[cluster])
        assert len(tracker.current(now)) == 1
    tracker.replace_cloud("obstacle_cloud", DistanceField.none(), 0.3)
    assert bool(len(tracker.current(0.3))) is not stands


def test_solids_stand_beside_spheres_and_are_distinguished_from_them():
    tracker = ObstacleTracker()
    for time in (0.0, 0.1):
        tracker.put("obstacles", ("a", 0), HERE + [time, 0.0, 0.0], 0.0, now=time, solid=box(HERE + [time, 0.0, 0.0]))
        tracker.put("obstacles", ("b", 0), THERE, 0.05, now=time)
    seen = tracker.current(0.1)
    assert seen.labels == ("obstacles/b/0", "obstacles/a/0")
    np.testing.assert_array_equal(seen.centres, [THERE])
    np.testing.assert_array_equal(seen.solids, [box(HERE + [0.1, 0.0, 0.0])])
    np.testing.assert_allclose(seen.solid_velocities, [[1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(seen.solid_times, [0.1])
    moved = seen.moved_on(0.3, longest=0.15, time=7.0)
    assert moved.time == 7.0
    np.testing.assert_allclose(moved.solids[0, :3], HERE + [0.25, 0.0, 0.0])
    np.testing.assert_array_equal(moved.centres, [THERE])
    np.testing.assert_array_equal(seen.solids, [box(HERE + [0.1, 0.0, 0.0])])
    # The same key may become a sphere.
    tracker.put("obstacles", ("a", 0), HERE, 0.05, now=0.2)
    assert len(tracker.current(0.2).radii) == 2
    tracker.delete("obstacles", ("a", 0), now=0.3)
    assert len(tracker.current(0.3)) == 1


def test_clear_forgets_obstacles_and_expectations():
    tracker = ObstacleTracker()
    tracker.put("obstacle_point", ("", 0), HERE, 0.05, now=0.0)
    tracker.clear()
    assert len(tracker.current(0.1).radii) == 0
    assert tracker.silent(100.0, timeout=0.5) == {}


def test_version_changes_with_the_set_and_only_then():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("", 0), HERE, 0.05, now=0.0, lifetime=1.0)
    first = tracker.current(0.1)
    assert tracker.current(0.9) is first
    expired = tracker.current(1.0)
    assert expired.version > first.version
    tracker.hear("obstacles", 1.1)
    assert tracker.current(1.2) is expired


def test_a_set_once_given_does_not_change():
    tracker = ObstacleTracker()
    centre = HERE.copy()
    tracker.put("obstacles", ("", 0), centre, 0.05, now=0.0)
    seen = tracker.current(0.0)
    centre[:] = 9.0
    tracker.put("obstacles", ("", 0), THERE, 0.05, now=0.1)
    np.testing.assert_array_equal(seen.centres, [HERE])


_KEYS = st.tuples(st.sampled_from(["", "a"]), st.integers(0, 3))
_EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["put", "delete", "delete_all", "wait"]),
        _KEYS,
        st.floats(0.0, 2.0),
        st.floats(0.0, 1.0),
    ),
    max_size=40,
)


@settings(deadline=None, max_examples=150)
@given(_EVENTS)
def test_agrees_with_a_plain_dictionary_of_expiry_times(events):
    """Any sequence of updates, against the simplest model there is."""
    tracker, model, now = ObstacleTracker(), {}, 0.0
    for number, (action, key, lifetime, pause) in enumerate(events):
        now += pause
        if action == "put":
            tracker.put("obstacles", key, HERE, 0.1 + number, now, lifetime)
            model[key] = (0.1 + number, now + lifetime if lifetime > 0.0 else np.inf)
        elif action == "delete":
            tracker.delete("obstacles", key, now)
            model.pop(key, None)
        elif action == "delete_all":
            tracker.delete_all("obstacles", now)
            model.clear()
        model = {key: entry for key, entry in model.items() if now < entry[1]}
        expected = [entry[0] for _, entry in sorted(model.items())]
        np.testing.assert_array_equal(tracker.current(now).radii, expected)


def moved(tracker: ObstacleTracker, until: float, stamped: bool = False, key: tuple[str, int] = ("", 0)) -> None:
    """Sends an obstacle along x with 0.4 m/s, sixty times a second from 0 to `until` [s]."""
    for time in np.arange(0.0, until, 1.0 / 60.0).tolist():
        # stamped messages arrive late, each differently
        late = 0.02 + 0.015 * np.sin(40.0 * time) if stamped else 0.0
        tracker.put("obstacles", key, np.array([0.4 * time, 0.0, 0.0]), 0.05, now=time + late, transit=late)


def test_what_moves_has_its_velocity_and_the_time_of_its_newest_update():
    tracker = ObstacleTracker()
    tracker.put("obstacles", ("", 1), HERE, 0.05, now=0.0)
    moved(tracker, 0.5)
    seen = tracker.current(0.6)
    np.testing.assert_allclose(seen.velocities, [[0.4, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-9)
    np.testing.assert_allclose(seen.times, [29 / 60.0, 0.0])


@pytest.mark.parametrize("solid", [False, True])
def test_what_has_turned_is_larger_the_longer_ago_it_was_seen(solid: bool) -> None:
    """The control is what moves straight on."""
    tracker = ObstacleTracker()
    for time in np.arange(0.0, 2.0, 1.0 / 60.0).tolist():
        places = np.array([0.2 * time, 0.2 * max(0.0, time - 1.0), 0.0]), np.array([0.2 * time, 1.0, 0.0])
        for number, place in enumerate(places):
            row = box(place) if solid else None
            tracker.put("obstacles", ("", number), place, 0.05, now=time, solid=row)
    seen = tracker.current(2.0)
    errors = seen.solid_velocity_errors if solid else seen.velocity_errors
    assert errors[0] == pytest.approx(0.2 * np.sqrt(2.0), rel=0.01)
    assert errors[1] == pytest.approx(0.0, abs=1e-9)
    now, later = seen.moved_on(2.0, 0.5, 0.0), seen.moved_on(2.2, 0.5, 0.0)
    sizes = [one.solids[:, 6] if solid else one.radii for one in (now, later)]
    np.testing.assert_allclose(sizes[1] - sizes[0], 0.2 * errors, atol=1e-9)
    np.testing.assert_array_equal(later.solid_velocity_errors if solid else later.velocity_errors, errors)


def test_velocities_are_measured_by_stamps_where_there_are_any():
    tracker = ObstacleTracker()
    moved(tracker, 0.5, stamped=True)
    np.testing.assert_allclose(tracker.current(0.6).velocities, [[0.4, 0.0, 0.0]], atol=1e-6)


def test_a_sender_that_stamps_now_and_then_has_a_velocity_all_the_same():
    tracker = ObstacleTracker()
    for number in range(30):
        taken = number / 30.0
        transit = 0.005 if number % 2 else 0.0
        tracker.put("obstacles", ("", 0), np.array([0.4 * taken, 0.0, 0.0]), 0.05, now=taken + 0.005, transit=transit)
    np.testing.assert_allclose(tracker.current(1.0).velocities, [[0.4, 0.0, 0.0]], atol=0.03)


def test_what_was_deleted_and_comes_again_starts_at_rest():
    tracker = ObstacleTracker()
    moved(tracker, 0.5)
    tracker.delete("obstacles", ("", 0), now=0.5)
    tracker.put("obstacles", ("", 0), np.array([0.2, 0.0, 0.0]), 0.05, now=0.51)
    np.testing.assert_array_equal(tracker.current(0.6).velocities, np.zeros((1, 3)))


def test_an_empty_set_has_the_shapes_of_a_full_one():
    seen = ObstacleTracker().current(0.0)
    assert (seen.centres.shape, seen.velocities.shape, seen.times.shape) == ((0, 3), (0, 3), (0,))
    assert (seen.solids.shape, seen.solid_velocities.shape, seen.solid_times.shape) == ((0, 16), (0, 3), (0,))
    assert seen.moved_on(1.0, 0.5, 1.0).objection() == ""


def moving_sphere(tracker: ObstacleTracker, speed: float, until: float = 0.2, solid: bool = False) -> np.ndarray:
    """A sphere or a box that is published 50 times a second until a time [s]; its last place."""
    for now in np.arange(0.0, until + 1e-9, 0.02):
        centre = HERE + [speed * now, 0.0, 0.0]
        tracker.put("obstacles", ("a", 1), centre, 0.05, now=now, solid=box(centre) if solid else None)
    return centre


def test_what_moved_and_is_not_published_again_may_have_stopped_anywhere_since():
    """Another one of the same topic is published all the time: the topic is not silent."""
    tracker = ObstacleTracker()
    last = moving_sphere(tracker, 0.4)
    for now in np.arange(0.2, 0.6, 0.02):
        tracker.put("obstacles", ("b", 2), THERE, 0.05, now=now)
        seen = tracker.current(now)
        if now < 0.2 + MOTION_LASTS - 1e-9:
            obstacles = seen.moved_on(now, 1.6, now)
            np.testing.assert_allclose(obstacles.centres[0], last + [0.4 * (now - 0.2), 0.0, 0.0], atol=1e-9)
            assert obstacles.ages[0] == pytest.approx(now - 0.2)
    obstacles = seen.moved_on(now, 1.6, now)
    # It may as well move on.
    np.testing.assert_allclose(obstacles.velocities[0], [0.4, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(obstacles.centres[0], last + [0.4 * (now - 0.2), 0.0, 0.0], atol=1e-9)
    standing = ~np.any(obstacles.velocities, axis=1)
    random = np.random.default_rng(0)
    for passed in np.linspace(0.0, now - 0.2, 50):
        on = random.normal(size=(50, 1, 3))
        on = last + [0.4 * passed, 0.0, 0.0] + 0.05 * on / np.linalg.norm(on, axis=2, keepdims=True)
        gaps = np.linalg.norm(on - obstacles.centres[standing], axis=2) - obstacles.radii[standing]
        assert np.max(np.min(gaps, axis=1)) < 1e-9
    assert set(seen.labels) == {"obstacles/a/1", "obstacles/b/2"}
    # Published again, it moves on.
    tracker.put("obstacles", ("a", 1), last, 0.05, now=0.6)
    assert len(tracker.current(0.6).radii) == 2


def test_that_comes_by_itself_without_another_message():
    tracker = ObstacleTracker()
    moving_sphere(tracker, 0.4)
    before = tracker.current(0.4)
    after = tracker.current(0.2 + MOTION_LASTS)
    assert after.version > before.version
    assert len(after.radii) > len(before.radii) == 1
    # Where it may have come to grows, up to a limit.
    last = [tracker.current(now).centres[:, 0].max() for now in (1.0, 1.5, 2.5, 9.0)]
    assert last[0] < last[1] < last[2] == last[3]


def test_a_solid_that_moved_and_is_not_published_again_likewise():
    tracker = ObstacleTracker()
    last = moving_sphere(tracker, 0.4, solid=True)
    solids = tracker.current(0.2 + MOTION_LASTS).moved_on(0.5, 1.6, 0.5).solids
    assert len(solids) > 1
    random = np.random.default_rng(0)
    for passed in np.linspace(0.0, MOTION_LASTS, 30):
        inside = last + [0.4 * passed, 0.0, 0.0] + random.uniform(-1.0, 1.0, (20, 3)) * [0.1, 0.2, 0.3]
        assert np.max(solid_distances(inside, solids)) < 1e-9


@pytest.mark.parametrize(("speed", "silent"), [(0.4, ["obstacles/a/1"]), (0.0, []), (0.005, [])])
def test_what_moves_must_be_published_again_and_what_stands_need_not(speed, silent):
    tracker = ObstacleTracker()
    moving_sphere(tracker, speed)
    tracker.put("obstacles", ("b", 2), THERE, 0.05, now=0.8)
    assert list(tracker.silent(0.6, 0.5)) == []
    assert list(tracker.silent(0.8, 0.5)) == silent
    assert list(tracker.silent(2.0, 0.5)) == ["obstacles"]
    tracker.delete("obstacles", ("a", 1), now=2.0)
    assert list(tracker.silent(2.0, 0.5)) == []


def detected(
    tracker: ObstacleTracker, place: np.ndarray, noise: float, until: float, seed: int = 0, key: tuple = ("", 0),
    turned: float | None = None, begin: float = 0.0,
) -> Iterator[ObstacleSet]:
    """What is known after each detection of what stands, 30 times a second; with a turn of so much [rad] of a box."""
    random = np.random.default_rng(seed)
    for now in np.arange(begin, until, 1.0 / 30.0).tolist():
        centre = place + random.normal(scale=noise, size=3)
        solid = None
        if turned is not None:
            rotation = Rotation.from_rotvec(random.normal(scale=turned, size=3)).as_matrix()
            solid = solid_rows(centre[None], rotation[None], np.array([[0.1, 0.2, 0.3]]), np.zeros(1))[0]
        tracker.put("camera", key, centre, 0.05, now=now + 0.08, transit=0.08, solid=solid)
        yield tracker.current(now + 0.08)


@pytest.mark.parametrize("turned", [None, 0.0, 1e-3])
def test_what_stands_is_the_same_to_the_last_bit_for_long_and_covers_where_it_is(turned: float | None) -> None:
    """A box too, turned a little in each detection. Not one of the detections themselves is like another."""
    seen = list(detected(ObstacleTracker(), HERE, 1e-2, 20.0, turned=turned))[60:]
    assert all(one.moved_on(one.version, 1.6, 0.0).is_static for one in seen)
    places = [one.centres.tobytes() + one.radii.tobytes() + one.solids.tobytes() for one in seen]
    # 3 s at least in the mean; the first seconds, in which less is known, are counted.
    assert len(set(places)) <= 6
    for one in seen:
        if turned is None:
            assert np.linalg.norm(one.centres[0] - HERE) <= one.radii[0] - 0.05 < 0.025
        else:
            corners = HERE + np.array(list(product((-1.0, 1.0), repeat=3))) * [0.1, 0.2, 0.3]
            assert np.max(solid_distances(corners, one.solids)) < 3.0 * 0.37 * turned
            assert one.solids[0, 6] < 0.025


def test_what_drifts_leaves_its_place() -> None:
    tracker = ObstacleTracker()
    *_, before = detected(tracker, HERE, 1e-2, 4.0)
    *_, after = detected(tracker, HERE + [0.04, 0.0, 0.0], 1e-2, 8.0, begin=4.0)
    assert np.linalg.norm(before.centres[0] - HERE) < 0.01
    assert np.linalg.norm(after.centres[0] - HERE - [0.04, 0.0, 0.0]) < 0.01


def test_a_new_obstacle_of_a_noisy_source_is_not_taken_as_exact() -> None:
    """Even when nothing of the source is there; one of an exact source is."""
    tracker = ObstacleTracker()
    *_, last = detected(tracker, HERE, 1e-2, 4.0)
    tracker.delete_all("camera", 4.1)
    tracker.put("camera", ("", 7), THERE, 0.05, now=9.0)
    tracker.put("simulation", ("", 7), THERE, 0.05, now=9.0)
    seen = tracker.current(9.0)
    assert seen.labels == ("camera//7", "simulation//7")
    assert seen.radii[0] > last.radii[0]
    assert seen.radii[1] == 0.05


def test_the_noise_of_a_moving_obstacle_is_in_its_radius_and_the_error_of_its_velocity() -> None:
    random, tracker = np.random.default_rng(0), ObstacleTracker()
    for now in np.arange(0.0, 4.0, 1.0 / 30.0).tolist():
        place = HERE + [0.3 * now, 0.0, 0.0]
        tracker.put("camera", ("", 0), place + random.normal(scale=1e-2, size=3), 0.05, now=now)
    seen = tracker.current(now)
    np.testing.assert_allclose(seen.velocities, [[0.3, 0.0, 0.0]], atol=seen.velocity_errors[0])
    np.testing.assert_allclose(seen.centres, [place], atol=seen.radii[0] - 0.05)
    # Three standard deviations over 2 s: of the velocity 2.2 mm/s, of the place 2.6 mm; the noise is found within 30 %.
    assert seen.velocity_errors[0] == pytest.approx(0.0067, rel=0.3)
    assert seen.radii[0] - 0.05 == pytest.approx(0.0077, rel=0.3)
