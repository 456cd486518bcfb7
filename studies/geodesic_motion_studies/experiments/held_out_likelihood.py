"""How likely a skill finds a demonstration that it was not trained on.

The demonstration is taken to the canonical sheet, where its ends have no offsets, and encoded; the decoder's densities
at its code judge every sample. Those of a quaternion are of q and -q alike, so that they are per unit of the same
surface: of a von Mises-Fisher density the mixture of both signs, lower by log 2 than that of the sign that was learned.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from geodesic_motion_ros.demonstrations.canonical import (
    offsets_between,
    remove_pose_offsets,
    sample_body_arc,
    sample_pose_arc,
)
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.learning.autoencoder import DecoderNetwork
from geodesic_motion_ros.learning.densities import (
    angular_central_gaussian_log_density,
    antipodal_log_density,
    full_gaussian_log_density,
    gaussian_log_density,
    wrapped_log_density,
)
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.learning.shown_task import CODE_SAMPLES
from geodesic_motion_ros.manifold.encoder import JointSpaceEncoder, TaskSpaceEncoder
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.experiments.joint_imitation import as_learned


def log_densities(skill: Skill, settings: TrainingSettings | JointTrainingSettings, item: Any) -> np.ndarray:
    """Log densities (S, 2) [nats] of samples of a demonstration, of position and orientation, or (S, 1) of joints."""
    if isinstance(settings, JointTrainingSettings):
        robot = Robot.named(skill.robot)
        curve, _ = as_learned(skill, sample_body_arc(item.configurations, robot, skill.metric, CODE_SAMPLES), robot)
        decoded = skill.decoder.decode(JointSpaceEncoder.from_arrays(skill.encoder_arrays).encode(curve))
        density = wrapped_log_density if settings.joint_density == "wrapped" else gaussian_log_density
        return density(*map(torch.tensor, (curve, decoded.configurations, 1.0 / decoded.sigma))).numpy()[:, None]
    poses = _canonical_poses(skill, settings, item)
    latent = torch.tensor(TaskSpaceEncoder.from_arrays(skill.encoder_arrays).encode(*poses))
    network, (x, q) = DecoderNetwork.from_numpy(skill.decoder), map(torch.tensor, poses)
    means, (inverse_sigma, kappa, _, below) = network.means(latent), network.precisions(latent)
    if below is None:
        of_position = gaussian_log_density(x, means.coordinates, inverse_sigma)
    else:
        of_position = full_gaussian_log_density(x, means.coordinates, inverse_sigma, below)
    of_directions = angular_central_gaussian_log_density if kappa.ndim == 2 else antipodal_log_density
    return torch.stack([of_position, of_directions(q, means.directions, kappa)], dim=1).numpy()


def _canonical_poses(skill: Skill, settings: TrainingSettings, item: Any) -> tuple[np.ndarray, np.ndarray]:
    """Positions (S, 3) and quaternions (S, 4) of a demonstration, of the sign that the skill has learned."""
    positions, quaternions = sample_pose_arc(item, CODE_SAMPLES, settings.rotation_length)
    ends = ((skill.start_pose, slice(0, 1)), (skill.goal_pose, slice(-1, None)))
    offsets = [offsets_between(pose, positions[end], quaternions[end]) for pose, end in ends]
    curves = remove_pose_offsets(positions[None], continuous_signs(quaternions)[None], *offsets, skill.fade)
    (positions,), (quaternions,) = curves
    return positions, quaternions * np.sign(np.sum(quaternions * skill.canonical.quaternions[0]))
