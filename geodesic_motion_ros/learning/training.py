"""From demonstrations to a skill: how the model of an output space is trained, of poses as of configurations.

Two stages (default). The means first, under fixed likelihood scales: learning precisions at the same time
lets the model explain a demonstration away as noise. Then the latent space stays as it is, kernels are placed
on the codes by k-means, and sigma and kappa are fitted by maximum likelihood, a concave problem without local
optima; of a full covariance and of three concentrations it is none, which begin as diagonal, and as equal. The paper's
literal joint training is kept as `schedule="joint"`.

On the canonical sheet (default) endpoint-normalised demonstrations are learned (`demonstrations.canonical`), and
the prior tells how far along them a sample is (`progress_prior`). The raw sheet, the paper's, is learned from the
demonstrations as they are, with the prior N(0, 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from torch import Tensor

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.learning.autoencoder import PROGRESS_SIGMA, AutoEncoder, FixedPrecisions, Precisions
from geodesic_motion_ros.learning.calibration import assemble_skill
from geodesic_motion_ros.learning.densities import divergence_from_normal
from geodesic_motion_ros.learning.likelihoods import Likelihood, Samples
from geodesic_motion_ros.learning.networks import (
    RadialBasisNetwork,
    SymmetricBasisNetwork,
    kernel_rate,
    place_centres,
)
from geodesic_motion_ros.learning.optimisation import Progress, descend, drawn_rows, minimise, one_seeded_thread
from geodesic_motion_ros.learning.progress_prior import prior_means, prior_variance
from geodesic_motion_ros.learning.settings import CommonSettings
from geodesic_motion_ros.learning.shown_task import Curves, ShownConfigurations, ShownPoses, ShownTask
from geodesic_motion_ros.skill.skill import Skill

_SHOWN = {Demonstrations: ShownPoses, JointDemonstrations: ShownConfigurations}


def train_skill(
    demonstrations: Demonstrations | JointDemonstrations,
    settings: CommonSettings | None = None,
    name: str = "skill",
    progress: Progress | None = None,
    provenance: dict[str, Any] | None = None,
    robot: str | None = None,
) -> Skill:
    """Learn a skill from demonstrations of one task: train, then calibrate support and feasibility.

    Parameters
    ----------
    settings : of the demonstrations' output space; None for the defaults.
    progress : called as progress(stage, step, steps).
    provenance : what to say of the data (source, licence); seed, settings and demonstrations' names are added.
    robot : that is to do it: the name of a shipped one, or the path of a folder. None: of poses the default one, of
        configurations the one that was recorded.

    Raises
    ------
    DemonstrationError : a demonstration that does not move, or demonstrations that have no form in common.
    SkillError : the model that came out is unusable (see `assemble_skill`).
    RobotError : there is no such robot.
    """
    shown = shown_task(demonstrations, settings, robot)
    vae = train_model(shown.learned_curves(), shown.likelihood, progress)
    described = {"demonstrations": shown.names, "frame": shown.frame}
    described |= {"seed": shown.settings.seed, "settings": asdict(shown.settings)} | (provenance or {})
    return assemble_skill(vae, shown, name, described)


def shown_task(
    demonstrations: Demonstrations | JointDemonstrations,
    settings: CommonSettings | None = None,
    robot: str | None = None,
) -> ShownTask:
    """Take demonstrations as their space is learned; parameters and errors as of `train_skill`."""
    return _SHOWN[type(demonstrations)](demonstrations, settings, robot)


def train_model(curves: Curves, likelihood: Likelihood, progress: Progress | None = None) -> AutoEncoder:
    """Train the auto-encoder; the result is float64, frozen and reproducible bit by bit from the seed.

    Parameters
    ----------
    curves : equally spaced along their arcs, exactly as they are to be learned: positions (C, T, 3) [m] and unit
        quaternions (C, T, 4), with both signs of each if both are wanted, or configurations (C, T, eta) [rad] alone;
        for the paper's toy (C, T, 2) and directions (C, T, 3).
    likelihood : of their samples, with the settings of the training.
    """
    settings = likelihood.settings
    with one_seeded_thread(settings.seed):
        vae, samples = _begun(curves, likelihood)
        if settings.schedule == "joint":
            _fit_jointly(vae, samples, likelihood, progress)
        else:
            _fit_means(vae, samples, likelihood, progress)
            vae.double()
            _fit_precisions(vae, samples.double(), likelihood, progress)
        return vae.double().requires_grad_(False)


def train_means(curves: Curves, likelihood: Likelihood, progress: Progress | None = None) -> AutoEncoder:
    """Train the auto-encoder's means alone, whatever the schedule: all that reconstruction needs; as `train_model`."""
    with one_seeded_thread(likelihood.settings.seed):
        vae, samples = _begun(curves, likelihood)
        _fit_means(vae, samples, likelihood, progress)
        return vae.double().requires_grad_(False)


