"""Things: what hangs together is a cluster if it is small, stands or moves as its cubes do, and is cubes otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.geometry.line_of_sight import LineOfSight
from geodesic_motion_ros.geometry.voxels import VoxelGrid
from geodesic_motion_ros.obstacles.cloud_memory import NEW_SHARE, OFTEN, SELDOM, CloudMemory, Cubes
from geodesic_motion_ros.obstacles.things import (
    APART_CUBES,
    FEWEST_CUBES,
    GAP,
    LARGEST,
    MOST_CLUSTERS,
    MOST_PARTS,
    MOST_SPHERES,
    WHOLE_SHARE,
    Things,
    find_things,
)

EDGE = 0.02
GRID = VoxelGrid.around(np.zeros(3), 1.0, EDGE)
NONE = Cubes.none()
Where = tuple[int, int, int]


def block(corner: Where, shape: Where = (3, 3, 3), stands: bool = True, share: float = 1.0, thing: int = -1) -> Cubes:
    """Cubes from a corner on, with the middles of their points a little off their own."""
    places = np.ascontiguousarray(np.argwhere(np.ones(shape)) + corner)
    means = EDGE * places + np.random.default_rng(0).uniform(-0.004, 0.004, places.shape)
    spreads, sight = np.zeros((len(places), 6)), LineOfSight.blank(None)
    seen = CloudMemory.nothing(EDGE).recall(places, means, spreads, 0.0, GRID, sight).seen
    stand, shares = np.full(len(places), stands), np.full(len(places), share)
    return replace(seen, stands=stand, share=shares, thing=np.full(len(places), thing))


def find(*seen: Cubes, remembered: Cubes = NONE, points: int = 10, numbered: int = 0) -> Things:
    together = NONE
    for one in seen:
        together = together.beside(one)
    return find_things(together, np.full(len(together), points), remembered, GRID, numbered)


def field_places(things: Things) -> np.ndarray:
    seen = things.cubes.only(np.arange(len(things.of_seen)))
    clusters = things.clusters(seen.means, seen.spreads, None)
    return things.field_places(clusters, EDGE)


def same(places: np.ndarray, *expected: Cubes) -> bool:
    """Whether places (n, 3) are those of cubes, in any order."""
    return sorted(map(tuple, places.tolist())) == sorted(
        tuple(place) for one in expected for place in one.places.tolist()
    )


@pytest.mark.parametrize("stands", [True, False])
def test_a_small_thing_is_a_cluster_and_moves_unless_its_cubes_stand(stands):
    seen = block((5, 5, 5), stands=stands)
    things = find(seen)
    (cluster,) = things.clusters(seen.means, seen.spreads, None)
    assert cluster.stands is stands
    assert things.moves[things.of_seen].tolist() == [not stands] * len(seen)
    np.testing.assert_array_equal(cluster.points, seen.means)
    assert len(field_places(things)) == 0


@pytest.mark.parametrize(("new", "moves"), [(0, False), (9, False), (11, True)])
def test_it_stands_but_for_a_few_new_cubes(new, moves):
    seen = block((5, 5, 5), (4, 5, 5))
    assert NEW_SHARE == 0.1
    seen.stands[np.random.default_rng(1).permutation(100)[:new]] = False
    things = find(seen)
    assert things.moves[things.of_seen].tolist() == [moves] * len(seen)


@pytest.mark.parametrize("stands", [True, False])
def test_what_is_large_or_of_few_cubes_stands_cube_by_cube(stands):
    longest = round(2.0 * LARGEST / EDGE)
    large, tiny = block((0, 0, 0), (longest + 2, 1, 1), stands), block((0, 20, 0), (FEWEST_CUBES - 1, 1, 1), stands)
    things = find(large, tiny)
    assert things.clusters(things.cubes.means, things.cubes.spreads, None) == ()
    assert same(field_places(things), large, tiny)
    assert not things.moves.any()
    # The controls: a little less, and one more.
    other = find(block((0, 0, 0), (longest - 2, 1, 1), stands), block((0, 20, 0), (FEWEST_CUBES, 1, 1), stands))
    assert len(other.clusters(other.cubes.means, other.cubes.spreads, None)) == 2


@pytest.mark.parametrize(("cubes", "things"), [(APART_CUBES, 2), (APART_CUBES - 1, 1)], ids=["two", "a part"])
def test_what_touches_with_cubes_whose_points_are_apart_is_two(cubes, things):
    one, other = block((0, 0, 0)), block((0, 3, 0), (cubes, 1, 1))
    far = replace(other, means=other.means + [0.0, (GAP - 0.5) * EDGE, 0.0])
    assert len(find(one, far).chosen) == things
    # The controls: they are near, and it is known that they are one.
    assert len(find(one, other).chosen) == 1
    assert len(find(replace(one, thing=np.full(27, 1)), replace(far, thing=np.full(cubes, 1)), numbered=1).chosen) == 1


def test_what_is_large_is_one_however_far_apart_its_points_are():
    wall = block((0, 0, 0), (20, 30, 1))
    # Two rows are nearer to each other, and the next two.
    coarse = replace(
        wall, means=wall.means + 0.45 * EDGE * np.where(wall.places[:, 1:2] // 2 % 2, 1.0, -1.0) * [0, 1, 0]
    )
    things = find(coarse)
    assert len(things.chosen) == 0
    assert same(field_places(things), wall)


def test_what_touches_is_one_and_what_does_not_is_two():
    one, touching, apart = block((0, 0, 0)), block((3, 1, 1)), block((4, 0, 0))
    assert len(find(one, touching).chosen) == 1
    assert len(find(one, apart).chosen) == 2


def numbers(things: Things) -> dict[int, tuple[int, int]]:
    """How many points each cluster is of, and what it was a part of, by its number."""
    clusters = things.clusters(things.cubes.means, things.cubes.spreads, None)
    assert len({cluster.number for cluster in clusters}) == len(clusters)
    return {cluster.number: (len(cluster.points), cluster.part_of) for cluster in clusters}


@pytest.mark.parametrize("stands", [True, False])
class TestNumbers:
    def test_are_new_for_what_is_new_and_stay(self, stands):
        things = find(block((0, 0, 0), stands=stands), block((9, 0, 0), (3, 3, 2), stands), numbered=5)
        assert numbers(things) == {6: (27, 0), 7: (18, 0)}
        assert things.numbered == 7
        again = find(block((0, 0, 0), stands=stands, thing=7), block((9, 0, 0), (3, 3, 2), stands, thing=6), numbered=7)
        assert numbers(again) == {7: (27, 7), 6: (18, 6)}
        assert again.numbered == 7

    def test_what_was_apart_stays_apart(self, stands):
        one, other = block((0, 0, 0), stands=stands, thing=1), block((3, 0, 0), stands=stands, thing=2)
        assert numbers(find(one, other, numbered=2)) == {1: (27, 1), 2: (27, 2)}
        # The control: nothing is known of them.
        assert numbers(find(block((0, 0, 0), stands=stands), block((3, 0, 0), stands=stands))) == {1: (54, 0)}

    def test_cubes_of_which_nothing_is_known_are_of_what_they_touch(self, stands):
        known, new = block((0, 0, 0), stands=stands, thing=1), block((3, 0, 0), (5, 3, 3), stands)
        assert numbers(find(known, new, numbered=1)) == {1: (72, 1)}

    @pytest.mark.parametrize(("length", "numbered"), [(3, {2, 3}), (9, {1, 2})], ids=["two", "one that lost little"])
    def test_parts_are_new_things_but_for_most_of_one(self, stands, length, numbered):
        parts = block((0, 0, 0), (3, 3, length), stands, thing=1), block((9, 0, 0), (3, 3, 2), stands, thing=1)
        assert (len(parts[0]) > WHOLE_SHARE * (len(parts[0]) + len(parts[1]))) is (length == 9)
        found = numbers(find(*parts, numbered=1))
        assert set(found) == numbered
        assert {part_of for _, part_of in found.values()} == {1}


class TestLarge:
    """Small things beside a table."""

    TABLE = block((-30, -30, 0), (60, 60, 1), thing=0)

    def test_what_moves_is_not_of_it(self):
        things = find(self.TABLE, block((0, 0, 1), stands=False, thing=1), numbered=1)
        assert numbers(things) == {1: (27, 1)}
        assert same(field_places(things), self.TABLE)
        assert set(things.numbers.tolist()) == {1, 0, -1}

    def test_what_stands_on_it_is(self):
        on_it, beside = block((0, 0, 1), thing=1), block((0, 0, 3), thing=2)
        things = find(self.TABLE, on_it, numbered=2)
        assert same(field_places(things), self.TABLE, on_it)
        assert things.numbers[things.of_seen].tolist() == [0] * (len(self.TABLE) + len(on_it))
        # The control: it does not touch it.
        assert numbers(find(self.TABLE, beside, numbered=2)) == {2: (27, 2)}

    def test_what_is_too_small_for_a_thing_has_no_number(self):
        things = find(self.TABLE, block((0, 0, 9), (1, 1, FEWEST_CUBES - 1)))
        assert set(things.numbers[things.of_seen].tolist()) == {0, -1}


class TestRemembered:
    def test_belongs_to_what_it_touches_that_stands(self):
        seen, unseen = block((5, 5, 5)), block((8, 5, 5))
        things = find(seen, remembered=unseen)
        (cluster,) = things.clusters(seen.means, seen.spreads, None)
        np.testing.assert_array_equal(cluster.points, seen.means)
        # It is covered as well.
        together = np.concatenate([seen.means, unseen.means])
        np.testing.assert_array_equal(cluster.covered, together)
        gaps = np.linalg.norm(together[:, None] - cluster.spheres[:, :3], axis=2) - cluster.spheres[:, 3]
        assert np.max(np.min(gaps, axis=1)) <= 1e-9
        assert np.any(np.linalg.norm(together - cluster.centre, axis=1) > np.max(cluster.half) + EDGE)
        assert len(field_places(things)) == 0

    def test_of_what_moves_it_stays_where_it_was(self):
        seen, unseen = block((5, 5, 5), stands=False), block((8, 5, 5), (6, 3, 3))
        things = find(seen, remembered=unseen)
        fresh = seen.means + 0.001
        (cluster,) = things.clusters(fresh, seen.spreads, None)
        assert not cluster.stands
        np.testing.assert_array_equal(cluster.points, fresh)
        # But for what it covers.
        places = set(map(tuple, field_places(things).tolist()))
        assert (8, 6, 6) not in places
        assert places >= set(map(tuple, unseen.places[unseen.places[:, 0] > 10].tolist()))

    def test_is_a_thing_of_its_own_if_it_touches_nothing(self):
        seen, unseen = block((5, 5, 5), stands=False), block((15, 5, 5))
        things = find(seen, remembered=unseen)
        assert sorted(cluster.stands for cluster in things.clusters(seen.means, seen.spreads, None)) == [False, True]
        # A thing of which nothing is seen has no new cubes.
        assert not things.moves[things.of_cube[len(seen) :]].any()


class TestNoise:
    @pytest.mark.parametrize(("share", "joined"), [(SELDOM - 0.1, False), (SELDOM + 0.1, True)])
    def test_joins_nothing_and_is_nowhere(self, share, joined):
        left, right = block((0, 0, 0), share=OFTEN + 0.1), block((4, 0, 0), share=OFTEN + 0.1)
        between = block((3, 1, 1), (1, 1, 1), share=share)
        things = find(left, between, right)
        assert len(things.chosen) == (1 if joined else 2)
        assert (things.of_cube[len(left)] >= 0) is np.bool_(joined)
        clusters = things.clusters(things.cubes.means, things.cubes.spreads, None)
        held = np.concatenate([cluster.points for cluster in clusters])
        assert len(held) == len(left) + len(right) + joined
        assert len(field_places(things)) == 0

    @pytest.mark.parametrize(("points", "share", "counts"), [(1, 0.2, False), (1, 0.4, True), (2, 0.2, True)])
    def test_is_a_point_by_itself_that_is_seen_seldom(self, points, share, counts):
        assert 0.2 < SELDOM < 0.4
        assert len(field_places(find(block((0, 0, 0), (1, 1, 1), share=share), points=points))) == counts

    def test_does_not_make_a_table_move_nor_larger(self):
        table = block((-30, -30, 0), (60, 60, 1))
        things = find(table, block((0, 0, 1), (5, 5, 1), stands=False, share=SELDOM - 0.1))
        assert same(field_places(things), table)


class TestMany:
    """More small things than become clusters: rows of rods."""

    @staticmethod
    def rods(count: int, stands: bool, row: int) -> list[Cubes]:
        return [block((3 * number - 40, row, 0), (1, 1, 4 + number), stands) for number in range(count)]

    def test_those_that_move_and_the_largest_are_taken(self):
        standing, moving = self.rods(MOST_CLUSTERS, True, 0), self.rods(3, False, 10)
        things = find(*standing, *moving)
        assert len(things.chosen) == MOST_CLUSTERS
        assert same(field_places(things), *standing[:3])

    def test_those_that_move_and_are_one_too_many_stand(self):
        moving = self.rods(MOST_CLUSTERS + 2, False, 0)
        things = find(*moving)
        assert same(field_places(things), *moving[:2])
        assert np.count_nonzero(things.moves) == MOST_CLUSTERS
        assert not things.moves[things.of_seen[: len(moving[0]) + len(moving[1])]].any()

    @pytest.mark.parametrize("count", [1, 3, MOST_CLUSTERS])
    def test_there_are_no_more_spheres_than_allowed(self, count):
        rods = [block((4 * number - 40, 0, 0), (1, 20, 1)) for number in range(count)]
        things = find(*rods)
        spheres = [len(cluster.spheres) for cluster in things.clusters(things.cubes.means, things.cubes.spreads, None)]
        assert len(spheres) == count
        assert sum(spheres) <= MOST_SPHERES
        assert 1 < max(spheres) <= MOST_PARTS


def test_no_cubes_are_no_things():
    things = find()
    assert things.clusters(np.zeros((0, 3)), np.zeros((0, 6)), None) == ()
    assert (len(field_places(things)), len(things.cubes)) == (0, 0)
