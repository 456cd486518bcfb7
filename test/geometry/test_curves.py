import numpy as np
import pytest

from geodesic_motion_ros.geometry.curves import PoseCurve, arc_length, arc_length_fractions, interpolate
from geodesic_motion_ros.geometry.quaternions import angle_between, slerp

QUARTER_TURN = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def test_arc_length_of_a_polyline():
    corner = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
    np.testing.assert_allclose(arc_length(corner), [0.0, 3.0, 7.0])
    np.testing.assert_allclose(arc_length_fractions(corner), [0.0, 3.0 / 7.0, 1.0])


def test_a_curve_in_one_place_is_spaced_equally():
    np.testing.assert_allclose(arc_length_fractions(np.ones((5, 3))), [0.0, 0.25, 0.5, 0.75, 1.0])


def test_interpolation_hits_the_samples_and_turns_on_great_circles():
    abscissa = np.array([0.0, 1.0, 3.0])
    positions = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    quaternions = np.stack([IDENTITY, QUARTER_TURN, QUARTER_TURN])
    moved, turned = interpolate(abscissa, positions, quaternions, np.array([0.0, 0.25, 1.0, 2.0, 3.0]))
    np.testing.assert_allclose(moved, [[0, 0, 0], [0.25, 0, 0], [1, 0, 0], [1, 1, 0], [1, 2, 0]], atol=1e-12)
    np.testing.assert_allclose(turned[1], slerp(IDENTITY, QUARTER_TURN, np.array([0.25]))[0], atol=1e-12)
    np.testing.assert_allclose(turned[[0, 2, 4]], quaternions, atol=1e-12)


def test_interpolation_survives_a_pause():
    abscissa = np.array([0.0, 1.0, 1.0, 1.0, 2.0])
    positions = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    quaternions = np.stack([IDENTITY, IDENTITY, IDENTITY, QUARTER_TURN, QUARTER_TURN])
    moved, turned = interpolate(abscissa, positions, quaternions, np.linspace(0.0, 2.0, 9))
    np.testing.assert_allclose(moved[:, 0], np.linspace(0.0, 2.0, 9), atol=1e-12)
    np.testing.assert_allclose(turned[5], QUARTER_TURN, atol=1e-12)
    assert np.all(np.isfinite(turned))


@pytest.mark.parametrize("samples", [2, 7, 200])
def test_resampling_keeps_ends_and_spaces_points_equally(samples):
    s = np.linspace(0.0, 1.0, 500) ** 2
    positions = np.stack([np.cos(2 * s), np.sin(2 * s), 0 * s], axis=1)
    curve = PoseCurve(positions, slerp(IDENTITY, QUARTER_TURN, s)).resample(samples)
    assert curve.positions.shape == (samples, 3)
    np.testing.assert_allclose(curve.positions[[0, -1]], positions[[0, -1]], atol=1e-12)
    steps = np.linalg.norm(np.diff(curve.positions, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-3)
    expected = slerp(IDENTITY, QUARTER_TURN, np.linspace(0.0, 1.0, samples))
    assert np.max(angle_between(curve.quaternions, expected)) < 1e-3