def _begun(curves: Curves, likelihood: Likelihood) -> tuple[AutoEncoder, Samples]:
    """The model before its first step, and the samples of curves that it learns."""
    settings = likelihood.settings
    fractions = np.tile(np.linspace(0.0, 1.0, curves[0].shape[1]), len(curves[0]))
    coordinates, *directions = (values.reshape(-1, values.shape[-1]) for values in curves)
    scaling = _scaling(coordinates)
    vae = AutoEncoder(
        settings.latent_dimension, settings.hidden, *scaling, likelihood.sign_blind,
        sum(values.shape[1] for values in directions), settings.progress_numbers,
    )  # fmt: skip
    points = likelihood.points(coordinates)
    samples = Samples(
        torch.tensor(coordinates).float(),
        torch.tensor(directions[0]).float() if directions else None,
        None if points is None else points.float(),
        torch.tensor(prior_means(fractions, settings)).float(),
        torch.tensor(fractions).float(),
    )
    if likelihood.sign_blind:
        _start_on_one_side(vae, samples)
    return vae, samples


def _fit_means(vae: AutoEncoder, samples: Samples, likelihood: Likelihood, progress: Progress | None) -> None:
    _ascend(vae, samples, _fixed_precisions(likelihood), likelihood.settings.steps, "means", likelihood, progress)


def _scaling(coordinates: np.ndarray) -> tuple[Tensor, Tensor]:
    """Mean (p,) and root mean square distance from it over sqrt p (): one scalar keeps proportions."""
    offset = coordinates.mean(axis=0)
    return torch.tensor(offset).float(), torch.tensor(np.sqrt(np.mean((coordinates - offset) ** 2))).float()


def _start_on_one_side(vae: AutoEncoder, samples: Samples) -> None:
    """Begin with a decoder whose quaternions all lie about the orientations' principal axis, for the mixture.

    The antipodal mixture pulls the decoder to the nearer of q and -q: from a random start parts of one motion end up on
    opposite sheets, with a seam between them.
    """
    axis = torch.linalg.eigh(samples.directions.T @ samples.directions).eigenvectors[:, -1]
    with torch.no_grad():
        vae.decoder.perceptron.layers[-1].bias[-len(axis) :] = axis


def _fixed_precisions(likelihood: Likelihood) -> FixedPrecisions:
    at_data = None if likelihood.kappa is None else likelihood.kappa[0]
    return FixedPrecisions(likelihood.settings.fixed_sigma, at_data)


def _ascend(
    vae: AutoEncoder,
    samples: Samples,
    precisions: Callable[[Tensor], Precisions],
    steps: int,
    stage: str,
    likelihood: Likelihood,
    progress: Progress | None,
) -> None:
    """Climb the weighted evidence lower bound over every parameter the model has now."""
    settings = likelihood.settings
    variance = prior_variance(settings)

    def loss(step: int) -> Tensor:
        batch = samples.take(torch.randint(len(samples.coordinates), (settings.batch,)))
        latent, mean, log_variance = vae.sample(batch.coordinates, batch.directions, batch.fractions)
        divergence = divergence_from_normal(mean, log_variance, batch.prior_means, variance)
        density = likelihood.bound_log_density(vae, batch, vae.decoder.means(latent), precisions(latent))
        warm = min(1.0, step / max(1.0, settings.kl_warm_up * steps))
        return (warm * settings.kl_weight * divergence - density).mean()

    gently = settings.progress_numbers > 0
    descend(loss, vae.parameters(), steps, settings.learning_rate, stage, progress, gently=gently)


