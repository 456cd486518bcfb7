"""Clusters over several clouds: which is which, how they move, and what becomes of what is hidden."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from geodesic_motion_ros.geometry.clusters import Cluster
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.obstacles.cluster_tracks import SAME_SIZE, STEADY_SIZE
from geodesic_motion_ros.obstacles.tracker import ObstacleSet, ObstacleTracker

RATE, AROUND, RADIUS = 30.0, 0.01, 0.05
HERE, VELOCITY = np.array([0.4, 0.1, 0.5]), np.array([0.2, -0.1, 0.05])


def ball(centre: Sequence[float] | np.ndarray, radius: float = RADIUS) -> Cluster:
    """All of a ball."""
    x, y, z = (float(c) for c in centre)
    return Cluster((x, y, z), (radius,) * 3, np.array([[x, y, z, radius]]))


class Clouds:
    """A tracker that is handed clusters thirty times a second."""

    def __init__(self) -> None:
        self.tracker, self.number = ObstacleTracker(), 0

    @property
    def now(self) -> float:
        return self.number / RATE

    def show(self, *clusters: Cluster, moment: float = MOMENT) -> ObstacleSet:
        """The obstacles after the next cloud."""
        self.number += 1
        self.tracker.replace_cloud(
            "obstacle_cloud", DistanceField.none(), self.now, clusters=clusters, around=AROUND, moment=moment
        )
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
    assert np.all(known.radii <= RADIUS + AROUND + 10.0 * noise + 1e-9)


def test_what_is_hidden_of_a_cluster_is_neither_lost_nor_a_motion():
    """An edge passes over a ball that stands, until a third of it is seen."""
    clouds = Clouds()
    for _ in range(30):
        clouds.show(ball(HERE))
    for share in np.linspace(1.0, 0.3, 30):
        seen = ball(HERE, share * RADIUS)
        # Of the box the lower side goes on with the edge.
        middle = HERE + [(1.0 - share) * RADIUS, 0.0, 0.0]
        half = share * RADIUS, RADIUS, RADIUS
        spheres = seen.spheres + np.array([*(middle - HERE), 0.0])
        known = clouds.show(Cluster(tuple(middle), half, spheres))
        reached = np.linalg.norm(known.centres - HERE, axis=1) + RADIUS
        # What the steps of pixels might be is taken as it is seen.
        assert np.min(reached - known.radii) <= STEADY_SIZE
    np.testing.assert_allclose(known.velocities, 0.0, atol=0.01)
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
        known = clouds.show(Cluster(tuple(place), (0.11, 0.05, 0.05), spheres + np.array([*place, 0.0])))
    assert len(known) == 1
    np.testing.assert_allclose(known.centres, place + spheres[:, :3], atol=1e-6)
    np.testing.assert_allclose(known.radii, spheres[:, 3] + AROUND, atol=1e-6)
    np.testing.assert_allclose(known.velocities, [VELOCITY] * 2, atol=1e-6)


def test_a_cluster_is_named_by_its_cloud_and_is_forgotten_with_it():
    clouds = Clouds()
    known = clouds.show(ball(HERE))
    assert known.names == ("the point cloud of obstacle_cloud",)
    clouds.tracker.clear()
    assert len(clouds.tracker.current(clouds.now)) == 0
