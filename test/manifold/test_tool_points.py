import numpy as np

from geodesic_motion_ros.geometry.quaternions import normalise, to_rotation
from geodesic_motion_ros.manifold.tool_points import tool_points


def test_tool_points_are_rotated_with_the_tool():
    random = np.random.default_rng(0)
    positions, quaternions = random.normal(size=(30, 3)), normalise(random.normal(size=(30, 4)))
    points = random.normal(size=(4, 3))
    expected = positions[:, None] + np.stack([to_rotation(quaternions).apply(point) for point in points], axis=1)
    np.testing.assert_allclose(tool_points(positions, quaternions, points), expected, atol=1e-12)
