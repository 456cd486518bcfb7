"""The clearance of a path is a lower bound: never optimistic against dense sampling of the path between its samples."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.certification.path_clearance import curve_clearances, rotation_allowance, segment_distance
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.quaternions import angle_between, normalise, slerp
from geodesic_motion_ros.geometry.shapes import solid_rows
from geodesic_motion_ros.manifold.ambient_metric import obstacle_clearances
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.obstacles.obstacles import Obstacles


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


@pytest.mark.parametrize("seed", range(20))
def test_among_solids_and_clouds_it_is_never_optimistic_and_costs_two_millimetres(seed):
    random = np.random.default_rng(seed)
    positions = np.cumsum(random.normal(scale=0.05, size=(6, 3)), axis=0)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (6, 1))
    points, radii = random.uniform(-0.1, 0.1, (2, 3)), np.array([0.03, 0.05])
    solids = solid_rows(
        random.normal(scale=0.3, size=(3, 3)), Rotation.random(3, random_state=seed).as_matrix(),
        random.uniform(0.0, 0.2, (3, 3)), random.uniform(0.01, 0.05, 3),
    )  # fmt: skip
    seen = random.normal(scale=0.2, size=(50, 3))
    field = DistanceField.of(seen, 0.02, 0.01, 0.05)
    spheres = Obstacles.of_spheres(random.normal(scale=0.3, size=(1, 3)), np.array([0.05]))
    with_solids = replace(spheres, solids=solids, solid_velocities=np.zeros((3, 3)))
    shares = np.linspace(0.0, 1.0, 201)[:, None, None]
    placed = tool_points(positions, still, points)
    for obstacles in (with_solids, replace(with_solids, cloud=field)):
        certified = curve_clearances(placed, radii, np.zeros((5, 2)), obstacles)
        for i, bound in enumerate(certified):
            dense = placed[i] + shares * (placed[i + 1] - placed[i])
            known = obstacle_clearances(dense, radii, obstacles, np.inf).min()
            assert known - 2e-3 <= bound <= known + (1e-12 if obstacles is with_solids else 2e-3)
            points_gap = np.min(cKDTree(seen).query(dense.reshape(-1, 3))[0].reshape(dense.shape[:2]) - radii) - 0.01
            assert obstacles is with_solids or bound <= points_gap
