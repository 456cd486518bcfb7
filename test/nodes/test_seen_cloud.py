"""What clouds show, from points to obstacles: the arm and the declared scene are none, the rest stands or moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from geodesic_motion_ros.geometry.distance_field import REACH, field_distances
from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.geometry.shapes import no_solids, solid_rows
from geodesic_motion_ros.nodes.seen_cloud import CloudSettings, SeenCloud, see_cloud
from geodesic_motion_ros.obstacles.cloud_memory import STOOD, STOPPED
from geodesic_motion_ros.obstacles.things import LARGEST
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import SelfFilter

SETTINGS, PERIOD = CloudSettings(0.02, 0.002, 0.05, 0.02), 1.0 / 30.0
EYE, RADIUS = np.array([1.4, -0.8, 1.2]), 0.05
BOTTLE = HeldObject("bottle", "cylinder", (0.04, 0.25), (0.0, 0.0, 0.05))
ROBOT = Robot.named("panda")
ARM = SelfFilter(ROBOT, CollisionModel.named("panda"))
#: Beside the arm where it is ready.
BESIDE, NOTHING = np.array([0.3, -0.6, 0.5]), np.zeros((0, 3))
#: Spheres of clusters hold the middles of what is in each cube; points stick out of them by no more [m].
STICKS_OUT = 0.002


def ball(centre: np.ndarray, radius: float = RADIUS) -> np.ndarray:
    """Points of the half that the camera sees, 5 mm apart at most."""
    count = round(16.0 * np.pi * radius**2 / 0.005**2)
    heights, turns = 1.0 - (2.0 * np.arange(count) + 1.0) / count, np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - heights**2)
    directions = np.column_stack([flat * np.cos(turns), flat * np.sin(turns), heights])
    points = centre + radius * directions
    return points[np.sum(directions * (EYE - points), axis=1) > 0.0]


def plate(centre: np.ndarray, along: np.ndarray, across: np.ndarray, step: float = 0.008) -> np.ndarray:
    """Points of a rectangle with half sides (3,) [m]."""
    u, v = (np.linspace(-1.0, 1.0, 1 + round(2.0 * np.linalg.norm(side) / step)) for side in (along, across))
    shares = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    return centre + shares @ [along, across]


def behind(centre: np.ndarray, distance: float = 0.3, half: float = 0.3) -> np.ndarray:
    """A wall so far behind a place, as the camera sees it [m]."""
    line = (centre - EYE) / np.linalg.norm(centre - EYE)
    along = np.cross(line, [0.0, 0.0, 1.0])
    along *= half / np.linalg.norm(along)
    return plate(centre + distance * line, along, np.cross(line, along))


class Clouds:
    """Clouds one after the other, thirty times a second."""

    def __init__(self, eye: np.ndarray | None = EYE, solids: np.ndarray | None = None) -> None:
        self.eye, self.solids = eye, no_solids() if solids is None else solids
        self.joints: np.ndarray | None = ROBOT.ready
        self.held: tuple[HeldObject, ...] = ()
        self.settings, self.time = SETTINGS, 0.0
        self.seen: SeenCloud | None = None

    def show(self, *points: np.ndarray, passed: float = PERIOD) -> SeenCloud:
        self.time += passed
        self.seen = see_cloud(
            np.concatenate([NOTHING, *points]), ARM, self.joints, self.held, self.solids, self.settings, self.time,
            self.seen, self.eye,
        )  # fmt: skip
        return self.seen

    def show_for(self, duration: float, *points: np.ndarray) -> SeenCloud:
        for _ in range(round(duration / PERIOD)):
            seen = self.show(*points)
        return seen


def gaps(points: np.ndarray) -> np.ndarray:
    """Signed distances (n,) [m] of points from the arm."""
    centres, radii = ARM.spheres(ROBOT.ready, ())
    return np.min(cdist(points, centres) - radii, axis=1)


def covered(seen: SeenCloud, points: np.ndarray) -> bool:
    """Whether points (n, 3) are all in what the clouds show."""
    away = np.full(len(points), np.inf)
    if seen.field.squares.size:
        away = field_distances(points, *seen.field)
    for cluster in seen.clusters:
        spheres = cluster.spheres
        outside = np.min(cdist(points, spheres[:, :3]) - spheres[:, 3] - seen.around, axis=1)
        away = np.minimum(away, outside - STICKS_OUT)
    return bool(np.all(away <= 1e-9))


def shows_nothing(seen: SeenCloud) -> bool:
    return not seen.clusters and not seen.field.squares.size


@pytest.mark.parametrize("eye", [EYE, None], ids=["camera", "unknown camera"])
def test_all_points_are_held_and_counted(eye):
    clouds, wall, table = Clouds(eye), behind(BESIDE), plate(np.array([0.5, 0.3, 0.1]), *0.3 * np.eye(3)[:2])
    centres, radii = ARM.spheres(ROBOT.ready, ())
    arm, far = centres + radii[:, None] * [0.0, 0.0, 1.0], np.array([[3.0, 0.0, 0.0]])
    seen = clouds.show(wall, table, ball(BESIDE), arm, far)
    near = np.concatenate([wall, table, ball(BESIDE)])
    assert covered(seen, near)
    assert (seen.points, seen.of_arm, seen.of_scene, seen.out_of_reach) == (len(near), len(arm), 0, 1)
    # The control: what nothing is near is not covered.
    assert not covered(seen, BESIDE[None] + [0.0, 0.0, 0.15])
    assert len(seen.clusters) == 1


def test_clouds_without_points_show_nothing():
    clouds = Clouds()
    assert shows_nothing(clouds.show())
    assert shows_nothing(clouds.show())


def test_without_joints_the_arm_is_an_obstacle():
    clouds = Clouds()
    points = ARM.spheres(ROBOT.ready, ())[0]
    assert clouds.show(points).of_arm == len(points)
    clouds.joints = None
    seen = clouds.show(points)
    assert (seen.of_arm, seen.points) == (0, len(points))


class TestBall:
    """In front of a wall."""

    @pytest.mark.parametrize("eye", [EYE, None], ids=["camera", "unknown camera"])
    @pytest.mark.parametrize("speed", [0.0, 0.1, 0.5])
    def test_moves_from_four_centimetres_a_second_on(self, eye, speed):
        clouds, wall = Clouds(eye), behind(BESIDE)
        direction = np.cross(BESIDE - EYE, [0.0, 0.0, 1.0])
        direction /= np.linalg.norm(direction)
        clouds.show(wall)
        for number in range(round(1.2 * STOPPED / PERIOD)):
            place = BESIDE + ((speed * number * PERIOD) % 0.3 - 0.15 * (speed > 0.0)) * direction
            seen = clouds.show(wall, ball(place))
        (cluster,) = seen.clusters
        assert cluster.stands is (speed == 0.0)
        assert covered(seen, ball(place))
        # The wall is behind it all the time.
        assert covered(seen, wall)
        (sphere,) = cluster.spheres
        if eye is not None:
            np.testing.assert_allclose(sphere, [*place, RADIUS], atol=0.015)

    def test_that_leaves_leaves_no_trace_where_the_wall_is_seen(self):
        clouds, wall = Clouds(), behind(BESIDE)
        clouds.show_for(1.2 * STOOD, wall, ball(BESIDE))
        seen = clouds.show(wall)
        assert (len(seen.clusters), seen.remembered) == (0, 0)

    @pytest.mark.parametrize("eye", [EYE, None], ids=["camera", "unknown camera"])
    def test_that_leaves_counts_for_a_moment_where_nothing_is_seen(self, eye):
        clouds = Clouds(eye)
        clouds.show_for(1.2 * STOOD, ball(BESIDE))
        assert covered(clouds.show_for(0.9 * MOMENT), ball(BESIDE))
        assert shows_nothing(clouds.show_for(0.2 * MOMENT))

    def test_that_is_hidden_stays(self):
        clouds, wall = Clouds(), behind(BESIDE)
        clouds.show_for(1.2 * STOOD, wall, ball(BESIDE))
        screen = behind(BESIDE, -0.3, 0.1)
        seen = clouds.show_for(3.0, wall, screen)
        assert covered(seen, ball(BESIDE))
        assert seen.remembered > 0
        # It was not where it is said to be while nobody looked.
        assert not covered(clouds.show(wall), BESIDE[None])

    def test_that_is_hidden_is_forgotten_after_a_moment_if_the_camera_is_not_known(self):
        clouds, wall = Clouds(None), behind(BESIDE)
        clouds.show_for(1.2 * STOOD, wall, ball(BESIDE))
        assert not covered(clouds.show_for(1.1 * MOMENT, wall, behind(BESIDE, -0.3, 0.1)), BESIDE[None])

    def test_that_is_uncovered_does_not_move(self):
        """A screen before it is taken away."""
        clouds, wall = Clouds(), behind(BESIDE)
        clouds.show_for(1.2 * STOOD, wall, behind(BESIDE, -0.3, 0.2))
        for _ in range(10):
            seen = clouds.show(wall, ball(BESIDE))
            assert covered(seen, ball(BESIDE))
            # Of the screen there may be a rest, for a moment.
            assert all(cluster.stands for cluster in seen.clusters)
        # The control: it was not there while that could be seen.
        other = Clouds()
        other.show_for(1.2 * STOOD, wall)
        assert [cluster.stands for cluster in other.show(wall, ball(BESIDE)).clusters] == [False]

    def test_that_is_too_large_is_cubes(self):
        wide = behind(BESIDE, 0.0, 1.1 * LARGEST)
        seen = Clouds().show(wide)
        assert seen.clusters == ()
        assert covered(seen, wide)


class TestTouchingTheArm:
    """A pebble beside the arm."""

    @pytest.fixture(scope="class")
    @classmethod
    def pebble(cls) -> Callable[[float], np.ndarray]:
        """Points of a pebble (40, 3) [m], its middle so far from the arm [m]."""
        centres, radii = ARM.spheres(ROBOT.ready, ())
        random, cluster = np.random.default_rng(4), np.random.default_rng(5).uniform(-0.005, 0.005, (40, 3))
        steps = np.array([0.01, 0.03, 0.06, 0.12])
        while True:
            sphere, direction = random.integers(len(radii) // 3, len(radii)), random.normal(size=3)
            direction /= np.linalg.norm(direction)
            place = centres[sphere] + radii[sphere] * direction
            if np.allclose(gaps(place + np.outer(steps, direction)), steps, atol=1e-6):
                return lambda distance: place + distance * direction + cluster

    @pytest.mark.parametrize("eye", [EYE, None], ids=["camera", "unknown camera"])
    def test_what_comes_within_the_padding_goes_on_for_a_moment(self, pebble, eye):
        """At half a metre a second, until it is on the arm: where it was seen, or as it moved."""
        clouds, tracker, speed = Clouds(eye), ObstacleTracker(), 0.5
        clouds.show()
        distance, seen_at, last_seen = 0.1, NOTHING, 0.0
        out = np.mean(pebble(1.0) - pebble(0.0), axis=0)

        def away(points: np.ndarray) -> float:
            """How far the farthest of points (n, 3) [m] is from what is known."""
            known = tracker.current(clouds.time).moved_on(clouds.time, 1.0, 0.0)
            result = np.full(len(points), np.inf)
            if known.cloud.squares.size:
                result = field_distances(points, *known.cloud)
            nearest = np.min(cdist(points, known.centres) - known.radii, axis=1, initial=np.inf)
            return float(np.max(np.minimum(result, nearest)))

        while not last_seen or clouds.time + PERIOD < last_seen + MOMENT:
            points = pebble(max(0.0, distance))
            outside = points[gaps(points) > SETTINGS.padding]
            seen = clouds.show(points)
            if len(outside):
                seen_at, last_seen = outside, clouds.time
            tracker.replace_cloud(
                "cloud", seen.field, clouds.time, clusters=seen.clusters, around=seen.around, sight=seen.memory.sight
            )
            goes_on = np.mean(pebble(0.0), axis=0) + distance * out
            assert min(away(seen_at), away(goes_on[None])) <= STICKS_OUT
            distance -= speed * PERIOD
        assert distance < -0.1
        # An obstacle that stays within the padding for longer is lost: the page says so.
        assert shows_nothing(clouds.show_for(0.2 * MOMENT, pebble(0.0)))

    def test_what_the_arm_comes_to_stays_too(self, pebble):
        """The pebble stands, and the arm's padding grows over it, as the tracking error does."""
        clouds = Clouds()
        clouds.show_for(1.2 * STOOD, pebble(0.06))
        clouds.settings = replace(SETTINGS, padding=0.08)
        seen = clouds.show(pebble(0.06))
        assert seen.of_arm == 40
        assert seen.remembered > 0
        assert covered(seen, pebble(0.06))
        assert shows_nothing(clouds.show_for(1.1 * MOMENT, pebble(0.06)))

    def test_what_was_grasped_is_not_remembered_as_an_obstacle(self, pebble):
        clouds = Clouds()
        clouds.show(pebble(0.03))
        assert clouds.show().remembered > 0
        clouds.held = (BOTTLE,)
        assert shows_nothing(clouds.show())

    def test_a_cloud_of_before_remembers_nothing_of_later(self, pebble):
        clouds = Clouds()
        clouds.show(pebble(0.03))
        assert shows_nothing(clouds.show(passed=-0.1))

    def test_other_cubes_remember_nothing(self, pebble):
        clouds = Clouds()
        clouds.show(pebble(0.03))
        clouds.settings = replace(SETTINGS, voxel=0.03)
        assert shows_nothing(clouds.show())

    def test_the_arm_leaves_nothing_where_it_was(self):
        """The camera sees the arm and the wall behind it, and then that wall alone."""
        centres, radii = ARM.spheres(ROBOT.ready, ())
        arm = np.concatenate([ball(centre, radius) for centre, radius in zip(centres, radii, strict=True)])
        clouds, wall = Clouds(), behind(np.array([0.3, 0.0, 0.5]), 0.6, 0.6)
        clouds.show_for(0.5, wall, arm)
        seen = clouds.show(wall, arm)
        assert seen.clusters == ()
        assert seen.of_arm >= len(arm)
        assert np.min(gaps(seen.field.occupied)) > SETTINGS.padding - SETTINGS.voxel


