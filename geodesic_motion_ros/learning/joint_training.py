"""From joint-space demonstrations to a skill: how the model of whole-arm configurations is trained.

Two stages, as in `training`: the means first, under a fixed likelihood scale, then kernels on the codes and sigma by
maximum likelihood. The paper's literal joint training is kept as `schedule="joint"`. On the canonical sheet (default)
start and goal offsets of the joints are taken out before (`demonstrations.joint_canonical`); the raw sheet, the
paper's, is learned from the demonstrations as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from geodesic_motion_ros.demonstrations.joint_canonical import along_body_arc, canonical_joint_form
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.modes import blend_weights, cluster_modes
from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.learning.densities import divergence_from_normal, gaussian_log_density
from geodesic_motion_ros.learning.joint_calibration import assemble_joint_skill
from geodesic_motion_ros.learning.joint_space import JointSpaceVAE
from geodesic_motion_ros.learning.networks import RadialBasisNetwork, kernel_rate, place_centres
from geodesic_motion_ros.learning.optimisation import Progress, descend, drawn_rows, minimise, one_seeded_thread
from geodesic_motion_ros.learning.progress_prior import prior_means, prior_variance
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.robot.body_points import BodyPoints, points_along_links
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import GRID_SHAPES, Skill
from geodesic_motion_ros.utils.errors import ParameterError

#: How far beside the tool points are watched while learning [m]: a turn by a radian counts so much.
TOOL_AXES = 0.1


class Samples(NamedTuple):
    """Training samples: configurations (n, eta) [rad], their body points (n, K, 3) [m], and the means (n, d) of their
    prior.
    """

    configurations: Tensor
    points: Tensor
    prior_means: Tensor

    def take(self, index: Tensor) -> Samples:
        return Samples(*(values[index] for values in self))

    def double(self) -> Samples:
        return Samples(*(values.double() for values in self))


def train_joint_space_skill(
    demonstrations: JointDemonstrations,
    robot: Robot,
    settings: JointTrainingSettings | None = None,
    name: str = "skill",
    progress: Progress | None = None,
    provenance: dict[str, Any] | None = None,
) -> Skill:
    """Learn a skill from demonstrations of one task: train, then calibrate support and feasibility.

    Parameters
    ----------
    robot : that the demonstrations are of.
    settings : None for the defaults. progress : called as progress(stage, step, steps).
    provenance : what to say of the data (source, licence); seed, settings and demonstrations' names are added.

    Raises
    ------
    ParameterError : more latent dimensions than a skill's graph can have.
    DemonstrationError : demonstrations that have no form in common.
    SkillError : the model that came out is unusable.
    """
    settings = settings or JointTrainingSettings()
    if settings.latent_dimension not in GRID_SHAPES:
        raise ParameterError(f"latent_dimension is {settings.latent_dimension}; a skill's graph has 2 or 3")
    configurations = training_configurations(demonstrations, robot, settings)
    vae = train_joint_model(configurations, settings, body_layer(robot, settings.metric), progress)
    described = {"demonstrations": [item.name for item in demonstrations], "frame": robot.base_link}
    described |= {"seed": settings.seed, "settings": asdict(settings)} | (provenance or {})
    return assemble_joint_skill(vae, demonstrations, robot, name, settings, described)


def training_configurations(
    demonstrations: JointDemonstrations, robot: Robot, settings: JointTrainingSettings
) -> np.ndarray:
    """Configurations (curves, samples, eta) [rad] that are learned, equally spaced along their arcs."""
    if settings.sheet == "raw":
        metric, samples = settings.metric, settings.samples
        return np.stack([along_body_arc(item.configurations, robot, metric, samples) for item in demonstrations])
    configurations = canonical_joint_form(demonstrations, robot, settings.metric, settings.samples).configurations
    weights = blend_weights(cluster_modes(configurations), settings.blends, settings.seed)
    return np.concatenate([configurations, np.einsum("bn,ntj->btj", weights, configurations)])


def body_layer(robot: Robot, metric: JointMetricSettings) -> BodyLayer:
    """The metric's body points and the tool's orientation; three points beside the tool tell how it is turned where the
    metric does not know.
    """
    if metric.orientation_weight > 0.0:
        return BodyLayer(robot, metric.body_points(robot), metric.orientation_weight)
    beside = {robot.tool_link: (TOOL_AXES * np.eye(3)).tolist()}
    return BodyLayer(robot, BodyPoints.of(robot, points_along_links(robot, metric.point_spacing) | beside))


def train_joint_model(
    configurations: np.ndarray,
    settings: JointTrainingSettings,
    body: BodyLayer,
    progress: Progress | None = None,
) -> JointSpaceVAE:
    """Train on (curves, samples, eta) [rad]; the model is float64, frozen and reproducible bit by bit from the seed."""
    curves, samples, joints = configurations.shape
    flat = configurations.reshape(-1, joints)
    fractions = np.tile(np.linspace(0.0, 1.0, samples), curves)
    with one_seeded_thread(settings.seed):
        offset = flat.mean(axis=0)
        scale = np.sqrt(np.mean((flat - offset) ** 2))
        vae = JointSpaceVAE(
            settings.latent_dimension, settings.hidden, torch.tensor(offset).float(), torch.tensor(scale).float()
        )
        points = body.points(torch.tensor(flat)).numpy()
        data = Samples(*(torch.tensor(values).float() for values in (flat, points, prior_means(fractions, settings))))
        if settings.schedule == "joint":
            _fit_jointly(vae, data, settings, body, progress)
        else:
            _ascend(vae, data, _fixed(data, settings), settings.steps, "means", settings, body, progress)
            vae.double()
            _fit_sigma(vae, data.double(), settings, progress)
        return vae.double().requires_grad_(False)


def _fixed(data: Samples, settings: JointTrainingSettings) -> Callable[[Tensor], Tensor]:
    """1 / sigma [1/rad] that does not depend on z, for learning the means first."""
    joints = data.configurations.shape[1]
    return lambda latent: latent.new_full((*latent.shape[:-1], joints), 1.0 / settings.fixed_sigma)


def counted_log_volume(body: BodyLayer, means: Tensor, shown: Tensor) -> Tensor:
    """Return log V (B,) of means (B, eta) [rad], each no less than that of the configuration (B, eta) it stands for.

    The gain of singular postures has nearly no end, and would lead means there from anywhere.
    """
    return torch.maximum(body.log_volume(means), body.log_volume(shown))


def _ascend(
    vae: JointSpaceVAE,
    data: Samples,
    inverse_sigma: Callable[[Tensor], Tensor],
    steps: int,
    stage: str,
    settings: JointTrainingSettings,
    body: BodyLayer,
    progress: Progress | None,
) -> None:
    """Climb the weighted evidence lower bound over every parameter the model has now."""
    variance = prior_variance(settings)

    def loss(step: int) -> Tensor:
        batch = data.take(torch.randint(len(data.configurations), (settings.batch,)))
        latent, mean, log_variance = vae.sample(batch.configurations)
        divergence = divergence_from_normal(mean, log_variance, batch.prior_means, variance)
        means, precisions = vae.decoder.means(latent), inverse_sigma(latent)
        likelihood = _log_likelihood(batch.configurations, means, precisions, settings)
        if settings.body_sigma > 0.0:
            off = (body.points(means) - batch.points) / settings.body_sigma
            likelihood = likelihood - 0.5 * (off**2).sum(-1).mean(-1)
        if settings.volume_weight > 0.0:
            likelihood = likelihood - settings.volume_weight * counted_log_volume(body, means, batch.configurations)
        warm = min(1.0, step / max(1.0, settings.kl_warm_up * steps))
        return (warm * settings.kl_weight * divergence - likelihood).mean()

    descend(loss, vae.parameters(), steps, settings.learning_rate, stage, progress)


def _log_likelihood(
    configurations: Tensor, means: Tensor, inverse_sigma: Tensor, settings: JointTrainingSettings
) -> Tensor:
    """log p(theta | z) (n,), in expectation over errors of the recording's resolution."""
    resolution = 0.5 * settings.joint_resolution**2 * (inverse_sigma**2).sum(-1)
    return gaussian_log_density(configurations, means, inverse_sigma) - resolution


