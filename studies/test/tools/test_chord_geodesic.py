"""Curves measured by chords have the length that the metric's tensors give them, and are moved to less energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.autoencoder import DecoderNetwork
from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.mean_path import LARGEST_EXPONENT, MeanPaths
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.tools.chord_geodesic import ChordMetric, _equations, shortened
from geodesic_motion_studies.tools.joint_metric import JointPullbackMetric
from geodesic_motion_studies.tools.metric import curve_length

UNIT = np.array([0.3, 0.5])


def mean_paths() -> MeanPaths:
    """Two codes that run side by side from left to right."""
    s = np.linspace(-1.0, 1.0, 40)
    codes = np.stack([np.stack([s, 0.2 * np.sin(2.0 * s) + side], axis=1) for side in (-0.3, 0.0, 0.3)])
    return MeanPaths.of_codes(codes, np.zeros(3, dtype=int))


@pytest.fixture(scope="module")
def plain(small_decoder: DecoderNetwork) -> ChordMetric:
    """Without mean paths."""
    settings = JointMetricSettings(sigma_weight=1.0, orientation_weight=0.5)
    return ChordMetric(small_decoder.to_numpy(), settings, Robot.named("panda"), UNIT)


def winding() -> np.ndarray:
    s = np.linspace(0.0, 1.0, 30)
    return np.stack([2.0 * s - 1.0, 0.5 * np.sin(5.0 * s)], axis=1)


def test_a_length_is_that_of_the_tensors(plain: ChordMetric, small_decoder: DecoderNetwork) -> None:
    curve = winding()
    body = BodyLayer(plain.robot, plain.settings.body_points(plain.robot))
    tensors = JointPullbackMetric(small_decoder, body, plain.settings)
    fine = np.stack([np.interp(np.linspace(0.0, 29.0, 3001), np.arange(30), column) for column in curve.T], axis=1)
    with torch.no_grad():
        expected = float(curve_length(tensors, torch.tensor(fine)))
    assert plain.length(curve) == pytest.approx(expected, rel=1e-3)


def test_exponents_are_those_of_the_mean_paths(plain: ChordMetric) -> None:
    paths = mean_paths()
    latent = np.random.default_rng(0).uniform(-1.5, 1.5, (50, 2))
    exponents, curvatures = replace(plain, mean_paths=paths, strength=0.7).exponents(latent / UNIT)
    np.testing.assert_allclose(np.exp(exponents), paths.conformal_factors(latent, 0.7), rtol=1e-9)
    assert np.all(np.linalg.eigvalsh(curvatures) >= 0.0)
    # Where the factor is at its largest it has no valley.
    assert not curvatures[exponents >= LARGEST_EXPONENT].any()


def test_the_gradient_is_that_of_the_energy(plain: ChordMetric) -> None:
    """Central differences of half the energy."""
    metric, points = replace(plain, mean_paths=mean_paths(), strength=0.2), winding()[::4] / UNIT
    gradient, bands = _equations(metric, points, metric.pieces(points))
    moves = np.random.default_rng(1).normal(size=(5, *points[1:-1].shape))
    for move in moves:
        energies = []
        for sign in (1.0, -1.0):
            moved = points.copy()
            moved[1:-1] += sign * 1e-6 * move
            energies.append(0.5 * np.sum(metric.pieces(moved) ** 2))
        assert (energies[0] - energies[1]) / 2e-6 == pytest.approx(gradient @ move.reshape(-1), rel=1e-4)
    assert np.all(bands[0] > 0.0)


@pytest.mark.parametrize("paths", [None, mean_paths()], ids=["plain", "mean path"])
def test_a_curve_becomes_shorter_between_the_same_ends(plain: ChordMetric, paths: MeanPaths | None) -> None:
    metric, curve = replace(plain, mean_paths=paths, strength=0.3), winding()
    found = shortened(metric, curve)
    np.testing.assert_allclose(found[[0, -1]], curve[[0, -1]], atol=1e-12)
    assert metric.length(found) < metric.length(curve)
    again = shortened(metric, found)
    assert metric.length(again) == pytest.approx(metric.length(found), rel=1e-2)