def _fit_jointly(vae: AutoEncoder, samples: Samples, likelihood: Likelihood, progress: Progress | None) -> None:
    steps = likelihood.settings.steps
    first = max(1, steps // 2)
    _ascend(vae, samples, _fixed_precisions(likelihood), first, "codes settle", likelihood, progress)
    networks = _basis_networks(vae, samples, likelihood)
    for network in networks:
        # They begin as the codes have settled under: a jump of the likelihood would throw them about.
        codes, _ = vae.encoder(samples.coordinates, samples.directions, samples.fractions)
        network.start_level(vae.decoder.seen(codes))
    _install(vae, networks, likelihood)
    _ascend(vae, samples, vae.decoder.precisions, steps - first, "joint", likelihood, progress)


def _basis_networks(vae: AutoEncoder, samples: Samples, likelihood: Likelihood) -> list[RadialBasisNetwork]:
    """Networks for 1 / sigma, and kappa if there is one, with kernels on the present codes, in their precision."""
    settings, like = likelihood.settings, {"dtype": samples.coordinates.dtype}
    some = samples.take(drawn_rows(len(samples.coordinates), 1))
    with torch.no_grad():
        codes = vae.encoder(some.coordinates, some.directions, some.fractions)[0]
        codes = vae.decoder.seen(codes).double().numpy()
    centres = place_centres(codes, settings.kernels, settings.seed)
    centre = torch.tensor(centres, **like)
    rate = torch.tensor(kernel_rate(centres, codes, settings.bandwidth_factor), **like)
    of_sigma = SymmetricBasisNetwork if likelihood.full_covariance else RadialBasisNetwork
    # Of each network its outputs, and their values at the data and far from it.
    wanted = [(of_sigma, samples.coordinates.shape[1], 1.0 / settings.fixed_sigma, 1.0 / settings.far_sigma)]
    if likelihood.kappa is not None:
        wanted.append((RadialBasisNetwork, likelihood.concentrations, *likelihood.kappa))
    if settings.progress_numbers:
        wanted.append((RadialBasisNetwork, 1, 1.0 / PROGRESS_SIGMA, 1.0))
    return [
        network(centre, rate, torch.full((outputs,), far, **like), torch.full((outputs,), at_data, **like))
        for network, outputs, at_data, far in wanted
    ]


def _install(vae: AutoEncoder, networks: list[RadialBasisNetwork], likelihood: Likelihood) -> None:
    """Give the decoder its networks: of `_basis_networks`, in their order."""
    sigma, *others = networks
    kappa = others.pop(0) if likelihood.kappa is not None else None
    vae.decoder.set_precisions(sigma, kappa, *others)


def _fit_precisions(vae: AutoEncoder, samples: Samples, likelihood: Likelihood, progress: Progress | None) -> None:
    """Maximum likelihood of sigma and kappa with the means frozen and z ~ q(z | x, q) drawn once."""
    settings, decoder = likelihood.settings, vae.decoder
    networks = _basis_networks(vae, samples, likelihood)
    _install(vae, networks, likelihood)
    drawn = samples.take(drawn_rows(len(samples.coordinates), settings.precision_samples))
    with torch.no_grad():
        latent, _, _ = vae.sample(drawn.coordinates, drawn.directions, drawn.fractions)
        means = decoder.means(latent)
        activations = decoder.activations(latent)

    def negative_log_likelihood() -> Tensor:
        return -likelihood.log_density(vae, drawn, means, decoder.combined_precisions(activations)).mean()

    stage = "sigma" if likelihood.kappa is None else "sigma and kappa"
    parameters = [parameter for network in networks for parameter in network.parameters()]
    minimise(negative_log_likelihood, parameters, settings.precision_iterations, stage, progress)
