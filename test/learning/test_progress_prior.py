"""The prior of the codes: a strip on the canonical sheet, the paper's ball on the raw one."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.autoencoder import START_LOG_VARIANCE, EncoderNetwork
from geodesic_motion_ros.learning.progress_prior import prior_means, prior_variance
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.manifold.encoder import PRIOR_REACH


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_canonical_strip_runs_along_the_first_axis(dimension) -> None:
    settings = TrainingSettings(latent_dimension=dimension, progress_deviation=0.2)
    means = prior_means(np.array([0.0, 0.5, 1.0]), settings)
    expected = np.zeros((3, dimension))
    expected[:, 0] = -PRIOR_REACH, 0.0, PRIOR_REACH
    np.testing.assert_allclose(means, expected)
    np.testing.assert_allclose(prior_variance(settings), [0.04, *np.ones(dimension - 1)])


def test_the_raw_prior_is_the_papers() -> None:
    settings = TrainingSettings(sheet="raw", latent_dimension=3)
    assert not np.any(prior_means(np.linspace(0.0, 1.0, 7), settings))
    np.testing.assert_array_equal(prior_variance(settings), 1.0)


def test_an_encoder_that_reads_progress_begins_at_the_prior() -> None:
    curves, settings = torch.randn(4, 11, 3), TrainingSettings(latent_dimension=3)
    mean, log_variance = EncoderNetwork(3, (8, 6), torch.zeros(3), torch.ones(()), progress=True)(curves)
    expected = prior_means(np.linspace(0.0, 1.0, 11), settings)
    np.testing.assert_allclose(mean.detach(), np.broadcast_to(expected, (4, 11, 3)), atol=1e-6)
    np.testing.assert_array_equal(log_variance.detach(), START_LOG_VARIANCE)
