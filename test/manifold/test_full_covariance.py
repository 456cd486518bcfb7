"""A full covariance out of positive kernels, without torch: its root, what of it is a length, how it is stored."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder, mean_concentration
from geodesic_motion_ros.manifold.full_covariance import covariance_root, kernel_rows, standard_deviations
from geodesic_motion_ros.manifold.pose_graph import MetricSettings
from geodesic_motion_ros.utils.errors import SkillError

BELOW = np.tril_indices(3, -1)


def unpacked(packed: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Symmetric matrices (n, 3, 3) of packed ones (n, 6), their elements below the diagonal times a scale."""
    matrices = np.zeros((len(packed), 3, 3))
    matrices[:, range(3), range(3)] = packed[:, :3]
    matrices[:, BELOW[0], BELOW[1]] = matrices[:, BELOW[1], BELOW[0]] = scale * packed[:, 3:]
    return matrices


@pytest.fixture
def arrays() -> dict[str, np.ndarray]:
    """Weights of a decoder with a diagonal covariance and one concentration."""
    random = np.random.default_rng(1)
    shapes = {"W1": (9, 2), "b1": (9,), "W2": (6, 9), "b2": (6,), "W3": (7, 6), "b3": (7,), "position_offset": (3,)}
    return {name: random.normal(size=shape) for name, shape in shapes.items()} | {
        "position_scale": np.array(0.2), "rbf_centres": random.normal(size=(20, 2)), "rbf_rate": np.array(1.5),
        "sigma_weights": random.uniform(1.0, 50.0, (3, 20)), "sigma_floor": np.full(3, 1.0),
        "kappa_weights": random.uniform(1.0, 500.0, 20), "kappa_floor": np.array(0.1),
    }  # fmt: skip


def test_rows_are_the_products_of_the_kernels_triangles() -> None:
    random = np.random.default_rng(0)
    weights, shears = random.uniform(0.0, 5.0, (3, 4)), random.normal(size=(3, 4))
    for k, packed in enumerate(kernel_rows(weights, shears).T):
        a, b, c = shears[:, k]
        triangle = np.array([[1.0, 0.0, 0.0], [a, 1.0, 0.0], [b, c, 1.0]])
        np.testing.assert_allclose(unpacked(packed[None])[0], triangle @ np.diag(weights[:, k]) @ triangle.T)


def test_the_root_is_the_symmetric_one_of_the_covariance_and_its_rows_are_standard_deviations() -> None:
    random = np.random.default_rng(1)
    square = random.normal(size=(50, 3, 3))
    inverse = square @ square.transpose(0, 2, 1) + np.eye(3)
    packed = np.concatenate([inverse[:, range(3), range(3)], inverse[:, BELOW[0], BELOW[1]]], axis=1)
    features = covariance_root(packed)
    root = unpacked(features, np.sqrt(0.5))
    covariance = np.linalg.inv(inverse @ inverse)
    np.testing.assert_allclose(root @ root, covariance, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(standard_deviations(features) ** 2, covariance[:, range(3), range(3)], rtol=1e-8)
    steps = np.sum(np.diff(features, axis=0) ** 2, axis=1)
    np.testing.assert_allclose(steps, np.sum(np.diff(root, axis=0) ** 2, axis=(1, 2)))


def test_without_shears_and_with_equal_concentrations_all_is_as_before(arrays: dict[str, np.ndarray]) -> None:
    before = TaskSpaceDecoder.from_arrays(arrays)
    assert not before.full
    assert "sigma_shears" not in before.arrays()
    after = TaskSpaceDecoder.from_arrays(
        arrays | {"sigma_shears": np.zeros((3, 20)), "kappa_weights": np.tile(arrays["kappa_weights"], (3, 1))}
    )
    assert after.full
    latent = np.random.default_rng(2).normal(size=(40, 2))
    one, other = before.decode(latent), after.decode(latent)
    np.testing.assert_allclose(other.root, np.hstack([one.root, np.zeros((40, 3))]))
    np.testing.assert_array_equal(one.sigma, one.root)
    for name in ("sigma", "kappa", "spread"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name))
    for scale in ("spread", "kappa"):
        metric = MetricSettings(orientation_scale=scale)
        features = metric.orientation_features(other)
        assert features.shape == (40, 3)
        np.testing.assert_allclose(np.sum(features**2, axis=1), metric.orientation_features(one)[:, 0] ** 2)


def test_the_spread_of_three_concentrations_is_the_mean_square_one() -> None:
    kappas = np.array([[4.0, 16.0, 100.0]])
    np.testing.assert_allclose(mean_concentration(kappas) ** -0.5, np.sqrt(np.mean(1.0 / kappas)))


def test_deviations_grow_to_the_floors_far_away_whatever_the_shears(arrays: dict[str, np.ndarray]) -> None:
    shears = np.random.default_rng(3).normal(0.0, 10.0, (3, 20))
    decoder = TaskSpaceDecoder.from_arrays(arrays | {"sigma_shears": shears})
    np.testing.assert_allclose(decoder.decode(np.full((1, 2), 50.0)).root, [[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]])
    sigma, _ = decoder.uncertainty(arrays["rbf_centres"])
    assert np.all(sigma < 1.0)
    assert np.all(sigma > 0.0)


@pytest.mark.parametrize(
    ("name", "shape"), [("sigma_shears", (3, 19)), ("sigma_shears", (20,)), ("kappa_weights", (2, 20))]
)
def test_weights_of_another_shape_are_refused(arrays: dict[str, np.ndarray], name: str, shape: tuple) -> None:
    with pytest.raises(SkillError, match=f"{name} has shape"):
        TaskSpaceDecoder.from_arrays(arrays | {name: np.ones(shape)})
