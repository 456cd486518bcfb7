"""Joint-space models for experiments on their latent spaces alone: what is shown, training, the tool, the support."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from tqdm import tqdm

from geodesic_motion_ros.learning.autoencoder import AutoEncoder
from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.learning.likelihoods import ConfigurationLikelihood
from geodesic_motion_ros.learning.networks import RadialBasisNetwork
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.learning.training import train_model
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import SUPPORT_MULTIPLE
from geodesic_motion_studies.experiments.trained import digest_of
from geodesic_motion_studies.tools.joint_metric import JointPullbackMetric

if TYPE_CHECKING:
    from geodesic_motion_ros.simulation.joint_teacher import Guidance


def commanded(robot: Robot, guidance: Guidance, samples: int, swivel: float = 0.0) -> np.ndarray:
    """Configurations (samples, 7) [rad] that the simulated teacher tells the arm, without physics.

    swivel : added to the guidance's swivel angles [rad].
    """
    from geodesic_motion_ros.simulation.joint_teacher import configurations

    motion, kept = guidance.motion, np.linspace(0, len(guidance.swivels) - 1, samples).astype(int)
    sampled = replace(motion, positions=motion.positions[kept], quaternions=motion.quaternions[kept])
    return configurations(robot, replace(guidance, motion=sampled, swivels=guidance.swivels[kept] + swivel))


def models(
    shown: np.ndarray,
    robot: Robot,
    dimensions: Sequence[int],
    seeds: Sequence[int],
    settings: JointTrainingSettings,
    folder: Path | None = None,
) -> Iterator[tuple[AutoEncoder, JointTrainingSettings]]:
    """Learn configurations (N, T, eta) [rad] in each number of latent dimensions, once for every seed.

    settings : with the dimension and the seed that replace its own they come with the model.
    folder : where models are kept, and taken from where the very same training was done before; None: nowhere.
    """
    for dimension, seed in tqdm(list(product(dimensions, seeds)), desc="models", unit="model"):
        chosen = replace(settings, seed=seed, latent_dimension=dimension)
        yield _model(shown, robot, chosen, folder), chosen


def _model(shown: np.ndarray, robot: Robot, settings: JointTrainingSettings, folder: Path | None) -> AutoEncoder:
    if folder is None:
        return train_model((shown,), ConfigurationLikelihood(settings, robot))
    kept = folder / f"{digest_of([shown], settings)}.safetensors"
    if not kept.is_file():
        vae = train_model((shown,), ConfigurationLikelihood(settings, robot))
        folder.mkdir(parents=True, exist_ok=True)
        unfinished = kept.with_suffix(".part")
        # Encoder and decoder share their scaling: the file wants every tensor for itself.
        save_file({name: tensor.clone() for name, tensor in vae.state_dict().items()}, unfinished)
        unfinished.replace(kept)
    # Also right after the training, so that both runs measure on the very same numbers.
    return _restored(load_file(kept), settings)


def _restored(tensors: dict[str, torch.Tensor], settings: JointTrainingSettings) -> AutoEncoder:
    """The model whose state it is, frozen."""
    scaling = tensors["encoder.offset"], tensors["encoder.scale"]
    vae = AutoEncoder(
        settings.latent_dimension, settings.hidden, *scaling, progress=settings.progress_numbers
    ).double()
    network = (tensors[f"decoder.inverse_sigma.{name}"] for name in ("centres", "rate", "floor", "scale"))
    vae.decoder.inverse_sigma = RadialBasisNetwork(*network)
    vae.load_state_dict(tensors)
    return vae.requires_grad_(False)


def pullback_metric(vae: AutoEncoder, robot: Robot, settings: JointTrainingSettings) -> JointPullbackMetric:
    """The metric that a model was learned for."""
    return JointPullbackMetric(vae.decoder, BodyLayer(robot, settings.metric.body_points(robot)), settings.metric)


def supported(vae: AutoEncoder, codes: np.ndarray, latent: np.ndarray) -> np.ndarray:
    """Whether latent points (n, d) are as near to the codes (..., d) of what was shown as a skill's nodes are: (n,)."""
    decoder = vae.decoder.to_numpy()
    limit = SUPPORT_MULTIPLE * np.percentile(rms_sigma(decoder.uncertainty(codes.reshape(-1, codes.shape[-1]))), 99.0)
    return rms_sigma(decoder.uncertainty(latent)) <= limit


def tool_positions(robot: Robot, configurations: np.ndarray) -> np.ndarray:
    """Where the tool is (..., 3) [m] in configurations (..., eta) [rad]."""
    flat = np.ascontiguousarray(configurations.reshape(-1, configurations.shape[-1]))
    return end_effector_poses(flat, robot.chain)[0].reshape(*configurations.shape[:-1], 3)


def decoded(vae: AutoEncoder, latent: np.ndarray) -> np.ndarray:
    """Mean configurations (n, eta) [rad] at latent points (n, d)."""
    with torch.no_grad():
        return vae.decoder.means(torch.tensor(latent)).coordinates.numpy()


def tool_error(vae: AutoEncoder, robot: Robot, configurations: np.ndarray) -> float:
    """Mean distance [m] of the tool in configurations (..., eta) [rad] from where it is in what comes back of them."""
    with torch.no_grad():
        given_back = vae.decoder.means(vae.encoder(torch.tensor(configurations))[0]).coordinates.numpy()
    off = tool_positions(robot, given_back) - tool_positions(robot, configurations)
    return float(np.linalg.norm(off, axis=-1).mean())