class TestDeclaredScene:
    """A table that is known without a camera."""

    TOP = np.array([0.45, -0.4, 0.2])

    @pytest.fixture
    def clouds(self) -> Clouds:
        half = np.array([0.3, 0.3, 0.1])
        return Clouds(solids=solid_rows(self.TOP[None] - [0.0, 0.0, 0.1], np.eye(3)[None], half[None], np.zeros(1)))

    @property
    def table(self) -> np.ndarray:
        points = plate(self.TOP, *0.3 * np.eye(3)[:2])
        return points + np.random.default_rng(0).normal(0.0, 0.003, points.shape)

    def test_is_no_obstacle_of_the_cloud(self, clouds):
        for _ in range(10):
            seen = clouds.show(self.table)
            assert shows_nothing(seen)
            assert (seen.points, seen.of_scene) == (0, len(self.table))
        # The control: it is not declared.
        assert covered(Clouds().show(self.table), self.table)

    def test_what_is_on_it_is_kept_and_does_not_hang_together_with_it(self, clouds):
        cup = ball(self.TOP + [0.0, 0.0, 0.07])
        seen = clouds.show(self.table, cup)
        assert len(seen.clusters) == 1
        assert seen.field.squares.size == 0
        # But for what is within the padding of the table.
        assert covered(seen, cup[cup[:, 2] > self.TOP[2] + SETTINGS.padding + SETTINGS.voxel])
        assert len(Clouds().show(self.table, cup - [0.0, 0.0, 0.02]).clusters) == 0


def test_what_is_beyond_the_reach_of_arm_and_field_is_no_obstacle():
    grid = ARM.grid(SETTINGS.voxel, REACH)
    points = grid.centre + (grid.radius + 0.01) * np.eye(3)
    seen = Clouds().show(points)
    assert shows_nothing(seen)
    assert seen.out_of_reach == 3
    assert Clouds().show(grid.centre + (grid.radius - 0.01) * np.eye(3)).points == 3
