"""The numpy decoder of configurations: shapes, walls away from the data, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.encoder import JointSpaceEncoder
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.utils.errors import SkillError


@pytest.fixture
def arrays() -> dict[str, np.ndarray]:
    """Weights of a decoder of seven joints with a three-dimensional latent space."""
    random = np.random.default_rng(0)
    shapes = {"W1": (6, 3), "b1": (6,), "W2": (5, 6), "b2": (5,), "W3": (7, 5), "b3": (7,), "joint_offset": (7,)}
    return {name: random.normal(size=shape) for name, shape in shapes.items()} | {
        "joint_scale": np.array(0.4), "rbf_centres": random.normal(size=(9, 3)), "rbf_rate": np.array(2.0),
        "sigma_weights": random.uniform(1.0, 5.0, (7, 9)), "sigma_floor": np.full(7, 2.0),
    }  # fmt: skip


def test_one_row_a_latent_point(arrays):
    decoder = JointSpaceDecoder.from_arrays(arrays)
    latent = np.random.default_rng(1).normal(size=(11, 3))
    decoded = decoder.decode(latent)
    assert (decoder.latent_dimension, decoder.joints) == (3, 7)
    assert decoded.configurations.shape == decoded.sigma.shape == (11, 7)
    np.testing.assert_allclose(decoder.decode(latent[4:5]).sigma, decoded.sigma[4:5])
    np.testing.assert_allclose(decoder.configurations(latent), decoded.configurations)


def test_sigma_is_largest_far_from_the_kernels(arrays):
    decoder = JointSpaceDecoder.from_arrays(arrays)
    far = decoder.uncertainty(np.full((1, 3), 50.0))
    np.testing.assert_allclose(far, 0.5)
    assert np.all(decoder.uncertainty(np.random.default_rng(2).normal(size=(100, 3))) <= far)
    assert np.all(decoder.uncertainty(arrays["rbf_centres"]) < 0.9 * far)


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("sigma_weights", None, "lack sigma_weights"),
        ("sigma_weights", np.ones((6, 9)), "sigma_weights has shape"),
        ("sigma_floor", np.full(7, np.nan), "sigma_floor holds NaN"),
        ("rbf_centres", np.zeros((9, 2)), "rbf_centres has shape"),
        ("joint_offset", np.zeros(6), "joint_offset has shape"),
        ("W1", np.array(1.0), "W1 has shape"),
    ],
)
def test_bad_weights_are_refused_by_name(arrays, name, value, match):
    arrays[name] = value
    with pytest.raises(SkillError, match=match):
        JointSpaceDecoder.from_arrays({key: array for key, array in arrays.items() if array is not None})


def test_an_encoder_of_other_joints_is_refused(arrays):
    weights = {name: arrays[name] for name in ("b1", "W2", "b2", "joint_offset", "joint_scale")}
    weights |= {"W1": np.zeros((6, 6)), "W3": np.zeros((3, 5)), "b3": np.zeros(3)}
    with pytest.raises(SkillError, match="joint_offset has shape"):
        JointSpaceEncoder.from_arrays(weights)
