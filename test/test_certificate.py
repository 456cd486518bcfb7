"""The certificate is a lower bound: never optimistic against dense sampling of the interpolated curve."""


import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.certificate import curve_allowance, motion_clearances
from geodesic_motion_ros.distance_field import DistanceField
from geodesic_motion_ros.graph.ambient import obstacle_clearances
from geodesic_motion_ros.graph.pose_graph import tool_points
from geodesic_motion_ros.motion_curve import MotionCurve, MotionLimits
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planning.path_clearance import curve_clearances
from geodesic_motion_ros.reference import TaskSpaceReference, timed_reference
from geodesic_motion_ros.solids import solid_rows

LIMITS = MotionLimits(0.2, 0.8, 0.5, 2.0)
TOOL, TOOL_RADII = np.array([[0.0, 0.0, 0.0], [0.05, -0.02, 0.1]]), np.array([0.03, 0.02])


def motion(random: np.random.Generator) -> TaskSpaceReference:
    """A bent way of a few seconds from rest to rest, of few samples."""
    share = np.linspace(0.0, 1.0, 12)[:, None]
    positions = share * random.normal(scale=0.3, size=3) + np.sin(np.pi * share) * random.normal(scale=0.1, size=3)
    turns = Rotation.from_rotvec(share * random.normal(scale=0.5, size=3))
    curve = MotionCurve.through(positions, np.roll(turns.as_quat(), 1, axis=1), LIMITS)
    return timed_reference(curve, np.zeros((12, 1)), LIMITS)


def moving_scene(random: np.random.Generator, seed: int) -> Obstacles:
    """Two spheres, a box and a capsule that move, and a cloud that does not, around the origin."""
    solids = solid_rows(
        random.normal(scale=0.3, size=(2, 3)), Rotation.random(2, random_state=seed).as_matrix(),
        np.array([[0.05, 0.1, 0.02], [0.0, 0.0, 0.1]]), np.array([0.0, 0.04]),
    )  # fmt: skip
    cloud = DistanceField.of(random.normal(scale=0.3, size=(20, 3)), 0.02, 0.01, 0.05)
    return Obstacles(
        random.normal(scale=0.3, size=(2, 3)), np.array([0.05, 0.08]), random.normal(scale=0.3, size=(2, 3)), solids,
        random.normal(scale=0.3, size=(2, 3)), cloud,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(20))
def test_among_obstacles_that_move_it_is_never_optimistic_at_any_instant(seed):
    random = np.random.default_rng(seed)
    reference, obstacles, prediction = motion(random), moving_scene(random, seed), 0.8
    points = tool_points(reference.positions, reference.quaternions, TOOL)
    allowance = curve_allowance(reference.curve, TOOL)
    certified = motion_clearances(
        points, TOOL_RADII, allowance, reference.times, reference.rates, obstacles, prediction
    )
    for i, bound in enumerate(certified):
        for time in np.linspace(reference.times[i], reference.times[i + 1], 40):
            position, quaternion = reference.sample(time)
            body = tool_points(position[None], quaternion[None], TOOL)
            # The cloud's field is told to 2 mm.
            assert bound <= obstacle_clearances(body, TOOL_RADII, obstacles.at(time, prediction), np.inf)[0] + 2e-3


def test_among_obstacles_that_stand_both_certificates_agree_but_for_what_time_costs():
    random = np.random.default_rng(3)
    reference = motion(random)
    obstacles = Obstacles.of_spheres(random.normal(scale=0.3, size=(3, 3)), np.full(3, 0.05))
    points = tool_points(reference.positions, reference.quaternions, TOOL)
    allowance = curve_allowance(reference.curve, TOOL)
    standing = curve_clearances(points, TOOL_RADII, allowance, obstacles)
    moving = motion_clearances(points, TOOL_RADII, allowance, reference.times, reference.rates, obstacles, 0.8)
    assert np.all(moving <= standing + 1e-12)
    # In the middle of the way, where its rate hardly changes, nothing is lost.
    np.testing.assert_allclose(moving[4:7], standing[4:7], atol=5e-3)
