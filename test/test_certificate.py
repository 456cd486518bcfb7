"""The certificate is a lower bound: never optimistic against dense sampling of the interpolated curve."""

import numpy as np
import pytest

from geodesic_motion_ros.certificate import curve_clearances, rotation_allowance, segment_distance
from geodesic_motion_ros.graph.pose_graph import tool_points
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.quaternions import angle_between, normalise, slerp


@pytest.mark.parametrize("seed", range(50))
def test_segment_distance_is_the_minimum_over_the_segment(seed):
    begin, end, point = np.random.default_rng(seed).normal(size=(3, 3))
    shares = np.linspace(0.0, 1.0, 20001)[:, None]
    sampled = np.linalg.norm(begin + shares * (end - begin) - point, axis=1).min()
    assert segment_distance(begin, end, point) == pytest.approx(sampled, abs=1e-7)


def test_a_segment_of_no_length_is_a_point():
    assert segment_distance(np.ones(3), np.ones(3), np.zeros(3)) == pytest.approx(np.sqrt(3.0))


@pytest.mark.parametrize("seed", range(50))
def test_never_optimistic_between_samples(seed):
    random = np.random.default_rng(seed)
    points, radii = random.uniform(-0.2, 0.2, (3, 3)), np.array([0.03, 0.05, 0.0])
    positions = np.cumsum(random.normal(scale=0.05, size=(6, 3)), axis=0)
    quaternions = normalise(np.array([1.0, 0, 0, 0]) + np.cumsum(random.normal(scale=0.3, size=(6, 4)), axis=0))
    centres, obstacle_radii = random.normal(scale=0.3, size=(4, 3)), random.uniform(0.02, 0.1, 4)
    angles = angle_between(quaternions[1:], quaternions[:-1])
    certified = curve_clearances(
        tool_points(positions, quaternions, points), radii, rotation_allowance(angles, points),
        Obstacles.of_spheres(centres, obstacle_radii),
    )  # fmt: skip
    shares = np.linspace(0.0, 1.0, 201)
    for i, bound in enumerate(certified):
        between = positions[i] + shares[:, None] * (positions[i + 1] - positions[i])
        dense = tool_points(between, slerp(quaternions[i], quaternions[i + 1], shares), points)
        gaps = np.linalg.norm(dense[:, :, None] - centres, axis=-1) - radii[:, None] - obstacle_radii
        assert bound <= gaps.min() + 1e-12
        assert bound >= gaps.min() - rotation_allowance(angles, points)[i].max() * 2.0 - 1e-3


def test_no_obstacle_no_limit():
    clearance = curve_clearances(np.zeros((4, 1, 3)), np.ones(1), np.zeros((3, 1)), Obstacles.none())
    assert np.all(np.isinf(clearance))
