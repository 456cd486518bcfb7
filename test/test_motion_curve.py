"""Curves pass their poses, are cut without a change, find poses on them, and bulge no further than they say."""

import numpy as np
import pytest

from geodesic_motion_ros.certificate import curve_allowance
from geodesic_motion_ros.graph.tool_points import tool_points
from geodesic_motion_ros.motion_curve import SHORTEST_STEP, MotionCurve, MotionLimits, distinct
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planning.path_clearance import curve_clearances
from geodesic_motion_ros.quaternions import angle_between, normalise, rotate_by, rotation_vector_between
from geodesic_motion_ros.task_frame import TaskFrame

LIMITS = MotionLimits(0.2, 0.8, 0.5, 2.0)


def wandering(seed: int, count: int = 12, step: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n, 3), (n, 4) of a random walk with corners everywhere."""
    random = np.random.default_rng(seed)
    positions = np.cumsum(random.normal(scale=step, size=(count, 3)), axis=0)
    quaternions = [normalise(random.normal(size=4))]
    for turn in random.normal(scale=5.0 * step, size=(count - 1, 3)):
        quaternions.append(rotate_by(turn[None], quaternions[-1][None])[0])
    return positions, np.array(quaternions)


def dense(curve: MotionCurve, count: int = 30) -> tuple[np.ndarray, np.ndarray]:
    shares = np.linspace(0.0, 1.0, count)
    poses = [curve.pose(i, share) for i in range(len(curve.chords)) for share in shares]
    return np.array([pose[0] for pose in poses]), np.array([pose[1] for pose in poses])


@pytest.mark.parametrize("seed", range(5))
def test_a_curve_passes_its_poses_with_a_continuous_velocity(seed):
    positions, quaternions = wandering(seed)
    curve = MotionCurve.through(positions, quaternions, LIMITS)
    for i in range(len(curve.chords)):
        for share in (0.0, 1.0):
            position, quaternion = curve.pose(i, share)
            np.testing.assert_allclose(position, positions[i + int(share)], atol=1e-12)
            assert angle_between(quaternion, quaternions[i + int(share)]) < 1e-7
            np.testing.assert_allclose(curve.velocity(i, share), curve.tangents[i + int(share)], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_velocity_is_the_derivative_of_the_pose(seed):
    curve, tiny = MotionCurve.through(*wandering(seed), LIMITS), 1e-5
    for i, share in ((0, 0.3), (4, 0.5), (10, 0.9)):
        step = curve.knots[i + 1] - curve.knots[i]
        (before, turned), (after, turned_more) = curve.pose(i, share - tiny), curve.pose(i, share + tiny)
        found = np.concatenate([after - before, rotation_vector_between(turned, turned_more)]) / (2 * tiny * step)
        velocity = curve.velocity(i, share)
        np.testing.assert_allclose(found[:3], velocity[:3], rtol=1e-5, atol=1e-6)
        # A rotation vector's derivative is the angular velocity up to second order of the segment's angle.
        np.testing.assert_allclose(found[3:], velocity[3:], atol=0.1 * np.linalg.norm(velocity[3:]))


@pytest.mark.parametrize("seed", range(10))
def test_cut_curves_are_parts_of_the_whole(seed):
    curve = MotionCurve.through(*wandering(seed), LIMITS)
    segment, share = seed, 0.37
    rest, at = curve.from_share(segment, share)
    begun = curve.until(segment, share)
    assert at == segment
    for part, index, own in ((rest, 0, 0.5), (begun, segment, 0.5)):
        within = share + (1.0 - share) * own if part is rest else share * own
        np.testing.assert_allclose(part.pose(index, own)[0], curve.pose(segment, within)[0], atol=1e-12)
        assert angle_between(part.pose(index, own)[1], curve.pose(segment, within)[1]) < 1e-3
    np.testing.assert_array_equal(rest.positions[1:], curve.positions[segment + 1 :])
    np.testing.assert_array_equal(begun.positions[:-1], curve.positions[: segment + 1])


@pytest.mark.parametrize("seed", range(10))
def test_the_foot_of_a_pose_on_the_curve_is_that_pose(seed):
    curve = MotionCurve.through(*wandering(seed), LIMITS)
    for i in range(len(curve.chords)):
        for share in (0.0, 0.21, 0.8):
            pose = curve.pose(i, share)
            segment, found, distance, angle = curve.foot(*pose, len(curve.chords), 0.1)
            assert distance < 1e-7
            assert angle < 1e-6
            np.testing.assert_allclose(curve.pose(segment, found)[0], pose[0], atol=1e-7)


@pytest.mark.parametrize("seed", range(20))
def test_the_certificate_of_a_curve_is_never_optimistic(seed):
    random = np.random.default_rng(seed)
    curve = MotionCurve.through(*wandering(seed, step=0.03), LIMITS)
    points, radii = random.uniform(-0.2, 0.2, (3, 3)), np.array([0.03, 0.05, 0.0])
    centres, obstacle_radii = random.normal(scale=0.2, size=(4, 3)), random.uniform(0.02, 0.05, 4)
    certified = curve_clearances(
        tool_points(curve.positions, curve.quaternions, points), radii, curve_allowance(curve, points),
        Obstacles.of_spheres(centres, obstacle_radii),
    )  # fmt: skip
    body = tool_points(*dense(curve, 100), points).reshape(len(curve.chords), 100, 3, 3)
    gaps = np.linalg.norm(body[:, :, :, None] - centres, axis=-1) - radii[:, None] - obstacle_radii
    assert np.all(certified <= gaps.min(axis=(1, 2, 3)) + 1e-12)
    assert np.all(certified >= gaps.min(axis=(1, 2, 3)) - 2.5 * curve_allowance(curve, points).max(axis=1))


def test_a_moved_curve_is_the_same_curve_elsewhere():
    curve = MotionCurve.through(*wandering(3), LIMITS)
    frame = TaskFrame(np.array([0.3, -0.2, 0.1]), normalise(np.array([0.5, 0.1, -0.7, 0.2])))
    moved = curve.moved(frame.to_base)
    for (position, quaternion), (there, turned) in zip(
        zip(*dense(curve, 5), strict=True), zip(*dense(moved, 5), strict=True), strict=True
    ):
        expected = frame.to_base(position, quaternion)
        np.testing.assert_allclose(there, expected[0], atol=1e-12)
        assert angle_between(turned, expected[1]) < 1e-7


def test_poses_that_repeat_are_taken_once_and_both_ends_stay():
    positions, quaternions = wandering(0)
    again = np.repeat(np.arange(12), 3)
    kept = distinct(positions[again], quaternions[again], LIMITS)
    np.testing.assert_array_equal(again[kept], np.arange(12))
    np.testing.assert_array_equal(distinct(positions[:1].repeat(5, 0), quaternions[:1].repeat(5, 0), LIMITS), [0, 4])
    creeping = positions[0] + np.linspace(0.0, 0.3 * SHORTEST_STEP, 50)[:, None] * np.array([1.0, 0.0, 0.0])
    kept = distinct(creeping, quaternions[:1].repeat(50, 0), LIMITS)
    assert kept[0] == 0
    assert kept[-1] == 49
    assert np.all(np.linalg.norm(np.diff(creeping[kept], axis=0), axis=1) >= 0.2 * SHORTEST_STEP - 1e-15)
