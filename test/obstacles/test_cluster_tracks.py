"""Clusters over several clouds: which is which, how they move, and what becomes of what is hidden."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from geodesic_motion_ros.geometry.clusters import Cluster
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.line_of_sight import LineOfSight
from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.obstacles.cluster_tracks import HIDDEN
from geodesic_motion_ros.obstacles.tracked_cluster import GROWN, LEAST_NOISE, SAME_SIZE, STEADY_SIZE, STEADY_SPHERE
from geodesic_motion_ros.obstacles.tracker import ObstacleSet, ObstacleTracker

RATE, AROUND, RADIUS = 30.0, 0.01, 0.05
HERE, VELOCITY = np.array([0.4, 0.1, 0.5]), np.array([0.2, -0.1, 0.05])


def ball(centre: Sequence[float] | np.ndarray, radius: float = RADIUS) -> Cluster:
    """All of a ball."""
    x, y, z = (float(c) for c in centre)
    points = np.array([x, y, z]) + radius * np.concatenate([np.eye(3), -np.eye(3)])
    return Cluster((x, y, z), (radius,) * 3, points, points, np.array([[x, y, z, radius]]))


class Clouds:
    """A tracker that is handed clusters thirty times a second."""

    def __init__(self) -> None:
        self.tracker, self.number = ObstacleTracker(), 0

    @property
    def now(self) -> float:
        return self.number / RATE

    def show(self, *clusters: Cluster, moment: float = MOMENT, sight: LineOfSight | None = None) -> ObstacleSet:
        """The obstacles after the next cloud."""
        self.number += 1
        self.tracker.replace_cloud(
            "obstacle_cloud", DistanceField.none(), self.now, clusters=clusters, around=AROUND, moment=moment,
            sight=sight,
        )  # fmt: skip
        return self.tracker.current(self.now)


@pytest.mark.parametrize("velocity", [np.zeros(3), VELOCITY], ids=["stands", "moves"])
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_cluster_is_known_with_its_velocity_as_a_marker_is(velocity, noise):
    clouds, random = Clouds(), np.random.default_rng(0)
    for number in range(60):
        place = HERE + (number + 1) / RATE * velocity
        known = clouds.show(ball(place + noise * random.normal(size=3)))
    assert set(known.labels) == {"obstacle_cloud/cluster/0"}
    np.testing.assert_allclose(known.velocities, [velocity] * len(known), atol=0.02)
    reached = np.linalg.norm(known.centres - place, axis=1) + RADIUS + AROUND
    # Bounds of the place hold the noise.
    assert np.all(reached <= known.radii + 3.0 * noise + 1e-9)
    assert np.all(known.radii <= RADIUS + AROUND + 10.0 * max(noise, LEAST_NOISE))


def test_what_is_hidden_of_a_cluster_is_neither_lost_nor_a_motion():
    """An edge passes over a ball that stands, at 7 cm / s, until a third of it is seen."""
    clouds, eye = Clouds(), np.array([1.4, -0.8, 1.2])
    random = np.random.default_rng(1).normal(size=(3000, 3))
    directions = random / np.linalg.norm(random, axis=1, keepdims=True)
    whole, across = HERE + RADIUS * directions, np.cross(eye - HERE, [0.0, 0.0, 1.0])
    front, across = np.sum(directions * (eye - whole), axis=1) > 0.0, across / np.linalg.norm(across)
    for share in np.concatenate([np.ones(30), np.linspace(1.0, 0.3, 30)]):
        seen = front & (directions @ across >= 1.0 - 2.0 * share)
        known = clouds.show(Cluster.of(whole[seen], 32, eye))
        outside = np.min(np.linalg.norm(whole[:, None] - known.centres, axis=2) - known.radii, axis=1)
        # What the steps of pixels might be is taken as it is seen.
        assert np.max(outside) <= STEADY_SIZE
        assert np.max(np.linalg.norm(known.velocities, axis=1)) < 0.035
    assert set(known.labels) == {"obstacle_cloud/cluster/0"}


def test_what_is_not_seen_any_more_moves_on_for_a_moment():
    clouds = Clouds()
    for number in range(30):
        clouds.show(ball(HERE + (number + 1) / RATE * VELOCITY))
    last = clouds.now
    while clouds.now < last + MOMENT - 1.0 / RATE:
        known = clouds.show()
        place = HERE + clouds.now * VELOCITY
        there = known.moved_on(clouds.now, 1.0, 0.0)
        assert np.min(np.linalg.norm(there.centres - place, axis=1)) < 0.01
    clouds.number += 2
    assert len(clouds.tracker.current(clouds.now)) == 0


@pytest.mark.parametrize(("wall", "lasts"), [(0.1, HIDDEN), (3.0, MOMENT)], ids=["hidden", "in view"])
def test_what_moves_and_is_hidden_goes_on_as_it_did(wall, lasts):
    """A wall is seen so far from the camera [m], in all directions."""
    blank = LineOfSight.blank(np.zeros(3))
    sight, clouds = LineOfSight(blank.eye, np.full_like(blank.nearest, wall**2)), Clouds()
    for number in range(30):
        clouds.show(ball(HERE + (number + 1) / RATE * VELOCITY))
    last = clouds.now
    while clouds.now < last + lasts - 1.5 / RATE:
        there = clouds.show(sight=sight).moved_on(clouds.now, HIDDEN, 0.0)
        place = HERE + clouds.now * VELOCITY
        assert np.min(np.linalg.norm(there.centres - place, axis=1) - there.radii) < 0.0
    clouds.show(sight=sight)
    assert len(clouds.show(sight=sight)) == 0


def test_of_what_comes_out_into_view_the_velocity_is_worked_out_anew():
    """The middle of what is seen of it moves, and that is no motion of the whole."""
    clouds, random = Clouds(), np.random.default_rng(1).normal(size=(2000, 3))
    points = HERE + 2.0 * RADIUS * random / np.linalg.norm(random, axis=1, keepdims=True)
    # In the second of these clouds it is larger than in the first one by more than what says so.
    assert 2.0 * RADIUS * (1.0 - 0.75) > GROWN
    for share in np.concatenate([np.linspace(0.5, 0.75, 20), np.ones(10)]):
        seen = points[points[:, 0] >= HERE[0] + 2.0 * (1.0 - 2.0 * share) * RADIUS]
        known = clouds.show(Cluster.of(seen, 1, None))
    np.testing.assert_allclose(known.velocities, 0.0, atol=0.01)


DIRECTIONS = np.random.default_rng(1).normal(size=(200, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def round_thing(centre: np.ndarray, least: float = -1.0, off: float = 0.0, is_ball: bool = True) -> Cluster:
    """A ball that is seen from +x, as far as directions from its middle have at least so much of that; its own fit is
    off by so much [m] along x, as if it were larger by that.
    """
    directions = DIRECTIONS[(DIRECTIONS[:, 0] >= 0.0) & (DIRECTIONS[:, 1] >= least)]
    points = centre + RADIUS * directions
    lower, upper = np.min(points, axis=0), np.max(points, axis=0)
    fit = np.array([*(centre - [off, 0.0, 0.0]), RADIUS + off])
    middle, half = tuple((0.5 * (lower + upper)).tolist()), tuple((0.5 * (upper - lower)).tolist())
    return Cluster(middle, half, points, points, fit[None], fit if is_ball else None)


class TestBall:
    """What is known to be a ball has its middle."""

    def test_is_as_large_as_it_is_on_average(self):
        """So what a fit errs by along the line of sight is no motion."""
        clouds, random = Clouds(), np.random.default_rng(0)
        for number in range(60):
            place = HERE + (number + 1) / RATE * VELOCITY
            known = clouds.show(round_thing(place, off=0.004 * random.normal()))
            if number > 20:
                np.testing.assert_allclose(known.velocities, [VELOCITY] * len(known), atol=0.02)
                assert np.max(known.radii) < RADIUS + AROUND + 0.008

    def test_holds_what_is_not_of_it_but_for_noise(self):
        """A few points of a finger, which are too few to make it none."""
        clouds = Clouds()
        for number in range(30):
            place = HERE + (number + 1) / RATE * VELOCITY
            clouds.show(round_thing(place))
        cluster = round_thing(place + VELOCITY / RATE)
        finger = place + VELOCITY / RATE + np.array([[RADIUS + out, 0.0, 0.0] for out in (0.01, 0.02, 0.03)])
        known = clouds.show(cluster._replace(points=np.concatenate([cluster.points, finger]), ball=None))
        outside = np.linalg.norm(finger[:, None] - known.centres, axis=2) - known.radii
        assert len(known) == 1
        assert np.max(outside) <= STEADY_SPHERE

    @pytest.mark.parametrize("is_ball", [True, False])
    def test_that_is_hidden_more_and_more_moves_on_as_it_does(self, is_ball):
        clouds, errors = Clouds(), []
        for number, least in enumerate(np.concatenate([np.full(30, -1.0), np.linspace(-1.0, 0.3, 15)])):
            place = HERE + (number + 1) / RATE * VELOCITY
            known = clouds.show(round_thing(place, least, is_ball=is_ball))
            errors.append(np.max(np.linalg.norm(known.velocities - VELOCITY, axis=1)))
        assert bool(max(errors[20:]) < 0.01) is is_ball

    @pytest.mark.parametrize("every", [2, 7])
    def test_that_is_none_in_some_clouds_has_not_moved_by_that(self, every):
        clouds = Clouds()
        for number in range(60):
            place = HERE + (number + 1) / RATE * VELOCITY
            other = round_thing(place, is_ball=False)
            if number % every:
                # No ball of that radius either.
                bent = other.points + np.outer(0.02 * (other.points[:, 1] - place[1] > 0.0), [1.0, 0.0, 0.0])
                known = clouds.show(other._replace(points=bent))
            else:
                known = clouds.show(round_thing(place))
            if number > 20:
                np.testing.assert_allclose(known.velocities, [VELOCITY] * len(known), atol=0.02)


class TestNumbered:
    """What moves has a number in all clouds."""

    def test_goes_on_by_its_number(self):
        """Two of a size change their places in one cloud, or else their names."""
        there = HERE + [0.12, 0.0, 0.0]
        for numbers, swapped in (((1, 2), True), ((0, 0), False)):
            clouds = Clouds()
            for _ in range(10):
                clouds.show(*(ball(at)._replace(number=n) for at, n in zip((HERE, there), numbers, strict=True)))
            known = clouds.show(*(ball(at)._replace(number=n) for at, n in zip((there, HERE), numbers, strict=True)))
            newest = dict(zip(known.labels, known.centres, strict=True))
            assert np.allclose(newest["obstacle_cloud/cluster/0"], there, atol=0.03) is swapped

    @pytest.mark.parametrize("part_of", [1, 0])
    def test_parts_move_on_as_the_whole_did(self, part_of):
        clouds, apart = Clouds(), np.array([0.0, 0.07, 0.0])
        for number in range(30):
            place = HERE + (number + 1) / RATE * VELOCITY
            whole = ball(place, 0.12)._replace(number=1)
            clouds.show(whole)
        place = place + VELOCITY / RATE
        known = clouds.show(*(
            ball(place + side * apart)._replace(number=number, part_of=part_of) for side, number in ((1, 2), (-1, 3))
        ))  # fmt: skip
        parts = [label.endswith(("/1", "/2")) for label in known.labels]
        # What has parted is not there any more beside its parts.
        assert (sum(parts), len(parts)) == ((2, 2) if part_of else (2, 3))
        expected = [VELOCITY if part_of else np.zeros(3)] * 2
        np.testing.assert_allclose(known.velocities[parts], expected, atol=0.01)


class TestStanding:
    """Clusters that are known to stand."""

    @staticmethod
    def standing(offset: float = 0.0, spheres: int = 1) -> Cluster:
        """A rod along x, an end of it farther by an offset [m]."""
        points = HERE + np.column_stack([np.linspace(-0.1, 0.1 + offset, 50), *np.zeros((2, 50))])
        return Cluster.of(points, spheres, None, known=(points, np.zeros((50, 6))))

    def test_have_their_spheres_and_no_velocity(self):
        clouds, random = Clouds(), np.random.default_rng(0)
        for _ in range(60):
            cluster = self.standing(spheres=4)
            known = clouds.show(cluster._replace(centre=tuple(cluster.centre + 0.01 * random.normal(size=3))))
        np.testing.assert_allclose(known.centres, cluster.spheres[:, :3], atol=1e-12)
        np.testing.assert_allclose(known.radii, cluster.spheres[:, 3] + AROUND, atol=1e-12)
        assert not known.velocities.any()
        # The control: they are not known to stand.
        moving = Clouds()
        for number in range(30):
            known = moving.show(ball(HERE + number / RATE * VELOCITY)._replace(stands=False))
        assert known.velocities.any()

    @pytest.mark.parametrize(
        ("offset", "before", "after", "kept"),
        [(0.0, 4, 1, True), (0.0, 1, 4, False), (0.5 * STEADY_SPHERE, 1, 1, True), (2.0 * STEADY_SPHERE, 1, 1, False)],
        ids=["larger", "smaller", "noise", "grown"],
    )
    def test_keep_their_spheres_while_these_hold_their_points_and_no_smaller_ones_do(self, offset, before, after, kept):
        clouds = Clouds()
        before = clouds.show(self.standing(0.0, before))
        after = clouds.show(self.standing(offset, after))
        assert np.array_equal(before.centres, after.centres) is kept
        assert np.array_equal(before.radii, after.radii) is kept

    def test_have_new_spheres_once_they_move(self):
        clouds = Clouds()
        clouds.show(ball(HERE)._replace(stands=True))
        for number in range(60):
            place = HERE + (number + 1) / RATE * VELOCITY
            known = clouds.show(ball(place))
        assert set(known.labels) == {"obstacle_cloud/cluster/0"}
        np.testing.assert_allclose(known.velocities, [VELOCITY] * len(known), atol=0.05)
        assert np.all(np.linalg.norm(known.centres - place, axis=1) + RADIUS <= known.radii + 1e-9)

    def test_are_not_what_has_moved_away_from_their_place(self):
        """What is remembered of where it was is as large as it, and nearer to where it was last."""
        clouds = Clouds()
        for number in range(60):
            place = HERE + number / RATE * VELOCITY
            moving = ball(place)
            known = clouds.show(moving)
        stays = ball(place)._replace(stands=True)
        for number in range(60, 90):
            place = HERE + number / RATE * VELOCITY
            known = clouds.show(stays, ball(place))
            first = np.array([label.endswith("/0") for label in known.labels])
            np.testing.assert_allclose(known.velocities[first], [VELOCITY] * sum(first), atol=0.02)
            assert not known.velocities[~first].any()
        assert set(known.labels) == {"obstacle_cloud/cluster/0", "obstacle_cloud/cluster/1"}


def test_clouds_farther_apart_than_a_moment_keep_what_they_show():
    clouds = Clouds()
    clouds.show(ball(HERE))
    clouds.number += 60
    assert len(clouds.tracker.current(clouds.now)) == 1
    assert len(clouds.show()) == 0


def test_nothing_is_remembered_where_no_moment_is_allowed():
    clouds = Clouds()
    clouds.show(ball(HERE))
    assert len(clouds.show(moment=0.0)) == 0


def test_two_that_pass_each_other_keep_their_names():
    clouds = Clouds()
    apart, velocity = np.array([0.0, 0.12, 0.0]), np.array([0.3, 0.0, 0.0])
    for number in range(40):
        offset = (number / RATE - 0.6) * velocity
        known = clouds.show(ball(HERE + offset), ball(HERE - offset + apart, 0.04))
    assert len(set(known.labels)) == 2
    first = [label.endswith("/0") for label in known.labels]
    np.testing.assert_allclose(known.velocities[first], [velocity] * sum(first), atol=0.02)
    np.testing.assert_allclose(known.velocities[~np.array(first)], [-velocity] * (len(first) - sum(first)), atol=0.02)


def test_what_changes_its_size_at_once_is_another_one():
    clouds = Clouds()
    for _ in range(10):
        clouds.show(ball(HERE))
    assert set(clouds.show(ball(HERE, RADIUS + 0.9 * SAME_SIZE)).labels) == {"obstacle_cloud/cluster/0"}
    for _ in range(10):
        clouds.show(ball(HERE))
    known = clouds.show(ball(HERE, RADIUS + 1.1 * SAME_SIZE))
    assert set(known.labels) == {"obstacle_cloud/cluster/0", "obstacle_cloud/cluster/1"}


def test_each_sphere_of_a_cluster_moves_with_it():
    clouds = Clouds()
    spheres = np.array([[-0.06, 0.0, 0.0, 0.04], [0.06, 0.0, 0.0, 0.05]])
    for number in range(30):
        place = HERE + (number + 1) / RATE * VELOCITY
        of_place = spheres + np.array([*place, 0.0])
        known = clouds.show(Cluster(tuple(place), (0.11, 0.05, 0.05), of_place[:, :3], of_place[:, :3], of_place))
    assert len(known) == 1
    np.testing.assert_allclose(known.centres, place + spheres[:, :3], atol=1e-6)
    larger = known.radii - spheres[:, 3] - AROUND
    assert np.all((larger >= 0.0) & (larger <= 2.0 * LEAST_NOISE))
    np.testing.assert_allclose(known.velocities, [VELOCITY] * 2, atol=1e-6)


def test_a_cluster_is_named_by_its_cloud_and_is_forgotten_with_it():
    clouds = Clouds()
    known = clouds.show(ball(HERE))
    assert known.names == ("the point cloud of obstacle_cloud",)
    clouds.tracker.clear()
    assert len(clouds.tracker.current(clouds.now)) == 0
