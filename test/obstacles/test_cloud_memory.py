"""Cubes over several clouds: since when they have held points, and which ones count on that are not seen any more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.geometry.line_of_sight import LineOfSight
from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.geometry.voxels import VoxelGrid
from geodesic_motion_ros.obstacles.cloud_memory import (
    AVERAGED,
    OFTEN,
    SELDOM,
    STOOD,
    STOPPED,
    CloudMemory,
    Recalled,
    flickering,
)

EDGE, PERIOD = 0.02, 1.0 / 30.0
EYE = np.array([0.0, 0.0, 0.5])
GRID = VoxelGrid.around(EYE, 1.2, EDGE)
#: All of them are a metre from the eye: one, the ones beside it, one that is not, and one far away.
ONE, BESIDE, APART, ELSEWHERE = (np.array([place]) for place in ([50, 0, 25], [50, 1, 25], [50, 2, 25], [0, 50, 25]))
ALL = np.concatenate([ONE, BESIDE, APART, ELSEWHERE])
NOTHING = ONE[:0]


def wall(distance: float) -> LineOfSight:
    """What a camera sees that has a wall so far from it [m], in all directions."""
    blank = LineOfSight.blank(EYE)
    return LineOfSight(blank.eye, np.full_like(blank.nearest, distance**2))


HIDDEN, BLIND, THROUGH = wall(0.5), LineOfSight.blank(None), wall(2.0)


class Clouds:
    """A memory that is shown clouds, thirty times a second."""

    def __init__(self) -> None:
        self.memory, self.time = CloudMemory.nothing(EDGE), 0.0

    def show(
        self, places: np.ndarray, sight: LineOfSight = BLIND, passed: float = PERIOD, off: float = 0.0
    ) -> Recalled:
        """What is known after the next cloud; off : its points are so far from the middles of cubes [m]."""
        self.time += passed
        means, spreads = EDGE * places + off, np.full((len(places), 6), off**2)
        recalled = self.memory.recall(places, means, spreads, self.time, GRID, sight)
        self.memory = CloudMemory(EDGE, recalled.seen.beside(recalled.unseen), self.time, sight, 0)
        return recalled

    def show_for(self, duration: float, places: np.ndarray, sight: LineOfSight = BLIND) -> Recalled:
        """What is known after so long [s]."""
        for _ in range(round(duration / PERIOD)):
            recalled = self.show(places, sight)
        return recalled


@pytest.fixture
def clouds() -> Clouds:
    """What was seen so far is elsewhere."""
    clouds = Clouds()
    clouds.show_for(3.0, ELSEWHERE)
    return clouds


class TestStands:
    def test_all_that_the_first_cloud_shows(self):
        assert Clouds().show(ALL).seen.stands.all()

    def test_what_has_held_points_for_long(self, clouds):
        while clouds.time < 3.0 + STOOD:
            assert clouds.show(ONE).seen.stands.tolist() == [False]
        clouds.show(ONE)
        assert clouds.show(ONE).seen.stands.tolist() == [True]

    def test_what_is_beside_that_and_nothing_farther_away(self, clouds):
        clouds.show_for(1.1 * STOOD, ONE)
        assert clouds.show(np.concatenate([BESIDE, APART])).seen.stands.tolist() == [True, False]

    def test_what_is_missing_in_a_few_clouds(self, clouds):
        for _ in range(round(1.1 * STOOD / (0.8 * MOMENT))):
            clouds.show(NOTHING, passed=0.4 * MOMENT)
            recalled = clouds.show(ONE, passed=0.4 * MOMENT)
        assert recalled.seen.stands.all()

    def test_but_what_was_away_for_longer_is_new(self, clouds):
        clouds.show_for(1.1 * STOOD, ONE)
        clouds.show_for(1.1 * MOMENT, NOTHING)
        assert clouds.show(ONE).seen.stands.tolist() == [False]

    @pytest.mark.parametrize(
        ("sight", "stands"), [(HIDDEN, True), (BLIND, False), (THROUGH, False)], ids=["hidden", "unknown", "open"]
    )
    def test_what_comes_out_from_behind_something_else(self, clouds, sight, stands):
        clouds.show(NOTHING, sight)
        for _ in range(5):
            assert clouds.show(ONE, THROUGH).seen.stands.tolist() == [stands]

    def test_what_comes_out_from_beside_it(self, clouds):
        """The camera may have seen nothing of it there."""
        sight = LineOfSight(THROUGH.eye, THROUGH.nearest.copy())
        sight.nearest[0, :, 92:] = 0.5**2
        clouds.show(NOTHING, sight)
        # Columns are along z, 11 mm wide there.
        beside, apart = np.array([[50, 0, 26]]), np.array([[50, 0, 24]])
        assert not sight.hides(EDGE * np.concatenate([beside, apart])).any()
        assert clouds.show(np.concatenate([beside, apart])).seen.stands.tolist() == [True, False]

    @pytest.mark.parametrize(("passed", "stands"), [(0.9 * MOMENT, False), (1.1 * MOMENT, True)])
    def test_what_comes_while_no_cloud_does(self, clouds, passed, stands):
        assert clouds.show(ONE, passed=passed).seen.stands.tolist() == [stands]


class TestThings:
    """What is known of the things that cubes were of in the cloud before."""

    @staticmethod
    def set_things(clouds: Clouds, things: list[int], stands: bool) -> None:
        cubes = clouds.memory.cubes
        stand, thing = np.full(len(cubes), stands), np.array(things)
        clouds.memory = replace(clouds.memory, cubes=replace(cubes, thing=thing, stands=stand))

    def test_cubes_are_of_what_most_beside_them_are_of(self, clouds):
        block = np.ascontiguousarray(np.argwhere(np.ones((4, 3, 3)))) + [50, 0, 25]
        clouds.show_for(2.0 * MOMENT, NOTHING)
        clouds.show(block)
        self.set_things(clouds, [1] * 18 + [2] * 17 + [1], True)
        expected = np.array([1] * 18 + [2] * 18)
        assert clouds.show(block).seen.thing.tolist() == expected.tolist()
        # A cloud later all of them are one cube farther.
        self.set_things(clouds, expected.tolist(), True)
        assert clouds.show(block + [0, 1, 0]).seen.thing.tolist() == expected.tolist()

    def test_of_what_is_far_from_all_that_was_seen_last_nothing_is_known(self, clouds):
        clouds.show_for(2.0 * MOMENT, NOTHING)
        clouds.show(ONE)
        self.set_things(clouds, [7], True)
        assert clouds.show(np.concatenate([BESIDE, APART])).seen.thing.tolist() == [7, -1]
        self.set_things(clouds, [7, 8] + [7] * (len(clouds.memory.cubes) - 2), True)
        clouds.show(NOTHING)
        assert clouds.show(ONE).seen.thing.tolist() == [-1]

    @pytest.mark.parametrize(("stands", "after"), [(True, STOOD), (False, STOPPED)])
    def test_what_has_moved_stands_after_a_longer_time(self, clouds, stands, after):
        assert STOPPED > STOOD + 2 * PERIOD
        begin = clouds.time
        known = clouds.show(ONE)
        while clouds.time < begin + after:
            assert known.seen.stands.tolist() == [False]
            self.set_things(clouds, [1] + [0] * (len(clouds.memory.cubes) - 1), stands)
            known = clouds.show(ONE)
        self.set_things(clouds, [1] + [0] * (len(clouds.memory.cubes) - 1), stands)
        clouds.show(ONE)
        self.set_things(clouds, [1] + [0] * (len(clouds.memory.cubes) - 1), stands)
        assert clouds.show(ONE).seen.stands.tolist() == [True]

    @pytest.mark.parametrize("moves", [True, False])
    def test_more_of_what_moves_comes_out_from_behind_something_else(self, clouds, moves):
        clouds.show(ONE, HIDDEN)
        self.set_things(clouds, [1] + [0] * (len(clouds.memory.cubes) - 1), not moves)
        assert clouds.show(BESIDE, THROUGH).seen.stands.tolist() == [not moves]


class TestUnseen:
    def test_counts_on_for_a_moment(self, clouds):
        clouds.show_for(1.1 * STOOD, ONE)
        last = clouds.time
        while clouds.time + PERIOD < last + MOMENT:
            recalled = clouds.show(NOTHING)
            np.testing.assert_array_equal(recalled.unseen.places, ONE)
            assert recalled.hidden.tolist() == [False]
        assert len(clouds.show(NOTHING, passed=2.0 * PERIOD).unseen) == 0

    def test_is_not_what_is_seen_again(self, clouds):
        clouds.show(ONE)
        clouds.show(NOTHING)
        np.testing.assert_array_equal(clouds.show(ONE).unseen.places, ELSEWHERE)
        assert len(clouds.show(np.concatenate([ONE, ELSEWHERE])).unseen) == 0

    @pytest.mark.parametrize(
        ("sight", "kept"), [(HIDDEN, True), (BLIND, False), (THROUGH, False)], ids=["hidden", "unknown", "open"]
    )
    def test_counts_on_as_long_as_it_is_hidden(self, clouds, sight, kept):
        clouds.show_for(1.1 * STOOD, ONE)
        recalled = clouds.show_for(20.0, NOTHING, sight)
        np.testing.assert_array_equal(recalled.unseen.places, ONE if kept else NOTHING)
        assert recalled.hidden.all()

    def test_counts_on_for_a_moment_alone_if_it_does_not_stand(self, clouds):
        clouds.show_for(0.9 * STOOD, ONE)
        assert len(clouds.show_for(0.9 * MOMENT, NOTHING, HIDDEN).unseen) == 1
        assert len(clouds.show_for(0.2 * MOMENT, NOTHING, HIDDEN).unseen) == 0

    def test_is_forgotten_at_once_where_the_camera_sees_through_it(self, clouds):
        clouds.show_for(1.1 * STOOD, ONE)
        clouds.show_for(5.0, NOTHING, HIDDEN)
        assert len(clouds.show(NOTHING, THROUGH).unseen) == 0
        # The control: a camera that sees nothing there.
        clouds.show_for(1.1 * STOOD, ONE)
        assert len(clouds.show(NOTHING).unseen) == 1

    def test_is_nothing_that_a_later_cloud_has_shown(self, clouds):
        clouds.show(ONE)
        assert len(clouds.show(NOTHING, passed=-0.1).unseen) == 0


class TestOfLate:
    def test_places_of_what_stands_are_averaged_and_of_what_does_not_they_are_new(self, clouds):
        clouds.show_for(1.1 * STOOD, ONE)
        random = np.random.default_rng(0)
        standing, new = [], []
        for off in random.uniform(-0.01, 0.01, 30):
            means = clouds.show(np.concatenate([ONE, ELSEWHERE + 5]), off=off).seen.means
            standing.append(means[0, 0] - EDGE * ONE[0, 0])
            new.append(means[1, 0] - EDGE * (ELSEWHERE[0, 0] + 5) - off)
        assert 0.0 < np.std(standing) < 0.004
        np.testing.assert_allclose(new, 0.0, atol=1e-12)
        # What it is averaged over is forgotten.
        clouds.show_for(3.0 * AVERAGED, ONE)
        for _ in range(round(5.0 * AVERAGED / PERIOD)):
            means = clouds.show(ONE, off=0.01).seen.means
        np.testing.assert_allclose(means, EDGE * ONE + 0.01, atol=1e-3)

    @pytest.mark.parametrize(("every", "least", "most"), [(1, OFTEN, 1.0), (2, SELDOM, OFTEN), (10, 0.0, SELDOM)])
    def test_a_share_is_of_the_clouds_in_which_a_cube_is_seen(self, clouds, every, least, most):
        shares = []
        for number in range(300):
            recalled = clouds.show(ONE if number % every == 0 else NOTHING)
            shares.extend(share for one in (recalled.seen, recalled.unseen) for share in one.share if len(one) == 1)
        assert least < np.mean(shares[100:]) <= most

    def test_what_is_hidden_does_not_lose_its_share(self, clouds):
        before = clouds.show_for(1.1 * STOOD, ONE).seen.share
        np.testing.assert_array_equal(clouds.show_for(5.0, NOTHING, HIDDEN).unseen.share, before)
        assert np.all(clouds.show_for(0.4 * MOMENT, NOTHING, BLIND).unseen.share < before)


@pytest.mark.parametrize(
    ("place", "shares", "noise"),
    [
        (BESIDE, (OFTEN + 0.1, SELDOM - 0.1), True),
        (BESIDE + [0, 0, 1], (OFTEN + 0.1, SELDOM - 0.1), True),
        (BESIDE, (OFTEN + 0.1, SELDOM + 0.1), False),
        (BESIDE, (OFTEN - 0.1, SELDOM - 0.1), False),
        (APART, (OFTEN + 0.1, SELDOM - 0.1), False),
    ],
)
def test_what_is_seen_seldom_beside_what_is_seen_often_is_noise(place, shares, noise):
    places = np.concatenate([ONE, place])
    found = flickering(places, GRID.numbered(places), GRID.first, np.array(shares))
    assert found.tolist() == [False, noise]
