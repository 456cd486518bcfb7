"""A small task shown four times, and a small skill learned from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.quaternions import rotate_by
from geodesic_motion_ros.learning.autoencoder import DecoderNetwork
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill

#: Small enough to train in seconds, large enough to learn the task below.
QUICK = TrainingSettings(
    sheet="raw", steps=1600, samples=60, batch=128, hidden=(60, 40), kernels=120, precision_iterations=60
)

#: Steps where each orientation is learned on one side of the sphere alone: errors are then an eighth of the bounds.
FEWER = 800


def bend(name: str, offset: np.ndarray, samples: int = 150) -> Demonstration:
    """A J-shaped motion of about half a metre whose tool turns by 100 degrees."""
    s = np.linspace(0.0, 1.0, samples)[:, None]
    positions = np.hstack([0.4 + 0.15 * np.sin(np.pi * s), 0.3 * (s - 0.5), 0.3 + 0.25 * s**2])
    turn = np.radians(100.0) * s * np.array([[0.6, 0.0, 0.8]])
    quaternions = rotate_by(turn, np.tile([0.5, 0.5, 0.5, 0.5], (samples, 1)))
    swell = np.sin(np.pi * s) * offset + (1.0 - s) * 0.3 * offset
    return Demonstration(positions + swell, quaternions, np.arange(samples) * 0.02, name)


@pytest.fixture(scope="session")
def demonstrations() -> Demonstrations:
    """Four bends that differ mostly in one direction, by some centimetres."""
    rng = np.random.default_rng(7)
    wide = np.linspace(-1.0, 1.0, 4)[:, None] * [0.05, -0.02, 0.04] + rng.normal(0.0, 0.004, (4, 3))
    return Demonstrations(tuple(bend(f"bend {i}", offset) for i, offset in enumerate(wide)))


@pytest.fixture(scope="session")
def skill(stored, demonstrations):
    return stored("bend", lambda: train_skill(demonstrations, QUICK, name="bend"))


@pytest.fixture(scope="session")
def trained_skill(demonstrations):
    return train_skill(demonstrations, QUICK, name="bend")


@pytest.fixture(scope="session")
def canonical_skill(demonstrations):
    settings = replace(QUICK, steps=FEWER, sheet="canonical", orientation_model=None, precision_samples=2)
    return train_skill(demonstrations, settings, name="bend")


@pytest.fixture(scope="session")
def sign_blind_skill(demonstrations):
    settings = replace(QUICK, steps=FEWER, orientation_model="sign_blind")
    return train_skill(demonstrations, settings, name="bend")


@pytest.fixture(scope="session")
def decoder(skill) -> DecoderNetwork:
    return DecoderNetwork.from_numpy(skill.decoder)


@pytest.fixture(scope="session")
def latent(skill) -> torch.Tensor:
    """Latent points on the demonstrations and between them and the rim of the box, (60, 2)."""
    rng = np.random.default_rng(3)
    on = skill.codes.reshape(-1, 2)[rng.integers(0, skill.codes.shape[0] * skill.codes.shape[1], 40)]
    off = rng.uniform(skill.latent_lower, skill.latent_upper, (20, 2))
    return torch.tensor(np.concatenate([on, off]))
