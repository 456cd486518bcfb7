"""From a trained model of configurations to a skill: codes, latent box, support and feasible energy."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from geodesic_motion_ros.demonstrations.joint_canonical import (
    CanonicalJointDemonstrations,
    along_body_arc,
    canonical_joint_form,
)
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.modes import cluster_modes
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.learning.calibration import CODE_SAMPLES, SUPPORT_PERCENTILE, dearest_energy
from geodesic_motion_ros.learning.joint_space import JointSpaceVAE
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.joint_sheet import JointSheet
from geodesic_motion_ros.skill.regression import regression_penalty
from geodesic_motion_ros.skill.skill import LearnedModel, Skill


def assemble_joint_skill(
    vae: JointSpaceVAE,
    demonstrations: JointDemonstrations,
    robot: Robot,
    name: str,
    settings: JointTrainingSettings,
    provenance: dict[str, Any],
) -> Skill:
    """Put a trained float64 model and the demonstrations it was trained on together into a calibrated skill.

    Raises
    ------
    SkillError : no demonstration's ends are connected inside the support; of a literal model no two of its nodes.
    """
    sheet = None
    configurations = np.stack(
        [along_body_arc(item.configurations, robot, settings.metric, CODE_SAMPLES) for item in demonstrations]
    )
    start, goal = configurations[:, 0].mean(axis=0), configurations[:, -1].mean(axis=0)
    if settings.sheet == "canonical":
        form = canonical_joint_form(demonstrations, robot, settings.metric, CODE_SAMPLES)
        sheet, configurations = joint_sheet(form), form.configurations
        start, goal = form.start_poles[0], form.goal_poles[0]
    with torch.no_grad():
        codes = vae.encoder(torch.tensor(configurations))[0].numpy()
    flat = codes.reshape(-1, codes.shape[-1])
    border = settings.margin * np.ptp(flat, axis=0)
    decoder = vae.decoder.to_numpy()
    model = LearnedModel(
        name=name,
        robot=demonstrations.robot,
        space="joint",
        decoder=decoder,
        codes=codes,
        latent_lower=flat.min(axis=0) - border,
        latent_upper=flat.max(axis=0) + border,
        sigma_support=float(np.percentile(rms_sigma(decoder.uncertainty(flat)), SUPPORT_PERCENTILE)),
        metric=settings.metric,
        canonical=sheet,
        orientation_model="none",
    )
    return Skill.of(
        model,
        calibrated_energy(model.graph(), codes, whole=settings.schedule != "joint"),
        start_pose=np.concatenate(robot.forward(start)),
        goal_pose=np.concatenate(robot.forward(goal)),
        base_frame=robot.base_link,
        tool_frame=robot.tool_link,
        encoder_arrays=vae.encoder.arrays(),
        quality=_reconstruction_quality(vae, codes, configurations, robot),
        provenance=provenance,
    )


def joint_sheet(form: CanonicalJointDemonstrations) -> JointSheet:
    """What a skill keeps of canonical demonstrations, with their modes and the regression they speak for."""
    modes = cluster_modes(form.configurations)
    sheet = JointSheet(
        form.start_offsets, form.goal_offsets, modes, math.inf,
        form.configurations, form.start_groups, form.goal_groups, form.start_poles, form.goal_poles, fade=form.fade,
    )  # fmt: skip
    # Between modes there is nothing to regress: a mean never averages two modes.
    if np.any(modes):
        return sheet
    return replace(sheet, penalty=regression_penalty(sheet.features(), form.configurations))


def calibrated_energy(graph: ConfigurationGraph, codes: np.ndarray, whole: bool = True) -> float:
    """Largest squared length of one edge that a feasible path may have; see `calibration.dearest_energy`."""
    still = graph.transported(JointOffsets.none(graph.robot, graph.mean_path_count))
    return dearest_energy(graph, still.energies(), codes, whole)


def _reconstruction_quality(
    vae: JointSpaceVAE, codes: np.ndarray, configurations: np.ndarray, robot: Robot
) -> dict[str, float]:
    """How well the tool's poses in the training demonstrations come back from their codes."""
    with torch.no_grad():
        decoded = vae.decoder.means(torch.tensor(codes)).numpy()
    joints = configurations.shape[-1]
    positions, quaternions = end_effector_poses(configurations.reshape(-1, joints), robot.chain)
    found, turned = end_effector_poses(decoded.reshape(-1, joints), robot.chain)
    return {
        "training_position_error_mm": float(1e3 * np.linalg.norm(found - positions, axis=-1).mean()),
        "training_orientation_error_deg": float(np.degrees(angle_between(turned, quaternions).mean())),
    }
