"""The likelihood of training samples, by output space: poses of a tool, or configurations seen at an arm's body."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from geodesic_motion_ros.learning.autoencoder import AutoEncoder, Means, Precisions
from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.learning.densities import wrapped_log_density
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.robot.body_points import BodyPoints, points_along_links
from geodesic_motion_ros.robot.kinematics import Robot

#: How far beside the tool points are watched while learning [m]: a turn by a radian counts so much.
TOOL_AXES = 0.1
#: Progress is no more exact than this: how far along two people are at the same place of a task is not.
PROGRESS_RESOLUTION = 0.005


class Samples(NamedTuple):
    """Training samples.

    Attributes
    ----------
    coordinates : (n, p) positions [m] or configurations [rad].
    directions : (n, o) unit quaternions; None of configurations.
    points : (n, K, 3) of the body [m]; None of poses.
    prior_means : (n, d) of their latent points.
    fractions : (n,) of the arc at which they lie.
    """

    coordinates: Tensor
    directions: Tensor | None
    points: Tensor | None
    prior_means: Tensor
    fractions: Tensor

    def take(self, index: Tensor) -> Samples:
        """Choose samples by their index."""
        return Samples(*(None if values is None else values[index] for values in self))

    def double(self) -> Samples:
        """Convert to float64."""
        return Samples(*(None if values is None else values.double() for values in self))


class PoseLikelihood:
    """The likelihood of poses, positions and quaternions weighted.

    Attributes
    ----------
    kappa : concentration of quaternions at the data, and far from it.
    full_covariance, concentrations : whether that of positions is full, and how many concentrations an orientation has.
    sign_blind : whether q and -q are the same observation. Of canonical curves they are not: their signs agree, and a
        density that does not care lets the decoder change its sign within the sheet, where the sheet would fall apart.
    """

    def __init__(self, settings: TrainingSettings) -> None:
        self.settings = settings
        self.sign_blind = settings.sheet == "raw" and settings.orientation_model == "sign_blind"
        self.kappa: tuple[float, float] | None = (settings.fixed_kappa, settings.far_kappa)
        self.full_covariance = settings.position_density == "full"
        self.concentrations = 3 if settings.orientation_density == "angular_central_gaussian" else 1

    def points(self, coordinates: np.ndarray) -> Tensor | None:
        """Return None: a pose places no body."""
        return None

    def log_density(self, vae: AutoEncoder, samples: Samples, means: Means, precisions: Precisions) -> Tensor:
        """Compute beta1 log p(x | z) + beta2 log p(q | z), (n,), in expectation over errors of the recording's
        resolution.
        """
        settings = self.settings
        position = _resolved_log_density(vae, samples, means, precisions, settings.position_resolution)
        # A rotation by an angle moves its quaternion by half of it.
        error = 0.5 * settings.angular_resolution
        orientation = vae.direction_log_density(samples.directions, means, precisions, error)
        weighted = settings.position_weight * position + settings.orientation_weight * orientation
        return weighted + _resolved_progress(vae, samples, means, precisions)

    #: The means are learned by the same.
    bound_log_density = log_density


class ConfigurationLikelihood:
    """The likelihood of configurations, and of the points of the body that they place. They have no kappa.

    A wrapped density is the same for joints and means that whole turns separate. Where no residual is near half a turn
    it is the Gaussian one: of arms whose joints have limits within a turn, and of recordings whose turns were counted
    (`demonstrations.turns`). The metric knows no turns in either case.
    """

    full_covariance, concentrations = False, 0

    def __init__(self, settings: JointTrainingSettings, robot: Robot) -> None:
        self.settings, self.body = settings, body_layer(robot, settings.metric)
        self.sign_blind = False
        self.kappa: tuple[float, float] | None = None

    def points(self, coordinates: np.ndarray) -> Tensor | None:
        """Place the body's points (n, K, 3) [m] at configurations (n, eta) [rad]."""
        return self.body.points(torch.tensor(coordinates))

    def log_density(self, vae: AutoEncoder, samples: Samples, means: Means, precisions: Precisions) -> Tensor:
        """Compute log p(theta | z) (n,), in expectation over errors of the recording's resolution."""
        wrapped = self.settings.joint_density == "wrapped"
        joints = _resolved_log_density(vae, samples, means, precisions, self.settings.joint_resolution, wrapped)
        return joints + _resolved_progress(vae, samples, means, precisions)

    def bound_log_density(self, vae: AutoEncoder, samples: Samples, means: Means, precisions: Precisions) -> Tensor:
        """Compute what the means are learned by, (n,): the body's points and its volume count as well."""
        likelihood = self.log_density(vae, samples, means, precisions)
        if self.settings.body_sigma > 0.0:
            off = (self.body.points(means.coordinates) - samples.points) / self.settings.body_sigma
            likelihood = likelihood - 0.5 * (off**2).sum(-1).mean(-1)
        if self.settings.volume_weight > 0.0:
            volume = counted_log_volume(self.body, means.coordinates, samples.coordinates)
            likelihood = likelihood - self.settings.volume_weight * volume
        return likelihood


Likelihood = PoseLikelihood | ConfigurationLikelihood


def body_layer(robot: Robot, metric: JointMetricSettings) -> BodyLayer:
    """Make the layer of the metric's body points and the tool's orientation; where the metric does not know how the
    tool is turned, three points beside it tell.
    """
    if metric.orientation_weight > 0.0:
        return BodyLayer(robot, metric.body_points(robot), metric.orientation_weight)
    beside = {robot.tool_link: (TOOL_AXES * np.eye(3)).tolist()}
    return BodyLayer(robot, BodyPoints.of(robot, points_along_links(robot, metric.point_spacing) | beside))


def counted_log_volume(body: BodyLayer, means: Tensor, shown: Tensor) -> Tensor:
    """Compute log V (B,) of means (B, eta) [rad], each no less than that of the configuration (B, eta) it stands for.

    The gain of singular postures has nearly no end, and would lead means there from anywhere.
    """
    return torch.maximum(body.log_volume(means), body.log_volume(shown))


def _resolved_log_density(
    vae: AutoEncoder,
    samples: Samples,
    means: Means,
    precisions: Precisions,
    resolution: float,
    wrapped: bool = False,
) -> Tensor:
    """log p(x | z) (n,), in expectation over errors of the recording's resolution [m] or [rad]."""
    inverse_sigma = precisions.inverse_sigma.expand_as(samples.coordinates)
    if wrapped:
        density = wrapped_log_density(samples.coordinates, means.coordinates, inverse_sigma)
    else:
        density = vae.coordinate_log_density(samples.coordinates, means, precisions)
    squares = (inverse_sigma**2).sum(-1)
    if precisions.below is not None:
        squares = squares + 2.0 * (precisions.below**2).sum(-1)
    return density - 0.5 * resolution**2 * squares


def _resolved_progress(vae: AutoEncoder, samples: Samples, means: Means, precisions: Precisions) -> Tensor | float:
    """log p(s | z) (n,), in expectation over errors of PROGRESS_RESOLUTION; 0 of a model that decodes no progress."""
    if means.progress is None:
        return 0.0
    density = vae.progress_log_density(samples.fractions, means, precisions)
    return density - 0.5 * (PROGRESS_RESOLUTION * precisions.progress) ** 2
