"""From demonstrations to a skill: how the task-space model is trained.

Two stages (default). The means first, under fixed likelihood scales: learning precisions at the same time
lets the model explain a demonstration away as noise. Then the latent space stays as it is, kernels are placed
on the codes by k-means, and sigma and kappa are fitted by maximum likelihood, a concave problem without local
optima. The paper's literal joint training is kept as `schedule="joint"`.

On the canonical sheet (default) endpoint-normalised demonstrations are learned (`demonstrations.canonical`), and
the prior tells how far along them a pose is (`progress_prior`). The raw sheet, the paper's, is learned from the
demonstrations as they are, with the prior N(0, 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from geodesic_motion_ros.demonstrations.canonical import along_arc, canonical_form
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.modes import blend_weights, cluster_modes
from geodesic_motion_ros.learning.calibration import assemble_skill
from geodesic_motion_ros.learning.densities import divergence_from_normal
from geodesic_motion_ros.learning.networks import RadialBasisNetwork, kernel_rate, place_centres
from geodesic_motion_ros.learning.optimisation import Progress, descend, drawn_rows, minimise, one_seeded_thread
from geodesic_motion_ros.learning.progress_prior import prior_means, prior_variance
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.task_space import FixedPrecisions, Means, Precisions, TaskSpaceVAE
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.skill.skill import Skill


class Poses(NamedTuple):
    """Training poses: positions (n, p) [m], unit quaternions (n, o), and the means (n, d) of their prior."""

    positions: Tensor
    quaternions: Tensor
    prior_means: Tensor

    def take(self, index: Tensor) -> Poses:
        return Poses(*(values[index] for values in self))


def train_task_space_skill(
    demonstrations: Demonstrations,
    settings: TrainingSettings | None = None,
    name: str = "skill",
    progress: Progress | None = None,
    provenance: dict[str, Any] | None = None,
    robot: str = DEFAULT_ROBOT,
) -> Skill:
    """Learn a skill from demonstrations of one task: train, then calibrate support and feasibility.

    Every orientation is learned with both signs, unless the recordings have no orientation.

    Parameters
    ----------
    settings : None for the defaults. progress : called as progress(stage, step, steps).
    provenance : what to say of the data (source, licence); seed, settings and demonstrations' names are
        added.
    robot : that is to do it: the name of a shipped one, or the path of a folder.

    Raises
    ------
    DemonstrationError : a demonstration that does not move.
    SkillError : the model that came out is unusable (see `assemble_skill`).
    """
    settings = settings or TrainingSettings()
    aligned = demonstrations.in_one_hemisphere()
    positions, quaternions = training_poses(aligned, settings)
    fractions = np.tile(np.linspace(0.0, 1.0, settings.samples), len(positions) // settings.samples)
    if aligned.has_orientation:
        positions = np.concatenate([positions, positions])
        quaternions = np.concatenate([quaternions, -quaternions])
        fractions = np.tile(fractions, 2)
    vae = train_model(positions, quaternions, fractions, settings, progress)
    described = {"demonstrations": [item.name for item in aligned], "frame": aligned.frame}
    described |= {"seed": settings.seed, "settings": asdict(settings)} | (provenance or {})
    return assemble_skill(vae, aligned, name, settings, described, robot)


def training_poses(demonstrations: Demonstrations, settings: TrainingSettings) -> tuple[np.ndarray, np.ndarray]:
    """Poses (N samples, 3) [m] and (N samples, 4), equally spaced along each demonstration's arc, one after the other.

    The arc counts turning as well (`curves.pose_arc_length`): with positions alone, a tool that turns nearly on the
    spot would leave gaps of ten degrees and more between neighbouring samples.
    """
    if settings.sheet == "canonical":
        canonical = canonical_form(demonstrations, settings.samples, settings.rotation_length)
        positions, quaternions = canonical.blended(
            blend_weights(cluster_modes(canonical.positions), settings.blends, settings.seed)
        )
        positions = np.concatenate([canonical.positions, positions])
        quaternions = np.concatenate([canonical.quaternions, quaternions])
        return positions.reshape(-1, 3), quaternions.reshape(-1, 4)
    curves = [along_arc(item, settings.samples, settings.rotation_length) for item in demonstrations]
    return np.concatenate([positions for positions, _ in curves]), np.concatenate([turns for _, turns in curves])


def train_model(
    positions: np.ndarray,
    quaternions: np.ndarray,
    fractions: np.ndarray,
    settings: TrainingSettings,
    progress: Progress | None = None,
) -> TaskSpaceVAE:
    """Train the auto-encoder on poses; the result is float64, frozen and reproducible bit by bit from the
    seed.

    Parameters
    ----------
    positions, quaternions : (n, 3) [m] and (n, 4) unit, exactly as they are to be learned (with both signs of
        each quaternion if both are wanted); for the paper's toy (n, 2) and directions (n, 3).
    fractions : (n,) of the arc where they lie; the raw sheet's prior does not look at them.
    """
    with one_seeded_thread(settings.seed):
        offset, scale = _position_scaling(positions)
        vae = TaskSpaceVAE(
            settings.latent_dimension, settings.hidden, offset, scale, settings.orientation_model, quaternions.shape[1]
        )
        means = prior_means(fractions, settings)
        poses = Poses(*(torch.tensor(values).float() for values in (positions, quaternions, means)))
        if settings.orientation_model == "sign_blind":
            _start_on_one_side(vae, poses)
        if settings.schedule == "joint":
            _fit_jointly(vae, poses, settings, progress)
        else:
            fixed = FixedPrecisions(settings.fixed_sigma, settings.fixed_kappa)
            _ascend(vae, poses, fixed, settings.steps, "means", settings, progress)
            vae.double()
            _fit_precisions(vae, Poses(*(values.double() for values in poses)), settings, progress)
        return vae.double().requires_grad_(False)


def _position_scaling(positions: np.ndarray) -> tuple[Tensor, Tensor]:
    """Mean (p,) and root mean square distance from it over sqrt p (): one scalar keeps proportions."""
    offset = positions.mean(axis=0)
    return torch.tensor(offset).float(), torch.tensor(np.sqrt(np.mean((positions - offset) ** 2))).float()


def _start_on_one_side(vae: TaskSpaceVAE, poses: Poses) -> None:
    """Begin with a decoder whose quaternions all lie about the orientations' principal axis, for the mixture.

    The antipodal mixture pulls the decoder to the nearer of q and -q: from a random start parts of one motion end up on
    opposite sheets, with a seam between them.
    """
    axis = torch.linalg.eigh(poses.quaternions.T @ poses.quaternions).eigenvectors[:, -1]
    with torch.no_grad():
        vae.decoder.perceptron.layers[-1].bias[-len(axis) :] = axis


def _ascend(
    vae: TaskSpaceVAE,
    poses: Poses,
    precisions: Callable[[Tensor], Precisions],
    steps: int,
    stage: str,
    settings: TrainingSettings,
    progress: Progress | None,
) -> None:
    """Climb the weighted evidence lower bound over every parameter the model has now."""
    variance = prior_variance(settings)

    def loss(step: int) -> Tensor:
        batch = poses.take(torch.randint(len(poses.positions), (settings.batch,)))
        latent, mean, log_variance = vae.sample(batch.positions, batch.quaternions)
        divergence = divergence_from_normal(mean, log_variance, batch.prior_means, variance)
        likelihood = _log_likelihood(vae, batch, vae.decoder.means(latent), precisions(latent), settings)
        warm = min(1.0, step / max(1.0, settings.kl_warm_up * steps))
        return (warm * settings.kl_weight * divergence - likelihood).mean()

    descend(loss, vae.parameters(), steps, settings.learning_rate, stage, progress)


def _log_likelihood(
    vae: TaskSpaceVAE, poses: Poses, means: Means, precisions: Precisions, settings: TrainingSettings
) -> Tensor:
    """beta1 log p(x | z) + beta2 log p(q | z), (n,), in expectation over errors of the recording's
    resolution.
    """
    inverse_sigma = precisions.inverse_sigma.expand_as(poses.positions)
    position = vae.position_log_density(poses.positions, means, precisions)
    position = position - 0.5 * settings.position_resolution**2 * (inverse_sigma**2).sum(-1)
    # A rotation by an angle moves its quaternion by half of it; on S^3 there are three independent axes.
    axes = poses.quaternions.shape[-1] - 1
    orientation = vae.orientation_log_density(poses.quaternions, means, precisions)
    orientation = orientation - 0.5 * axes * (0.5 * settings.angular_resolution) ** 2 * precisions.kappa
    return settings.position_weight * position + settings.orientation_weight * orientation


def _fit_jointly(vae: TaskSpaceVAE, poses: Poses, settings: TrainingSettings, progress: Progress | None) -> None:
    first = max(1, settings.steps // 2)
    fixed = FixedPrecisions(settings.fixed_sigma, settings.fixed_kappa)
    _ascend(vae, poses, fixed, first, "codes settle", settings, progress)
    networks = _basis_networks(vae, poses, settings)
    for network in networks:
        # Both begin as the codes have settled under: a jump of the likelihood would throw them about.
        network.start_level(vae.encoder(poses.positions, poses.quaternions)[0])
    vae.decoder.set_precisions(*networks)
    _ascend(vae, poses, vae.decoder.precisions, settings.steps - first, "joint", settings, progress)


def _basis_networks(
    vae: TaskSpaceVAE, poses: Poses, settings: TrainingSettings
) -> tuple[RadialBasisNetwork, RadialBasisNetwork]:
    """Networks for 1 / sigma and kappa with kernels on the present codes, in the precision of the poses."""
    with torch.no_grad():
        codes = vae.encoder(poses.positions, poses.quaternions)[0].double().numpy()
    centres = place_centres(codes, settings.kernels, settings.seed)
    like = {"dtype": poses.positions.dtype}
    centre, rate = (
        torch.tensor(centres, **like),
        torch.tensor(kernel_rate(centres, codes, settings.bandwidth_factor), **like),
    )
    coordinates = poses.positions.shape[1]
    sigma_floor = torch.full((coordinates,), 1.0 / settings.far_sigma, **like)
    sigma_scale = torch.full((coordinates,), 1.0 / settings.fixed_sigma, **like)
    kappa_floor = torch.tensor([settings.far_kappa], **like)
    kappa_scale = torch.tensor([settings.fixed_kappa], **like)
    return (
        RadialBasisNetwork(centre, rate, sigma_floor, sigma_scale),
        RadialBasisNetwork(centre, rate, kappa_floor, kappa_scale),
    )


def _fit_precisions(vae: TaskSpaceVAE, poses: Poses, settings: TrainingSettings, progress: Progress | None) -> None:
    """Maximum likelihood of sigma and kappa with the means frozen and z ~ q(z | x, q) drawn once."""
    inverse_sigma, kappa = _basis_networks(vae, poses, settings)
    vae.decoder.set_precisions(inverse_sigma, kappa)
    drawn = drawn_rows(len(poses.positions), settings.precision_samples)
    repeated = Poses(*(values[drawn] for values in poses))
    with torch.no_grad():
        latent, _, _ = vae.sample(repeated.positions, repeated.quaternions)
        means = vae.decoder.means(latent)
        activations = inverse_sigma.activations(latent)

    def negative_log_likelihood() -> Tensor:
        precisions = Precisions(inverse_sigma.combine(activations), kappa.combine(activations)[..., 0])
        return -_log_likelihood(vae, repeated, means, precisions, settings).mean()

    parameters = [inverse_sigma.raw_weights, kappa.raw_weights]
    minimise(negative_log_likelihood, parameters, settings.precision_iterations, "sigma and kappa", progress)