def _fit_jointly(
    vae: JointSpaceVAE, data: Samples, settings: JointTrainingSettings, body: BodyLayer, progress: Progress | None
) -> None:
    first = max(1, settings.steps // 2)
    _ascend(vae, data, _fixed(data, settings), first, "codes settle", settings, body, progress)
    network = vae.decoder.inverse_sigma = _basis_network(vae, data, settings)
    # Sigma begins as the codes have settled under: a jump of the likelihood would throw them about.
    network.start_level(vae.encoder(data.configurations)[0])
    _ascend(vae, data, network, settings.steps - first, "joint", settings, body, progress)


def _basis_network(vae: JointSpaceVAE, data: Samples, settings: JointTrainingSettings) -> RadialBasisNetwork:
    """A network for 1 / sigma with kernels on the present codes, in the precision of the data."""
    with torch.no_grad():
        codes = vae.encoder(data.configurations)[0].double().numpy()
    centres, joints = place_centres(codes, settings.kernels, settings.seed), data.configurations.shape[1]
    like = {"dtype": data.configurations.dtype}
    return RadialBasisNetwork(
        torch.tensor(centres, **like),
        torch.tensor(kernel_rate(centres, codes, settings.bandwidth_factor), **like),
        torch.full((joints,), 1.0 / settings.far_sigma, **like),
        torch.full((joints,), 1.0 / settings.fixed_sigma, **like),
    )


def _fit_sigma(
    vae: JointSpaceVAE, data: Samples, settings: JointTrainingSettings, progress: Progress | None
) -> None:
    """Maximum likelihood of sigma with the means frozen and z ~ q(z | theta) drawn once.

    The volume does not depend on sigma.
    """
    with torch.no_grad():
        repeated = data.configurations[drawn_rows(len(data.configurations), settings.precision_samples)]
        latent, _, _ = vae.sample(repeated)
        means = vae.decoder.means(latent)
    network = vae.decoder.inverse_sigma = _basis_network(vae, data, settings)
    activations = network.activations(latent)

    def negative_log_likelihood() -> Tensor:
        return -_log_likelihood(repeated, means, network.combine(activations), settings).mean()

    minimise(negative_log_likelihood, [network.raw_weights], settings.precision_iterations, "sigma", progress)
