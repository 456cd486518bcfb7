"""Models without a skill around them: what is commanded, that each is learned anew, and what counts as support."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import swivel_angle
from geodesic_motion_ros.simulation.joint_teacher import reach_guidances
from geodesic_motion_studies.experiments.joint_models import (
    commanded,
    decoded,
    models,
    pullback_metric,
    supported,
    tool_error,
    tool_positions,
)

ROBOT = Robot.named("panda")
SMALL = JointTrainingSettings(
    sheet="raw", hidden=(32, 16), steps=300, batch=64, learning_rate=1e-2, samples=30, kernels=60,
    precision_samples=1, precision_iterations=100,
)  # fmt: skip


@pytest.fixture(scope="module")
def shown() -> np.ndarray:
    return np.stack([commanded(ROBOT, each, 30) for each in reach_guidances(2, 0, 2, connected=False)])


def test_the_arm_receives_the_guidance_with_its_elbow_turned_on() -> None:
    (guidance,) = reach_guidances(1, 0, 1, connected=False)
    plain, turned = commanded(ROBOT, guidance, 12), commanded(ROBOT, guidance, 12, 0.2)
    np.testing.assert_allclose(tool_positions(ROBOT, plain)[[0, -1]], guidance.motion.positions[[0, -1]], atol=1e-6)
    np.testing.assert_allclose(tool_positions(ROBOT, turned), tool_positions(ROBOT, plain), atol=1e-6)
    more = [swivel_angle(ROBOT, b) - swivel_angle(ROBOT, a) for a, b in zip(plain, turned, strict=True)]
    np.testing.assert_allclose(more, 0.2, atol=1e-6)


def test_models_come_by_dimension_and_seed_and_are_measured(shown) -> None:
    learned = list(models(shown, ROBOT, (2,), (0, 1), SMALL))
    assert [(chosen.latent_dimension, chosen.seed) for _, chosen in learned] == [(2, 0), (2, 1)]
    for vae, chosen in learned:
        with torch.no_grad():
            codes = vae.encoder(torch.tensor(shown))[0].numpy()
        assert codes.shape == (*shown.shape[:2], chosen.latent_dimension)
        found = tool_positions(ROBOT, decoded(vae, codes.reshape(-1, chosen.latent_dimension)))
        off = np.linalg.norm(found - tool_positions(ROBOT, shown).reshape(-1, 3), axis=1).mean()
        assert tool_error(vae, ROBOT, shown) == pytest.approx(off)
        kept = supported(vae, codes, np.concatenate([codes[0], codes[0] + 100.0]))
        assert kept[:30].mean() > 0.9
        assert not kept[30:].any()
        tensors = pullback_metric(vae, ROBOT, chosen)(torch.tensor(codes[0]))
        assert torch.linalg.eigvalsh(tensors).min() > 0.0


def test_a_model_that_was_kept_is_the_one_that_was_trained(shown, tmp_path) -> None:
    settings = replace(SMALL, steps=20, precision_iterations=5)
    (trained, _), (kept, _), (plain, _) = (
        next(models(shown, ROBOT, (2,), (0,), settings, folder=folder)) for folder in (tmp_path, tmp_path, None)
    )
    assert len(list(tmp_path.iterdir())) == 1
    assert [name for name, _ in kept.named_parameters()] == [name for name, _ in plain.named_parameters()]
    for name, tensor in plain.state_dict().items():
        assert torch.equal(trained.state_dict()[name], tensor)
        assert torch.equal(kept.state_dict()[name], tensor)
    next(models(shown, ROBOT, (2,), (0,), replace(settings, steps=21), folder=tmp_path))
    assert len(list(tmp_path.iterdir())) == 2
