"""Rotations stored as q and -q, and the operations on them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry import quaternions as quat

RANDOM = np.random.default_rng(0)
FIRST, SECOND = quat.normalise(RANDOM.normal(size=(2, 200, 4)))


def test_scalar_first_round_trip():
    np.testing.assert_allclose(quat.from_rotation(quat.to_rotation(FIRST)), FIRST, atol=1e-15)
    quarter_turn = np.sqrt([0.5, 0.5, 0.0, 0.0])
    np.testing.assert_allclose(quat.to_rotation(quarter_turn).apply([0, 1, 0]), [0, 0, 1], atol=1e-15)


def test_angle_is_that_of_scipy_and_blind_to_sign():
    expected = (quat.to_rotation(SECOND) * quat.to_rotation(FIRST).inv()).magnitude()
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(quat.angle_between(FIRST, sign * SECOND), expected, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 0.1, np.pi])
def test_small_angles_are_exact(angle):
    turned = quat.from_rotation(Rotation.from_rotvec([angle, 0, 0]))
    assert quat.angle_between(np.array([1.0, 0, 0, 0]), turned) == pytest.approx(angle, rel=1e-9, abs=1e-16)


def test_rotation_vector_carries_first_to_second():
    vector = quat.rotation_vector_between(FIRST, SECOND)
    assert quat.angle_between(quat.rotate_by(vector, FIRST), SECOND).max() < 1e-7
    assert np.linalg.norm(vector, axis=-1).max() <= np.pi + 1e-12


def test_rotate_by_keeps_the_hemisphere():
    small = RANDOM.normal(scale=0.3, size=(200, 3))
    assert np.all(np.sum(quat.rotate_by(small, FIRST) * FIRST, axis=-1) > 0.0)
    np.testing.assert_allclose(quat.rotate_by(small, -FIRST), -quat.rotate_by(small, FIRST), atol=1e-12)


def test_continuous_signs_repairs_flips_and_keeps_rotations():
    curve = quat.slerp(FIRST[0], SECOND[0], np.linspace(0, 1, 30))
    flipped = curve * np.where(RANDOM.random(30) < 0.5, -1.0, 1.0)[:, None]
    repaired = quat.continuous_signs(flipped)
    np.testing.assert_allclose(repaired * np.sign(flipped[0] @ curve[0]), curve, atol=1e-15)


def test_slerp_has_constant_speed_and_both_ends():
    curve = quat.slerp(FIRST[0], SECOND[0], np.linspace(0, 1, 11))
    assert quat.angle_between(curve[0], FIRST[0]) < 1e-7
    assert quat.angle_between(curve[-1], SECOND[0]) < 1e-7
    np.testing.assert_allclose(np.diff(quat.angle_between(curve[0], curve)), quat.angle_between(*curve[:2]), rtol=1e-9)


def test_mean_rotation_of_opposite_turns_is_the_middle_whatever_the_signs():
    rng = np.random.default_rng(5)
    middle = quat.normalise(rng.normal(size=(4, 4)))
    turns = rng.normal(0.0, 0.3, size=(4, 3))
    around = np.stack([quat.rotate_by(turns, middle), -quat.rotate_by(-turns, middle)])
    assert np.max(quat.angle_between(quat.mean_rotation(around), middle)) < 1e-7
